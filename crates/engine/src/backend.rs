//! What draws: a GPU where there is a real one, else the CPU; or what the user says. A software driver
//! counts as no GPU: the CPU renderer is many times faster than it.

use anyhow::Result;
use esker_render::gpu::Gpu;
pub use esker_render::gpu::{ProjectPath, Request as GpuRequest, wgpu};

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

impl Backend {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Gpu => "gpu",
            Self::Cpu => "cpu",
        }
    }

    /// The device to draw on, `None` for the CPU; and what is to be said of it. A device that is given (a
    /// window's) is taken as the only one there is.
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

    /// `gpu` or `cpu`.
    pub fn backend(&self) -> &'static str {
        if self.adapter.is_some() { "gpu" } else { "cpu" }
    }

    /// The path's name on the command line; `cpu` where the CPU draws.
    pub fn path_name(&self) -> &'static str {
        match self.path {
            None => "cpu",
            Some(ProjectPath::Atomics) => "atomics",
            Some(ProjectPath::Primitives) => "primitives",
        }
    }
}
