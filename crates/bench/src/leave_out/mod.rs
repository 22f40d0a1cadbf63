//! The benchmark of leaving out. Each thing that a frame can do without is drawn with it and
//! without it, in turns: bytes read from the file, bytes of planes in memory, and the time of a
//! frame. If both frames are the same, the row says that the omission does not apply to the view.

mod measure;
mod omissions;
mod report;

pub use measure::{LeaveOutRequest, measure};
pub use report::{LeaveOutReport, text};
