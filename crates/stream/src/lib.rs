//! Streams the nodes of an `.esker` file for a moving view (kanzok2015, section 3.2). Views go in
//! by [`Streamer::look`], a [`Cut`] to draw comes out of [`Streamer::cut`], and bytes go through
//! the caller's [`Landing`]. This crate knows nothing of GPUs, windows or pictures, and maps no
//! file.
//!
//! # What each thread may touch
//!
//! - The **LOD thread** (`esker-lod`, `lod_thread.rs`) alone owns the cache, the slots of drawing
//!   memory, the table of requests, and the retries of failed reads. It takes views, what is shown,
//!   budgets, surroundings and feedback from the mailboxes of `shared.rs`, chooses a cut, publishes
//!   it as the front cut, and replaces the load queue. It reads no file and sees no run.
//! - A **loader thread** (`esker-load-N`, `loader.rs`) takes batches from the load queue, borrows
//!   runs from the [`Landing`], reads the file into them and lands them. It may write to the run
//!   that it holds, to the counters of `shared.rs`, and to the channel of reports. It touches
//!   neither the cache nor a slot: a batch names the slots, and the render thread copies the bytes
//!   there.
//! - The **render thread** (the caller's) calls [`Streamer`]. It writes the mailboxes, loads the
//!   front cut, and reports uploaded requests by a channel. It alone copies landed runs into
//!   drawing memory and draws from it.
//!
//! No call of the render thread but stopping waits for a lock, a thread or the disk. `shared.rs`
//! explains why a slot can get a new owner without a lock; `handover.rs` checks the protocol under
//! loom.

#![forbid(unsafe_code)]

mod batch;
mod cache;
mod choose;
mod cut;
mod error;
#[cfg(all(test, loom))]
mod handover;
mod identity;
mod landing;
mod loader;
mod lod_thread;
mod mailbox;
mod options;
mod planes;
mod pool;
mod priority;
mod queue;
mod rate;
mod reading;
mod requests;
mod retries;
mod shared;
mod status;
mod streamer;
mod surroundings;
#[cfg(test)]
mod testing;

pub use cut::{Cut, CutNode, CutSurroundings};
pub use error::StreamError;
pub use landing::{Landing, RUN_BYTES_MIN, Run, Slot, Transfer};
pub use options::{Limits, Needs, Options, Priority, Shown};
pub use status::{LodPassTimes, Status};
pub use streamer::Streamer;
