//! Copies the colours of a picture without its margin from its buffer to its texture, after dots
//! are drawn.

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::sources;
use crate::gpu::memory::picture::GpuPicture;
use wgpu::BindingResource;

/// The pass.
pub struct Store {
    kernel: Kernel,
}

impl Store {
    /// Builds the kernel.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { kernel: Kernel::new(gpu, sources::PICTURE_STORE, "main", &[])? })
    }

    /// Dispatch that fills the texture of a picture; `uniform` is the frame's.
    pub fn dispatch(&self, gpu: &Gpu, uniform: &wgpu::Buffer, picture: &GpuPicture) -> Dispatch {
        let view = picture.texture.create_view(&Default::default());
        let resources = [
            (0, uniform.as_entire_binding()),
            (1, picture.rgba.as_entire_binding()),
            (2, BindingResource::TextureView(&view)),
        ];
        Dispatch::over(gpu, &self.kernel, [picture.width, picture.height], &resources)
    }
}
