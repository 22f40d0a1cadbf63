//! Shade and soften on the GPU ([`crate::passes::shade`] and [`crate::passes::antialias`] are the twins), the last of which writes the
//! picture; and the last step alone ([`Store`]), for pictures made otherwise.

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::sources;
use crate::gpu::device::variants::Variants;
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::surface::Target;
use wgpu::BindingResource;

/// Lighting.
pub struct Shade {
    /// By whether pixels carry normals, and whether there are highlights.
    kernels: Variants<2>,
    has_normals: bool,
}

impl Shade {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where the shader is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let mut kernels = Variants::new(sources::SHADE_SHADE, ["NORMALS", "SHINES"]);
        kernels.get(gpu, [u32::from(has_normals), 1])?;
        Ok(Self { kernels, has_normals })
    }

    /// What lights level 0 into [`Target::shaded`], with highlights or without.
    ///
    /// # Errors
    /// Where the shader is refused.
    pub fn dispatches(
        &mut self,
        gpu: &Gpu,
        target: &Target<'_>,
        shines: bool,
    ) -> Result<Vec<Dispatch>, GpuError> {
        let (base, levels) = (target.base(), &target.pyramid.levels);
        let coarse = levels.get(1).unwrap_or(base);
        let depth = if self.has_normals { &target.picture.depth } else { target.spare };
        let (tint, normal, coarse) = (&base.tint, &base.plane, &coarse.plane);
        let &Target { relief, sources, shaded, .. } = target;
        let buffers = [relief, depth, tint, normal, coarse, sources, shaded];
        let kernel = self.kernels.get(gpu, [self.has_normals, shines].map(u32::from))?;
        Ok(vec![target.dispatch(gpu, kernel, &buffers)])
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        self.kernels.all().collect()
    }
}

/// Antialiasing, and the picture.
pub struct Soften {
    kernel: Kernel,
}

impl Soften {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where the shader is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(has_normals))];
        Ok(Self { kernel: Kernel::new(gpu, sources::SOFTEN_SOFTEN, "main", &constants)? })
    }

    /// What makes the picture of [`Target::shaded`].
    pub fn dispatches(&self, gpu: &Gpu, target: &Target<'_>) -> Vec<Dispatch> {
        let (picture, base) = (target.picture, target.base());
        let view = picture.texture.create_view(&Default::default());
        let &Target { marks, sources, shaded, .. } = target;
        let planes = [&picture.depth, marks, &base.plane, sources, shaded, &picture.rgba];
        let mut resources = target.resources(&planes);
        resources.push((7, BindingResource::TextureView(&view)));
        vec![Dispatch::over(gpu, &self.kernel, [picture.width, picture.height], &resources)]
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        vec![&mut self.kernel]
    }
}

/// The colours of a picture to its texture.
pub struct Store {
    kernel: Kernel,
}

impl Store {
    /// For a device.
    ///
    /// # Errors
    /// Where the shader is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { kernel: Kernel::new(gpu, sources::PICTURE_STORE, "main", &[])? })
    }

    /// What fills the texture of a picture; `uniform` is the frame's.
    pub fn dispatch(&self, gpu: &Gpu, uniform: &wgpu::Buffer, picture: &GpuPicture) -> Dispatch {
        let view = picture.texture.create_view(&Default::default());
        let resources = [
            (0, uniform.as_entire_binding()),
            (1, picture.rgba.as_entire_binding()),
            (2, BindingResource::TextureView(&view)),
        ];
        Dispatch::over(gpu, &self.kernel, [picture.width, picture.height], &resources)
    }
}
