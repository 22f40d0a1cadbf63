//! What draws: a GPU where there is a real one, else the CPU; or what the user says. A software
//! driver counts as no GPU: the CPU renderer is many times faster than it.

use anyhow::Result;
use esker_render::gpu::Gpu;
pub use esker_render::gpu::{GpuRequest, ProjectPath, wgpu};
use serde::Serialize;

/// What the user wants drawn with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// A GPU that is one, else the CPU; and the CPU from when a GPU fails.
    #[default]
    Auto,
    /// A GPU or an error.
    Gpu,
    /// The CPU.
    Cpu,
}

/// What the user wants drawn with, and on which GPU.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrawWith {
    /// CPU or GPU.
    pub backend: Backend,
    /// Which GPU, and how it draws points.
    pub gpu: GpuRequest,
}

impl DrawWith {
    /// As [`Backend::choose`].
    ///
    /// # Errors
    /// As [`Backend::choose`].
    pub fn choose(&self, device: Option<&Gpu>) -> Result<(Option<Gpu>, Drawer)> {
        self.backend.choose(&self.gpu, device)
    }

    /// The command line that gives it.
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec![format!("--backend={}", self.backend.name())];
        arguments.extend(self.gpu.path.map(|path| format!("--gpu-path={}", name_of(path))));
        let api = Api::ALL.into_iter().find(|api| api.backends() == self.gpu.backends);
        arguments.extend(api.map(|api| format!("--gpu-api={}", api.name())));
        arguments.extend(self.gpu.allow_software.then(|| "--gpu-software".to_owned()));
        arguments
    }
}

/// The interface that a GPU is driven by, where it is not for the program to choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Api {
    /// Vulkan.
    Vulkan,
    /// OpenGL.
    Gl,
    /// Metal.
    Metal,
    /// Direct3D 12.
    Dx12,
}

impl Api {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Vulkan, Self::Gl, Self::Metal, Self::Dx12];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vulkan => "vulkan",
            Self::Gl => "gl",
            Self::Metal => "metal",
            Self::Dx12 => "dx12",
        }
    }

    /// As the device library calls it.
    pub fn backends(self) -> wgpu::Backends {
        match self {
            Self::Vulkan => wgpu::Backends::VULKAN,
            Self::Gl => wgpu::Backends::GL,
            Self::Metal => wgpu::Backends::METAL,
            Self::Dx12 => wgpu::Backends::DX12,
        }
    }
}

fn name_of(path: ProjectPath) -> &'static str {
    match path {
        ProjectPath::Atomics => "atomics",
        ProjectPath::Primitives => "primitives",
    }
}

/// What draws.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Drawer {
    /// The adapter with its driver and interface; `None` where the CPU draws.
    pub adapter: Option<String>,
    /// How the GPU makes pixels of points.
    pub path: Option<ProjectPath>,
    /// Why it is not a GPU that draws, where that was for the program to choose.
    pub note: Option<String>,
}

/// A [`Drawer`] in a report.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DrawerReport {
    /// `gpu` or `cpu`.
    pub backend: &'static str,
    /// Name of the adapter with its driver and interface; none if the CPU draws.
    pub adapter: Option<String>,
    /// How points become pixels: the GPU's path, or `cpu`.
    pub path: &'static str,
    /// Why no GPU draws, if the program chose so.
    pub note: Option<String>,
}

impl Backend {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Gpu => "gpu",
            Self::Cpu => "cpu",
        }
    }

    /// The device to draw on, `None` for the CPU; and what is to be said of it. A device that is
    /// given (a window's) is taken as the only one there is.
    ///
    /// # Errors
    /// Where a GPU is asked for and there is none.
    pub fn choose(
        self,
        request: &GpuRequest,
        device: Option<&Gpu>,
    ) -> Result<(Option<Gpu>, Drawer)> {
        if self == Self::Cpu {
            return Ok((None, Drawer::default()));
        }
        let found = match device {
            Some(gpu) => match gpu.fault() {
                None => Ok(gpu.clone()),
                Some(fault) => Err(fault),
            },
            None => Gpu::open(request),
        };
        match found {
            Ok(gpu) if self == Self::Auto && gpu.tier.is_software && !request.allow_software => {
                Ok((None, Drawer::cpu(format!("{} is a software driver", gpu.name))))
            }
            Ok(gpu) => {
                let drawer = Drawer::gpu(&gpu);
                Ok((Some(gpu), drawer))
            }
            Err(fault) if self == Self::Auto => Ok((None, Drawer::cpu(fault.to_string()))),
            Err(fault) => Err(fault.into()),
        }
    }
}

impl Drawer {
    /// Of a device.
    pub fn gpu(gpu: &Gpu) -> Self {
        Self { adapter: Some(gpu.name.clone()), path: Some(gpu.tier.path), note: None }
    }

    /// The CPU, and why.
    pub fn cpu(why: String) -> Self {
        Self { note: Some(why), ..Self::default() }
    }

    /// The drawer as part of a report.
    pub fn report(&self) -> DrawerReport {
        DrawerReport {
            backend: self.backend(),
            adapter: self.adapter.clone(),
            path: self.path_name(),
            note: self.note.clone(),
        }
    }

    /// `gpu` or `cpu`.
    pub fn backend(&self) -> &'static str {
        if self.adapter.is_some() { "gpu" } else { "cpu" }
    }

    /// The path's name on the command line; `cpu` where the CPU draws.
    pub fn path_name(&self) -> &'static str {
        self.path.map_or("cpu", name_of)
    }
}
