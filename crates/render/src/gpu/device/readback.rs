//! Reads buffers of the GPU: a ring of small buffers that frames copy into and that are polled,
//! never waited for; and a read that waits, for pictures that go to a file. Only the render thread
//! calls it.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Counted, Gpu};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use wgpu::{BufferUsages, MapMode, PollType};

/// Buffers of a ring; drivers keep two or three frames in flight.
const RING: usize = 4;
/// State of a mapping: requested.
const PENDING: u8 = 0;
/// State of a mapping: readable.
const MAPPED: u8 = 1;
/// State of a mapping: refused.
const FAILED: u8 = 2;

/// Copies on their way to the host, each with a value that identifies it. A frame without a free
/// buffer is left out.
#[derive(Debug)]
pub struct ReadbackRing<T> {
    free: Vec<Counted>,
    /// Targets of copies that are not submitted yet.
    copied: Vec<(Counted, T)>,
    /// Targets of submitted copies, the oldest first, with the states of their mappings.
    flying: VecDeque<(Counted, T, Arc<AtomicU8>)>,
}

impl<T> ReadbackRing<T> {
    /// Creates a ring of buffers of `bytes` bytes.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu, label: &str, bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let free = (0..RING).map(|_| gpu.buffer(label, bytes, usage)).collect::<Result<_, _>>()?;
        Ok(Self { free, copied: Vec::new(), flying: VecDeque::new() })
    }

    /// Whether a buffer is free for [`ReadbackRing::copy`].
    pub fn has_room(&self) -> bool {
        !self.free.is_empty()
    }

    /// Encodes a copy of the first `bytes` (a multiple of 4) of `source`, identified by `of`.
    /// Whether a buffer was free.
    pub fn copy(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::Buffer,
        bytes: u64,
        of: T,
    ) -> bool {
        let Some(buffer) = self.free.pop() else { return false };
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes.min(buffer.size()));
        self.copied.push((buffer, of));
        true
    }

    /// To be called after the submission of the copies: requests the mappings of their buffers.
    pub fn submitted(&mut self) {
        for (buffer, of) in self.copied.drain(..) {
            let state = Arc::new(AtomicU8::new(PENDING));
            let shared = Arc::clone(&state);
            buffer.map_async(MapMode::Read, .., move |r| {
                shared.store(if r.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
            });
            self.flying.push_back((buffer, of, state));
        }
    }

    /// The newest copy that has arrived since the last call, with its bytes. The caller has polled
    /// the device.
    pub fn newest(&mut self) -> Option<(T, Vec<u8>)> {
        let mut newest = None;
        while let Some((buffer, of, state)) = self.flying.pop_front() {
            match state.load(Ordering::Acquire) {
                PENDING => {
                    self.flying.push_front((buffer, of, state));
                    break;
                }
                MAPPED => {
                    // If several have arrived, only the last is read.
                    let is_last =
                        self.flying.front().is_none_or(|f| f.2.load(Ordering::Acquire) == PENDING);
                    if is_last && let Ok(bytes) = buffer.get_mapped_range(..) {
                        newest = Some((of, bytes.to_vec()));
                    }
                    buffer.unmap();
                    self.free.push(buffer);
                }
                _ => self.free.push(buffer),
            }
        }
        newest
    }
}

/// Reads the first bytes (a multiple of 4) of each buffer of `sources`, and waits for them.
///
/// # Errors
/// If memory is refused or the device is lost.
pub fn read(gpu: &Gpu, sources: &[(&wgpu::Buffer, u64)]) -> Result<Vec<Vec<u8>>, GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut staged = Vec::with_capacity(sources.len());
    for &(source, bytes) in sources {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let buffer = gpu.buffer("read back", bytes, usage)?;
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes);
        staged.push((buffer, bytes));
    }
    gpu.queue.submit([encoder.finish()]);
    let states: Vec<_> = staged
        .iter()
        .map(|(buffer, bytes)| {
            let state = Arc::new(AtomicU8::new(PENDING));
            let shared = Arc::clone(&state);
            buffer.map_async(MapMode::Read, ..*bytes, move |r| {
                shared.store(if r.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
            });
            state
        })
        .collect();
    let gone = |e: &dyn std::fmt::Display| gpu.fault().unwrap_or(GpuError::Lost(e.to_string()));
    gpu.device.poll(PollType::wait_indefinitely()).map_err(|e| gone(&e))?;
    let mut all = Vec::with_capacity(staged.len());
    for ((buffer, bytes), state) in staged.iter().zip(states) {
        if state.load(Ordering::Acquire) != MAPPED {
            return Err(gone(&"a buffer could not be read"));
        }
        all.push(buffer.get_mapped_range(..*bytes).map_err(|e| gone(&e))?.to_vec());
        buffer.unmap();
    }
    Ok(all)
}
