//! Antialias on the GPU: smooths silhouettes and creases, and writes the picture. Twin:
//! [`crate::passes::antialias`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::target::SurfaceTarget;
use wgpu::BindingResource;

same_values!(antialias_antialias == crate::passes::antialias {
    COVERAGE[..],
    COVERAGE_SUM,
    COLOUR[..] = [0.0, COLOUR[0], COLOUR[1], COLOUR[2], 0.0],
    COLOUR_SUM,
    STEEP,
    INSET_PX,
    STEP_PX,
    CREASE,
    FAR = f32::MAX,
});

/// The pass.
pub struct Antialias {
    kernel: Kernel,
}

impl Antialias {
    /// Builds the kernels for pyramids with or without normals.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(has_normals))];
        Ok(Self { kernel: Kernel::new(gpu, sources::ANTIALIAS_ANTIALIAS, "main", &constants)? })
    }

    /// Dispatches that write the picture from [`SurfaceTarget::shaded`].
    pub fn dispatches(&self, gpu: &Gpu, target: &SurfaceTarget<'_>) -> Vec<Dispatch> {
        let (picture, base) = (target.picture, target.base());
        let view = picture.texture.create_view(&Default::default());
        let &SurfaceTarget { marks, sources, shaded, .. } = target;
        let planes = [&picture.depth, marks, &base.plane, sources, shaded, &picture.rgba];
        let mut resources = target.resources(&planes);
        resources.push((7, BindingResource::TextureView(&view)));
        vec![Dispatch::over(gpu, &self.kernel, [picture.width, picture.height], &resources)]
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        vec![&mut self.kernel]
    }
}
