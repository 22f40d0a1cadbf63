//! What streaming may cost, in what order it loads, and which planes the frames need.

use esker_format::{PlaneKind, Shown};
use std::sync::Arc;

/// Budgets and habits of a `Streamer`.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Bytes of drawing memory (`--budget-gpu`). Slots never pass it.
    pub drawing_bytes: u64,
    /// Bytes of a page of drawing memory, which no slot straddles.
    pub page_bytes: u64,
    /// Nodes resident at most, beside the budget in bytes (the paper's cache has 2,000).
    pub nodes_max: usize,
    /// Points drawn at most in a frame.
    pub points_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Which missing node is read first.
    pub priority: Priority,
    /// Whether what is hidden is left out.
    pub occlusion: bool,
    /// Loader threads: reads in flight.
    pub loaders: usize,
    /// Which points, and what of them.
    pub shown: Arc<Shown>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            drawing_bytes: 512 << 20,
            page_bytes: 128 << 20,
            nodes_max: usize::MAX,
            points_budget: 10_000_000,
            target_spacing_px: 1.0,
            priority: Priority::default(),
            occlusion: true,
            // Disks give their best at about eight requests in flight.
            loaders: 8,
            shown: Arc::default(),
        }
    }
}

/// Which missing node is read first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priority {
    /// The nearest (kanzok2015, section 3.2.2).
    Distance,
    /// The one whose absence shows most for its bytes.
    #[default]
    ErrorPerByte,
}

/// The planes that frames need. Positions always; residuals where hot positions would be off by half a
/// pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// The plane that colours come from.
    pub colour: Option<PlaneKind>,
    /// Whether normals are drawn.
    pub normals: bool,
    /// Whether splats are clipped at their lines.
    pub clip_lines: bool,
    /// Whether splats have shapes of their own.
    pub tangents: bool,
}
