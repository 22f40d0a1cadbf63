//! Node planes in GPU memory: one range of addresses from 0 to the budget, in pages that are
//! allocated when they are first written, so that memory grows with use. The streamer, which
//! assigns addresses, lets no plane straddle two pages. A plane is not written to while it is
//! drawn. If points are drawn by compute, each page also has the boxes of its runs
//! ([`crate::gpu::memory::runs`]).

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{BINDING_BYTES_MAX, Counted, Gpu, ProjectPath};
use crate::gpu::memory::runs::{BOX_BYTES, PageRuns, RUN_BYTES, boxes_bytes};
use crate::gpu::memory::table::PlaneAt;
use wgpu::{BufferUsages, CommandEncoder};

/// Divisor of page sizes, bytes: the alignment of bound ranges.
const PAGE_STEP: u64 = 256;
/// Divisor of the sizes of copies, bytes.
const COPY_STEP: u64 = 4;

/// Pages of node planes.
#[derive(Debug)]
pub struct NodePool {
    bytes: u64,
    page_bytes: u64,
    /// `None` for pages that were never written.
    pages: Vec<Option<Page>>,
}

#[derive(Debug)]
struct Page {
    buffer: Counted,
    runs: Option<PageRuns>,
}

impl NodePool {
    /// Bytes of planes that fit in `memory` bytes together with the boxes of their runs.
    pub fn bytes_within(memory: u64) -> u64 {
        // The last run of a page may be partial.
        let shared = memory.saturating_sub(boxes_bytes(1) * memory.div_ceil(BINDING_BYTES_MAX));
        (u128::from(shared) * u128::from(RUN_BYTES) / u128::from(RUN_BYTES + BOX_BYTES)) as u64
    }

    /// Creates a pool of `bytes` bytes, with pages as large as the device binds; allocates none.
    pub fn new(gpu: &Gpu, bytes: u64) -> Self {
        Self::with_pages(gpu, bytes, u64::MAX)
    }

    /// Creates a pool like [`NodePool::new`] with pages of at most `page_bytes_max` bytes, so that
    /// a small scene takes no large page.
    pub fn with_pages(gpu: &Gpu, bytes: u64, page_bytes_max: u64) -> Self {
        let bytes = bytes - bytes % PAGE_STEP;
        let page_bytes = page_bytes_max.min(gpu.tier.page_bytes_max).min(bytes);
        let page_bytes = (page_bytes - page_bytes % PAGE_STEP).max(PAGE_STEP);
        Self { bytes, page_bytes, pages: Vec::new() }
    }

    /// Bytes of the range of addresses.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of the allocated pages and their boxes.
    pub fn taken_bytes(&self) -> u64 {
        let boxes = |page: &Page| page.runs.as_ref().map_or(0, |runs| runs.boxes.size());
        self.pages.iter().flatten().map(|page| page.buffer.size() + boxes(page)).sum()
    }

    /// Bytes of a page, which no plane straddles; the last page may be shorter.
    pub fn page_bytes(&self) -> u64 {
        self.page_bytes
    }

    /// Number of pages up to the last one that was written.
    pub fn pages(&self) -> usize {
        self.pages.len()
    }

    /// A page; `None` if it was never written.
    pub fn page(&self, index: usize) -> Option<&wgpu::Buffer> {
        Some(&self.pages.get(index)?.as_ref()?.buffer)
    }

    /// Boxes of the runs of a page, as the last frame left them (`shaders/common/runs.wgsl`);
    /// `None` if the page was never written, or points are drawn as primitives.
    pub fn boxes(&self, index: usize) -> Option<&wgpu::Buffer> {
        Some(&self.pages.get(index)?.as_ref()?.runs.as_ref()?.boxes)
    }

