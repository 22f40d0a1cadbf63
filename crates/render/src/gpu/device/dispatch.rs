//! A dispatch that is ready to run in every frame: a kernel with its bindings and number of
//! workgroups.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::{Counted, DispatchCount, Gpu};
use wgpu::{BindGroupDescriptor, BindGroupEntry, BindingResource, BufferUsages, ComputePass};

/// Pixels on a side of a workgroup of the kernels that go over pictures.
const GROUP_SIDE: u32 = 8;

/// A kernel, its bindings and its number of workgroups.
#[derive(Debug)]
pub struct Dispatch {
    pipeline: wgpu::ComputePipeline,
    bind: wgpu::BindGroup,
    groups: Groups,
    count: DispatchCount,
}

/// Number of workgroups.
#[derive(Clone, Debug)]
pub enum Groups {
    /// A fixed number, across and down.
    Fixed([u32; 2]),
    /// The three words in a buffer from a byte on.
    Indirect(wgpu::Buffer, u64),
}

impl Dispatch {
    /// Binds `resources` at group 0 of a kernel that runs over all pixels of a picture.
    pub fn over(
        gpu: &Gpu,
        kernel: &Kernel,
        [width, height]: [u32; 2],
        resources: &[(u32, BindingResource<'_>)],
    ) -> Self {
        let groups = [width.div_ceil(GROUP_SIDE), height.div_ceil(GROUP_SIDE)];
        Self::new(gpu, kernel, Groups::Fixed(groups), resources)
    }

    /// Binds `resources` at group 0 of a kernel that runs `groups` workgroups.
    pub fn new(
        gpu: &Gpu,
        kernel: &Kernel,
        groups: Groups,
        resources: &[(u32, BindingResource<'_>)],
    ) -> Self {
        let entries: Vec<_> = resources
            .iter()
            .map(|(binding, resource)| BindGroupEntry {
                binding: *binding,
                resource: resource.clone(),
            })
            .collect();
        let bind = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: None,
            layout: &kernel.pipeline().get_bind_group_layout(0),
            entries: &entries,
        });
        let (pipeline, count) = (kernel.pipeline().clone(), kernel.dispatch_count().clone());
        Self { pipeline, bind, groups, count }
    }

    /// Encodes the dispatch.
    pub fn run(&self, pass: &mut ComputePass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind, &[]);
        match &self.groups {
            &Groups::Fixed([x, y]) => pass.dispatch_workgroups(x, y, 1),
            Groups::Indirect(buffer, first) => pass.dispatch_workgroups_indirect(buffer, *first),
        }
        self.count.add_one();
    }
}

/// Creates a uniform that never changes.
///
/// # Errors
/// If memory is refused.
pub fn fixed_uniform(gpu: &Gpu, label: &str, bytes: &[u8]) -> Result<Counted, GpuError> {
    let buffer = gpu.buffer_mapped(label, bytes.len() as u64, BufferUsages::UNIFORM, true)?;
    if let Ok(mut mapped) = buffer.get_mapped_range_mut(..bytes.len() as u64) {
        mapped.copy_from_slice(bytes);
    }
    buffer.unmap();
    Ok(buffer)
}
