//! What the scene is drawn on: the window's own graphics device, so that the picture needs no copy, or the CPU.

use crate::args::Backend;
use crate::settings::Settings;
use eframe::egui_wgpu::RenderState;
use esker_engine::backend;
use esker_engine::session::Options;

/// Who shows the window.
#[derive(Clone, Default)]
pub struct ShownBy {
    /// Its name.
    pub name: String,
    /// Its device, where it is a graphics driver.
    pub painter: Option<RenderState>,
}

/// What the scene is drawn on.
#[derive(Clone)]
pub struct Device {
    backend: backend::Backend,
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
        let _ = wanted;
        Device { backend: backend::Backend::Cpu }
    }
}

impl Device {
    /// Of a session with these settings.
    pub fn options(&self, settings: &Settings, size: [u32; 2]) -> Options {
        Options { backend: self.backend, ..settings.options(size) }
    }
}