    /// Pages with the boxes of their runs.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (&wgpu::Buffer, &PageRuns)> {
        self.pages.iter().flatten().filter_map(|page| Some((&*page.buffer, page.runs.as_ref()?)))
    }

    /// Page of a plane and its first word there; `None` if the plane is not within one page, does
    /// not begin at a word, or was never written.
    pub fn place(&self, plane: PlaneAt) -> Option<(u32, u32)> {
        let (page, start) = self.within(plane.offset, plane.bytes)?;
        self.page(page)?;
        Some((page as u32, (start / COPY_STEP) as u32))
    }

    /// Frees the pages that begin at this byte or beyond it; no plane there is drawn any more. They
    /// are allocated again when they are written.
    pub fn free_beyond(&mut self, bytes: u64) {
        let pages = bytes.div_ceil(self.page_bytes);
        self.pages.truncate(usize::try_from(pages).unwrap_or(usize::MAX));
    }

    /// Encodes a copy of `bytes` bytes of `source`, rounded up to whole words, to the address `to`.
    /// The commands must be submitted before the next frame or with it. A range that fits no page
    /// is not copied.
    ///
    /// # Errors
    /// If memory for the page is refused.
    pub fn copy_from(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        source: &wgpu::Buffer,
        source_offset: u64,
        to: u64,
        bytes: u64,
    ) -> Result<(), GpuError> {
        let Some(copied) = bytes.checked_next_multiple_of(COPY_STEP) else { return Ok(()) };
        let in_source = source_offset.is_multiple_of(COPY_STEP)
            && source_offset.checked_add(copied).is_some_and(|end| end <= source.size());
        let Some((page, start)) = self.within(to, copied).filter(|_| in_source) else {
            debug_assert!(false, "{bytes} bytes from {source_offset} to {to} fit no page");
            return Ok(());
        };
        if copied > 0 {
            let page = self.touch(gpu, page, start, copied)?;
            encoder.copy_buffer_to_buffer(source, source_offset, page, start, copied);
        }
        Ok(())
    }

    /// Writes `bytes` to the address `to` through the queue, for planes that are in memory already.
    /// A range that fits no page is not written.
    ///
    /// # Errors
    /// If memory for the page is refused.
    pub fn write(&mut self, gpu: &Gpu, to: u64, bytes: &[u8]) -> Result<(), GpuError> {
        let whole = bytes.len() - bytes.len() % COPY_STEP as usize;
        let (words, rest) = bytes.split_at(whole);
        let taken = (bytes.len() as u64).next_multiple_of(COPY_STEP);
        let Some((page, start)) = self.within(to, taken) else { return Ok(()) };
        if taken == 0 {
            return Ok(());
        }
        let page = self.touch(gpu, page, start, taken)?;
        gpu.queue.write_buffer(page, start, words);
        if !rest.is_empty() {
            let mut word = [0; COPY_STEP as usize];
            word[..rest.len()].copy_from_slice(rest);
            gpu.queue.write_buffer(page, start + whole as u64, &word);
        }
        Ok(())
    }

    /// Page of a range of addresses, and the range's first byte there.
    fn within(&self, offset: u64, bytes: u64) -> Option<(usize, u64)> {
        let (page, start) = (offset / self.page_bytes, offset % self.page_bytes);
        let fits = start.checked_add(bytes)? <= self.page_bytes
            && offset.checked_add(bytes)? <= self.bytes
            && offset.is_multiple_of(COPY_STEP);
        fits.then_some((page as usize, start))
    }

    /// The page to write to, allocated if needed; marks the runs of the range as stale.
    fn touch(
        &mut self,
        gpu: &Gpu,
        index: usize,
        start: u64,
        bytes: u64,
    ) -> Result<&wgpu::Buffer, GpuError> {
        if self.pages.len() <= index {
            self.pages.resize_with(index + 1, || None);
        }
        let page = match &mut self.pages[index] {
            Some(page) => page,
            none => {
                let bytes = self.page_bytes.min(self.bytes - index as u64 * self.page_bytes);
                none.insert(Page::new(gpu, bytes)?)
            }
        };
        if let Some(runs) = &mut page.runs {
            runs.touch(start, bytes);
        }
        Ok(&page.buffer)
    }
}

