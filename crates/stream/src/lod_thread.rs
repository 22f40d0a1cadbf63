//! The LOD thread: waits for something to happen, takes it in, makes a pass. It alone owns cache, slots
//! and requests; all others tell it what they did by channels and mailboxes. Sleeps while nothing
//! happens, and between passes leaves the core to others.

use crate::choose::Chooser;
use crate::loader::{QUEUE_LOW, Report};
use crate::options::Needs;
use crate::status::Status;
use crossbeam_channel::{Receiver, Select, TryRecvError};
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// Between two passes while only loading goes on: what arrives is drawn a few milliseconds later, and
/// a pass is not made for each node.
const PAUSE: Duration = Duration::from_millis(5);

/// Passes that follow one another without a cause from outside: what is drawn hides more, and what is
/// hidden is not drawn; this ends where nothing changes, or here.
const FOLLOWING_MAX: u32 = 3;

/// Its ends of the channels, and what it owns.
pub(crate) struct LodThread {
    pub(crate) chooser: Chooser,
    pub(crate) wake: Receiver<()>,
    pub(crate) uploaded: Receiver<u64>,
    pub(crate) reports: Receiver<Report>,
    /// Nothing is ever sent: it closes when streaming stops.
    pub(crate) stop: Receiver<Infallible>,
    pub(crate) status: Status,
    /// How much had been told before mailboxes were looked into last.
    pub(crate) told: u64,
    /// Whether feedback from where the view is has been used since what is drawn changed.
    pub(crate) is_fed: bool,
}

/// Why a pass is made, the most urgent last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Cause {
    None,
    Following,
    Loading,
    /// All that was asked for has come: waiting brings nothing more.
    Loaded,
    Looking,
}

/// The last pass.
#[derive(Clone, Copy, Debug)]
struct Past {
    ended: Instant,
    took: Duration,
}

impl Past {
    /// When it began: nodes that were to be tried again by then were asked for in it.
    fn began(&self) -> Instant {
        self.ended - self.took
    }

    /// When the next pass may begin: at most half of a core is spent on looking around, a third while
    /// loading goes on.
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
        let (mut cause, mut following) = (Cause::Loading, 0);
        let mut past = Past { ended: Instant::now(), took: Duration::ZERO };
        loop {
            cause = cause.max(self.take_in());
            if cause > Cause::Following {
                following = 0;
            }
            let due = match cause {
                Cause::None => self.chooser.retries.next_due(past.began()),
                _ => Some(past.rested(cause)),
            };
            let began = Instant::now();
            if due.is_none_or(|due| due > began) {
                self.publish_status();
                if cause == Cause::None {
                    self.chooser.shared.taken_in.store(self.told, SeqCst);
                }
                if !self.wait(due) {
                    break;
                }
                continue;
            }
            let follows = self.chooser.pass(following < FOLLOWING_MAX);
            past = Past { ended: Instant::now(), took: began.elapsed() };
            self.status.passes += 1;
            self.status.lod_ms.add(past.took.as_secs_f64() * 1000.0);
            following += 1;
            cause = if follows { Cause::Following } else { Cause::None };
            self.is_fed &= !follows;
            self.chooser.shared.taken_in.store(self.told, SeqCst);
        }
        self.chooser.take_back();
    }

    /// Waits until something happens or it is `due`; false once streaming stops.
    fn wait(&self, due: Option<Instant>) -> bool {
        let mut select = Select::new();
        select.recv(&self.stop);
        select.recv(&self.wake);
        select.recv(&self.uploaded);
        select.recv(&self.reports);
        // Which one is ready does not matter: `take_in` looks at all.
        match due {
            Some(due) => drop(select.ready_deadline(due)),
            None => drop(select.ready()),
        }
        self.stop.try_recv() != Err(TryRecvError::Disconnected)
    }

    /// Takes in all that has happened.
    fn take_in(&mut self) -> Cause {
        while self.wake.try_recv().is_ok() {}
        let mut cause = self.take_views();
        while let Ok(id) = self.uploaded.try_recv() {
            self.status.nodes_loaded += u64::from(self.chooser.arrive(id));
            let is_last = self.chooser.asked.is_empty();
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

    fn take_views(&mut self) -> Cause {
        let chooser = &mut self.chooser;
        let shared = Arc::clone(&chooser.shared);
        let mut cause = Cause::None;
        self.told = shared.told.load(SeqCst);
        if let Some(needs) = shared.needs.take().filter(|n| **n != chooser.needs) {
            match chooser.check_roots(&needs) {
                Ok(()) => {
                    chooser.needs = Needs::clone(&needs);
                    cause = Cause::Looking;
                }
                Err(error) => self.status.fault = Some(error.to_string()),
            }
        }
        if let Some(view) = shared.view.take().filter(|v| chooser.view != Some(**v)) {
            chooser.look(*view);
            cause = Cause::Looking;
        }
        if let Some(feedback) = shared.feedback.take() {
            if !self.is_fed {
                cause = cause.max(Cause::Following);
            }
            // What a frame before the view's hides is soon told better.
            self.is_fed |= chooser.view.is_none_or(|view| feedback.is_from(&view));
            chooser.feedback = Some(feedback);
        }
        cause
    }

    fn take_report(&mut self, report: Report) -> Cause {
        match report {
            Report::Dropped(requests) => {
                for id in requests {
                    self.chooser.give_up(id);
                }
            }
            Report::Failed(requests, fault) => {
                self.status.reads_failed += requests.len() as u64;
                self.status.fault = Some(fault);
                let now = Instant::now();
                for id in requests {
                    if let Some(node) = self.chooser.give_up(id) {
                        self.chooser.retries.fail(node, now);
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

    fn publish_status(&mut self) {
        let cache = &self.chooser.cache;
        self.status.drawing_bytes = cache.pool().used();
        self.status.drawing_bytes_peak = cache.pool().peak();
        self.status.nodes_resident = cache.resident_nodes();
        self.status.nodes_evicted = cache.evicted();
        self.status.nodes_failed = self.chooser.retries.given_up();
        // How many of them wait is known to the queue.
        self.status.requests_in_flight = self.chooser.asked.len();
        self.chooser.shared.status.store(Arc::new(self.status.clone()));
    }
}
