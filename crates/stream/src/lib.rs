//! Streams the nodes of an `.esker` file for a moving view (kanzok2015, section 3.2): one LOD thread
//! chooses, loader threads read, the caller's render thread draws and never waits. Views go in by
//! `Streamer::look`, a [`Cut`] to draw comes out by `Streamer::cut`, bytes go through the caller's
//! [`Landing`]. Knows nothing of GPUs, windows or pictures; maps no file.

#![forbid(unsafe_code)]

mod ask;
mod batch;
mod cache;
mod choose;
pub mod cut;
pub mod error;
#[cfg(all(test, loom))]
mod handover;
mod identity;
pub mod landing;
mod loader;
mod lod_thread;
mod mailbox;
pub mod options;
mod planes;
mod pool;
mod priority;
mod queue;
mod reading;
mod retries;
mod shared;
pub mod status;
pub mod streamer;
#[cfg(test)]
mod testing;

pub use cut::{Cut, CutNode};
pub use error::StreamError;
pub use landing::{Landing, Run, Slot, Transfer};
pub use options::{Needs, Options, Priority};
pub use status::{PassTimes, Status};
pub use streamer::Streamer;