impl Page {
    fn new(gpu: &Gpu, bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffer = gpu.buffer("node planes", bytes, usage)?;
        let skips = gpu.tier.path == ProjectPath::Atomics;
        let runs = skips.then(|| PageRuns::new(gpu, bytes)).transpose()?;
        Ok(Self { buffer, runs })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::testing::{gpus, read};

    fn at(offset: u64, bytes: u64) -> PlaneAt {
        PlaneAt { offset, bytes }
    }

    #[test]
    fn pages_are_allocated_when_they_are_written_and_freed_with_the_pool() {
        for gpu in gpus() {
            let before = gpu.bytes();
            let mut pool = NodePool::with_pages(&gpu, 2 * 4096 + 512, 4096);
            assert_eq!((pool.page_bytes(), pool.pages(), gpu.bytes()), (4096, 0, before));
            let plane = at(2 * 4096 + 256, 7);
            assert_eq!(pool.place(plane), None);
            pool.write(&gpu, plane.offset, b"abcdefg").unwrap();
            assert_eq!(pool.place(plane), Some((2, 64)));
            assert!(pool.page(0).is_none() && pool.page(1).is_none(), "only what is used");
            assert_eq!(gpu.bytes(), before + pool.taken_bytes());
            assert!([512, 512 + 16].contains(&pool.taken_bytes()), "never more than the budget");
            assert_eq!(&read(&gpu, pool.page(2).unwrap(), 256, 8), b"abcdefg\0");
            pool.write(&gpu, 8, b"a").unwrap();
            pool.free_beyond(2 * 4096);
            assert_eq!((pool.place(plane), pool.place(at(8, 1))), (None, Some((0, 2))));
            pool.free_beyond(0);
            assert_eq!(gpu.bytes(), before);
            pool.write(&gpu, plane.offset, b"abcdefg").unwrap();
            assert_eq!(&read(&gpu, pool.page(2).unwrap(), 256, 8), b"abcdefg\0");
            drop(pool);
            assert_eq!(gpu.bytes(), before);
            assert_eq!(gpu.fault(), None);
        }
    }

    #[test]
    fn copied_bytes_are_at_their_address() {
        for gpu in gpus() {
            let mut pool = NodePool::with_pages(&gpu, 1 << 20, 64 << 10);
            let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            let source = gpu.buffer("source", 1024, usage).unwrap();
            let bytes: Vec<u8> = (0..1024u32).map(|i| (i * 7) as u8).collect();
            gpu.queue.write_buffer(&source, 0, &bytes);
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let to = (64 << 10) + 512;
            pool.copy_from(&gpu, &mut encoder, &source, 64, to, 333).unwrap();
            gpu.queue.submit([encoder.finish()]);
            assert_eq!(read(&gpu, pool.page(1).unwrap(), 512, 336), bytes[64..64 + 336]);
            assert_eq!(gpu.fault(), None);
        }
    }

    #[test]
    fn planes_outside_of_the_pool_or_across_pages_have_no_place() {
        for gpu in gpus() {
            let mut pool = NodePool::with_pages(&gpu, 8192 + 256, 4096);
            pool.write(&gpu, 0, &[1; 4096]).unwrap();
            let before = gpu.bytes();
            for wrong in [at(8192 + 256, 4), at(4096 - 256, 512), at(u64::MAX, 2), at(0, u64::MAX)]
            {
                pool.write(&gpu, wrong.offset, &vec![1; (wrong.bytes as usize).min(512)]).ok();
                assert_eq!(pool.place(wrong), None, "{wrong:?}");
            }
            assert_eq!(pool.place(at(2, 4)), None, "between words");
            assert_eq!(gpu.bytes(), before);
        }
    }

    #[test]
    fn planes_and_their_boxes_fit_the_memory_that_they_share() {
        for memory in [1 << 20, (1 << 30) - 77, (1 << 40) + 12345] {
            let planes = NodePool::bytes_within(memory);
            let (pages, rest) = (planes / BINDING_BYTES_MAX, planes % BINDING_BYTES_MAX);
            let boxes = pages * boxes_bytes(BINDING_BYTES_MAX) + boxes_bytes(rest);
            assert!(planes + boxes <= memory && planes + boxes + 64 >= memory - memory / 1000);
        }
    }

    #[test]
    fn a_page_is_at_most_what_the_device_binds() {
        for gpu in gpus() {
            let pool = NodePool::new(&gpu, 1 << 40);
            assert_eq!(pool.page_bytes(), gpu.tier.page_bytes_max);
            assert!(pool.page_bytes() <= BINDING_BYTES_MAX);
        }
    }
}
