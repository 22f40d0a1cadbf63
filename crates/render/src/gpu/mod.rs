//! The passes on a GPU. Each has its shader in `shaders/`, a host here, a twin of the same name in this
//! crate, and a test that holds the two together. One thread submits, maps and polls.

pub mod device;
pub mod feedback;
pub mod memory;
pub mod passes;
pub mod renderer;
pub mod surface;
#[cfg(test)]
mod testing;

pub use device::error::GpuError;
pub use device::kernel::Kernel;
pub use device::{Gpu, ProjectPath, Request, Tier};
pub use memory::pool::NodePool;
pub use memory::table::PlaneAt;
pub use memory::upload::{UploadRing, UploadRun};
pub use renderer::GpuRenderer;
/// The device library, for those that bring a device of their own.
pub use wgpu;
