//! The drawing rate: how many points a second become single pixels if all of them are in memory.
//! All paths draw the same points in turns, frame by frame, so that other work of the machine
//! affects all alike. Beside them stand the bandwidth of copies of the same memory, and the pass of
//! 64-bit atomics without its frame buffer. `schuetz2021` compares orders of points in this way.

mod cloud;
mod cpu;
mod frame;
mod gpu;
mod measure;
mod report;

pub(crate) use gpu::{copy_rate, wait};
pub use measure::{DrawBenchRequest, measure};
pub use report::{DrawReport, text};
