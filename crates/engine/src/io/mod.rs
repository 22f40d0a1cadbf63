//! Inputs, outputs, quantities and progress, as people write and read them.

pub mod file;
pub mod inputs;
pub mod output;
pub mod picture;
pub mod polygon;
pub mod progress;
pub mod quantity;
pub mod stages;
