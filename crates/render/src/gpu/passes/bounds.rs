//! Computes the bounding boxes of runs that were written to, before points are drawn
//! (`shaders/project/bounds.wgsl`; see [`crate::gpu::memory::runs`]).

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{sources, without_twin};
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::pool::NodePool;
use wgpu::BufferUsages;

without_twin!(project_bounds { THREADS });

/// Lists of runs begin at multiples of this number of words: the alignment of bound ranges, 256
/// bytes.
const LIST_STEP: usize = 64;
/// Items of a workgroup of [`groups_of`]: a run has a workgroup of its own.
const GROUP: u64 = 256;

/// Bounding boxes of runs.
pub struct Bounds {
    kernel: Kernel,
    /// Numbers of the stale runs of all pages, each page from a multiple of [`LIST_STEP`].
    list: Vec<u32>,
    buffer: Option<Counted>,
}

impl Bounds {
    /// Builds the kernel.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, sources::PROJECT_BOUNDS, "main", &[])?;
        Ok(Self { kernel, list: Vec::new(), buffer: None })
    }

    /// Uploads the numbers of the stale runs of `pool` and encodes the computation of their boxes.
    /// They stay stale until [`Bounds::submitted`].
    ///
    /// # Errors
    /// If memory is refused.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        self.list.clear();
        let mut lists = Vec::new();
        for (page, runs) in pool.runs() {
            self.list.resize(self.list.len().next_multiple_of(LIST_STEP), 0);
            let start = self.list.len();
            runs.list(&mut self.list);
            if self.list.len() > start {
                lists.push((page, &runs.boxes, start..self.list.len()));
            }
        }
        if lists.is_empty() {
            return Ok(());
        }
        let needed = size_of_val(&self.list[..]) as u64;
        let buffer = match self.buffer.take().filter(|b| b.size() >= needed) {
            Some(buffer) => buffer,
            None => {
                let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
                gpu.buffer("stale runs", needed.next_power_of_two(), usage)?
            }
        };
        let buffer = self.buffer.insert(buffer);
        gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&self.list));
        for (page, boxes, range) in lists {
            let list = wgpu::BufferBinding {
                buffer,
                offset: (range.start * size_of::<u32>()) as u64,
                size: wgpu::BufferSize::new((range.len() * size_of::<u32>()) as u64),
            };
            let resources = [
                wgpu::BindingResource::Buffer(list),
                page.as_entire_binding(),
                boxes.as_entire_binding(),
            ];
            let entries: Vec<_> = (0..)
                .zip(resources)
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            let bind = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("bounds"),
                layout: &self.kernel.pipeline().get_bind_group_layout(0),
                entries: &entries,
            });
            self.kernel.dispatch(pass, &bind, groups_of(range.len() as u64 * GROUP));
        }
        Ok(())
    }

    /// To be called after the submission of what was encoded, and of all writes to `pool` before
    /// it.
    pub fn submitted(&self, pool: &NodePool) {
        pool.runs().for_each(|(_, runs)| runs.settle());
    }

    /// Rebuilds the kernel if its shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old one stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernel.reload(gpu)
    }
}
