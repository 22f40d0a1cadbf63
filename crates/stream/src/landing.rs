//! Where read bytes land: memory that the render thread lends to the loader threads and gets back filled.
//! Written so that a ring of mapped GPU upload buffers fits it as well as plain memory does: a loader
//! writes a run front to back or in any order, never reads it, and may hold it on any thread; only the
//! render thread maps, unmaps and copies. This is the paper's pair of map and unmap queues
//! (kanzok2015, section 3.2.1, item 6).

use esker_format::PlaneKind;
use std::ops::Range;
use std::time::Duration;

/// Bytes of a run at least.
pub const RUN_BYTES_MIN: usize = 4096;

/// A lent run of bytes.
pub trait Run: Send {
    /// Lets `write` fill a range of its bytes, which are to be written and never read: mapped GPU memory is
    /// slow to read, or gives anything. `None`, and nothing is called, where it has no such range or its
    /// memory is gone. A call and not a borrow, so that a GPU that is lost can wait for those who write.
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T>;
}

/// Lends runs and takes them back. Shared by all loader threads.
pub trait Landing: Send + Sync + 'static {
    /// What is lent.
    type Run: Run + 'static;

    /// Bytes of a run: a multiple of [`Transfer::ALIGNMENT`], at least
    /// [`RUN_BYTES_MIN`]. What is longer is read in
    /// several runs.
    fn run_bytes(&self) -> usize;

    /// Lends a run, waiting at most `patience` for one that is free. `None` where none was, or where the
    /// landing is closed.
    fn lend(&self, patience: Duration) -> Option<Self::Run>;

    /// Takes a run back with what was written into it: nothing, where reading failed. Never waits: there
    /// are only as many runs as were lent. Runs are uploaded in the order in which they were landed, and
    /// transfers in theirs: a slot's later owner overwrites what came late for its former one.
    fn land(&self, run: Self::Run, transfers: Vec<Transfer>);
}

/// A part of a plane of a node in a landed run, and where it goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// The node.
    pub node: u32,
    /// The plane.
    pub plane: PlaneKind,
    /// Where it starts in the run, bytes.
    pub run_offset: usize,
    /// How long it is, bytes.
    pub bytes: usize,
    /// The plane's place in drawing memory.
    pub slot: Slot,
    /// Where this part goes in the slot, bytes.
    pub slot_offset: u64,
    /// Whether this is the last part of what was asked of the node: with it uploaded, the render thread
    /// tells the streamer by `Streamer::uploaded`.
    pub request: Option<u64>,
}

/// A place in drawing memory, which is one range of addresses from 0 to the budget, cut into pages that
/// no slot straddles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Slot {
    /// Its first byte; a multiple of [`Slot::ALIGNMENT`].
    pub offset: u64,
    /// Bytes in use.
    pub bytes: u64,
}

impl Transfer {
    /// What [`Transfer::run_offset`] and [`Transfer::slot_offset`] are multiples of, so that copies on a
    /// GPU can begin there. Where `bytes` is none of 4, a copy may be rounded up to one: run and slot
    /// have room.
    pub const ALIGNMENT: usize = 64;
}

impl Slot {
    /// What slots are aligned to: what GPUs ask of bound ranges.
    pub const ALIGNMENT: u64 = 256;
}
