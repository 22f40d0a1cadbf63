//! Buffers that the passes between push and the picture read and write, and helpers that bind them.

use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::sources::constants::common_radii::RADII_TILE;
use crate::gpu::device::shader::sources::constants::common_turns::{TILE, TURNS};
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pyramid::{GpuLevel, GpuPyramid};
use wgpu::BufferUsages;

/// Buffers of the passes after push.
pub struct SurfaceTarget<'a> {
    /// The frame's uniform.
    pub uniform: &'a wgpu::Buffer,
    /// The pyramid, pushed.
    pub pyramid: &'a GpuPyramid,
    /// The picture.
    pub picture: &'a GpuPicture,
    /// Bits of `shaders/common/marks.wgsl`, a word a pixel.
    pub marks: &'a Counted,
    /// Depth after fill_holes, `f32` a pixel, from which [`crate::gpu::passes::silhouette`] makes
    /// the picture's. Afterwards it holds depth smoothed along rows, and then
    /// [`SurfaceTarget::shaded`].
    pub depth: &'a Counted,
    /// Source of each pixel, a word a pixel (`shaders/common/source.wgsl`).
    pub sources: &'a Counted,
    /// Sources between two halves of a turn; afterwards smooth depth.
    pub spare: &'a Counted,
    /// Colours before antialiasing, sRGB bytes, a word a pixel.
    pub shaded: &'a Counted,
    /// State of the turns of silhouette.
    pub turns: &'a Turns,
    /// Mean radii of discs.
    pub radii: &'a Radii,
}

impl<'a> SurfaceTarget<'a> {
    /// Level 0 of the pyramid.
    pub fn base(&self) -> &'a GpuLevel {
        &self.pyramid.levels[0]
    }

    /// Binds a kernel over the picture: the uniform at binding 0, then `buffers`.
    pub(crate) fn dispatch(&self, gpu: &Gpu, kernel: &Kernel, buffers: &[&Counted]) -> Dispatch {
        let size = [self.picture.width, self.picture.height];
        Dispatch::over(gpu, kernel, size, &self.resources(buffers))
    }

    /// The uniform and `buffers`, with their bindings.
    pub(crate) fn resources<'b>(
        &'b self,
        buffers: &[&'b Counted],
    ) -> Vec<(u32, wgpu::BindingResource<'b>)> {
        let all = std::iter::once(self.uniform).chain(buffers.iter().map(|b| &***b));
        (0..).zip(all.map(wgpu::Buffer::as_entire_binding)).collect()
    }
}

/// Mean radii of discs (`shaders/smooth_depth/tiles.wgsl` and `corners.wgsl`).
pub struct Radii {
    /// Sum and number of the samples of each tile, two words a tile.
    pub(crate) tiles: Counted,
    /// Radius at each corner of a tile, `f32` each.
    pub(crate) corners: Counted,
    /// Greatest radius: the structure `Smoothing` of `shaders/common/smoothing.wgsl`.
    pub(crate) most: Counted,
}

impl Radii {
    /// Creates the buffers for a picture.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let buffer = |words: u64, usage| {
            gpu.buffer("radii of discs", words * 4, BufferUsages::STORAGE | usage)
        };
        let count = |[across, down]: [u32; 2]| u64::from(across) * u64::from(down);
        Ok(Self {
            tiles: buffer(count(size.map(|n| n.div_ceil(RADII_TILE))) * 2, BufferUsages::empty())?,
            corners: buffer(count(Self::corners(size)), BufferUsages::COPY_DST)?,
            most: buffer(4, BufferUsages::UNIFORM)?,
        })
    }

    /// Corners of tiles across and down, for a picture of `size` pixels.
    pub(crate) fn corners(size: [u32; 2]) -> [u32; 2] {
        size.map(|n| n.div_ceil(RADII_TILE) + 1)
    }
}

/// State of the turns of silhouette, which `shaders/silhouette/start.wgsl` resets.
pub struct Turns {
    /// The structure `Turns` of `shaders/common/turns.wgsl`.
    pub(crate) turns: Counted,
    /// Arguments of the indirect dispatch of each turn, four words each.
    pub(crate) groups: Counted,
    /// Whether a pixel of a tile has been removed, a word a tile.
    pub(crate) gone: Counted,
    /// Tiles of a turn.
    pub(crate) tiles: Counted,
}

impl Turns {
    /// Creates the buffers for a picture.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let [across, down] = size.map(|n| u64::from(n.div_ceil(TILE)));
        let buffer = |words: u64, usage| {
            gpu.buffer("turns of silhouette", words * 4, BufferUsages::STORAGE | usage)
        };
        Ok(Self {
            turns: buffer(u64::from(TURNS) * 2, BufferUsages::empty())?,
            groups: buffer(u64::from(TURNS) * 4, BufferUsages::INDIRECT)?,
            gone: buffer(across * down, BufferUsages::empty())?,
            tiles: buffer(across * down, BufferUsages::empty())?,
        })
    }
}
