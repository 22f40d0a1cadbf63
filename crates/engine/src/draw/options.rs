//! Options of a session: its memory, the order in which it reads, and what it draws with; and the
//! settings that the user changes while a session runs.

use crate::cameras::vertical::Vertical;
use crate::draw::method::Method;
use crate::light::settings::LightSettings;
use crate::machine::backend::{Backend, GpuRequest};
use esker_points::Filter;
use esker_render::Dots;
pub use esker_render::gpu::Gpu;
pub use esker_render::gpu::device::{descriptor, is_software};
use esker_stream::Priority;

/// What a user changes while looking at a file: budgets, detail, method, colours, filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Points only, or surfaces.
    pub method: Method,
    /// Source of colours; none for the best that the file has.
    pub colour_by: Option<String>,
    /// Axis along which elevations are measured.
    pub vertical: Vertical,
    /// Which points are shown.
    pub filter: Filter,
    /// Clouds that are not shown, of a file that holds several ([`Forest::together`]).
    ///
    /// [`Forest::together`]: esker_format::Forest::together
    pub hidden_clouds: Vec<usize>,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// How lit pictures are lit.
    pub light: LightSettings,
    /// Whether differences of exposure between scans are removed.
    pub evens_exposure: bool,
    /// Whether points of surfaces are left out whose normal looks away from the eye.
    pub culls_back: bool,
    /// How points look that are drawn alone.
    pub dots: Dots,
    /// Whether full planes are read although there are compact ones.
    pub full: bool,
    /// Most points of a picture.
    pub points_budget: u64,
    /// Distance of adjacent points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Bytes of drawing memory; on a GPU, of all buffers, those of pictures included.
    pub budget_gpu_bytes: u64,
    /// Bytes of main memory: table, statistics, staging, the renderer's buffers.
    pub budget_ram_bytes: u64,
    /// Whether hidden nodes are left out.
    pub occlusion: bool,
}

/// Options of a session.
#[derive(Clone, Debug)]
pub struct Options {
    /// What the user can change.
    pub settings: Settings,
    /// CPU or GPU.
    pub backend: Backend,
    /// Which GPU, and how it draws points.
    pub gpu: GpuRequest,
    /// Device of a window to draw on. The session belongs to the thread that submits to it.
    pub device: Option<Gpu>,
    /// Width and height of the largest picture, pixels.
    pub size: [u32; 2],
    /// Whether the largest lit picture may be smaller than `size` where the budgets do not hold it
    /// beside a useful scene. [`Session::size`](crate::draw::session::Session::size) has its size.
    pub shrinks_lit: bool,
    /// Order in which missing nodes are read.
    pub priority: Priority,
    /// Concurrent reads.
    pub loaders: usize,
    /// Most bytes read a second, to measure slower disks and networks; `None` for what the disk
    /// gives.
    pub read_bytes_a_second: Option<u64>,
    /// Most nodes in memory.
    pub nodes_max: usize,
    /// Runs of staging; none for what the budget allows.
    pub runs: Option<usize>,
    /// Bytes copied to drawing memory in a frame, beyond the first run.
    pub upload_bytes_a_frame: usize,
}

impl Default for Settings {
    fn default() -> Self {
        let stream = esker_stream::Options::default();
        Self {
            method: Method::PullPush,
            colour_by: None,
            vertical: Vertical::default(),
            filter: Filter::default(),
            hidden_clouds: Vec::new(),
            shines: true,
            light: LightSettings::default(),
            evens_exposure: false,
            culls_back: false,
            dots: Dots::default(),
            full: false,
            points_budget: stream.points_budget,
            target_spacing_px: stream.target_spacing_px,
            budget_gpu_bytes: 512 << 20,
            budget_ram_bytes: 1 << 30,
            occlusion: stream.occlusion,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        let stream = esker_stream::Options::default();
        Self {
            settings: Settings::default(),
            backend: Backend::default(),
            gpu: GpuRequest::default(),
            device: None,
            size: [1024, 1024],
            shrinks_lit: false,
            priority: stream.priority,
            loaders: stream.loaders,
            read_bytes_a_second: None,
            nodes_max: stream.nodes_max,
            runs: None,
            // About ten milliseconds of copying.
            upload_bytes_a_frame: 32 << 20,
        }
    }
}

impl Options {
    /// Options of the streamer; the painter adds how much memory there is.
    pub(crate) fn stream(&self) -> esker_stream::Options {
        esker_stream::Options {
            nodes_max: self.nodes_max,
            points_budget: self.settings.points_budget,
            target_spacing_px: self.settings.target_spacing_px,
            priority: self.priority,
            occlusion: self.settings.occlusion,
            loaders: self.loaders,
            read_bytes_a_second: self.read_bytes_a_second,
            ..esker_stream::Options::default()
        }
    }
}
