//! The benchmark of leaving out. Each thing that a frame can do without is drawn with it and
//! without it, in turns: bytes read from the file, bytes of planes in memory, and the time of a
//! frame. If both frames are the same, the row says that the omission does not apply to the view.
//! The pictures are compared: what a plan leaves out as not needed must not change a pixel.
//! The same is asked of each optional pass of the frames; and bare pictures must not load planes
//! or shaders of light, filters, normals or other methods.

mod loaded;
mod measure;
mod omissions;
mod passes;
mod pictures;
mod report;

pub use measure::{LeaveOutRequest, measure};
pub use report::{LeaveOutReport, text};
