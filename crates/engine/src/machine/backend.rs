//! Choice of what draws: a GPU if there is a real one, else the CPU, unless the user decides. A
//! software driver does not count as a GPU: the CPU renderer is many times faster.

use anyhow::Result;
use esker_render::gpu::Gpu;
pub use esker_render::gpu::{GpuRequest, ProjectPath, wgpu};
use serde::Serialize;

/// Requested backend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// A real GPU, else the CPU; and the CPU from the moment a GPU fails.
    #[default]
    Auto,
    /// A GPU or an error.
    Gpu,
    /// The CPU.
    Cpu,
}

/// Requested backend, and kind of GPU.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrawWith {
    /// CPU or GPU.
    pub backend: Backend,
    /// Which GPU, and how it draws points.
    pub gpu: GpuRequest,
}

impl DrawWith {
    /// Chooses the device to draw on ([`Backend::choose`]).
    ///
    /// # Errors
    /// If the user insists on a GPU and there is none.
    pub fn choose(&self, device: Option<&Gpu>) -> Result<(Option<Gpu>, Drawer)> {
        self.backend.choose(&self.gpu, device)
    }

    /// Options of the command line that give this choice.
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = vec![format!("--backend={}", self.backend.name())];
        arguments.extend(self.gpu.path.map(|path| format!("--gpu-path={}", name_of(path))));
        let api = Api::ALL.into_iter().find(|api| api.backends() == self.gpu.backends);
        arguments.extend(api.map(|api| format!("--gpu-api={}", api.name())));
        arguments.extend(self.gpu.allow_software.then(|| "--gpu-software".to_owned()));
        arguments
    }
}

/// Graphics interface that drives a GPU, if the user chooses it.
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
    /// All interfaces.
    pub const ALL: [Self; 4] = [Self::Vulkan, Self::Gl, Self::Metal, Self::Dx12];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vulkan => "vulkan",
            Self::Gl => "gl",
            Self::Metal => "metal",
            Self::Dx12 => "dx12",
        }
    }

    /// Name in wgpu.
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
    /// Adapter with its driver and interface; `None` if the CPU draws.
    pub adapter: Option<String>,
    /// How the GPU draws points.
    pub path: Option<ProjectPath>,
    /// Why no GPU draws, if the program chose so.
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
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Gpu => "gpu",
            Self::Cpu => "cpu",
        }
    }

    /// Chooses the device to draw on, `None` for the CPU, and describes it. With `device`, that of
    /// a window, no other one is considered.
    ///
    /// # Errors
    /// If the user insists on a GPU and there is none.
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
    /// A GPU.
    pub fn gpu(gpu: &Gpu) -> Self {
        Self { adapter: Some(gpu.name.clone()), path: Some(gpu.tier.path), note: None }
    }

    /// The CPU, with the reason.
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

    /// Name of the path on the command line; `cpu` if the CPU draws.
    pub fn path_name(&self) -> &'static str {
        self.path.map_or("cpu", name_of)
    }
}
