//! Upload memory that loader threads write: a ring of mapped buffers (kanzok2015, section 3.2.1, item 6: the
//! map and the unmap queue). A run is mapped while a loader holds it; the render thread alone unmaps it,
//! copies from it, submits, and asks for its mapping again, without ever waiting for it.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Counted, Gate, Gpu};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Acquire, Ordering::Release};
use wgpu::{BufferUsages, BufferViewMut, MapMode, PollType};

/// Bytes of a run: several neighbouring nodes' planes in one read.
pub const RUN_BYTES: usize = 1 << 20;

/// States of a mapping that was asked for.
const ASKED: u8 = 0;
const MAPPED: u8 = 1;
const REFUSED: u8 = 2;

/// A run of mapped memory.
pub struct UploadRun {
    /// Before the buffer, which outlives it.
    view: Option<BufferViewMut>,
    buffer: Counted,
    gate: Arc<Gate>,
    state: Arc<AtomicU8>,
}

/// The runs that are not lent: unmapped, waiting for the submission that reads them, or for their mapping.
#[derive(Default)]
pub struct UploadRing {
    unmapped: Vec<UploadRun>,
    asked: Vec<UploadRun>,
}

impl UploadRun {
    /// Lets `write` fill a range of the run, with bytes that are to be written and never read: mapped memory
    /// is slow to read, or gives anything. `None` where the run has no such range, or the device was lost.
    pub fn fill<T>(
        &mut self,
        range: Range<usize>,
        write: impl FnOnce(&mut [u8]) -> T,
    ) -> Option<T> {
        let bytes = range.end.checked_sub(range.start)?;
        let view = self.view.as_mut().filter(|v| range.end <= v.len())?;
        // Held while bytes are written: a lost device takes the memory of its mapped buffers away.
        let _gate = self.gate.enter()?;
        let start = view.slice(range).as_raw_element_ptr();
        // SAFETY: the range is within the view, whose memory wgpu has set to zeros before it was mapped first.
        // It is exclusively borrowed with `self`, and stays mapped: only `UploadRing::unmap` unmaps it, which
        // takes the run itself, and a lost device gives no memory back before the gate is shut, which waits
        // for all who have entered. wgpu keeps its view write-only since such memory may be write-combining,
        // on which atomics don't work; nothing but plain writes and the system's reads into it happen here.
        let bytes = unsafe { std::slice::from_raw_parts_mut(start.as_ptr(), bytes) };
        Some(write(bytes))
    }
}

impl UploadRing {
    /// So many runs, mapped, to be lent.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn runs(gpu: &Gpu, count: usize) -> Result<Vec<UploadRun>, GpuError> {
        let usage = BufferUsages::MAP_WRITE | BufferUsages::COPY_SRC;
        let run = |_| {
            let buffer = gpu.buffer_mapped("upload run", RUN_BYTES as u64, usage, true)?;
            let state = Arc::new(AtomicU8::new(MAPPED));
            let mut run = UploadRun { view: None, buffer, gate: gpu.gate(), state };
            run.view()?;
            Ok(run)
        };
        (0..count).map(run).collect()
    }

    /// Takes a filled run back, so that it can be copied from.
    pub fn unmap(&mut self, mut run: UploadRun) -> &wgpu::Buffer {
        run.view = None;
        run.buffer.unmap();
        self.unmapped.push(run);
        // It was put there above.
        &self.unmapped[self.unmapped.len() - 1].buffer
    }

    /// To be called after the submission that copies from what was unmapped: asks for the mappings.
    pub fn map(&mut self) {
        for run in self.unmapped.drain(..) {
            run.state.store(ASKED, Release);
            let state = Arc::clone(&run.state);
            run.buffer.slice(..).map_async(MapMode::Write, move |mapped| {
                state.store(if mapped.is_ok() { MAPPED } else { REFUSED }, Release);
            });
            self.asked.push(run);
        }
    }

    /// Hands the runs to `lend` that are mapped again. Never waits.
    ///
    /// # Errors
    /// Where a mapping was refused.
    pub fn ready(&mut self, gpu: &Gpu, mut lend: impl FnMut(UploadRun)) -> Result<(), GpuError> {
        if self.asked.is_empty() {
            return Ok(());
        }
        // What fails here shows in the runs' states.
        let _ = gpu.device.poll(PollType::Poll);
        for mut run in self.asked.extract_if(.., |r| r.state.load(Acquire) != ASKED) {
            run.view()?;
            lend(run);
        }
        Ok(())
    }
}

