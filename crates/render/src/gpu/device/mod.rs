//! The device and its tier: chooses an adapter, and records the features and limits that the passes
//! choose their variants by. WebGPU's default limits and no feature suffice (`docs/design/gpu.md`).

pub mod dispatch;
pub mod error;
pub mod kernel;
pub(crate) mod link;
pub(crate) mod quiet;
pub mod readback;
pub(crate) mod same;
pub mod shader;
pub mod timing;
pub(crate) mod variants;

use crate::gpu::device::error::GpuError;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock, RwLockReadGuard};
use wgpu::{Backends, DeviceType, Features, Limits};

/// Bytes of a storage binding that WebGPU guarantees.
pub const BINDING_BYTES_MAX: u64 = 128 << 20;

/// The way in which points are drawn to the frame buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProjectPath {
    /// Compute shader with one 64-bit atomic minimum a point.
    Atomics,
    /// Point primitives with a depth test.
    Primitives,
}

/// Requirements on the adapter and the device.
#[derive(Clone, Copy, Debug)]
pub struct GpuRequest {
    /// Interfaces to search.
    pub backends: Backends,
    /// Whether a software driver is accepted.
    pub allow_software: bool,
    /// The way to draw points; `None` for the best that the device has.
    pub path: Option<ProjectPath>,
    /// Whether to request only WebGPU's default limits and no features.
    pub is_minimal: bool,
}

impl Default for GpuRequest {
    fn default() -> Self {
        Self { backends: interfaces(), allow_software: false, path: None, is_minimal: false }
    }
}

/// Interfaces that are searched by default. On Linux OpenGL is left out without a display, because
/// its libraries then write messages to standard error.
fn interfaces() -> Backends {
    let has_display =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    let looks_at_gl = !cfg!(target_os = "linux") || has_display;
    if looks_at_gl { Backends::PRIMARY | Backends::GL } else { Backends::PRIMARY }
}

/// Interfaces whose devices can exist at the same time, for tests on all adapters of the system.
/// OpenGL is among them only if no other interface has a hardware GPU: NVIDIA's driver (580.159,
/// Linux) hangs when a thread that used its OpenGL ends while another thread drops a Vulkan device.
pub fn all_interfaces() -> &'static [Backends] {
    const ALL: [Backends; 4] = [Backends::VULKAN, Backends::METAL, Backends::DX12, Backends::GL];
    static HAS_OTHERS: OnceLock<bool> = OnceLock::new();
    let others = &ALL[..3];
    let is_real = |&backends| choose(&GpuRequest { backends, ..GpuRequest::default() }).is_ok();
    if *HAS_OTHERS.get_or_init(|| others.iter().any(is_real)) { others } else { &ALL }
}

/// Features and limits of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Tier {
    /// The way in which points are drawn.
    pub path: ProjectPath,
    /// Whether loaders can map pages of node planes and write to them.
    pub is_mappable: bool,
    /// Whether passes can be timed.
    pub has_timestamps: bool,
    /// Bytes of a page of node planes at most.
    pub page_bytes_max: u64,
    /// Bytes of a storage binding at most.
    pub binding_bytes_max: u64,
    /// Whether the driver runs on the CPU.
    pub is_software: bool,
}

/// A device with its queue. Clones are handles to the same device. Only the render thread submits,
/// maps and polls.
#[derive(Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Features and limits.
    pub tier: Tier,
    /// Name, driver and interface of the adapter.
    pub name: String,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    fault: Mutex<Option<GpuError>>,
    gate: Arc<Gate>,
    bytes: AtomicU64,
    peak_bytes: AtomicU64,
    dispatches: DispatchCount,
    /// Files of the shaders that kernels were built from.
    shaders: Mutex<BTreeSet<&'static str>>,
}

/// Number of dispatches and draws that were encoded on a device.
#[derive(Clone, Debug, Default)]
pub struct DispatchCount(Arc<AtomicU64>);

impl DispatchCount {
    /// Adds one.
    pub fn add_one(&self) {
        self.0.fetch_add(1, Relaxed);
    }
}

/// Guard of mapped memory that other threads write to: shut when the device is lost, before the
/// device frees that memory.
#[derive(Debug, Default)]
pub struct Gate {
    is_shut: RwLock<bool>,
}

impl Gate {
    /// Keeps mapped memory valid while the guard lives; `None` if the device was lost.
    pub fn enter(&self) -> Option<RwLockReadGuard<'_, bool>> {
        let guard = self.is_shut.read().unwrap_or_else(PoisonError::into_inner);
        (!*guard).then_some(guard)
    }

    /// Refuses further guards and waits for those that live.
    fn shut(&self) {
        *self.is_shut.write().unwrap_or_else(PoisonError::into_inner) = true;
    }
}

/// A buffer whose bytes are counted while it lives.
pub struct Counted {
    buffer: wgpu::Buffer,
    state: Arc<State>,
}

