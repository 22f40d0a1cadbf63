//! What the programs do, as calls: build, info, verify, export, render and demo. Joins the crates
//! that scan, build, store, choose, stream and draw. The programs parse their command lines, call
//! this crate, and print the reports that it returns.

pub mod calls;
pub mod cameras;
pub mod document;
pub mod draw;
pub mod io;
pub mod light;
pub mod machine;

pub use draw::method::Method;
pub use esker_builder::budget::memory;
pub use esker_builder::jobs::{Resources as JobResources, plan::PlanHow};
pub use esker_builder::{BuildError, ExportOptions, NormalsMode, Options as BuildOptions, Resume};
pub use esker_format::{Codec, EskerFile, Forest, ForestFilter};
pub use esker_lod::{View, Window};
pub use esker_points::filter::{
    Bound, Bounds, Classes, Clip, ClipShape, Filter, Flags, Polygon, ValueRange,
};
pub use esker_points::lattice::Grid;
pub use esker_points::unfinished::remove_all as remove_unfinished;
pub use esker_points::{AttrType, Attribute, Cancelled, ColourDepth, Lattice, Task};

pub use esker_render::{Dots, Gradient, POINT_SIZE_MAX, Picture, PointSize};
pub use esker_scan::caught::hide as hide_caught_panics;
pub use esker_scan::given;
pub use esker_scan::system::{UNITS, read_crs};
pub use esker_scan::{Columns, Crs, OpenOptions};
pub use esker_stream::{Cut, Status};

/// Writes an error and its causes as one line. A cause that is part of the text before it is left
/// out.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut message = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if message.is_empty() {
            message = cause;
        } else if !message.contains(&cause) {
            message = format!("{message}: {cause}");
        }
    }
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
