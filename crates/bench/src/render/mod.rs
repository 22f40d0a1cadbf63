//! Table 1 of `marroquim2007`: the time of a frame for models and pictures of several sizes, by
//! every method and backend, beside the time in which the same bytes are copied once. As in the
//! paper, all points are drawn. Frames of the backends take turns, so that other work of the
//! machine affects all alike.
//!
//! Rows of a GPU have another floor: its memory moves the bytes of the points or those of the
//! pixels, whichever are more, and each dispatch takes a least time. If radii are given, each row
//! has the time of a view with the same points and passes in which every pixel is covered, which no
//! radius may exceed.

mod measure;
mod models;
mod report;
pub(crate) mod scene;

pub use measure::{RenderBenchRequest, measure};
pub use report::{RenderBenchReport, text};
