//! The picture in GPU memory: the buffers that the passes write, and the texture that a window
//! shows.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Counted, Gpu};
use wgpu::{BufferUsages, TextureUsages};

/// A picture; its buffers include the margin ([`crate::picture::margin`]).
#[derive(Debug)]
pub struct GpuPicture {
    /// Width of the buffers, pixels.
    pub width: u32,
    /// Height of the buffers, pixels.
    pub height: u32,
    /// Width of the margin on each side, pixels.
    pub margin_px: u32,
    /// sRGB with straight alpha, a word a pixel, red lowest.
    pub rgba: Counted,
    /// Linear eye depth, `f32` a pixel; infinite without a surface.
    pub depth: Counted,
    /// The colours without the margin, `rgba8unorm`.
    pub texture: wgpu::Texture,
}

impl GpuPicture {
    /// Allocates a picture of `size` pixels, margin included; at least one pixel.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu, size: [u32; 2], margin_px: u32) -> Result<Self, GpuError> {
        let [width, height] = size.map(|side| side.max(1));
        let [inner_width, inner_height] = [width, height].map(|side| side - 2 * margin_px);
        let bytes = u64::from(width) * u64::from(height) * 4;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d {
                width: inner_width,
                height: inner_height,
                depth_or_array_layers: 1,
            },
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
            margin_px,
            rgba: gpu.buffer("picture colours", bytes, usage)?,
            depth: gpu.buffer("picture depths", bytes, usage)?,
            texture,
        })
    }
}