impl std::ops::Deref for Counted {
    type Target = wgpu::Buffer;
    fn deref(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

impl fmt::Debug for Counted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.buffer.fmt(f)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.state.bytes.fetch_sub(self.buffer.size(), Relaxed);
    }
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gpu")
            .field("name", &self.name)
            .field("tier", &self.tier)
            .finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens the best adapter that meets `request`: discrete before integrated before others before
    /// software.
    ///
    /// # Errors
    /// If there is none; the error lists the adapters found.
    pub fn open(request: &GpuRequest) -> Result<Self, GpuError> {
        let adapter = choose(request)?;
        let descriptor = descriptor(&adapter, request);
        // Checked before the device exists: creating a device only to drop it is slow and strains
        // drivers.
        path_of(descriptor.required_features, &adapter.get_info(), request.path)?;
        let made = pollster::block_on(adapter.request_device(&descriptor));
        let (device, queue) = made.map_err(|e| GpuError::NoDevice {
            adapter: adapter.get_info().name,
            fault: e.to_string(),
        })?;
        Self::new(device, queue, request.path)
    }

    /// Wraps a device that the caller (a window) created with [`descriptor`].
    ///
    /// # Errors
    /// If the device lacks a feature that `path` needs.
    pub fn new(
        device: wgpu::Device,
        queue: wgpu::Queue,
        path: Option<ProjectPath>,
    ) -> Result<Self, GpuError> {
        let info = device.adapter_info();
        let tier = tier(&device, &info, path)?;
        let state = Arc::new(State::default());
        let faults = Arc::clone(&state);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            faults.note(match e {
                wgpu::Error::OutOfMemory { .. } => {
                    GpuError::Memory { what: "a pass".into(), bytes: 0 }
                }
                e => GpuError::Refused(e.to_string()),
            });
        }));
        let faults = Arc::clone(&state);
        device.set_device_lost_callback(move |reason, message| {
            faults.gate.shut();
            if reason != wgpu::DeviceLostReason::Destroyed {
                faults.note(GpuError::Lost(message));
            }
        });
        let name = format!("{} ({}, {:?})", info.name, info.driver_info, info.backend);
        Ok(Self { device, queue, tier, name, state })
    }

    /// The first fault of the device, if any; checked after every frame.
    pub fn fault(&self) -> Option<GpuError> {
        self.state.fault.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The guard of mapped memory.
    pub fn gate(&self) -> Arc<Gate> {
        Arc::clone(&self.state.gate)
    }

    /// Ends the device for all of its handles, as if it were lost; `why` becomes the fault.
    pub fn end(&self, why: &str) {
        self.state.gate.shut();
        self.state.note(GpuError::Lost(why.into()));
        self.device.destroy();
    }

    /// Creates a buffer whose bytes are counted.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn buffer(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<Counted, GpuError> {
        self.buffer_mapped(label, bytes, usage, false)
    }

    /// Creates a buffer like [`Gpu::buffer`]; if `is_mapped`, it can be written to at once.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn buffer_mapped(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
        is_mapped: bool,
    ) -> Result<Counted, GpuError> {
        let size = bytes.max(16).next_multiple_of(16);
        let refused = || GpuError::Memory { what: label.into(), bytes };
        if size > self.device.limits().max_buffer_size {
            return Err(refused());
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: is_mapped,
        };
        let buffer = self.device.create_buffer(&descriptor);
        if pollster::block_on(scope.pop()).is_some() {
            return Err(refused());
        }
        let now = self.state.bytes.fetch_add(size, Relaxed) + size;
        self.state.peak_bytes.fetch_max(now, Relaxed);
        Ok(Counted { buffer, state: Arc::clone(&self.state) })
    }

    /// Records that a kernel was built from a shader, by the name of its file.
    pub(crate) fn built(&self, shader: &'static str) {
        let mut shaders = self.state.shaders.lock().unwrap_or_else(PoisonError::into_inner);
        shaders.insert(shader);
    }

    /// Files of the shaders that kernels were built from so far.
    pub fn shaders(&self) -> Vec<&'static str> {
        let shaders = self.state.shaders.lock().unwrap_or_else(PoisonError::into_inner);
        shaders.iter().copied().collect()
    }

    /// The counter of dispatches and draws.
    pub fn dispatch_count(&self) -> &DispatchCount {
        &self.state.dispatches
    }

    /// Number of dispatches and draws that were encoded so far.
    pub fn dispatches(&self) -> u64 {
        self.state.dispatches.0.load(Relaxed)
    }

    /// Bytes of all live buffers.
    pub fn bytes(&self) -> u64 {
        self.state.bytes.load(Relaxed)
    }

    /// Greatest number of bytes of live buffers so far.
    pub fn peak_bytes(&self) -> u64 {
        self.state.peak_bytes.load(Relaxed)
    }
}

