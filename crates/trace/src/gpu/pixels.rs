//! Pictures in GPU memory: four floats a pixel, row by row, in one buffer, so that a kernel binds
//! few buffers.

use crate::Image;
use bytemuck::cast_slice;
use esker_render::gpu::device::{Counted, readback};
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError};

/// A picture of four floats a pixel: three channels of light and 1 where there is a surface, else
/// 0; or normals scaled to [0, 1] and depth.
#[derive(Debug)]
pub struct Pixels {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// The values.
    pub buffer: Counted,
}

impl Pixels {
    /// A picture of zeros.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu, label: &str, width: u32, height: u32) -> Result<Self, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let bytes = u64::from(width) * u64::from(height) * 16;
        Ok(Self { width, height, buffer: gpu.buffer(label, bytes, usage)? })
    }

    /// Uploads values, one for each pixel.
    pub fn write(&self, gpu: &Gpu, values: &[[f32; 4]]) {
        let pixels = self.width as usize * self.height as usize;
        gpu.queue.write_buffer(&self.buffer, 0, cast_slice(&values[..pixels.min(values.len())]));
    }

    /// Reads all values, and waits for them.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Image<4>, GpuError> {
        let bytes = u64::from(self.width) * u64::from(self.height) * 16;
        let read = readback::read(gpu, &[(&self.buffer, bytes)])?;
        let values = read.iter().flat_map(|bytes| bytes.as_chunks::<16>().0);
        let mut image = Image::new(self.width as usize, self.height as usize);
        for (i, value) in values.enumerate() {
            for (c, plane) in image.planes.iter_mut().enumerate() {
                let bytes = std::array::from_fn(|b| value[4 * c + b]);
                plane[i] = f32::from_le_bytes(bytes);
            }
        }
        Ok(image)
    }
}
