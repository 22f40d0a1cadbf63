//! The image pyramid in GPU memory, with the planes of [`crate::picture::pyramid`]. Each plane of
//! each level is a buffer of its own, so that none exceeds the size of a binding.

use crate::gpu::device::dispatch::fixed_uniform;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{same_layout, same_values};
use crate::gpu::device::{Counted, Gpu};
use crate::picture::pyramid::Planes;
use bytemuck::{Pod, Zeroable};
use wgpu::BufferUsages;

same_values!(common_plane == crate::picture::pyramid { FITTED, NORMAL = NORMALS });
same_values!(common_tangent == crate::passes::tangent {
    SLOPE_MAX,
    FACTOR_MAX,
    LEAST = f32::MIN_POSITIVE,
});

/// The uniform of a level (`shaders/common/level.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct LevelShape {
    width: u32,
    height: u32,
    edge_px: f32,
    unused: u32,
}

same_layout!(LevelShape { width, height, edge_px });

/// One level, with the planes of [`crate::picture::pyramid::Level`].
#[derive(Debug)]
pub struct GpuLevel {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Edge of a pixel, in pixels of level 0.
    pub edge_px: f32,
    /// Uniform of width, height and edge.
    pub shape: Counted,
    /// `vec4<f32>` a pixel.
    pub front: Counted,
    /// `vec4<f32>` a pixel.
    pub tint: Counted,
    /// `f32` a pixel.
    pub depth: Counted,
    /// Normals, `vec4<f32>` a pixel, or tilts, `vec2<f32>` a pixel; a single pixel if there are
    /// neither, so that a buffer can be bound.
    pub plane: Counted,
}

/// All levels, that of the picture first.
#[derive(Debug, Default)]
pub struct GpuPyramid {
    /// The levels.
    pub levels: Vec<GpuLevel>,
    /// Planes that pixels have room for.
    pub planes: Planes,
}

impl GpuPyramid {
    /// Allocates the levels for a picture, if they have another shape so far. Whether the buffers
    /// are new.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn fit(
        &mut self,
        gpu: &Gpu,
        width: u32,
        height: u32,
        planes: Planes,
    ) -> Result<bool, GpuError> {
        let fits = self.levels.first().is_some_and(|l| (l.width, l.height) == (width, height));
        if fits && self.planes == planes {
            return Ok(false);
        }
        // The old buffers are released first, so that both never exist at once.
        *self = Self { levels: Vec::new(), planes };
        let (mut w, mut h, mut edge_px) = (width.max(1), height.max(1), 1.0);
        loop {
            let pixels = u64::from(w) * u64::from(h);
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            if pixels * 16 > gpu.tier.binding_bytes_max {
                return Err(GpuError::Memory { what: "the pyramid".into(), bytes: pixels * 16 });
            }
            let plane = |name: &str, bytes: u64| gpu.buffer(name, bytes, usage);
            self.levels.push(GpuLevel {
                width: w,
                height: h,
                edge_px,
                shape: shape(gpu, LevelShape { width: w, height: h, edge_px, unused: 0 })?,
                front: plane("pyramid front", pixels * 16)?,
                tint: plane("pyramid tint", pixels * 16)?,
                depth: plane("pyramid depth", pixels * 4)?,
                plane: plane("pyramid plane", (pixels * 4 * planes.values() as u64).max(16))?,
            });
            if w == 1 && h == 1 {
                return Ok(true);
            }
            (w, h, edge_px) = (w.div_ceil(2), h.div_ceil(2), edge_px * 2.0);
        }
    }
}

fn shape(gpu: &Gpu, shape: LevelShape) -> Result<Counted, GpuError> {
    fixed_uniform(gpu, "pyramid shape", bytemuck::bytes_of(&shape))
}
