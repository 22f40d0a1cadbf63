//! Eye-dome lighting on the GPU: darkens pixels that lie behind those around them. Paper:
//! `boucheny2009`, section 3. Twin: [`crate::passes::eye_dome`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::variants::Variants;
use crate::gpu::memory::picture::GpuPicture;

same_values!(eye_dome_eye_dome == crate::passes::eye_dome {
    AROUND[..] = AROUND.as_flattened(),
    DARKENING,
    BRIGHTNESS_MIN,
});

/// The pass.
pub struct EyeDome {
    /// Variants: whether only the pixels of dots are darkened.
    kernels: Variants<1>,
}

impl Default for EyeDome {
    fn default() -> Self {
        Self { kernels: Variants::new(sources::EYE_DOME_EYE_DOME, ["DOTS_ONLY"]) }
    }
}

impl EyeDome {
    /// Dispatch that darkens the colours of a picture, if there are `dots` only at their pixels;
    /// `uniform` is the frame's.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn dispatch(
        &mut self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        picture: &GpuPicture,
        dots: Option<&wgpu::Buffer>,
    ) -> Result<Dispatch, GpuError> {
        let kernel = self.kernels.get(gpu, [u32::from(dots.is_some())])?;
        let resources = [
            (0, uniform.as_entire_binding()),
            (1, picture.depth.as_entire_binding()),
            (2, picture.rgba.as_entire_binding()),
            // Bound in any case; only read where there are dots.
            (3, dots.unwrap_or(&picture.depth).as_entire_binding()),
        ];
        Ok(Dispatch::over(gpu, kernel, [picture.width, picture.height], &resources))
    }

    /// Rebuilds the kernels if their shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old one stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernels.reload(gpu)
    }
}
