//! The LOD thread: waits for an event, takes in all that has happened, and makes a pass. This
//! thread alone owns the cache, the slots and the requests; the other threads report to it by
//! channels and mailboxes. It sleeps while nothing happens and rests between passes.

use crate::choose::Chooser;
use crate::loader::{QUEUE_LOW, Report};
use crate::status::Status;
use crossbeam_channel::{Receiver, Select, TryRecvError};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// Pause between two passes while loading goes on: an arriving node is drawn a few milliseconds
/// later, and there is not a pass for each node.
const PAUSE: Duration = Duration::from_millis(5);

/// Greatest number of passes in a row without an outside cause. A new cut hides other nodes, which
/// changes the next cut; the passes end when the cut stays the same, or at this number.
const FOLLOW_UPS_MAX: u32 = 3;

/// The thread's state and its ends of the channels.
pub(crate) struct LodThread {
    pub(crate) chooser: Chooser,
    pub(crate) wake: Receiver<()>,
    pub(crate) uploaded: Receiver<u64>,
    pub(crate) reports: Receiver<Report>,
    /// Nothing is ever sent: the channel closes when streaming stops.
    pub(crate) stop: Receiver<Infallible>,
    pub(crate) status: Status,
    /// Value of `Shared::inputs` before the mailboxes were last read.
    pub(crate) inputs: u64,
    /// Whether feedback from the current view has been used since the drawn nodes changed.
    pub(crate) is_fed: bool,
}

/// Reason for a pass, in ascending urgency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Cause {
    None,
    /// The last pass changed what is hidden.
    FollowUp,
    /// Requests arrived or failed, and more are in progress.
    Loading,
    /// All requests have arrived: waiting brings no more.
    Loaded,
    /// The view, what is shown, the budgets or the surroundings changed.
    NewView,
}

/// Times of the last pass.
#[derive(Clone, Copy, Debug)]
struct LastPass {
    ended: Instant,
    took: Duration,
}

impl LastPass {
    /// When the pass began: it has requested the nodes whose retry was due by then.
    fn began(&self) -> Instant {
        self.ended - self.took
    }

    /// When the next pass may begin: passes take at most half of a core, and a third while loading
    /// goes on.
    fn rested(&self, cause: Cause) -> Instant {
        match cause {
            Cause::Loading => self.ended + PAUSE.max(self.took * 2),
            _ => self.ended + self.took,
        }
    }
}

impl LodThread {
    /// Runs until streaming stops.
    pub(crate) fn run(mut self) {
        let (mut cause, mut follow_ups) = (Cause::Loading, 0);
        let mut last = LastPass { ended: Instant::now(), took: Duration::ZERO };
        loop {
            cause = cause.max(self.take_in());
            if cause > Cause::FollowUp {
                follow_ups = 0;
            }
            let due = match cause {
                Cause::None => self.chooser.retries.next_due(last.began()),
                _ => Some(last.rested(cause)),
            };
            let began = Instant::now();
            if due.is_none_or(|due| due > began) {
                self.publish_status();
                if cause == Cause::None {
                    self.chooser.shared.inputs_used.store(self.inputs, SeqCst);
                }
                if !self.wait(due) {
                    break;
                }
                continue;
            }
            let follows = self.chooser.pass(follow_ups < FOLLOW_UPS_MAX);
            last = LastPass { ended: Instant::now(), took: began.elapsed() };
            self.status.passes += 1;
            self.status.lod_ms.add(last.took.as_secs_f64() * 1000.0);
            follow_ups += 1;
            cause = if follows { Cause::FollowUp } else { Cause::None };
            self.is_fed &= !follows;
            self.chooser.shared.inputs_used.store(self.inputs, SeqCst);
        }
        self.chooser.take_back();
    }

    /// Waits for an event, or until `due`. Returns false once streaming stops.
    fn wait(&self, due: Option<Instant>) -> bool {
        let mut select = Select::new();
        select.recv(&self.stop);
        select.recv(&self.wake);
        select.recv(&self.uploaded);
        select.recv(&self.reports);
        // It does not matter which channel is ready: `take_in` reads all of them.
        match due {
            Some(due) => drop(select.ready_deadline(due)),
            None => drop(select.ready()),
        }
        self.stop.try_recv() != Err(TryRecvError::Disconnected)
    }

    /// Reads all channels and mailboxes. Returns the most urgent cause for a pass.
    fn take_in(&mut self) -> Cause {
        while self.wake.try_recv().is_ok() {}
        let mut cause = self.take_mail();
        while let Ok(id) = self.uploaded.try_recv() {
            self.status.nodes_loaded += u64::from(self.chooser.arrive(id));
            let is_last = self.chooser.requests.is_empty();
            cause = cause.max(if is_last { Cause::Loaded } else { Cause::Loading });
        }
        while let Ok(report) = self.reports.try_recv() {
            cause = cause.max(self.take_report(report));
        }
        if self.chooser.has_more && self.chooser.queue.len() < QUEUE_LOW {
            cause = cause.max(Cause::Loading);
        }
        cause
    }

    /// Reads the mailboxes.
    fn take_mail(&mut self) -> Cause {
        let chooser = &mut self.chooser;
        let shared = Arc::clone(&chooser.shared);
        let mut cause = Cause::None;
        self.inputs = shared.inputs.load(SeqCst);
        let limited = shared.limits.take().map(|limits| chooser.limit(&limits));
        let shown = shared.shown.take().map(|shown| chooser.show(Arc::clone(&shown)));
        for changed in limited.into_iter().chain(shown) {
            match changed {
                Ok(()) => cause = Cause::NewView,
                Err(error) => self.status.fault = Some(error.to_string()),
            }
        }
        if let Some(around) = shared.surroundings.take().filter(|a| **a != chooser.surroundings) {
            chooser.surroundings = *around;
            cause = Cause::NewView;
        }
        if let Some(view) = shared.view.take().filter(|v| chooser.view != Some(**v)) {
            chooser.look(*view);
            cause = Cause::NewView;
        }
        if let Some(feedback) = shared.feedback.take() {
            if !self.is_fed {
                cause = cause.max(Cause::FollowUp);
            }
            // Feedback from an earlier view is soon replaced by better feedback.
            self.is_fed |= chooser.view.is_none_or(|view| feedback.is_from(&view));
            chooser.feedback = Some(feedback);
        }
        cause
    }

    /// Takes a loader's report.
    fn take_report(&mut self, report: Report) -> Cause {
        match report {
            Report::Dropped(requests) => {
                for id in requests {
                    self.chooser.drop_request(id);
                }
            }
            Report::Failed { requests, fault, is_final } => {
                self.status.reads_failed += requests.len() as u64;
                self.status.fault = Some(fault);
                let now = Instant::now();
                for id in requests {
                    if let Some(node) = self.chooser.give_up(id) {
                        self.chooser.retries.fail(node, now, is_final);
                    }
                }
            }
            Report::Changed(fault) => {
                self.status.fault = Some(fault);
                return Cause::None;
            }
        }
        Cause::Loading
    }

    /// Publishes this thread's part of the status.
    fn publish_status(&mut self) {
        let cache = &self.chooser.cache;
        self.status.drawing_bytes = cache.pool().used();
        self.status.drawing_bytes_peak = cache.pool().peak();
        self.status.nodes_resident = cache.resident_nodes();
        self.status.nodes_evicted = cache.evicted();
        self.status.nodes_failed = self.chooser.retries.given_up();
        // The number of requests still in the queue is known to the loaders' counters.
        self.status.requests_in_flight = self.chooser.requests.len();
        self.chooser.shared.status.store(Arc::new(self.status.clone()));
    }
}
