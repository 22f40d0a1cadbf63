//! The benchmark of light: path tracing with filtered indirect light (`bauszat2011`). Traces three
//! generated meshes and two generated scans; reports times by bounces, samples and filters (tables
//! 1 and 2 of the paper), errors against references (figure 8), and writes figures 2 and 5 to 8.

mod content;
mod error;
mod estimate;
mod figures;
mod filters;
mod limits;
mod measure;
mod meshes;
mod moving;
mod picture;
mod plot;
mod quads;
mod references;
mod report;
mod scans;
mod scene;
mod scenes;

pub use measure::{TraceBenchRequest, measure};
pub use report::{Part, TraceBenchReport, text};
pub use scenes::SCENES;
