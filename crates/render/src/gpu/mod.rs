//! The passes on a GPU. Each has its shader in `shaders/`, a host here, a twin of the same name in this
//! crate, and a test that holds the two together. One thread submits, maps and polls.

pub mod average;
pub mod colour;
pub mod cut;
pub mod device;
pub mod dispatch;
pub mod error;
pub mod even;
pub mod ewa;
pub mod feedback;
pub mod frame;
pub mod gather;
pub mod hits;
pub mod kernel;
mod link;
pub mod lookup;
pub mod mend;
pub mod octree;
pub mod picture;
pub mod pool;
pub mod primitives;
pub mod project;
pub mod pull;
pub mod push;
pub mod pyramid;
mod quiet;
pub mod readback;
pub mod relief;
pub mod renderer;
pub mod resolve;
pub mod runs;
pub mod shade;
pub mod shader;
pub mod slant;
pub mod surface;
pub mod table;
#[cfg(test)]
mod testing;
pub mod tiles;
pub mod timing;
pub mod trim;
pub mod upload;
mod variants;

pub use device::{Gpu, ProjectPath, Request, Tier};
pub use error::GpuError;
pub use kernel::Kernel;
pub use pool::NodePool;
pub use renderer::GpuRenderer;
pub use table::PlaneAt;
pub use upload::{UploadRing, UploadRun};
/// The device library, for those that bring a device of their own.
pub use wgpu;
