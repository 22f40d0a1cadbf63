//! The device and its tier: which adapter is drawn on, and what it has that the passes choose between.
//! Nothing is required: WebGPU's default limits and no feature suffice (DESIGN section 8).

pub(crate) mod dispatch;
pub mod error;
pub mod kernel;
pub(crate) mod link;
pub(crate) mod quiet;
pub mod readback;
pub mod shader;
pub mod timing;
pub(crate) mod variants;

use crate::gpu::device::error::GpuError;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock, RwLockReadGuard};
use wgpu::{Backends, DeviceType, Features, Limits};

/// Bytes of a buffer that is bound whole, at most: what WebGPU promises.
pub const BINDING_BYTES_MAX: u64 = 128 << 20;

/// How points become pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProjectPath {
    /// Compute, one 64-bit atomic minimum a point.
    Atomics,
    /// Point primitives with a depth test.
    Primitives,
}

/// What is asked of a GPU.
#[derive(Clone, Copy, Debug)]
pub struct GpuRequest {
    /// Interfaces to look at.
    pub backends: Backends,
    /// Whether a software driver counts.
    pub allow_software: bool,
    /// The path to draw points by; the best there is where not said.
    pub path: Option<ProjectPath>,
    /// WebGPU's default limits and no features, whatever the adapter has.
    pub is_minimal: bool,
}

impl Default for GpuRequest {
    fn default() -> Self {
        Self { backends: interfaces(), allow_software: false, path: None, is_minimal: false }
    }
}

/// The interfaces that are looked at where nobody says which: OpenGL on Linux only with a display, since its
/// libraries write complaints to standard error without one.
fn interfaces() -> Backends {
    let has_display =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    let looks_at_gl = !cfg!(target_os = "linux") || has_display;
    if looks_at_gl { Backends::PRIMARY | Backends::GL } else { Backends::PRIMARY }
}

/// Every interface whose devices can be held beside those of the others, for tests on all that the system has. OpenGL is among
/// them only where no other has a real GPU: NVIDIA's driver (580.159, Linux) never returns where a thread that used its
/// OpenGL ends while another lets go of a Vulkan device.
pub fn all_interfaces() -> &'static [Backends] {
    const ALL: [Backends; 4] = [Backends::VULKAN, Backends::METAL, Backends::DX12, Backends::GL];
    static HAS_OTHERS: OnceLock<bool> = OnceLock::new();
    let others = &ALL[..3];
    let is_real = |&backends| choose(&GpuRequest { backends, ..GpuRequest::default() }).is_ok();
    if *HAS_OTHERS.get_or_init(|| others.iter().any(is_real)) { others } else { &ALL }
}

/// What a device has.
#[derive(Clone, Debug, PartialEq)]
pub struct Tier {
    /// How points become pixels.
    pub path: ProjectPath,
    /// Whether node pages can be mapped and written by loaders.
    pub is_mappable: bool,
    /// Whether passes can be timed.
    pub has_timestamps: bool,
    /// Bytes of a page of node planes, at most.
    pub page_bytes_max: u64,
    /// Bytes of a binding, at most.
    pub binding_bytes_max: u64,
    /// Whether it is a driver on the CPU.
    pub is_software: bool,
}

/// A device with its queue. Clones are handles to the same device. All submitting, mapping and polling is done by
/// one thread, the render thread.
#[derive(Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What it has.
    pub tier: Tier,
    /// Name, driver, interface.
    pub name: String,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    fault: Mutex<Option<GpuError>>,
    gate: Arc<Gate>,
    bytes: AtomicU64,
    peak_bytes: AtomicU64,
    runs: DispatchCount,
}

/// How often kernels were run on a device, and point primitives drawn.
#[derive(Clone, Debug, Default)]
pub struct DispatchCount(Arc<AtomicU64>);

impl DispatchCount {
    /// Counts one.
    pub fn count(&self) {
        self.0.fetch_add(1, Relaxed);
    }
}

/// What those pass who write mapped memory on other threads: shut when the device is lost, before the device
/// gives that memory back.
#[derive(Debug, Default)]
pub struct Gate {
    is_shut: RwLock<bool>,
}

