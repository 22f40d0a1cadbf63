//! Inputs, outputs, quantities and progress.

pub use esker_points::address;

pub mod file;
pub(crate) mod inputs;
pub mod kept;
pub mod output;
pub mod picture;
pub mod polygon;
pub mod progress;
pub mod quantity;
pub mod stages;
pub mod visible;
