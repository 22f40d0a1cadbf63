//! Memory that the render thread lends to the loader threads and gets back filled. The traits fit a
//! ring of mapped GPU upload buffers as well as plain memory: a loader writes a run in any order,
//! never reads it, and may hold it on any thread; only the render thread maps, unmaps and copies.
//! This is the pair of map and unmap queues of kanzok2015, section 3.2.1, item 6.

use esker_format::PlaneKind;
use std::ops::Range;
use std::time::Duration;

/// Least length of a run, bytes.
pub const RUN_BYTES_MIN: usize = 4096;

/// A lent run of bytes.
pub trait Run: Send {
    /// Lets `write` fill a range of the run. The bytes must be written and never read: mapped GPU
    /// memory is slow to read and may hold anything. Returns `None`, without calling `write`, if
    /// the run has no such range or its memory is gone. A call and not a borrow, so that a lost GPU
    /// can wait for writers.
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T>;
}

/// Lends runs and takes them back. Shared by all loader threads.
pub trait Landing: Send + Sync + 'static {
    /// Type of the runs.
    type Run: Run + 'static;

    /// Length of a run, bytes: a multiple of [`Transfer::ALIGNMENT`], at least [`RUN_BYTES_MIN`].
    /// Longer planes are read in several runs.
    fn run_bytes(&self) -> usize;

    /// Lends a run, waiting at most `patience` for a free one. `None` if there was none, or if the
    /// landing is closed.
    fn lend(&self, patience: Duration) -> Option<Self::Run>;

    /// Takes a run back with its transfers, of which there are none if reading failed. Never waits,
    /// since there are only as many runs as were lent. Runs are uploaded in the order in which they
    /// landed, and transfers in their order: the later owner of a slot overwrites late bytes of the
    /// former one.
    fn land(&self, run: Self::Run, transfers: Vec<Transfer>);
}

/// A part of a plane in a landed run, and its destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// Index in the node table.
    pub node: u32,
    /// Plane that the bytes belong to.
    pub plane: PlaneKind,
    /// Offset in the run, bytes.
    pub run_offset: usize,
    /// Length, bytes.
    pub bytes: usize,
    /// Slot of the plane.
    pub slot: Slot,
    /// Offset in the slot, bytes.
    pub slot_offset: u64,
    /// Id of the request, if this is its last part: after uploading it, the render thread calls
    /// `Streamer::uploaded`.
    pub request: Option<u64>,
}

/// A range of drawing memory, which is one range of addresses from 0 to the budget. It is divided
/// into pages, and a slot lies within one page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Slot {
    /// First byte; a multiple of [`Slot::ALIGNMENT`].
    pub offset: u64,
    /// Bytes in use.
    pub bytes: u64,
}

impl Transfer {
    /// Alignment of [`Transfer::run_offset`] and [`Transfer::slot_offset`], so that copies on a GPU
    /// can begin there. If `bytes` is not a multiple of 4, a copy may be rounded up to one: run and
    /// slot have room.
    pub const ALIGNMENT: usize = 64;
}

impl Slot {
    /// Alignment of slots: what GPUs require of bound ranges.
    pub const ALIGNMENT: u64 = 256;
}
