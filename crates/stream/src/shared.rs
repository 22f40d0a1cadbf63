//! State that the threads of a streamer share: the front cut, the mailboxes, and counters. No
//! access to it ever waits.
//!
//! # Why a slot can get a new owner without a lock
//!
//! The LOD thread gives a slot that some cut draws from to another node only after it has published
//! a newer cut without the old node; only then does it request the new node's bytes. In each frame
//! the render thread **first** drains landed runs, **then** takes the front cut, **then** uploads,
//! **then** draws. So when the render thread finds bytes for a slot, the cut that it takes next is
//! at least as new as the one for which the slot was given away: an upload never goes to a slot
//! that is being drawn. A request that a loader has taken keeps its slots until it is uploaded, or
//! until it is reported as dropped or failed, which happens after its runs have been landed. Runs
//! are uploaded in the order in which they landed, so the later owner of a slot writes last.
//!
//! `handover.rs` checks this order in all interleavings, and checks that other orders fail. Data
//! races are excluded since the crate has no `unsafe`; the model checks the protocol.

use crate::cut::Cut;
use crate::mailbox::Mailbox;
use crate::options::{Limits, Shown};
use crate::status::Status;
use arc_swap::{ArcSwap, ArcSwapOption};
use esker_format::Forest;
use esker_lod::{DepthFeedback, Surroundings, View, Visible};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

/// State shared by all threads of one streamer.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Cut that is drawn (kanzok2015, section 3.2.1, item 2: the list that is read from).
    pub(crate) front: ArcSwap<Cut>,
    /// Newest view.
    pub(crate) view: Mailbox<View>,
    /// Newest choice of what is shown.
    pub(crate) shown: Mailbox<Arc<Shown>>,
    /// Newest budgets.
    pub(crate) limits: Mailbox<Limits>,
    /// Depth of the last finished frame.
    pub(crate) feedback: Mailbox<DepthFeedback>,
    /// Newest choice of surroundings.
    pub(crate) surroundings: Mailbox<Option<Surroundings>>,
    /// Number of values other than views that the render thread has put into the mailboxes.
    pub(crate) inputs: AtomicU64,
    /// Number of these inputs that the LOD thread has used, in a pass if they required one.
    pub(crate) inputs_used: AtomicU64,
    /// Frustum of the newest view, for the loaders. What the view hides is known only after the
    /// next choice, which replaces the queue.
    pub(crate) visible: ArcSwapOption<Visible>,
    /// The LOD thread's part of the status.
    pub(crate) status: ArcSwap<Status>,
    /// The loaders' part of the status.
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
    pub(crate) fn new(forest: &Arc<Forest>, shown: &Arc<Shown>) -> Self {
        Self {
            front: ArcSwap::from_pointee(Cut::empty(Arc::clone(forest), Arc::clone(shown))),
            view: Mailbox::default(),
            shown: Mailbox::default(),
            limits: Mailbox::default(),
            feedback: Mailbox::default(),
            surroundings: Mailbox::default(),
            inputs: AtomicU64::new(0),
            inputs_used: AtomicU64::new(0),
            visible: ArcSwapOption::empty(),
            status: ArcSwap::from_pointee(Status::default()),
            counts: Counts::default(),
        }
    }

    /// Joins the LOD thread's status with the loaders' counters.
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
