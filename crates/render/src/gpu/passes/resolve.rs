//! Resolve on the GPU: the points that won straight to the picture, colours as they are ([`crate::passes::resolve`] is
//! the twin).

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::sources;
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::colour::encode_table;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::picture::GpuPicture;
use crate::plan::FramePlan;
use wgpu::{BufferUsages, ComputePass};

/// Bytes of the words fetched for a pixel, a buffer.
const PIXEL_WORDS_BYTES: u64 = 16;

/// The pass.
pub struct Resolve {
    encode: Counted,
    /// By what gives points their colour.
    kernels: Variants<1>,
    /// Words of the points that won.
    paint: Counted,
    geometry: Counted,
}

impl Resolve {
    /// Creates it on a device.
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

    /// Fills colours and depths of a picture, which has the size of what was won, but not its texture. Adds to
    /// both counts.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &mut GpuLookup,
        won: &WinningPoints<'_>,
        picture: &GpuPicture,
    ) -> Result<(), GpuError> {
        let pixels = u64::from(won.size[0]) * u64::from(won.size[1]);
        fit(gpu, &mut self.paint, pixels)?;
        // Where heights are not coloured one pixel stands for all, since something must be bound.
        fit(gpu, &mut self.geometry, if plan.fetches[0] { pixels } else { 1 })?;
        let [geometry, paint] = [&*self.geometry, &*self.paint];
        lookup.fetch(gpu, pass, won, plan, [geometry, paint])?;
        let kernel = self.kernels.get(gpu, [plan.colour_constants()[1].1])?;
        let buffers = [
            (0, won.uniform),
            (1, lookup.uniform()),
            (2, &*self.encode),
            (3, won.hits),
            (4, won.draws),
            (5, geometry),
            (6, paint),
            (7, &*picture.rgba),
            (8, &*picture.depth),
            (9, won.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), won.groups());
        Ok(())
    }

    /// Gives back the memory of the last picture.
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

/// Makes a buffer for so many pixels; the old one goes first, so that never both are there.
fn fit(gpu: &Gpu, buffer: &mut Counted, pixels: u64) -> Result<(), GpuError> {
    if buffer.size() != pixels * PIXEL_WORDS_BYTES {
        *buffer = words(gpu, 1)?;
        *buffer = words(gpu, pixels)?;
    }
    Ok(())
}
