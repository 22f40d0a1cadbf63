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

pub mod average;
pub mod camera;
pub mod colour;
pub mod density;
pub mod edges;
pub mod ellipse;
pub mod error;
pub mod even;
pub mod ewa;
pub mod frame;
pub mod gather;
pub mod gpu;
mod lanes;
pub mod margin;
pub mod marks;
pub mod mend;
pub mod plan;
pub mod project;
pub mod pull;
pub mod push;
pub mod pyramid;
pub mod relief;
pub mod renderer;
pub mod resolve;
mod rim;
mod rim_row;
pub mod shade;
pub mod slant;
pub mod soften;
pub mod surface;
pub mod tangent;
pub mod trim;
mod values;
mod windows;

pub use colour::{Codebook, ColourBy, ColourMap, Palette};
pub use error::RenderError;
pub use frame::{Background, ColourPlane, DrawNode, Frame, Method, Picture, Stage, Stages, Stats};
pub use plan::{Asked, FramePlan, Pass, SceneHas, Variant};
pub use renderer::{Renderer, render};
