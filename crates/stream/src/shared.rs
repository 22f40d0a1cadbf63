//! What the threads of a streamer share: the front cut, the mailboxes, and counters. Nothing in it is
//! ever waited for.
//!
//! # Why slots can be given away without asking the render thread
//!
//! A slot that some cut draws from is given to another node only after a newer cut without it has been
//! published; only then is a loader asked to fill it. The render thread, each frame, **first** drains
//! landed runs, **then** takes the front cut, **then** uploads, **then** draws. So when it finds bytes
//! for a slot, the cut that it takes next is at least as new as the one for which the slot was given
//! away: what is uploaded never lies under anything drawn. Requests that a loader has taken keep their
//! slots until they are uploaded, or reported as dropped or failed, which happens after their runs have
//! been landed; runs are uploaded in that order, so a slot's later owner writes last.
//!
//! `handover.rs` checks this order in all interleavings, and that other orders fail. There is no `unsafe`
//! in this crate, so that no data race can be; what it checks is the protocol.

use crate::cut::Cut;
use crate::mailbox::Mailbox;
use crate::options::Needs;
use crate::status::Status;
use arc_swap::{ArcSwap, ArcSwapOption};
use esker_lod::{DepthFeedback, View, Visible};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

/// Shared by all threads of one streamer.
#[derive(Debug)]
pub(crate) struct Shared {
    /// What is drawn (kanzok2015, section 3.2.1, item 2: the list that is read from).
    pub(crate) front: ArcSwap<Cut>,
    /// Where to look from.
    pub(crate) view: Mailbox<View>,
    /// Which planes to draw.
    pub(crate) needs: Mailbox<Needs>,
    /// What the last finished frame hides.
    pub(crate) feedback: Mailbox<DepthFeedback>,
    /// How often needs or feedback were told.
    pub(crate) told: AtomicU64,
    /// Which of these times the LOD thread has taken in, and made a pass for where one was due.
    pub(crate) taken_in: AtomicU64,
    /// What the newest view can show: its frustum. What it hides is known only after the next choice,
    /// which replaces the queue.
    pub(crate) visible: ArcSwapOption<Visible>,
    /// What the LOD thread knows.
    pub(crate) status: ArcSwap<Status>,
    /// What the loaders do.
    pub(crate) counts: Counts,
}

/// Counters that loaders write.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    /// Requests in the queue.
    pub(crate) waiting: AtomicUsize,
    pub(crate) read_bytes: AtomicU64,
    pub(crate) useful_bytes: AtomicU64,
    pub(crate) reads: AtomicU64,
    pub(crate) dropped: AtomicU64,
}

impl Shared {
    pub(crate) fn new(needs: &Needs) -> Self {
        Self {
            front: ArcSwap::from_pointee(Cut::empty(needs.clone())),
            view: Mailbox::default(),
            needs: Mailbox::default(),
            feedback: Mailbox::default(),
            told: AtomicU64::new(0),
            taken_in: AtomicU64::new(0),
            visible: ArcSwapOption::empty(),
            status: ArcSwap::from_pointee(Status::default()),
            counts: Counts::default(),
        }
    }

    /// A snapshot of it all.
    pub(crate) fn status(&self) -> Status {
        let mut status = Status::clone(&self.status.load());
        let counts = &self.counts;
        let under_way = status.requests_waiting + status.requests_in_flight;
        status.requests_waiting = counts.waiting.load(Relaxed).min(under_way);
        status.requests_in_flight = under_way - status.requests_waiting;
        status.read_bytes = counts.read_bytes.load(Relaxed);
        status.useful_bytes = counts.useful_bytes.load(Relaxed);
        status.reads = counts.reads.load(Relaxed);
        status.requests_dropped = counts.dropped.load(Relaxed);
        status
    }
}
