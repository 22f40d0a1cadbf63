//! The GPUs that tests run on.

use esker_render::gpu::device::all_interfaces;
use esker_render::gpu::{Gpu, GpuRequest};

/// Each software or real GPU of this machine, with only what WebGPU guarantees.
pub fn gpus() -> Vec<Gpu> {
    let request = |backends| GpuRequest {
        backends,
        allow_software: true,
        is_minimal: true,
        ..GpuRequest::default()
    };
    let gpus: Vec<Gpu> =
        all_interfaces().iter().filter_map(|&b| Gpu::open(&request(b)).ok()).collect();
    if gpus.is_empty() {
        eprintln!("no adapter");
    }
    gpus
}
