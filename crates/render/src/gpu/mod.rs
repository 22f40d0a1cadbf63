//! The passes on a GPU, by wgpu. Each has shaders in `shaders/`, a host file here, a CPU pass of
//! the same name (its twin), and a test that compares both. One thread submits, maps and polls.

pub mod device;
pub mod feedback;
pub mod memory;
pub mod passes;
pub mod renderer;
pub mod splats;
pub mod surface;
pub(crate) mod target;
#[cfg(test)]
mod testing;

pub use device::error::GpuError;
pub use device::kernel::Kernel;
pub(crate) use device::same::same_values;
pub(crate) use device::shader::sources;
pub use device::{Gpu, GpuRequest, ProjectPath, Tier};
pub use memory::pool::NodePool;
pub use memory::table::PlaneAt;
pub use memory::upload::{UploadRing, UploadRun};
pub use renderer::GpuRenderer;
pub use splats::{GpuSplats, SplatBuffer};
/// The device library, for callers that create the device themselves.
pub use wgpu;
