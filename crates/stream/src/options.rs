//! Options of a streamer: budgets, the order of loading, and the planes that frames need.

use esker_format::{ForestFilter, PlaneKind};
use esker_lod::Surroundings;
use std::sync::Arc;

/// Budgets and settings of a `Streamer`.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Bytes of drawing memory (`--budget-gpu`). Slots never exceed it.
    pub drawing_bytes: u64,
    /// Bytes of a page of drawing memory; a slot lies within one page.
    pub page_bytes: u64,
    /// Greatest number of resident nodes, beside the budget in bytes (2,000 in kanzok2015).
    pub nodes_max: usize,
    /// Greatest number of points drawn in a frame.
    pub points_budget: u64,
    /// Distance of neighbouring points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Order in which missing nodes are read.
    pub priority: Priority,
    /// Whether hidden nodes are culled.
    pub occlusion: bool,
    /// Detail and budgets of what is loaded around the picture for light, from the start;
    /// `Streamer::surround` changes it. They take at most a quarter of drawing memory, and no more
    /// than the picture leaves.
    pub surroundings: Option<Surroundings>,
    /// Number of loader threads, which is the number of reads in progress.
    pub loaders: usize,
    /// Most bytes that all loaders read a second, to measure slower disks and networks; `None` for
    /// what the disk gives.
    pub read_bytes_a_second: Option<u64>,
    /// Filter of points, and values mapped while reading.
    pub filter: Arc<ForestFilter>,
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
            surroundings: None,
            // Disks reach their best rate at about eight requests in progress.
            loaders: 8,
            read_bytes_a_second: None,
            filter: Arc::default(),
        }
    }
}

/// Order in which missing nodes are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priority {
    /// Nearest first (kanzok2015, section 3.2.2).
    Distance,
    /// Greatest expected error of the picture a byte first.
    #[default]
    ErrorPerByte,
}

/// Planes that frames need. Positions are always loaded; residuals where hot positions would be off
/// by half a pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Plane that colours come from.
    pub colour: Option<PlaneKind>,
    /// Whether normals are used.
    pub normals: bool,
    /// Whether splats are clipped at their clip lines.
    pub clip_lines: bool,
    /// Whether splats have shapes of their own.
    pub tangents: bool,
    /// Plane of the classes of points, where lights choose points by them.
    pub classes: Option<PlaneKind>,
}
