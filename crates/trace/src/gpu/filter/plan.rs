//! Dispatches of a filter, ready to run in every frame.

use esker_render::gpu::device::{Counted, DispatchCount};
use esker_render::gpu::wgpu::{BindGroup, Buffer, ComputePass, ComputePipeline};
use esker_render::gpu::{Gpu, Kernel};

/// A filter that is ready to run in every frame: its dispatches over pictures.
#[derive(Debug, Default)]
pub struct FilterPlan {
    steps: Vec<Step>,
    /// Buffers that the bindings refer to, kept so that their bytes are counted.
    kept: Vec<Counted>,
}

/// A dispatch.
#[derive(Debug)]
struct Step {
    pipeline: ComputePipeline,
    bind: BindGroup,
    groups: [u32; 3],
    count: DispatchCount,
}

impl FilterPlan {
    /// Appends a dispatch; `buffers` are its bindings from 0 on.
    pub(crate) fn add(
        &mut self,
        gpu: &Gpu,
        kernel: &Kernel,
        buffers: &[&Buffer],
        groups: [u32; 3],
    ) {
        let bound: Vec<_> = (0..).zip(buffers.iter().copied()).collect();
        let (pipeline, bind) = (kernel.pipeline().clone(), kernel.bind(gpu, &bound));
        self.steps.push(Step { pipeline, bind, groups, count: kernel.dispatch_count().clone() });
    }

    /// Keeps buffers that dispatches use.
    pub(crate) fn keep(&mut self, buffers: impl IntoIterator<Item = Counted>) {
        self.kept.extend(buffers);
    }

    /// Encodes the filter.
    pub fn run(&self, pass: &mut ComputePass<'_>) {
        for Step { pipeline, bind, groups, count } in &self.steps {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, bind, &[]);
            pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
            count.add_one();
        }
    }

    /// Bytes of the buffers that the filter needs for itself.
    pub fn bytes(&self) -> u64 {
        self.kept.iter().map(|buffer| buffer.size()).sum()
    }
}
