//! Passes from points to a picture (marroquim2007 section 3): points become single pixels
//! ([`project`]), pixels become the base of an image pyramid ([`gather`]; where points crowd, all of a pixel's front
//! surface, [`average`]), the pyramid is averaged
//! upwards ([`pull`]) and filled downwards ([`push`]), and what is filled is lit ([`shade`]). Beside the
//! published passes: gaps are closed ([`mend`]) and outlines taken back to the samples ([`trim`]) before
//! shading, and edges antialiased ([`soften`]) after it.
//!
//! These are the passes on the CPU. They are the renderer of a machine without a GPU, and the twins
//! that passes on a GPU are held against: `f32`, flat buffers, one file a pass. Knows no file, starts
//! no thread (it works in the current rayon pool) and touches no device.

pub(crate) mod error;
pub mod ewa;
pub(crate) mod frame;
pub mod gpu;
pub mod inputs;
pub mod passes;
pub mod picture;
pub(crate) mod plan;
pub(crate) mod renderer;
pub(crate) mod simd;

pub use error::RenderError;
pub use frame::{Background, ColourPlane, DrawNode, Frame, Method, Picture, Stages, Stats};
pub use inputs::colour::{Codebook, ColourBy, ColourMap, Palette};
pub use plan::{Asked, FramePlan, Pass, SceneHas, Variant};
pub use renderer::{Renderer, render};
