//! Runs: the bytes of a page by 2 KiB, 256 hot positions each, counted from the page's first byte. Beside a
//! page lie the boxes of its runs, by which what is off the picture is skipped unread. A box is made of the run's
//! bytes whatever they belong to, and is stale once they are written to: none outlives the plane that it was made of.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::pool::NodePool;
use std::cell::RefCell;
use wgpu::BufferUsages;

same_values!(common_runs == crate::gpu::memory::runs { RUN_POINTS });
without_twin!(project_bounds { THREADS });

/// Points of a run, and threads of a group that draws.
pub const RUN_POINTS: u64 = 256;
/// Bytes of a run.
pub const RUN_BYTES: u64 = RUN_POINTS * 8;
/// Bytes of a box: least and greatest hot coordinates, `u16` each, and an unused word.
pub const BOX_BYTES: u64 = 16;
/// Lists of runs begin at multiples of this: what devices ask of bound ranges, in words.
const LIST_STEP: usize = 64;
/// Threads of a group of [`groups_of`].
const GROUP: u64 = 256;

/// The boxes of a page.
#[derive(Debug)]
pub(crate) struct PageRuns {
    pub boxes: Counted,
    /// A bit a run: whether it was written to since its box was made.
    stale: RefCell<Vec<u64>>,
}

impl PageRuns {
    /// For a page of so many bytes.
    ///
    /// # Errors
    /// Where memory is refused.
    pub fn new(gpu: &Gpu, page_bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let boxes = gpu.buffer("boxes of runs", boxes_bytes(page_bytes), usage)?;
        let words = page_bytes.div_ceil(RUN_BYTES).div_ceil(64);
        Ok(Self { boxes, stale: RefCell::new(vec![0; words as usize]) })
    }

    /// Bytes of the page were written to.
    pub fn touch(&mut self, start: u64, bytes: u64) {
        let stale = self.stale.get_mut();
        for run in start / RUN_BYTES..(start + bytes).div_ceil(RUN_BYTES) {
            stale[run as usize / 64] |= 1 << (run % 64);
        }
    }

    /// Adds the numbers of the runs whose boxes are stale.
    fn list(&self, to: &mut Vec<u32>) {
        // In most frames most words are empty.
        let stale = self.stale.borrow();
        let words = (0..).step_by(64).zip(stale.iter());
        for (word, &bits) in words.filter(|(_, bits)| **bits != 0) {
            to.extend((0..64).filter(|bit| bits >> bit & 1 != 0).map(|bit| word + bit));
        }
    }

    fn settle(&self) {
        self.stale.borrow_mut().fill(0);
    }
}

/// Bytes of the boxes of so many bytes of a page.
pub(crate) fn boxes_bytes(page_bytes: u64) -> u64 {
    page_bytes.div_ceil(RUN_BYTES) * BOX_BYTES
}

/// Makes the boxes of runs (`shaders/project/bounds.wgsl`).
pub struct Bounds {
    kernel: Kernel,
    list: Vec<u32>,
    buffer: Option<Counted>,
}

impl Bounds {
    /// On any device.
    ///
    /// # Errors
    /// Where the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, sources::PROJECT_BOUNDS, "main", &[])?;
        Ok(Self { kernel, list: Vec::new(), buffer: None })
    }

    /// Sends the numbers of the runs of `pool` whose boxes are stale, and makes these. They count as made
    /// only after [`Bounds::submitted`].
    ///
    /// # Errors
    /// Where memory is refused.
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

    /// What was encoded has been submitted, and all that was written to `pool` before it.
    pub fn submitted(&self, pool: &NodePool) {
        pool.runs().for_each(|(_, runs)| runs.settle());
    }

    /// Makes the kernel anew where its shader has changed on the disk.
    ///
    /// # Errors
    /// Where the changed shader does not build; the old one goes on.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernel.reload(gpu)
    }
}
