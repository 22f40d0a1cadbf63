//! What the machine can draw with (`esker info --system`): the graphics adapters with the features
//! that passes choose between, and which adapter is chosen and why. Works without a graphics
//! driver.

use crate::io::quantity::readable_bytes;
use crate::machine::backend::{Backend, DrawWith, ProjectPath, wgpu};
use esker_render::gpu::{Gpu, Tier, device};
use serde::Serialize;
use wgpu::{Adapter, Backends, Features};

/// What the machine can draw with.
#[derive(Clone, Debug, Serialize)]
pub struct SystemReport {
    /// Adapters that the drivers offer.
    pub adapters: Vec<AdapterReport>,
    /// Requested backend.
    pub requested: &'static str,
    /// What is chosen.
    pub chosen: ChoiceReport,
    /// Threads of the processor.
    pub threads: usize,
}

/// A graphics adapter.
#[derive(Clone, Debug, Serialize)]
pub struct AdapterReport {
    /// Name of the adapter.
    pub name: String,
    /// Graphics interface that it is driven by.
    pub interface: String,
    /// Kind of the adapter.
    pub kind: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Whether the driver draws on the CPU.
    pub software: bool,
    /// Whether shaders have 64-bit atomic minima.
    pub atomics_64: bool,
    /// Whether passes can be timed.
    pub timestamps: bool,
    /// Whether drawing memory can be mapped.
    pub mappable_buffers: bool,
    /// Most bytes of a buffer.
    pub buffer_bytes_max: u64,
    /// Most bytes of a buffer that a shader can be given.
    pub binding_bytes_max: u64,
    /// Most pixels of a side of a picture.
    pub picture_side_max: u32,
}

/// What is chosen to draw with.
#[derive(Clone, Debug, Serialize)]
pub struct ChoiceReport {
    /// `gpu`, `cpu`, or none if the user insists on a GPU and there is none.
    pub backend: Option<&'static str>,
    /// How points become pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<&'static str>,
    /// Reason for the choice.
    pub why: String,
    /// The GPU.
    #[serde(flatten)]
    pub gpu: Option<GpuReport>,
}

/// What a chosen GPU offers.
#[derive(Clone, Debug, Serialize)]
pub struct GpuReport {
    /// Name of the adapter with its driver and interface.
    pub adapter: String,
    /// Most bytes of a page of drawing memory.
    pub page_bytes_max: u64,
    /// Most bytes of a buffer that a shader can be given.
    pub binding_bytes_max: u64,
    /// Whether passes can be timed.
    pub timestamps: bool,
    /// Whether drawing memory can be mapped.
    pub mappable_buffers: bool,
    /// Whether the driver draws on the CPU.
    pub software: bool,
}

/// Reports on all adapters, and on what `with` chooses.
pub fn system(with: &DrawWith) -> SystemReport {
    SystemReport {
        adapters: device::adapters(Backends::all()).iter().map(AdapterReport::from).collect(),
        requested: with.backend.name(),
        chosen: ChoiceReport::of(with),
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    }
}

impl ChoiceReport {
    fn of(with: &DrawWith) -> Self {
        match with.choose(None) {
            Ok((Some(gpu), drawer)) => Self {
                backend: Some(drawer.backend()),
                path: Some(drawer.path_name()),
                why: why(&gpu.tier, with),
                gpu: Some(GpuReport::from(&gpu)),
            },
            Ok((None, drawer)) => Self {
                backend: Some("cpu"),
                path: Some("cpu"),
                why: drawer.note.unwrap_or_else(|| "the CPU was requested".into()),
                gpu: None,
            },
            // Only if the user insists on a GPU.
            Err(fault) => Self { backend: None, path: None, why: format!("{fault:#}"), gpu: None },
        }
    }
}

impl From<&Gpu> for GpuReport {
    fn from(gpu: &Gpu) -> Self {
        Self {
            adapter: gpu.name.clone(),
            page_bytes_max: gpu.tier.page_bytes_max,
            binding_bytes_max: gpu.tier.binding_bytes_max,
            timestamps: gpu.tier.has_timestamps,
            mappable_buffers: gpu.tier.is_mappable,
            software: gpu.tier.is_software,
        }
    }
}

impl From<&Adapter> for AdapterReport {
    fn from(adapter: &Adapter) -> Self {
        let (info, features, limits) = (adapter.get_info(), adapter.features(), adapter.limits());
        let atomics = Features::SHADER_INT64 | Features::SHADER_INT64_ATOMIC_MIN_MAX;
        Self {
            interface: format!("{:?}", info.backend).to_lowercase(),
            kind: format!("{:?}", info.device_type),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            software: device::is_software(&info),
            name: info.name,
            atomics_64: features.contains(atomics),
            timestamps: features.contains(Features::TIMESTAMP_QUERY),
            mappable_buffers: features.contains(Features::MAPPABLE_PRIMARY_BUFFERS),
            buffer_bytes_max: limits.max_buffer_size,
            binding_bytes_max: limits.max_storage_buffer_binding_size,
            picture_side_max: limits.max_texture_dimension_2d,
        }
    }
}

fn why(tier: &Tier, with: &DrawWith) -> String {
    let adapter = match (with.backend, tier.is_software) {
        (_, true) => "a software driver was requested",
        (Backend::Gpu, false) => "a GPU was requested, and this is the best one",
        _ => "it is the best GPU of this machine",
    };
    let path = match (with.gpu.path, tier.path) {
        (Some(_), _) => "its path was requested",
        (None, ProjectPath::Atomics) => "it has 64-bit atomics",
        (None, ProjectPath::Primitives) => "it has no 64-bit atomics, so points are primitives",
    };
    format!("{adapter}; {path}")
}

/// Text of a report.
pub fn text(report: &SystemReport) -> String {
    let mut lines = Vec::new();
    if report.adapters.is_empty() {
        lines.push("adapters     none: the system has no graphics driver".into());
    }
    lines.extend(report.adapters.iter().flat_map(AdapterReport::lines));
    let ChoiceReport { backend, path, why, gpu } = &report.chosen;
    let what = match (gpu, backend) {
        (Some(gpu), _) => format!("{}, points by {}", gpu.adapter, path.unwrap_or("?")),
        (None, Some(_)) => format!("the CPU renderer on {} threads", report.threads),
        (None, None) => "nothing".into(),
    };
    lines.push(format!("draws with   {what}"));
    lines.push(format!("  since      {why}"));
    lines.join("\n")
}

impl AdapterReport {
    fn lines(&self) -> [String; 2] {
        let has = |is: bool| if is { "yes" } else { "no" };
        [
            format!(
                "adapter      {} by {}{}; {}",
                self.name,
                self.interface,
                if self.software { ", a software driver" } else { "" },
                self.driver,
            ),
            format!(
                "  has        64-bit atomics {}, timestamps {}, mappable buffers {}; buffers of {}, bindings of {}, pictures of {} pixels a side",
                has(self.atomics_64),
                has(self.timestamps),
                has(self.mappable_buffers),
                readable_bytes(self.buffer_bytes_max),
                readable_bytes(self.binding_bytes_max),
                self.picture_side_max,
            ),
        ]
    }
}
