//! The compact octree of a cut in GPU memory (`shaders/common/octree.wgsl`); uploaded when it has
//! changed.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::sources::layout::OctreeCell as shader;
use crate::gpu::device::{Counted, Gpu};
use esker_lod::CompactOctree;
use std::mem::size_of;
use wgpu::BufferUsages;

/// A cell as the words of [`CompactOctree::words`].
type Words = [u32; 16];

const _: () = {
    assert!(size_of::<Words>() == shader::SIZE);
    assert!(shader::corner == 0 && shader::log2 == 3 * 4);
    assert!(shader::spacing == 4 * 4 && shader::children == 5 * 4);
};

/// The octree of the newest cut.
#[derive(Debug)]
pub struct GpuOctree {
    cells: Vec<Words>,
    buffer: Counted,
}

impl GpuOctree {
    /// Creates an octree without cells.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { cells: Vec::new(), buffer: buffer(gpu, 1)? })
    }

    /// Takes the octree of a frame.
    ///
    /// # Errors
    /// If memory is refused; the octree then has no cells.
    pub fn set(&mut self, gpu: &Gpu, octree: Option<&CompactOctree>) -> Result<(), GpuError> {
        let words = || octree.into_iter().flat_map(CompactOctree::words);
        let count = octree.map_or(0, CompactOctree::len);
        if count == self.cells.len() && words().eq(self.cells.iter().copied()) {
            return Ok(());
        }
        self.cells.clear();
        let bytes = (count * shader::SIZE) as u64;
        if bytes > gpu.tier.binding_bytes_max {
            return Err(GpuError::Memory { what: "the octree of what is drawn".into(), bytes });
        }
        if bytes > self.buffer.size() {
            self.buffer = buffer(gpu, count + count / 2).or_else(|_| buffer(gpu, count))?;
        }
        self.cells.extend(words());
        gpu.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&self.cells));
        Ok(())
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// The cells, for a storage binding.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

fn buffer(gpu: &Gpu, cells: usize) -> Result<Counted, GpuError> {
    let bytes = (cells * shader::SIZE) as u64;
    // Room to grow, but at most what can be bound.
    let bytes = bytes.min(gpu.tier.binding_bytes_max);
    gpu.buffer("octree of the cut", bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST)
}
