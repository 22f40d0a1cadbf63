//! Eye-dome lighting on the GPU: darkens pixels that lie behind those around them. Paper:
//! `boucheny2009`, section 3. Twin: [`crate::passes::eye_dome`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::memory::picture::GpuPicture;

same_values!(eye_dome_eye_dome == crate::passes::eye_dome {
    AROUND[..] = AROUND.as_flattened(),
    DARKENING,
    BRIGHTNESS_MIN,
});

/// The pass; its kernel is built when it is first drawn with.
#[derive(Default)]
pub struct EyeDome {
    kernel: Option<Kernel>,
}

impl EyeDome {
    /// Dispatch that darkens the colours of a picture; `uniform` is the frame's.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn dispatch(
        &mut self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        picture: &GpuPicture,
    ) -> Result<Dispatch, GpuError> {
        let kernel = match &mut self.kernel {
            Some(kernel) => kernel,
            none => none.insert(Kernel::new(gpu, sources::EYE_DOME_EYE_DOME, "main", &[])?),
        };
        let resources = [
            (0, uniform.as_entire_binding()),
            (1, picture.depth.as_entire_binding()),
            (2, picture.rgba.as_entire_binding()),
        ];
        Ok(Dispatch::over(gpu, kernel, [picture.width, picture.height], &resources))
    }

    /// Rebuilds the kernel if its shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old one stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernel.as_mut().map_or(Ok(false), |kernel| kernel.reload(gpu))
    }
}
