//! Streams the nodes of an `.esker` file for a moving view (kanzok2015, section 3.2): one LOD thread
//! chooses, loader threads read, the caller's render thread draws and never waits. Views go in by
//! `Streamer::look`, a [`Cut`] to draw comes out by `Streamer::cut`, bytes go through the caller's
//! [`Landing`]. Knows nothing of GPUs, windows or pictures; maps no file.

#![forbid(unsafe_code)]

pub mod cut;
pub mod error;
pub mod landing;
pub mod options;
pub mod status;

pub use cut::{Cut, CutNode};
pub use error::StreamError;
pub use landing::{Landing, Run, Slot, Transfer};
pub use options::{Needs, Options, Priority};
pub use status::{PassTimes, Status};
