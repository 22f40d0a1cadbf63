//! What the scene is drawn on: the window's own graphics device, so that the picture needs no copy,
//! or the CPU.

use crate::args::Backend;
use crate::settings::Settings;
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;
use esker_engine::draw::options::{Gpu, Options, descriptor};
use esker_engine::machine::backend::{self, GpuRequest};

/// Who shows the window.
#[derive(Clone, Default)]
pub struct ShownBy {
    /// Its name.
    pub name: String,
    /// Its device, where it is a graphics driver.
    pub painter: Option<RenderState>,
}

/// What the scene is drawn on.
#[derive(Clone, Default)]
pub struct Device {
    backend: backend::Backend,
    gpu: Option<Gpu>,
}

/// The device to ask an adapter for: one that the engine can draw on, too, where the adapter has
/// what that takes.
pub fn device_of(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    let has = adapter.limits();
    if wgpu::Limits::default().check_limits(&has) {
        return descriptor(adapter, &GpuRequest::default());
    }
    wgpu::DeviceDescriptor {
        label: Some("esker-view"),
        required_limits: wgpu::Limits::downlevel_webgl2_defaults().using_resolution(has),
        ..Default::default()
    }
}

impl ShownBy {
    /// A graphics driver.
    pub fn driver(state: &RenderState) -> Self {
        let info = state.adapter.get_info();
        let name = format!("{} ({:?})", info.name, info.backend);
        Self { name, painter: Some(state.clone()) }
    }

    /// What the scene is drawn on in this window, where the user wants this.
    pub fn device(&self, wanted: Backend) -> Device {
        let backend = match wanted {
            Backend::Auto => backend::Backend::Auto,
            Backend::Gpu => backend::Backend::Gpu,
            Backend::Cpu => backend::Backend::Cpu,
        };
        let gpu = self.painter.as_ref().filter(|_| wanted != Backend::Cpu).and_then(gpu);
        // Without the window's device a GPU's picture would go through main memory every frame:
        // only on demand.
        let backend =
            if gpu.is_none() && wanted == Backend::Auto { backend::Backend::Cpu } else { backend };
        Device { backend, gpu }
    }
}

/// The window's device as the engine's; `None` where the engine cannot draw on it.
fn gpu(state: &RenderState) -> Option<Gpu> {
    let is_able = wgpu::Limits::default().check_limits(&state.device.limits());
    is_able.then(|| Gpu::new(state.device.clone(), state.queue.clone(), None).ok())?
}

impl Device {
    /// Of a session with these settings.
    pub fn options(&self, settings: &Settings, size: [u32; 2]) -> Options {
        let gpu = GpuRequest {
            allow_software: self.backend == backend::Backend::Gpu,
            ..GpuRequest::default()
        };
        Options {
            settings: settings.clone(),
            backend: self.backend,
            gpu,
            device: self.gpu.clone(),
            size,
            ..Options::default()
        }
    }
}