impl UploadRun {
    /// Looks at the mapped memory.
    fn view(&mut self) -> Result<(), GpuError> {
        let refused = || GpuError::Refused("upload memory was not mapped".into());
        if self.state.load(Acquire) != MAPPED {
            return Err(refused());
        }
        self.view = Some(self.buffer.slice(..).get_mapped_range_mut().map_err(|_| refused())?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::memory::pool::NodePool;
    use crate::gpu::testing::{gpus, read};

    /// Polls until every run is back.
    fn all_back(gpu: &Gpu, ring: &mut UploadRing, count: usize) -> Vec<UploadRun> {
        let mut back = Vec::new();
        for _ in 0..10_000 {
            ring.ready(gpu, |run| back.push(run)).unwrap();
            if back.len() == count {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert_eq!(back.len(), count);
        back
    }

    #[test]
    fn runs_go_round_through_other_threads_and_their_bytes_arrive() {
        for gpu in gpus() {
            let before = gpu.bytes();
            let mut pool = NodePool::with_pages(&gpu, 4 << 20, 4 << 20);
            let mut ring = UploadRing::default();
            let mut runs = UploadRing::runs(&gpu, 3).unwrap();
            assert_eq!(gpu.bytes() - before, 3 * RUN_BYTES as u64);
            for round in 0..4u8 {
                let fill = |mut run: UploadRun| {
                    std::thread::scope(|scope| {
                        scope.spawn(|| run.fill(64..4096, |bytes| bytes.fill(round + 1)).unwrap());
                    });
                    run
                };
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                for (i, run) in runs.drain(..).enumerate() {
                    let buffer = ring.unmap(fill(run));
                    let to = (i * 8192 + usize::from(round) * 512) as u64;
                    pool.copy_from(&gpu, &mut encoder, buffer, 64, to, 512).unwrap();
                }
                gpu.queue.submit([encoder.finish()]);
                ring.map();
                runs = all_back(&gpu, &mut ring, 3);
            }
            for i in 0..3 {
                for round in 0..4u8 {
                    let at = i * 8192 + u64::from(round) * 512;
                    assert_eq!(read(&gpu, pool.page(0).unwrap(), at, 512), [round + 1; 512]);
                }
            }
            drop((runs, ring, pool));
            assert_eq!((gpu.bytes(), gpu.fault()), (before, None));
        }
    }

    #[test]
    fn a_ring_that_goes_while_a_loader_holds_a_run_leaves_it_usable() {
        for gpu in gpus() {
            let before = gpu.bytes();
            let mut ring = UploadRing::default();
            let mut runs = UploadRing::runs(&gpu, 2).unwrap();
            ring.unmap(runs.remove(0));
            ring.map();
            drop(ring);
            assert!(runs[0].fill(0..16, |bytes| bytes.fill(1)).is_some());
            drop(runs);
            assert_eq!((gpu.bytes(), gpu.fault()), (before, None));
        }
    }

    #[test]
    fn a_range_that_is_not_there_is_not_lent() {
        for gpu in gpus() {
            let mut runs = UploadRing::runs(&gpu, 1).unwrap();
            for range in [0..RUN_BYTES + 1, RUN_BYTES + 1..RUN_BYTES + 2, 1..usize::MAX] {
                assert_eq!(runs[0].fill(range, |_| ()), None);
            }
            #[allow(clippy::reversed_empty_ranges, reason = "it must be harmless")]
            let reversed = 8..4;
            assert_eq!(runs[0].fill(reversed, |_| ()), None);
            assert_eq!(runs[0].fill(RUN_BYTES..RUN_BYTES, |b| b.len()), Some(0));
        }
    }

    #[test]
    fn a_lost_device_takes_the_memory_from_loaders_before_it_is_gone() {
        for gpu in gpus() {
            let mut runs = UploadRing::runs(&gpu, 1).unwrap();
            gpu.end("ended by a test");
            assert_eq!(runs[0].fill(0..16, |bytes| bytes.fill(1)), None);
            assert!(matches!(gpu.fault(), Some(GpuError::Lost(_))), "{:?}", gpu.fault());
            let _ = gpu.device.poll(PollType::Poll);
            drop(runs);
        }
    }
}
