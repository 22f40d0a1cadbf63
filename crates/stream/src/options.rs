//! Options of a streamer: budgets, the order of loading, and what frames show. Budgets and what is
//! shown change while it runs.

use esker_format::{ForestFilter, PlaneKind};
use esker_lod::Surroundings;
use std::any::Any;
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
}

/// Budgets that change while a streamer runs, as in [`Options`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Bytes of drawing memory in slots.
    pub drawing_bytes: u64,
    /// Greatest number of points drawn in a frame.
    pub points_budget: u64,
    /// Distance of neighbouring points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Whether hidden nodes are culled.
    pub occlusion: bool,
}

impl Options {
    /// The budgets that can change.
    pub fn limits(&self) -> Limits {
        let Self { drawing_bytes, points_budget, target_spacing_px, occlusion, .. } = *self;
        Limits { drawing_bytes, points_budget, target_spacing_px, occlusion }
    }

    /// Changes the budgets.
    pub(crate) fn limit(&mut self, limits: &Limits) {
        let Limits { drawing_bytes, points_budget, target_spacing_px, occlusion } = *limits;
        self.drawing_bytes = drawing_bytes;
        self.points_budget = points_budget;
        self.target_spacing_px = target_spacing_px;
        self.occlusion = occlusion;
    }
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

/// What frames show: which planes they read, and which points. A cut has all of it, so that it is
/// drawn by what it was chosen for.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Planes that frames need.
    pub needs: Needs,
    /// Filter of points, and values mapped while reading.
    pub filter: Arc<ForestFilter>,
    /// What the caller draws such cuts with; the streamer passes it on to them.
    pub look: Arc<dyn Any + Send + Sync>,
}

impl Default for Shown {
    fn default() -> Self {
        Needs::default().into()
    }
}

impl From<Needs> for Shown {
    /// All points, as they are in the files.
    fn from(needs: Needs) -> Self {
        Self { needs, filter: Arc::default(), look: Arc::new(()) }
    }
}
