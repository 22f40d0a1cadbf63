//! Runs of a page of GPU memory: 2 KiB each, which is 256 hot positions, counted from the page's
//! first byte. Each run has a bounding box, by which drawing skips runs outside the picture without
//! reading them. A box is computed from all bytes of its run, whatever they belong to, and is stale
//! once they are written to, so that no box outlives the plane that it was computed from.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::same_values;
use crate::gpu::device::{Counted, Gpu};
use std::cell::RefCell;
use wgpu::BufferUsages;

same_values!(common_runs == crate::gpu::memory::runs { RUN_POINTS });

/// Points of a run, and threads of a workgroup that draws it.
pub const RUN_POINTS: u64 = 256;
/// Bytes of a run.
pub const RUN_BYTES: u64 = RUN_POINTS * 8;
/// Bytes of a box: least and greatest hot coordinates, `u16` each, and an unused word.
pub const BOX_BYTES: u64 = 16;

/// The boxes of a page.
#[derive(Debug)]
pub(crate) struct PageRuns {
    pub boxes: Counted,
    /// A bit a run: whether it was written to since its box was computed.
    stale: RefCell<Vec<u64>>,
}

impl PageRuns {
    /// Creates the boxes of a page of `page_bytes` bytes.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu, page_bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let boxes = gpu.buffer("boxes of runs", boxes_bytes(page_bytes), usage)?;
        let words = page_bytes.div_ceil(RUN_BYTES).div_ceil(64);
        Ok(Self { boxes, stale: RefCell::new(vec![0; words as usize]) })
    }

    /// Marks the runs of `bytes` bytes from `start` as stale.
    pub fn touch(&mut self, start: u64, bytes: u64) {
        let stale = self.stale.get_mut();
        for run in start / RUN_BYTES..(start + bytes).div_ceil(RUN_BYTES) {
            stale[run as usize / 64] |= 1 << (run % 64);
        }
    }

    /// Appends the numbers of the runs whose boxes are stale.
    pub fn list(&self, to: &mut Vec<u32>) {
        // In most frames most words are zero.
        let stale = self.stale.borrow();
        let words = (0..).step_by(64).zip(stale.iter());
        for (word, &bits) in words.filter(|(_, bits)| **bits != 0) {
            to.extend((0..64).filter(|bit| bits >> bit & 1 != 0).map(|bit| word + bit));
        }
    }

    /// Marks all boxes as up to date.
    pub fn settle(&self) {
        self.stale.borrow_mut().fill(0);
    }
}

/// Bytes of the boxes of `page_bytes` bytes of a page.
pub(crate) fn boxes_bytes(page_bytes: u64) -> u64 {
    page_bytes.div_ceil(RUN_BYTES) * BOX_BYTES
}
