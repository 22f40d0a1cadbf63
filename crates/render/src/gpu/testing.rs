//! Helpers of the tests of this folder: devices on every adapter, with its own limits and with
//! those that WebGPU guarantees; and reading a buffer.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use crate::gpu::device::readback;
use crate::gpu::device::{Gpu, GpuRequest, all_interfaces};

/// Devices on all adapters of the machine; prints a note if there is none.
pub(crate) fn gpus() -> Vec<Gpu> {
    let request = |backends, is_minimal| GpuRequest {
        backends,
        allow_software: true,
        is_minimal,
        ..GpuRequest::default()
    };
    let requests = all_interfaces().iter().flat_map(|&b| [request(b, false), request(b, true)]);
    let gpus: Vec<Gpu> = requests.filter_map(|r| Gpu::open(&r).ok()).collect();
    if gpus.is_empty() {
        eprintln!("no adapter");
    }
    gpus
}

/// Reads `bytes` bytes of a buffer from `offset`, and waits for them.
pub(crate) fn read(gpu: &Gpu, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Vec<u8> {
    let mut all = readback::read(gpu, &[(buffer, offset + bytes)]).unwrap();
    all.remove(0).split_off(offset as usize)
}
