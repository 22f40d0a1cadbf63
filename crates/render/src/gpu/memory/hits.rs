//! The frame buffer: for each pixel the number of its winning point (that of its chunk times
//! `CHUNK_POINTS`, plus its index there) and the bits of its depth, or all ones without a point.
//! Twin: the target of [`crate::passes::project`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::{Counted, Gpu};
use wgpu::BufferUsages;

same_values!(common_hits == crate::passes::project { NO_HIT = EMPTY >> 32 });

/// Bytes of a pixel.
pub const HIT_BYTES: u64 = 8;

/// The frame buffer.
pub struct Hits {
    buffer: Option<Counted>,
    pixels: u32,
    clear: Kernel,
}

impl Hits {
    /// Creates an empty frame buffer.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let clear = Kernel::new(gpu, sources::PROJECT_CLEAR, "main", &[])?;
        Ok(Self { buffer: None, pixels: 0, clear })
    }

    /// Allocates the buffer for a picture of `size`, if it has another size so far.
    ///
    /// # Errors
    /// If memory is refused, or the buffer is larger than a binding of the device.
    pub fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<(), GpuError> {
        let pixels = size[0] * size[1];
        let bytes = u64::from(pixels) * HIT_BYTES;
        if self.buffer.is_none() || self.pixels != pixels {
            (self.buffer, self.pixels) = (None, 0);
            if bytes > gpu.tier.binding_bytes_max {
                return Err(GpuError::Size { width: size[0], height: size[1] });
            }
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
            self.buffer = Some(gpu.buffer("frame buffer", bytes, usage)?);
            self.pixels = pixels;
        }
        Ok(())
    }

    /// The buffer; `None` before the first [`Hits::fit`].
    pub fn buffer(&self) -> Option<&wgpu::Buffer> {
        self.buffer.as_deref()
    }

    /// Encodes the clearing of all pixels.
    pub fn clear(&self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>, uniform: &wgpu::Buffer) {
        if let Some(buffer) = &self.buffer {
            let bind = self.clear.bind(gpu, &[(0, uniform), (1, buffer)]);
            self.clear.dispatch(pass, &bind, groups_of(u64::from(self.pixels)));
        }
    }

    /// Rebuilds the kernel if its shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old one stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.clear.reload(gpu)
    }
}
