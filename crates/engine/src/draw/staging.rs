//! The landing of both renderers: a ring of runs that go from the render thread to the loaders,
//! come back filled, and go round again (`kanzok2015`, section 3.2.1, item 6: the map and the unmap
//! queue). Runs are plain memory for the CPU, mapped upload memory for a GPU. Both queues have room
//! for all runs, so that returning a run never waits.

use crossbeam_channel::{Receiver, Sender, bounded};
use esker_render::gpu::UploadRun;
pub use esker_render::gpu::memory::upload::RUN_BYTES;
use esker_stream::{Landing, Run, Transfer};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

/// A run that came back, with the transfers to copy from it, in their order.
pub type Landed<R> = (R, Vec<Transfer>);

/// The ring of runs.
pub struct Staging<R> {
    /// Free runs, each with the transfers that were last copied from it. The loader that gets the
    /// run next drops the list: freeing memory that another thread has allocated can wait for that
    /// thread, and the render thread must not wait.
    free: (Sender<Landed<R>>, Receiver<Landed<R>>),
    landed: (Sender<Landed<R>>, Receiver<Landed<R>>),
    is_closed: AtomicBool,
}

/// A run of plain memory.
pub struct PlainRun(Box<[u8]>);

/// A run of mapped GPU memory.
pub struct GpuRun(pub UploadRun);

impl Run for PlainRun {
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T> {
        self.0.get_mut(range).map(write)
    }
}

impl Run for GpuRun {
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T> {
        self.0.fill(range, write)
    }
}

impl PlainRun {
    /// `count` runs.
    pub fn runs(count: usize) -> Vec<Self> {
        (0..count).map(|_| Self(vec![0; RUN_BYTES].into())).collect()
    }

    /// Bytes of a transfer; empty if it is not within the run.
    pub fn bytes(&self, transfer: &Transfer) -> &[u8] {
        let end = transfer.run_offset.checked_add(transfer.bytes);
        end.and_then(|end| self.0.get(transfer.run_offset..end)).unwrap_or_default()
    }
}

impl<R> Staging<R> {
    /// A ring of `runs`.
    pub fn new(runs: Vec<R>) -> Self {
        let count = runs.len().max(1);
        let ring = Self {
            free: bounded(count),
            landed: bounded(count),
            is_closed: AtomicBool::new(false),
        };
        runs.into_iter().for_each(|run| ring.free(run, Vec::new()));
        ring
    }

    /// Takes the run that came back first. Never waits.
    pub fn take(&self) -> Option<Landed<R>> {
        self.landed.1.try_recv().ok()
    }

    /// The runs that came back first, of at most `bytes_max` bytes, but one if there is any. Never
    /// waits.
    pub fn take_up_to(&self, bytes_max: usize) -> impl Iterator<Item = Landed<R>> {
        let runs = (bytes_max / RUN_BYTES).max(1);
        std::iter::from_fn(|| self.take()).take(runs)
    }

    /// Makes a run free for loaders; `spent` are the transfers that were copied from it.
    pub fn free(&self, run: R, spent: Vec<Transfer>) {
        // The queue has room for all runs.
        let _ = self.free.0.try_send((run, spent));
    }

    /// Stops lending runs.
    pub fn close(&self) {
        self.is_closed.store(true, Relaxed);
    }
}

impl<R: Run + 'static> Landing for Staging<R> {
    type Run = R;

    fn run_bytes(&self) -> usize {
        RUN_BYTES
    }

    fn lend(&self, patience: Duration) -> Option<R> {
        if self.is_closed.load(Relaxed) {
            return None;
        }
        self.free.1.recv_timeout(patience).ok().map(|(run, _)| run)
    }

    fn land(&self, run: R, transfers: Vec<Transfer>) {
        if transfers.is_empty() {
            self.free(run, transfers);
        } else {
            let _ = self.landed.0.try_send((run, transfers));
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
        let staging = Staging::new(PlainRun::runs(2));
        let mut first = staging.lend(Duration::ZERO).unwrap();
        let second = staging.lend(Duration::ZERO).unwrap();
        assert!(staging.lend(Duration::from_millis(1)).is_none(), "there are two");
        first.fill(64..67, |bytes| bytes.copy_from_slice(b"abc")).unwrap();
        assert_eq!(first.fill(RUN_BYTES - 1..RUN_BYTES + 1, |_| ()), None);
        staging.land(first, vec![transfer(64, 3)]);
        staging.land(second, Vec::new());
        let (run, transfers) = staging.take().unwrap();
        assert_eq!(run.bytes(&transfers[0]), b"abc");
        assert_eq!(run.bytes(&transfer(RUN_BYTES, 1)), b"");
        assert_eq!(run.bytes(&transfer(usize::MAX, 2)), b"");
        assert!(staging.take().is_none(), "a run that nothing was written to is free at once");
        staging.free(run, transfers);
        let again = [staging.lend(Duration::ZERO), staging.lend(Duration::ZERO)];
        assert!(again.iter().all(Option::is_some));
    }

    #[test]
    fn a_closed_ring_lends_nothing() {
        let staging = Staging::new(PlainRun::runs(1));
        staging.close();
        assert!(staging.lend(Duration::from_secs(60)).is_none());
    }
}
