//! Overlay on the GPU: draws dots over a finished picture of surfaces. Twin:
//! [`crate::passes::overlay`].

use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::sources;
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::colour::encode_table;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::picture::GpuPicture;
use crate::plan::FramePlan;
use wgpu::ComputePass;

/// The pass.
pub struct Overlay {
    encode: Counted,
    /// Variants: whether normals are read, whether there are highlights, and the source of colours.
    kernels: Variants<3>,
}

impl Overlay {
    /// Creates the table of the pass.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let names = ["NORMALS", "SHINES", "COLOUR"];
        let kernels = Variants::new(sources::OVERLAY_OVERLAY, names);
        Ok(Self { encode: encode_table(gpu)?, kernels })
    }

    /// Encodes the drawing of dots, whose `geometry` and `paint` are fetched, to the colours and
    /// depths of a picture, but not to its texture. Removes hidden dots.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    #[allow(clippy::too_many_arguments, reason = "each input of a pass has its own argument")]
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &GpuLookup,
        dots: &WinningPoints<'_>,
        [geometry, paint]: [&wgpu::Buffer; 2],
        picture: &GpuPicture,
    ) -> Result<(), GpuError> {
        let kernel = self.kernels.get(gpu, plan.overlay_constants().map(|(_, value)| value))?;
        let buffers = [
            dots.uniform,
            lookup.uniform(),
            &*self.encode,
            dots.hits,
            dots.draws,
            geometry,
            paint,
            &*picture.rgba,
            &*picture.depth,
        ];
        let resources: Vec<_> = (0..).zip(buffers.map(wgpu::Buffer::as_entire_binding)).collect();
        Dispatch::over(gpu, kernel, dots.size, &resources).run(pass);
        Ok(())
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernels.reload(gpu)
    }
}
