//! Faults of a GPU. With `--backend auto` every one of them leads to the CPU renderer.

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
        /// Name of the adapter.
        adapter: String,
        /// Message of the system.
        fault: String,
    },
    /// Memory was refused.
    #[error(
        "GPU memory: {bytes} bytes for {what} were refused; lower --budget-gpu or draw smaller pictures"
    )]
    Memory {
        /// What the memory was for.
        what: String,
        /// Bytes requested.
        bytes: u64,
    },
    /// A shader does not build: its file and the message.
    #[error("shader {0}")]
    Shader(String),
    /// The device was lost.
    #[error("the GPU was lost: {0}; start again, or draw with --backend cpu")]
    Lost(String),
    /// wgpu refused a call, which is a defect of Esker.
    #[error("the GPU refused a call: {0}")]
    Refused(String),
    /// The view makes no valid camera.
    #[error(transparent)]
    View(#[from] RenderError),
    /// The picture is larger than the device can draw.
    #[error(
        "a picture of {width} x {height} pixels is more than this GPU draws; draw it with --backend cpu"
    )]
    Size {
        /// Width of the picture, pixels.
        width: u32,
        /// Height of the picture, pixels.
        height: u32,
    },
    /// The device lacks a feature that the requested way to draw points needs.
    #[error("{0}")]
    Path(String),
}
