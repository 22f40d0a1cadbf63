//! Stands in for the drawer of lit frames in programs that were built without light: there is none.

use crate::light::check_built;
use crate::light::settings::LightSettings;
use crate::light::status::LitStatus;
use anyhow::{Result, bail};
use esker_render::gpu::Gpu;
use esker_render::{Frame, Picture};

/// A drawer of lit frames, which no value can be.
pub(crate) enum Progressive {}

/// The drawer on the CPU.
pub(crate) type CpuProgressive = Progressive;
/// The drawer on a GPU.
pub(crate) type GpuProgressive = Progressive;

impl Progressive {
    /// Refuses to light.
    ///
    /// # Errors
    /// Always.
    pub(crate) fn on_cpu(_: &LightSettings, _: u64) -> Result<Self> {
        check_built()?;
        bail!("this program does not light")
    }

    /// Refuses to light.
    ///
    /// # Errors
    /// Always.
    pub(crate) fn on_gpu(_: &Gpu, settings: &LightSettings, splats_max: u64) -> Result<Self> {
        Self::on_cpu(settings, splats_max)
    }

    pub(crate) fn status(&self) -> LitStatus {
        match *self {}
    }

    pub(crate) fn is_converged(&self) -> bool {
        match *self {}
    }

    pub(crate) fn draw<P, M: ?Sized>(
        &mut self,
        _: &Frame<'_, P>,
        _: &M,
        _: u64,
        _: &LightSettings,
        _: &mut Picture,
    ) -> Result<()> {
        match *self {}
    }
}
