//! A loader thread (kanzok2015, section 3.2.3): takes the best batch, gets a run, looks again whether it
//! is in view, reads it, lands it. It waits for runs and for the queue only, and stops from either at
//! once when streaming does.

use crate::batch::Batch;
use crate::identity::Identity;
use crate::landing::Landing;
use crate::planes::{Planes, Sight};
use crate::queue::Queue;
use crate::reading::{Outcome, Reading};
use crate::shared::Shared;
use crossbeam_channel::{Receiver, Sender, TryRecvError};
use esker_lod::{OrientedBox, Visible};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// How long a loader waits for a run before it looks whether it shall stop.
const PATIENCE: Duration = Duration::from_millis(20);

/// Batches in the queue below which the LOD thread is woken to fill it.
pub(crate) const QUEUE_LOW: usize = 4;

/// What loaders tell the LOD thread, of each request that is not landed once.
#[derive(Debug)]
pub(crate) enum Report {
    /// Out of view when their turn came.
    Dropped(Vec<u64>),
    /// Could not be read, and why.
    Failed(Vec<u64>, String),
    /// The file is not what it was.
    Changed(String),
}

/// One loader.
pub(crate) struct Loader<L: Landing> {
    pub(crate) planes: Planes,
    pub(crate) landing: Arc<L>,
    pub(crate) shared: Arc<Shared>,
    pub(crate) identity: Arc<Identity>,
    pub(crate) queue: Arc<Queue<Batch>>,
    pub(crate) reports: Sender<Report>,
    pub(crate) wake: Sender<()>,
    /// Nothing is ever sent: it closes when streaming stops.
    pub(crate) stop: Receiver<Infallible>,
}

impl<L: Landing> Loader<L> {
    /// Loads until streaming stops.
    pub(crate) fn run(self) {
        while let Some(mut batch) = self.take() {
            // No run is held without a batch to fill it: one that needs a second run would wait for ever.
            let Some(run) = self.lend() else { return };
            self.drop_unseen(&mut batch);
            if batch.is_empty() {
                self.landing.land(run, Vec::new());
                continue;
            }
            if let Some(fault) = self.identity.fault_if_due() {
                self.report(Report::Changed(fault));
            }
            let lend = || self.lend();
            let reading = Reading { planes: &self.planes, landing: &*self.landing, lend: &lend };
            let Some(outcome) = reading.read(&batch, run) else { return };
            self.account(outcome);
        }
    }

    /// Waits for a batch; `None` once streaming stops.
    fn take(&self) -> Option<Batch> {
        let batch = self.queue.take()?;
        self.shared.counts.waiting.fetch_sub(batch.len(), Relaxed);
        if self.queue.len() < QUEUE_LOW {
            // Full: the LOD thread is woken already.
            let _ = self.wake.try_send(());
        }
        Some(batch)
    }

    /// Waits for a run; `None` once streaming stops.
    fn lend(&self) -> Option<L::Run> {
        loop {
            if self.stop.try_recv() == Err(TryRecvError::Disconnected) {
                return None;
            }
            let asked = Instant::now();
            if let Some(run) = self.landing.lend(PATIENCE) {
                return Some(run);
            }
            // A closed landing answers at once.
            let _ = self.stop.recv_timeout(PATIENCE.saturating_sub(asked.elapsed()));
        }
    }

    /// Leaves out what has gone out of view since it was chosen.
    fn drop_unseen(&self, batch: &mut Batch) {
        let Some(visible) = self.shared.visible.load_full() else { return };
        let unseen = batch.extract_if(.., |r| !self.is_seen(r.node, r.sight, &visible));
        let dropped: Vec<u64> = unseen.map(|r| r.id).collect();
        if !dropped.is_empty() {
            self.shared.counts.dropped.fetch_add(dropped.len() as u64, Relaxed);
            self.report(Report::Dropped(dropped));
        }
    }

    fn is_seen(&self, node: u32, sight: Sight, visible: &Visible) -> bool {
        let (node, lattice) = (self.planes.node(node), self.planes.lattice());
        match sight {
            Sight::Always => true,
            Sight::Contour => visible.may_show(&OrientedBox::of_contour(node, lattice)),
            Sight::Cell => visible.may_show(&OrientedBox::of_cell(&node.cell(), lattice)),
        }
    }

    fn account(&self, outcome: Outcome) {
        let counts = &self.shared.counts;
        counts.read_bytes.fetch_add(outcome.read_bytes, Relaxed);
        counts.useful_bytes.fetch_add(outcome.useful_bytes, Relaxed);
        counts.reads.fetch_add(outcome.reads, Relaxed);
        if !outcome.failed.is_empty() {
            // A file that was cut short or changed explains more than the read that met it.
            let fault = self.identity.fault().or(outcome.fault).unwrap_or_default();
            self.report(Report::Failed(outcome.failed, fault));
        }
    }

    fn report(&self, report: Report) {
        // Has room, as each request is reported once; where the caller of `uploaded` made up requests
        // it is better to lose one than to wait.
        let _ = self.reports.try_send(report);
    }
}
