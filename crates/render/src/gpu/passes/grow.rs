//! Grow on the GPU: draws points as dots of more than a pixel, into a second frame buffer. Adaptive
//! dots have sizes from the words of the points. Before that, split parts dots from the points of
//! surfaces. Twins: [`crate::passes::grow`], [`crate::passes::split`].

use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::hits::HIT_BYTES;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::passes::split::CELL_PX;
use crate::plan::FramePlan;
use wgpu::{BufferUsages, ComputePass};

same_values!(grow_sizes == crate::passes::grow { ADAPTIVE_FACTOR, PIXEL_RADIUS });
same_values!(grow_sizes == crate::frame { ADAPTIVE_MAX });
same_values!(grow_sizes == crate::passes::split {
    SURFACE_PX[..] = SURFACE_PX,
    WIDE_PX,
});
same_values!(grow_cells == crate::passes::split { CELL_PX = CELL_PX as u32 });
same_values!(grow_support == crate::passes::split {
    CELL_PX = CELL_PX as u32,
    SUPPORTERS,
    SUPPORT_REACH,
    SUPPORT_OFF,
    SUPPORT_COS,
});

/// Bytes of the nearest wide point of a cell.
const CELL_BYTES: u64 = 4;
/// Threads of a workgroup that fills cells.
const CELL_THREADS: u32 = 64;
/// Bytes of the radius of a dot.
const RADIUS_BYTES: u64 = 4;

/// The pass.
pub struct Grow {
    /// Variants: whether dots are parted from surfaces, and whether there are normals.
    sizes: Variants<2>,
    /// The nearest wide points of cells, and the parting of those without support.
    nearest: Variants<0>,
    support: Variants<0>,
    /// Variants: whether dots have sizes of their own.
    kernels: Variants<1>,
    radii: Counted,
    /// Points that are parted from surfaces.
    dots: Counted,
    /// Nearest wide point of each cell.
    cells: Counted,
    grown: Counted,
}

impl Grow {
    /// Creates the pass, without memory for a picture.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            sizes: Variants::new(sources::GROW_SIZES, ["SPLITS", "NORMALS"]),
            nearest: Variants::new(sources::GROW_CELLS, []),
            support: Variants::new(sources::GROW_SUPPORT, []),
            kernels: Variants::new(sources::GROW_GROW, ["ADAPTS"]),
            radii: buffer(gpu, RADIUS_BYTES)?,
            dots: buffer(gpu, HIT_BYTES)?,
            cells: buffer(gpu, CELL_BYTES)?,
            grown: buffer(gpu, HIT_BYTES)?,
        })
    }

    /// Encodes split: moves the points that are dots out of the frame buffer of `winners`. `words`
    /// are `geometry` and `paint` of its points. Adds to the count of pixels with a point.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn split(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &GpuLookup,
        winners: &WinningPoints<'_>,
        words: [&wgpu::Buffer; 2],
    ) -> Result<(), GpuError> {
        let pixels = pixels_of(winners);
        fit(gpu, &mut self.radii, RADIUS_BYTES * pixels)?;
        fit(gpu, &mut self.dots, HIT_BYTES * pixels)?;
        self.size(gpu, pass, plan, lookup, winners, words)?;
        if !plan.carries_normals {
            return Ok(());
        }
        let [columns, rows] = winners.size.map(|side| side.div_ceil(CELL_PX as u32));
        fit(gpu, &mut self.cells, CELL_BYTES * u64::from(columns) * u64::from(rows))?;
        let kernel = self.nearest.get(gpu, [])?;
        let buffers =
            [(0, winners.uniform), (1, winners.hits), (2, &*self.dots), (3, &*self.cells)];
        let groups = [(columns * rows).div_ceil(CELL_THREADS), 1, 1];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), groups);
        let kernel = self.support.get(gpu, [])?;
        let [geometry, paint] = words;
        let buffers = [
            (0, winners.uniform),
            (1, winners.hits),
            (2, winners.draws),
            (3, geometry),
            (4, paint),
            (5, &*self.cells),
            (6, &*self.dots),
            (7, winners.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), winners.groups());
        Ok(())
    }

    /// Encodes the filling of [`Grow::hits`] from those of `winners`, or from the dots of
    /// [`Grow::split`] if the plan has that. `words` are `geometry` and `paint` of the points of
    /// `winners`, if dots have sizes of their own.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &GpuLookup,
        winners: &WinningPoints<'_>,
        words: [&wgpu::Buffer; 2],
    ) -> Result<(), GpuError> {
        let pixels = pixels_of(winners);
        fit(gpu, &mut self.grown, HIT_BYTES * pixels)?;
        if !plan.mixes_dots() {
            // Dots of one size have no radii of their own; a buffer of one pixel is bound.
            fit(gpu, &mut self.radii, RADIUS_BYTES * if plan.adapts { pixels } else { 1 })?;
            fit(gpu, &mut self.dots, HIT_BYTES)?;
            if plan.adapts {
                self.size(gpu, pass, plan, lookup, winners, words)?;
            }
        }
        let hits = if plan.mixes_dots() { &*self.dots } else { winners.hits };
        let kernel = self.kernels.get(gpu, [u32::from(plan.adapts)])?;
        let buffers = [winners.uniform, hits, &*self.radii, &*self.grown];
        let resources: Vec<_> = (0..).zip(buffers.map(wgpu::Buffer::as_entire_binding)).collect();
        Dispatch::over(gpu, kernel, winners.size, &resources).run(pass);
        Ok(())
    }

    /// Encodes the filling of the radii, and the parting of dots if the plan has that.
    fn size(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &GpuLookup,
        winners: &WinningPoints<'_>,
        [geometry, paint]: [&wgpu::Buffer; 2],
    ) -> Result<(), GpuError> {
        let kernel = self.sizes.get(gpu, plan.sizes_constants().map(|(_, value)| value))?;
        let buffers = [
            (0, winners.uniform),
            (1, lookup.uniform()),
            (2, winners.hits),
            (3, winners.draws),
            (4, lookup.octree()),
            (5, geometry),
            (6, paint),
            (7, &*self.radii),
            (8, &*self.dots),
            (9, winners.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), winners.groups());
        Ok(())
    }

    /// The frame buffer of dots.
    pub fn hits(&self) -> &wgpu::Buffer {
        &self.grown
    }

    /// Releases the memory of the last picture.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn release(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        fit(gpu, &mut self.radii, RADIUS_BYTES)?;
        fit(gpu, &mut self.dots, HIT_BYTES)?;
        fit(gpu, &mut self.cells, CELL_BYTES)?;
        fit(gpu, &mut self.grown, HIT_BYTES)
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let sizes = self.sizes.reload(gpu)? | self.kernels.reload(gpu)?;
        Ok(sizes | self.nearest.reload(gpu)? | self.support.reload(gpu)?)
    }
}

fn pixels_of(winners: &WinningPoints<'_>) -> u64 {
    u64::from(winners.size[0]) * u64::from(winners.size[1])
}

fn buffer(gpu: &Gpu, bytes: u64) -> Result<Counted, GpuError> {
    gpu.buffer("dots of points", bytes, BufferUsages::STORAGE)
}

/// Allocates a buffer of this size. The old one is released first, so that both never exist at
/// once.
fn fit(gpu: &Gpu, to: &mut Counted, bytes: u64) -> Result<(), GpuError> {
    if to.size() != bytes {
        *to = buffer(gpu, HIT_BYTES)?;
        *to = buffer(gpu, bytes)?;
    }
    Ok(())
}
