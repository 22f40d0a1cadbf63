//! What can go wrong with a GPU. With `--backend auto` all of it ends on the CPU renderer.

use crate::error::RenderError;
use thiserror::Error;

/// Faults of a GPU.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum GpuError {
    /// No adapter fits the request.
    #[error("no GPU to draw on: {0}; draw with --backend cpu, or install a Vulkan driver")]
    NoAdapter(String),
    /// The adapter gave no device.
    #[error("{adapter}: gives no device: {fault}")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// What the system said.
        fault: String,
    },
    /// Memory was refused.
    #[error(
        "GPU memory: {bytes} bytes for {what} were refused; lower --budget-gpu or draw smaller pictures"
    )]
    Memory {
        /// What for.
        what: String,
        /// How much.
        bytes: u64,
    },
    /// A shader does not build.
    #[error("shader {0}")]
    Shader(String),
    /// The device is gone.
    #[error("the GPU was lost: {0}; start again, or draw with --backend cpu")]
    Lost(String),
    /// A call was refused: a fault of Esker.
    #[error("the GPU refused a call: {0}")]
    Refused(String),
    /// No picture can be drawn of the view.
    #[error(transparent)]
    View(#[from] RenderError),
    /// A picture larger than the device draws.
    #[error(
        "a picture of {width} x {height} pixels is more than this GPU draws; draw it with --backend cpu"
    )]
    Size {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
    },
    /// The path asked for is not there.
    #[error("{0}")]
    Path(String),
}