impl State {
    fn note(&self, fault: GpuError) {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(fault);
    }
}

/// All adapters of `backends`, the best first.
pub fn adapters(backends: Backends) -> Vec<wgpu::Adapter> {
    /// Never dropped: dropping the last instance unloads the driver, and NVIDIA's (580.159, Linux)
    /// then crashes threads that used it and are just ending.
    static KEPT: OnceLock<wgpu::Instance> = OnceLock::new();
    let mut adapters = quiet::while_probing(|| {
        if backends.contains(Backends::VULKAN) {
            KEPT.get_or_init(|| instance(Backends::VULKAN));
        }
        pollster::block_on(instance(backends).enumerate_adapters(backends))
    });
    adapters.sort_by_key(|a| {
        let info = a.get_info();
        (rank(info.device_type), info.backend == wgpu::Backend::Gl)
    });
    adapters
}

fn instance(backends: Backends) -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    wgpu::Instance::new(descriptor)
}

fn rank(kind: DeviceType) -> u8 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// Whether an adapter is a driver on the CPU. OpenGL does not report that as its device type.
pub fn is_software(info: &wgpu::AdapterInfo) -> bool {
    let name = info.name.to_lowercase();
    info.device_type == DeviceType::Cpu
        || ["llvmpipe", "softpipe", "swiftshader", "basic render"].iter().any(|s| name.contains(s))
}

fn choose(request: &GpuRequest) -> Result<wgpu::Adapter, GpuError> {
    let all = adapters(request.backends);
    let seen: Vec<String> = all
        .iter()
        .map(|a| a.get_info())
        .map(|i| {
            format!(
                "{} by {:?}{}",
                i.name,
                i.backend,
                if is_software(&i) { ", a software driver" } else { "" }
            )
        })
        .collect();
    let fits = |a: &wgpu::Adapter| request.allow_software || !is_software(&a.get_info());
    all.into_iter().find(fits).ok_or_else(|| {
        GpuError::NoAdapter(if seen.is_empty() {
            "the system has no driver".into()
        } else {
            format!("there is only {}", seen.join("; "))
        })
    })
}

/// Descriptor of the device to request: WebGPU's default limits, but the largest buffers that the
/// adapter has, and those of its features that the passes can use.
pub fn descriptor(
    adapter: &wgpu::Adapter,
    request: &GpuRequest,
) -> wgpu::DeviceDescriptor<'static> {
    let has = adapter.limits();
    let mut limits = Limits::default();
    let mut features = Features::empty();
    if !request.is_minimal {
        limits.max_buffer_size = has.max_buffer_size;
        limits.max_storage_buffer_binding_size = has.max_storage_buffer_binding_size;
        limits.max_texture_dimension_2d = has.max_texture_dimension_2d;
        let useful = Features::SHADER_INT64
            | Features::SHADER_INT64_ATOMIC_MIN_MAX
            | Features::TIMESTAMP_QUERY
            | Features::MAPPABLE_PRIMARY_BUFFERS;
        features = adapter.features() & useful;
    }
    wgpu::DeviceDescriptor {
        label: Some("esker"),
        required_features: features,
        required_limits: limits,
        ..Default::default()
    }
}

fn tier(
    device: &wgpu::Device,
    info: &wgpu::AdapterInfo,
    path: Option<ProjectPath>,
) -> Result<Tier, GpuError> {
    let (features, limits) = (device.features(), device.limits());
    let path = path_of(features, info, path)?;
    let binding_bytes_max = limits.max_storage_buffer_binding_size;
    Ok(Tier {
        path,
        is_mappable: features.contains(Features::MAPPABLE_PRIMARY_BUFFERS),
        has_timestamps: features.contains(Features::TIMESTAMP_QUERY),
        page_bytes_max: binding_bytes_max.min(limits.max_buffer_size).min(BINDING_BYTES_MAX),
        binding_bytes_max,
        is_software: is_software(info),
    })
}

/// The way to draw points on a device with these features: `wanted`, or else the best.
fn path_of(
    features: Features,
    info: &wgpu::AdapterInfo,
    wanted: Option<ProjectPath>,
) -> Result<ProjectPath, GpuError> {
    let atomics = Features::SHADER_INT64 | Features::SHADER_INT64_ATOMIC_MIN_MAX;
    // The pass reads pixels before it writes them; Metal's 64-bit atomics have a minimum, but no
    // load.
    let has_atomics = features.contains(atomics) && info.backend != wgpu::Backend::Metal;
    match wanted {
        Some(ProjectPath::Atomics) if !has_atomics => {
            let fault = format!("{}: has no 64-bit atomics; draw by point primitives", info.name);
            Err(GpuError::Path(fault))
        }
        Some(path) => Ok(path),
        None if has_atomics => Ok(ProjectPath::Atomics),
        None => Ok(ProjectPath::Primitives),
    }
}
