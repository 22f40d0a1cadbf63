//! Resolve on the GPU: writes the colours and depths of the winning points to the picture. Twin:
//! [`crate::passes::resolve`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::sources;
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::colour::encode_table;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::picture::GpuPicture;
use crate::plan::FramePlan;
use wgpu::{BufferUsages, ComputePass};

/// Bytes a pixel of each buffer of fetched words.
const PIXEL_WORDS_BYTES: u64 = 16;

/// The pass.
pub struct Resolve {
    encode: Counted,
    /// Variants: the source of colours.
    kernels: Variants<1>,
    /// Words of the winning points (`shaders/common/lookup.wgsl`).
    paint: Counted,
    geometry: Counted,
}

impl Resolve {
    /// Creates the tables of the pass.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            encode: encode_table(gpu)?,
            kernels: Variants::new(sources::RESOLVE_RESOLVE, ["COLOUR"]),
            paint: words(gpu, 1)?,
            geometry: words(gpu, 1)?,
        })
    }

    /// Encodes the filling of the colours and depths of a picture, which has the size of the frame
    /// buffer, but not of its texture. Adds to both counts of pixels.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &mut GpuLookup,
        winners: &WinningPoints<'_>,
        picture: &GpuPicture,
    ) -> Result<(), GpuError> {
        self.fetch(gpu, pass, plan, lookup, winners)?;
        let [geometry, paint] = [&*self.geometry, &*self.paint];
        let kernel = self.kernels.get(gpu, [plan.colour_constants()[1].1])?;
        let buffers = [
            (0, winners.uniform),
            (1, lookup.uniform()),
            (2, &*self.encode),
            (3, winners.hits),
            (4, winners.draws),
            (5, geometry),
            (6, paint),
            (7, &*picture.rgba),
            (8, &*picture.depth),
            (9, winners.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), winners.groups());
        Ok(())
    }

    /// Encodes the filling of [`Resolve::words`].
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn fetch(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &mut GpuLookup,
        winners: &WinningPoints<'_>,
    ) -> Result<(), GpuError> {
        let pixels = u64::from(winners.size[0]) * u64::from(winners.size[1]);
        fit(gpu, &mut self.paint, pixels)?;
        // If nothing needs positions, a buffer of one pixel is bound in their place.
        fit(gpu, &mut self.geometry, if plan.fetches[0] { pixels } else { 1 })?;
        lookup.fetch(gpu, pass, winners, plan, self.words())
    }

    /// Buffers of the words of the winning points: `geometry` and `paint`.
    pub fn words(&self) -> [&wgpu::Buffer; 2] {
        [&self.geometry, &self.paint]
    }

    /// Releases the memory of the last picture.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn release(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        fit(gpu, &mut self.paint, 1)?;
        fit(gpu, &mut self.geometry, 1)
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernels.reload(gpu)
    }
}

fn words(gpu: &Gpu, pixels: u64) -> Result<Counted, GpuError> {
    gpu.buffer("words of points", pixels * PIXEL_WORDS_BYTES, BufferUsages::STORAGE)
}

/// Allocates a buffer for `pixels` pixels. The old one is released first, so that both never exist
/// at once.
fn fit(gpu: &Gpu, buffer: &mut Counted, pixels: u64) -> Result<(), GpuError> {
    if buffer.size() != pixels * PIXEL_WORDS_BYTES {
        *buffer = words(gpu, 1)?;
        *buffer = words(gpu, pixels)?;
    }
    Ok(())
}
