//! The picture in GPU memory: what the passes write, and the texture that a window shows.

use super::device::{Counted, Gpu};
use super::error::GpuError;
use wgpu::{BufferUsages, TextureUsages};

/// A picture.
#[derive(Debug)]
pub struct GpuPicture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// sRGB with straight alpha, a word a pixel, red lowest.
    pub rgba: Counted,
    /// Linear eye depth, `f32` a pixel; infinite where nothing is.
    pub depth: Counted,
    /// The same colours, `rgba8unorm`.
    pub texture: wgpu::Texture,
}

impl GpuPicture {
    /// Room for a picture; at least one pixel.
    ///
    /// # Errors
    /// Where memory is refused.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Self, GpuError> {
        let (width, height) = (width.max(1), height.max(1));
        let bytes = u64::from(width) * u64::from(height) * 4;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: TextureUsages::STORAGE_BINDING
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC
                | TextureUsages::COPY_DST,
            view_formats: &[],
        });
        Ok(Self {
            width,
            height,
            rgba: gpu.buffer("picture colours", bytes, usage)?,
            depth: gpu.buffer("picture depths", bytes, usage)?,
            texture,
        })
    }
}
