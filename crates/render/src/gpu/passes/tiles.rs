//! Depth tiles of a finished picture, by which the LOD thread finds nodes that are hidden in the
//! next views. Their buffer is small and is read back some frames later. Twin:
//! [`esker_lod::tiles_of`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::sources;
use crate::gpu::device::{Counted, Gpu};
use esker_lod::DepthTile;
use esker_lod::TILES;
use wgpu::{Buffer, BufferUsages, ComputePass};

/// Bytes of all tiles.
pub const TILES_BYTES: u64 = (TILES * TILES * 8) as u64;

/// The pass.
pub struct Tiles {
    kernel: Kernel,
    buffer: Counted,
}

impl Tiles {
    /// Builds the kernel and allocates the tiles.
    ///
    /// # Errors
    /// If the driver refuses the shader or memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let constants = [("TILES", TILES as f64)];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        Ok(Self {
            kernel: Kernel::new(gpu, sources::TILES_TILES, "main", &constants)?,
            buffer: gpu.buffer("depth tiles", TILES_BYTES, usage)?,
        })
    }

    /// Encodes the filling of the tiles from the depths of a picture; the uniform has its size.
    pub fn encode(&self, gpu: &Gpu, pass: &mut ComputePass<'_>, uniform: &Buffer, depth: &Buffer) {
        let buffers = [(0, uniform), (1, depth), (2, &*self.buffer)];
        let bind = self.kernel.bind(gpu, &buffers);
        self.kernel.dispatch(pass, &bind, [TILES as u32, TILES as u32, 1]);
    }

    /// Buffer of the tiles, [`TILES_BYTES`] long, whose bytes [`tiles_from`] reads.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Rebuilds the kernel if its shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernel.reload(gpu)
    }
}

/// Reads the tiles from the bytes of their buffer.
pub fn tiles_from(bytes: &[u8]) -> Vec<DepthTile> {
    let tile = |b: &[u8; 8]| {
        let [nearest, farthest] = bytemuck::cast::<[u8; 8], [f32; 2]>(*b);
        DepthTile { nearest, farthest }
    };
    bytes.as_chunks::<8>().0.iter().map(tile).collect()
}
