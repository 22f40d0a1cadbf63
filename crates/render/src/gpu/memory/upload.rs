//! Upload memory that loader threads write to: a ring of mapped buffers (`kanzok2015`, section
//! 3.2.1, item 6: the map and the unmap queue). A run is mapped while a loader holds it; only the
//! render thread unmaps it, copies from it, submits, and requests its mapping again, without ever
//! waiting for it.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Counted, Gate, Gpu};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Acquire, Ordering::Release};
use wgpu::{BufferUsages, BufferViewMut, MapMode, PollType};

/// Bytes of a run: one read of the planes of several neighbouring nodes.
pub const RUN_BYTES: usize = 1 << 20;

/// State of a mapping: requested.
const REQUESTED: u8 = 0;
/// State of a mapping: writable.
const MAPPED: u8 = 1;
/// State of a mapping: refused.
const REFUSED: u8 = 2;

/// A run of mapped memory.
pub struct UploadRun {
    /// Declared before the buffer, and so dropped before it.
    view: Option<BufferViewMut>,
    buffer: Counted,
    gate: Arc<Gate>,
    state: Arc<AtomicU8>,
}

/// Runs that are not lent to loaders: they wait for the submission that reads them, or for their
/// mapping.
#[derive(Default)]
pub struct UploadRing {
    unmapped: Vec<UploadRun>,
    mapping: Vec<UploadRun>,
}

impl UploadRun {
    /// Lets `write` fill a range of the run. It must only write: reading mapped memory is slow and
    /// may give any value. `None` if the run does not have the range, or the device was lost.
    pub fn fill<T>(
        &mut self,
        range: Range<usize>,
        write: impl FnOnce(&mut [u8]) -> T,
    ) -> Option<T> {
        let bytes = range.end.checked_sub(range.start)?;
        let view = self.view.as_mut().filter(|v| range.end <= v.len())?;
        // Held while bytes are written, because a lost device frees the memory of its mapped
        // buffers.
        let _gate = self.gate.enter()?;
        let start = view.slice(range).as_raw_element_ptr();
        // SAFETY: the range is within the view, whose memory wgpu zeroed before it was first
        // mapped. It is exclusively borrowed with `self`, and stays mapped: only
        // `UploadRing::unmap` unmaps it, which takes the run by value, and a lost device frees no
        // memory before the gate is shut, which waits for all guards. wgpu keeps its view
        // write-only because such memory may be write-combining, on which atomics don't work; only
        // plain writes and reads of the system into it happen here.
        let bytes = unsafe { std::slice::from_raw_parts_mut(start.as_ptr(), bytes) };
        Some(write(bytes))
    }
}

impl UploadRing {
    /// Allocates `count` mapped runs, to be lent.
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

    /// Takes a filled run back and unmaps it, so that it can be copied from.
    pub fn unmap(&mut self, mut run: UploadRun) -> &wgpu::Buffer {
        run.view = None;
        run.buffer.unmap();
        self.unmapped.push(run);
        // The run was pushed above.
        &self.unmapped[self.unmapped.len() - 1].buffer
    }

    /// To be called after the submission that copies from unmapped runs: requests their mappings.
    pub fn map(&mut self) {
        for run in self.unmapped.drain(..) {
            run.state.store(REQUESTED, Release);
            let state = Arc::clone(&run.state);
            run.buffer.slice(..).map_async(MapMode::Write, move |mapped| {
                state.store(if mapped.is_ok() { MAPPED } else { REFUSED }, Release);
            });
            self.mapping.push(run);
        }
    }

    /// Passes the runs that are mapped again to `lend`. Never waits.
    ///
    /// # Errors
    /// If a mapping was refused.
    pub fn ready(&mut self, gpu: &Gpu, mut lend: impl FnMut(UploadRun)) -> Result<(), GpuError> {
        if self.mapping.is_empty() {
            return Ok(());
        }
        // The states of the runs report failures.
        let _ = gpu.device.poll(PollType::Poll);
        for mut run in self.mapping.extract_if(.., |r| r.state.load(Acquire) != REQUESTED) {
            run.view()?;
            lend(run);
        }
        Ok(())
    }
}

impl UploadRun {
    /// Gets the view of the mapped memory.
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

    /// Polls until `count` runs are mapped again.
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
    fn bytes_that_other_threads_write_to_runs_arrive_round_after_round() {
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
    fn a_run_stays_usable_when_its_ring_is_dropped() {
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
    fn a_range_outside_of_a_run_is_refused() {
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
    fn a_lost_device_takes_memory_from_loaders_before_it_is_freed() {
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
