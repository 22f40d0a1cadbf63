//! What a session may cost, in which order it reads, and with what and how it draws.

use crate::machine::backend::{Backend, GpuRequest};
use esker_points::Filter;
use esker_render::Method;
pub use esker_render::gpu::Gpu;
pub use esker_render::gpu::device::{descriptor, is_software};
use esker_stream::Priority;

/// What a session may cost and how it draws.
#[derive(Clone, Debug)]
pub struct Options {
    /// What draws.
    pub backend: Backend,
    /// Which GPU, and how it draws points.
    pub gpu: GpuRequest,
    /// The device to draw on, where a window has one. The session is used by the thread that
    /// submits to it.
    pub device: Option<Gpu>,
    /// Bytes of drawing memory: on a GPU of all its buffers, with those that pictures need.
    pub budget_gpu_bytes: u64,
    /// Bytes of main memory: table, statistics, staging, the renderer's buffers.
    pub budget_ram_bytes: u64,
    /// Width and height of the largest picture, pixels.
    pub size: [u32; 2],
    /// Points alone, or surfaces.
    pub method: Method,
    /// Where colours come from; the best there is where not said.
    pub colour_by: Option<String>,
    /// Which points are shown.
    pub filter: Filter,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether differences of exposure between scans are evened out.
    pub evens_exposure: bool,
    /// Whether full planes are read where there are compact ones, too.
    pub full: bool,
    /// Points drawn at most.
    pub points_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Whether what is hidden is left out.
    pub occlusion: bool,
    /// Which missing node is read first.
    pub priority: Priority,
    /// Reads in flight.
    pub loaders: usize,
    /// Nodes resident at most.
    pub nodes_max: usize,
    /// Runs of staging; what the budget allows where not said.
    pub runs: Option<usize>,
    /// Bytes copied to drawing memory in a frame, beyond the first run.
    pub upload_bytes_a_frame: usize,
}

impl Default for Options {
    fn default() -> Self {
        let stream = esker_stream::Options::default();
        Self {
            backend: Backend::default(),
            gpu: GpuRequest::default(),
            device: None,
            budget_gpu_bytes: 512 << 20,
            budget_ram_bytes: 1 << 30,
            size: [1024, 1024],
            method: Method::PullPush,
            colour_by: None,
            filter: Filter::default(),
            shines: true,
            evens_exposure: false,
            full: false,
            points_budget: stream.points_budget,
            target_spacing_px: stream.target_spacing_px,
            occlusion: stream.occlusion,
            priority: stream.priority,
            loaders: stream.loaders,
            nodes_max: stream.nodes_max,
            runs: None,
            // About ten milliseconds of copying.
            upload_bytes_a_frame: 32 << 20,
        }
    }
}

impl Options {
    /// What of it concerns streaming; how much memory there is, the painter says.
    pub(crate) fn stream(&self) -> esker_stream::Options {
        esker_stream::Options {
            nodes_max: self.nodes_max,
            points_budget: self.points_budget,
            target_spacing_px: self.target_spacing_px,
            priority: self.priority,
            occlusion: self.occlusion,
            loaders: self.loaders,
            ..esker_stream::Options::default()
        }
    }
}
