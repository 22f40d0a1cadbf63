//! What the scene is drawn on: the window's graphics device, so that the picture is not copied, or
//! the CPU.

use crate::args::Backend;
use crate::settings::Settings;
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;
use esker_engine::draw::options::{Gpu, Options, descriptor};
use esker_engine::machine::backend::{self, GpuRequest};

/// What paints the window.
#[derive(Clone, Default)]
pub struct WindowPainter {
    /// Name of the adapter, or `CPU`.
    pub name: String,
    /// Device and queue of egui, if a graphics driver paints.
    pub driver: Option<RenderState>,
}

/// What the scene is drawn on.
#[derive(Clone, Default)]
pub struct Device {
    backend: backend::Backend,
    gpu: Option<Gpu>,
}

/// Describes the device to request from an adapter: one that the engine can draw on if the adapter
/// has the limits for that, else one that suffices for egui.
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

impl WindowPainter {
    /// A window that a graphics driver paints.
    pub fn driver(state: &RenderState) -> Self {
        let info = state.adapter.get_info();
        let name = format!("{} ({:?})", info.name, info.backend);
        Self { name, driver: Some(state.clone()) }
    }

    /// Chooses what the scene is drawn on in this window, as the user requests it.
    pub fn device(&self, wanted: Backend) -> Device {
        let backend = match wanted {
            Backend::Auto => backend::Backend::Auto,
            Backend::Gpu => backend::Backend::Gpu,
            Backend::Cpu => backend::Backend::Cpu,
        };
        let gpu = self.driver.as_ref().filter(|_| wanted != Backend::Cpu).and_then(gpu);
        // On another device than the window's, each picture of a GPU is copied through main memory,
        // so that is done only on request.
        let backend =
            if gpu.is_none() && wanted == Backend::Auto { backend::Backend::Cpu } else { backend };
        Device { backend, gpu }
    }
}

/// Wraps the window's device for the engine; `None` if the engine cannot draw on it.
fn gpu(state: &RenderState) -> Option<Gpu> {
    let is_able = wgpu::Limits::default().check_limits(&state.device.limits());
    is_able.then(|| Gpu::new(state.device.clone(), state.queue.clone(), None).ok())?
}

impl Device {
    /// Options of a session with these settings, for pictures of at most `size` pixels.
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
            shrinks_lit: true,
            ..Options::default()
        }
    }
}