impl Gate {
    /// Holds the memory of mapped buffers as long as what comes back lives; `None` where the device is lost.
    pub fn enter(&self) -> Option<RwLockReadGuard<'_, bool>> {
        let guard = self.is_shut.read().unwrap_or_else(PoisonError::into_inner);
        (!*guard).then_some(guard)
    }

    /// Lets nobody in any more, and waits for those who are.
    fn shut(&self) {
        *self.is_shut.write().unwrap_or_else(PoisonError::into_inner) = true;
    }
}

/// A buffer whose bytes are counted as long as it lives.
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
    /// The best device that fits: discrete before integrated before others before software.
    ///
    /// # Errors
    /// Where there is none, with what was looked at.
    pub fn open(request: &GpuRequest) -> Result<Self, GpuError> {
        let adapter = choose(request)?;
        let descriptor = descriptor(&adapter, request);
        // Before there is a device: to make one only to let it go takes time, and drivers to the end.
        path_of(descriptor.required_features, &adapter.get_info(), request.path)?;
        let made = pollster::block_on(adapter.request_device(&descriptor));
        let (device, queue) = made.map_err(|e| GpuError::NoDevice {
            adapter: adapter.get_info().name,
            fault: e.to_string(),
        })?;
        Self::new(device, queue, request.path)
    }

    /// Over a device that another made (a window), asked for by [`descriptor`].
    ///
    /// # Errors
    /// Where the device lacks what the path asked for needs.
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

    /// What went wrong first, if anything did. Looked at after every frame.
    pub fn fault(&self) -> Option<GpuError> {
        self.state.fault.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What those pass who write mapped memory on other threads.
    pub fn gate(&self) -> Arc<Gate> {
        Arc::clone(&self.state.gate)
    }

    /// Ends the device for all of its handles, as losing it does: the fault says why.
    pub fn end(&self, why: &str) {
        self.state.gate.shut();
        self.state.note(GpuError::Lost(why.into()));
        self.device.destroy();
    }

    /// A buffer, counted.
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

    /// As [`Gpu::buffer`]; where `is_mapped`, it can be written at once.
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

    /// What counts the runs of kernels.
    pub fn runs(&self) -> &DispatchCount {
        &self.state.runs
    }

    /// Dispatches, and draws of point primitives, that were encoded so far.
    pub fn dispatches(&self) -> u64 {
        self.state.runs.0.load(Relaxed)
    }

    /// Bytes of all buffers that live.
    pub fn bytes(&self) -> u64 {
        self.state.bytes.load(Relaxed)
    }

    /// The most bytes of buffers that lived at once.
    pub fn peak_bytes(&self) -> u64 {
        self.state.peak_bytes.load(Relaxed)
    }
}

impl State {
    fn note(&self, fault: GpuError) {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(fault);
    }
}

/// The adapters there are, the best first: name, interface, kind.
pub fn adapters(backends: Backends) -> Vec<wgpu::Adapter> {
    /// Never let go of: with its last instance a driver is unloaded, and NVIDIA's (580.159, Linux) then crashes threads
    /// that have used it and are just ending.
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

/// Whether an adapter is a driver on the CPU: OpenGL does not say it by its kind.
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

/// The device to ask an adapter for: WebGPU's default limits, with buffers as large as there are; and those
/// of the features that the passes know to use.
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

/// How points become pixels on a device with these features, where `asked` does not say.
fn path_of(
    features: Features,
    info: &wgpu::AdapterInfo,
    asked: Option<ProjectPath>,
) -> Result<ProjectPath, GpuError> {
    let atomics = Features::SHADER_INT64 | Features::SHADER_INT64_ATOMIC_MIN_MAX;
    // The pass reads a pixel before it writes it; Metal's 64-bit atomics have a minimum, but no read.
    let has_atomics = features.contains(atomics) && info.backend != wgpu::Backend::Metal;
    match asked {
        Some(ProjectPath::Atomics) if !has_atomics => {
            let fault = format!("{}: has no 64-bit atomics; draw by point primitives", info.name);
            Err(GpuError::Path(fault))
        }
        Some(path) => Ok(path),
        None if has_atomics => Ok(ProjectPath::Atomics),
        None => Ok(ProjectPath::Primitives),
    }
}
