//! What the programs do, as calls: build, info, verify, render, demo. Puts scan, build, format, lod and
//! render together; the programs only parse their command lines and print what comes back.

pub mod build;
pub mod camera;
pub mod colour;
pub mod demo;
pub mod info;
pub mod output;
pub mod picture;
pub mod pool;
pub mod progress;
pub mod quantity;
pub mod render;
pub mod verify;

pub use esker_build::memory;
pub use esker_build::{Options as BuildOptions, Report as BuildReport};
pub use esker_points::{Cancelled, ColourDepth, Task};
pub use esker_render::Method;
pub use serde_json::Value;
