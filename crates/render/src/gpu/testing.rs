//! For the tests of this folder: every adapter that there is, as it is and with the least that WebGPU
//! promises; and what a buffer holds.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use crate::gpu::device::readback;
use crate::gpu::device::{Gpu, GpuRequest, all_interfaces};

/// A device of each kind that the machine has; says so where it has none.
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

/// Bytes of a buffer; waits.
pub(crate) fn read(gpu: &Gpu, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Vec<u8> {
    let mut all = readback::read(gpu, &[(buffer, offset + bytes)]).unwrap();
    all.remove(0).split_off(offset as usize)
}
