//! The CPU renderer's landing: a ring of runs of plain memory that goes from the render thread to the
//! loaders, filled back, and round again (kanzok2015, section 3.2.1, item 6: the map and the unmap
//! queue). Both queues hold as many runs as there are, so that giving back never waits.

use crossbeam_channel::{Receiver, Sender, bounded};
use esker_stream::{Landing, Run, Transfer};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

/// Bytes of a run: several neighbouring nodes' planes in one read.
pub const RUN_BYTES: usize = 1 << 20;

/// The ring.
pub struct Staging {
    free: (Sender<StagingRun>, Receiver<StagingRun>),
    landed: (Sender<Landed>, Receiver<Landed>),
    is_closed: AtomicBool,
}

/// A run of plain memory.
pub struct StagingRun {
    bytes: Box<[u8]>,
    /// What was last copied from it. Dropped by the loader that gets the run next: to free what another
    /// thread has allocated can mean waiting for that thread, which the render thread must not.
    spent: Vec<Transfer>,
}

/// A run that came back, and what of it goes where.
pub struct Landed {
    run: StagingRun,
    /// In the order in which they are to be copied.
    pub transfers: Vec<Transfer>,
}

impl Run for StagingRun {
    fn bytes(&mut self) -> &mut [u8] {
        &mut self.bytes
    }
}

impl Landed {
    /// The bytes of a transfer; none where it does not lie in the run.
    pub fn bytes(&self, transfer: &Transfer) -> &[u8] {
        let end = transfer.run_offset.checked_add(transfer.bytes);
        end.and_then(|end| self.run.bytes.get(transfer.run_offset..end)).unwrap_or_default()
    }
}

impl Staging {
    /// A ring of so many runs, at least one.
    pub fn new(runs: usize) -> Self {
        let runs = runs.max(1);
        let (free, landed) = (bounded(runs), bounded(runs));
        for _ in 0..runs {
            // There is room for all of them.
            let _ =
                free.0.try_send(StagingRun { bytes: vec![0; RUN_BYTES].into(), spent: Vec::new() });
        }
        Self { free, landed, is_closed: AtomicBool::new(false) }
    }

    /// The run that came back first. Never waits.
    pub fn take(&self) -> Option<Landed> {
        self.landed.1.try_recv().ok()
    }

    /// Makes the memory of a run that was copied free for loaders.
    pub fn free(&self, landed: Landed) {
        let run = StagingRun { spent: landed.transfers, ..landed.run };
        let _ = self.free.0.try_send(run);
    }

    /// Lends nothing any more.
    pub fn close(&self) {
        self.is_closed.store(true, Relaxed);
    }
}

impl Landing for Staging {
    type Run = StagingRun;

    fn run_bytes(&self) -> usize {
        RUN_BYTES
    }

    fn lend(&self, patience: Duration) -> Option<StagingRun> {
        if self.is_closed.load(Relaxed) {
            return None;
        }
        let mut run = self.free.1.recv_timeout(patience).ok()?;
        run.spent = Vec::new();
        Some(run)
    }

    fn land(&self, run: StagingRun, transfers: Vec<Transfer>) {
        if transfers.is_empty() {
            let _ = self.free.0.try_send(run);
        } else {
            let _ = self.landed.0.try_send(Landed { run, transfers });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_format::PlaneKind;
    use esker_stream::Slot;

    fn transfer(run_offset: usize, bytes: usize) -> Transfer {
        let slot = Slot { offset: 0, bytes: bytes as u64 };
        Transfer {
            node: 0,
            plane: PlaneKind::Position,
            run_offset,
            bytes,
            slot,
            slot_offset: 0,
            request: Some(1),
        }
    }

    #[test]
    fn runs_go_round_and_there_are_never_more() {
        let staging = Staging::new(2);
        let mut first = staging.lend(Duration::ZERO).unwrap();
        let second = staging.lend(Duration::ZERO).unwrap();
        assert!(staging.lend(Duration::from_millis(1)).is_none(), "there are two");
        first.bytes()[64..67].copy_from_slice(b"abc");
        staging.land(first, vec![transfer(64, 3)]);
        staging.land(second, Vec::new());
        let landed = staging.take().unwrap();
        assert_eq!(landed.bytes(&transfer(64, 3)), b"abc");
        assert_eq!(landed.bytes(&transfer(RUN_BYTES, 1)), b"");
        assert_eq!(landed.bytes(&transfer(usize::MAX, 2)), b"");
        assert!(staging.take().is_none(), "a run that nothing was written to is free at once");
        staging.free(landed);
        let again = [staging.lend(Duration::ZERO), staging.lend(Duration::ZERO)];
        assert!(again.iter().all(Option::is_some));
    }

    #[test]
    fn a_closed_ring_lends_nothing() {
        let staging = Staging::new(1);
        staging.close();
        assert!(staging.lend(Duration::from_secs(60)).is_none());
    }
}
