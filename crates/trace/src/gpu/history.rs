//! Incident light of the last picture for a new camera. In: what the guide rays of both pictures
//! see, and the light of the last one. Out: light at the new guides, with the number of samples
//! that it stands for. Twin: [`crate::paths::history`].

use crate::camera::Camera;
use crate::gpu::frame::{Buffers, Last};
use crate::gpu::{same_layout, same_values, without_twin};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::wgpu::Buffer;
use esker_render::gpu::{Gpu, GpuError, Kernel};

same_values!(common_history == crate::paths::history { HISTORY_SAMPLES });
without_twin!(trace_reuse { WEIGHT_LEAST });

/// Pixels on a side of a workgroup.
const GROUP_SIDE: u32 = 8;

/// The uniform (`shaders/trace/reuse.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Moved {
    eye: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    width: u32,
    height: u32,
    samples: f32,
    has_past: u32,
    first: u32,
    rows: u32,
    first_place: u32,
    last_first: u32,
    last_rows: u32,
    last_first_place: u32,
    focal: f32,
    unused: u32,
}

same_layout!(Moved {
    eye,
    right,
    up,
    forward,
    width,
    height,
    samples,
    has_past,
    first,
    rows,
    first_place,
    last_first,
    last_rows,
    last_first_place,
    focal,
});

/// Submits the transfer of light from the last picture to `buffers`, whose places are traced.
/// `cameras` are the last one and the new one, of one size; the last picture had `samples`.
///
/// # Errors
/// If memory is refused.
pub(crate) fn reuse(
    gpu: &Gpu,
    kernel: &Kernel,
    last: &Last,
    [before, now]: [&Camera; 2],
    samples: u32,
    buffers: &Buffers,
) -> Result<(), GpuError> {
    let Some(past) = &buffers.past else { return Ok(()) };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    for new in &buffers.parts {
        for (old, last_places) in &last.parts {
            let moved = Moved {
                eye: before.eye.extend(before.focal_px).to_array(),
                right: before.right.extend(before.near).to_array(),
                up: before.up.extend(before.parallel_at).to_array(),
                forward: before.forward.extend(0.0).to_array(),
                width: before.width as u32,
                height: before.height as u32,
                samples: samples as f32,
                has_past: u32::from(last.past.is_some()),
                first: new.part.first,
                rows: new.part.rows,
                first_place: new.part.first_place,
                last_first: old.first,
                last_rows: old.rows,
                last_first_place: old.first_place,
                focal: now.focal_px,
                unused: 0,
            };
            let uniform = fixed_uniform(gpu, "moved camera", bytes_of(&moved))?;
            let last_past = last.past.as_deref().unwrap_or(&last.light);
            let bound: [(u32, &Buffer); 6] = [
                (0, &uniform),
                (1, &new.places),
                (2, last_places),
                (3, &last.light),
                (4, last_past),
                (5, past),
            ];
            let groups = [moved.width.div_ceil(GROUP_SIDE), moved.rows.div_ceil(GROUP_SIDE), 1];
            kernel.dispatch(&mut pass, &kernel.bind(gpu, &bound), groups);
        }
    }
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    Ok(())
}
