//! Buffers of a picture in progress: what the guide rays see, sums of light, and what the filter
//! and the picture take.

use crate::gpu::Pixels;
use crate::gpu::world::Unsupported;
use esker_render::gpu::device::Counted;
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError};

/// Bytes of a `vec4<f32>`.
const FOUR: u64 = 16;
/// `vec4<f32>` of the sums of a pixel: direct light, indirect light that is not looked up, and,
/// from the second sample on, the albedo that looks up each of the nine pixels around.
const SUMS: u64 = 2;
const LINKS: u64 = 9;

/// Buffers of a picture.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// What the guide rays see (`shaders/common/places.wgsl`).
    pub(crate) places: Counted,
    /// Incident indirect light of even and odd samples.
    pub(crate) halves: Counted,
    /// Direct light, and which indirect light is looked up (`shaders/trace/direct.wgsl`).
    pub(crate) sums: Counted,
    /// Whether `sums` has room for lookups.
    has_links: bool,
    /// Mean incident indirect light.
    pub(crate) light: Pixels,
    pub(crate) guides: Pixels,
    pub(crate) filtered: Pixels,
    /// Direct and indirect light (`shaders/trace/resolve.wgsl`).
    pub(crate) picture: Counted,
}

impl Buffers {
    /// Buffers for a picture whose sums are zero.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Self, GpuError> {
        let pixels = u64::from(width) * u64::from(height);
        let of = |label, fours: u64| gpu.buffer(label, pixels * fours * FOUR, USAGE);
        let image = |label| Pixels::new(gpu, label, width, height);
        Ok(Self {
            places: of("places", 3)?,
            halves: of("halves", 2)?,
            sums: of("sums", SUMS)?,
            has_links: false,
            light: image("incident light")?,
            guides: image("guides")?,
            filtered: image("filtered light")?,
            picture: of("lit picture", 2)?,
        })
    }

    /// Refuses pictures whose largest buffer for `samples` samples exceeds a binding.
    pub(crate) fn check(gpu: &Gpu, pixels: usize, samples: u32) -> Result<(), Unsupported> {
        let most = if samples > 1 { SUMS + LINKS } else { 3 };
        let fits = pixels as u64 * most * FOUR <= gpu.tier.binding_bytes_max;
        if fits { Ok(()) } else { Err(Unsupported::Size) }
    }

    /// Makes room for lookups, which the second sample begins.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_links(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.has_links {
            return Ok(());
        }
        let bytes = self.sums.size();
        let sums = gpu.buffer("sums", bytes / SUMS * (SUMS + LINKS), USAGE)?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.sums, 0, &sums, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        (self.sums, self.has_links) = (sums, true);
        Ok(())
    }

    /// Bytes of all.
    pub(crate) fn bytes(&self) -> u64 {
        let images = [&self.light, &self.guides, &self.filtered].map(|image| image.buffer.size());
        let others = [&self.places, &self.halves, &self.sums, &self.picture].map(|b| b.size());
        images.iter().chain(&others).sum()
    }
}

const USAGE: BufferUsages =
    BufferUsages::STORAGE.union(BufferUsages::COPY_SRC).union(BufferUsages::COPY_DST);
