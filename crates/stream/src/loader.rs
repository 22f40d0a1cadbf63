//! A loader thread (kanzok2015, section 3.2.3): takes the best batch, borrows a run, tests again
//! whether the batch is in view, reads it and lands it. A loader waits only for the queue and for
//! runs, and stops either wait at once when streaming stops.

use crate::batch::Batch;
use crate::identity::Identity;
use crate::landing::Landing;
use crate::planes::{LoadRequest, Planes, VisibilityTest};
use crate::queue::Queue;
use crate::rate::Rate;
use crate::reading::{Outcome, Reading};
use crate::shared::Shared;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TryRecvError};
use esker_lod::{OrientedBox, Visible};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// Longest wait for a run before a loader tests whether streaming has stopped.
const PATIENCE: Duration = Duration::from_millis(20);

/// Number of batches in the queue below which a loader wakes the LOD thread to fill it.
pub(crate) const QUEUE_LOW: usize = 4;

/// Message of a loader to the LOD thread. Each request that is not landed is reported once.
#[derive(Debug)]
pub(crate) enum Report {
    /// Requests that were out of view when a loader took them, or that only made more of a tree
    /// known.
    Dropped(Vec<u64>),
    /// Requests that could not be read, and the reason.
    Failed {
        requests: Vec<u64>,
        /// Message to the user.
        fault: String,
        /// Whether the file has changed, so that reading again does not help.
        is_final: bool,
    },
    /// The file has changed since it was opened.
    Changed(String),
}

/// One loader thread.
pub(crate) struct Loader<L: Landing> {
    pub(crate) landing: Arc<L>,
    pub(crate) shared: Arc<Shared>,
    pub(crate) identity: Arc<Identity>,
    pub(crate) queue: Arc<Queue<Batch>>,
    /// Limit on the rate of reading, if there is one.
    pub(crate) rate: Option<Arc<Rate>>,
    pub(crate) reports: Sender<Report>,
    pub(crate) wake: Sender<()>,
    /// Nothing is ever sent: the channel closes when streaming stops.
    pub(crate) stop: Receiver<Infallible>,
}

impl<L: Landing> Loader<L> {
    /// Loads until streaming stops.
    pub(crate) fn run(self) {
        while let Some(mut batch) = self.take() {
            // A loader borrows a run only after it has a batch: idle loaders that hold all runs
            // would block a batch that needs a second one.
            let Some(run) = self.lend() else { return };
            self.drop_unseen(&mut batch);
            self.complete_links(&mut batch);
            let Some(LoadRequest { forest, filter, .. }) = batch.first().cloned() else {
                self.landing.land(run, Vec::new());
                continue;
            };
            if let Some(fault) = self.identity.fault_if_due() {
                self.report(Report::Changed(fault));
            }
            let lend = || self.lend();
            let planes = Planes::read_by(forest, filter);
            if !self.waits_for_rate(&batch, &planes) {
                return;
            }
            let reading = Reading { planes: &planes, landing: &*self.landing, lend: &lend };
            let Some(outcome) = reading.read(&batch, run) else { return };
            self.account(outcome);
        }
    }

    /// Waits for a batch; `None` once streaming stops.
    fn take(&self) -> Option<Batch> {
        let batch = self.queue.take()?;
        self.shared.counts.waiting.fetch_sub(batch.len(), Relaxed);
        if self.queue.len() < QUEUE_LOW {
            // A full channel means that the LOD thread is woken already.
            let _ = self.wake.try_send(());
        }
        Some(batch)
    }

    /// Waits until the limit on the rate of reading lets a batch be read; false once streaming
    /// stops.
    fn waits_for_rate(&self, batch: &Batch, planes: &Planes) -> bool {
        let Some(rate) = &self.rate else { return true };
        let bytes_of = |request: &LoadRequest| -> u64 {
            request.planes.iter().map(|&(kind, _)| planes.bytes(request.node, kind)).sum()
        };
        let wait = rate.take(batch.iter().map(bytes_of).sum(), Instant::now());
        self.stop.recv_timeout(wait) == Err(RecvTimeoutError::Timeout)
    }

    /// Waits for a run; `None` once streaming stops.
    fn lend(&self) -> Option<L::Run> {
        loop {
            if self.stop.try_recv() == Err(TryRecvError::Disconnected) {
                return None;
            }
            let began = Instant::now();
            if let Some(run) = self.landing.lend(PATIENCE) {
                return Some(run);
            }
            // A closed landing returns at once.
            let _ = self.stop.recv_timeout(PATIENCE.saturating_sub(began.elapsed()));
        }
    }

    /// Removes requests that have left the view since they were made.
    fn drop_unseen(&self, batch: &mut Batch) {
        let Some(visible) = self.shared.visible.load_full() else { return };
        let unseen = batch.extract_if(.., |r| !is_seen(r, &visible));
        let dropped: Vec<u64> = unseen.map(|r| r.id).collect();
        if !dropped.is_empty() {
            self.shared.counts.dropped.fetch_add(dropped.len() as u64, Relaxed);
            self.report(Report::Dropped(dropped));
        }
    }

    /// Makes what is below nodes that stand for more of their tree, and removes their requests.
    fn complete_links(&self, batch: &mut Batch) {
        for request in batch.extract_if(.., |r| r.planes.is_empty()) {
            self.report(match request.forest.complete(&[request.node]) {
                Ok(()) => Report::Dropped(vec![request.id]),
                Err(error) => {
                    let (requests, fault) = (vec![request.id], error.to_string());
                    Report::Failed { requests, fault, is_final: false }
                }
            });
        }
    }

    fn account(&self, outcome: Outcome) {
        let counts = &self.shared.counts;
        counts.read_bytes.fetch_add(outcome.read_bytes, Relaxed);
        counts.useful_bytes.fetch_add(outcome.useful_bytes, Relaxed);
        counts.reads.fetch_add(outcome.reads, Relaxed);
        if !outcome.failed.is_empty() {
            // A truncated or changed file explains a failed read better than the read's own error.
            let changed = self.identity.fault();
            let is_final = changed.is_some();
            let fault = changed.or(outcome.fault).unwrap_or_default();
            self.report(Report::Failed { requests: outcome.failed, fault, is_final });
        }
    }

    fn report(&self, report: Report) {
        // The channel has room for one report a request. If the caller of `uploaded` invented
        // requests, it is better to lose a report than to wait.
        let _ = self.reports.try_send(report);
    }
}

/// Whether the part of a node for which a request was made may still be in view.
fn is_seen(request: &LoadRequest, visible: &Visible) -> bool {
    let LoadRequest { node, forest, test, .. } = request;
    let (node, lattice) = (forest.record(*node), forest.metric());
    match test {
        VisibilityTest::Always => true,
        VisibilityTest::Contour => visible.may_show(&OrientedBox::of_contour(node, lattice)),
        VisibilityTest::Cell => visible.may_show(&OrientedBox::of_cell(&node.cell(), lattice)),
    }
}
