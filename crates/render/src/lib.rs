//! Passes from points to a picture, on the CPU ([`Renderer`]) and on a GPU ([`gpu`]). The CPU
//! passes are the renderer of machines without a GPU and the reference that tests compare the GPU
//! passes with. This crate reads no files but shaders that are reloaded. Its CPU passes work in the
//! current rayon pool and touch no device.
//!
//! [`FramePlan::of`] chooses the passes of a frame, which run in this order ([`Pass::ALL`]). CPU
//! files are in `src/passes` unless another folder is named, shaders in a folder of `shaders`. The
//! GPU host of a pass has its name in `src/gpu/passes` (`place` and `blend`: `ewa.rs`; without
//! 64-bit atomics `primitives.rs` projects).
//!
//! | pass           | CPU file          | shaders        | paper, section      | when             |
//! |----------------|-------------------|----------------|---------------------|------------------|
//! | `project`      | `project.rs`      | `project`      | `marroquim2007` 3.1 | P, S, E bare     |
//! | `split`        | `split.rs`        | `grow`         | -                   | S mixed          |
//! | `fit_planes`   | `fit_planes.rs`   | `fit_planes`   | -                   | S bare, E bare   |
//! | `gather`       | `gather.rs`       | `gather`       | `marroquim2007` 3.1 | S                |
//! | `average`      | `average.rs`      | `average`      | `schuetz2021`       | S crowded        |
//! | `exposure`     | `exposure.rs`     | `exposure`     | `kanzok2015` 3.2.4  | S RGB, optional  |
//! | `pull`         | `pull.rs`         | `pull`         | `marroquim2007` 3.2 | S not dense      |
//! | `push`         | `push.rs`         | `push`         | `marroquim2007` 3.3 | S not dense      |
//! | `fill_holes`   | `fill_holes.rs`   | `fill_holes`   | `rosenthal2008`     | S                |
//! | `silhouette`   | `silhouette/`     | `silhouette`   | -                   | S not dense      |
//! | `place`        | `ewa/place.rs`    | `ewa`          | `zwicker2004` 4, 5  | E                |
//! | `blend`        | `ewa/blend.rs`    | `ewa`          | `zwicker2004` 6     | E                |
//! | `smooth_depth` | `smooth_depth.rs` | `smooth_depth` | `boucheny2009`      | S bare, E bare   |
//! | `shade`        | `shade.rs`        | `shade`        | `marroquim2007` 3.4 | S, E             |
//! | `antialias`    | `antialias.rs`    | `antialias`    | -                   | S, E             |
//! | `grow`         | `grow.rs`         | `grow`         | -                   | P wide, S mixed  |
//! | `overlay`      | `overlay.rs`      | `overlay`      | -                   | S mixed          |
//! | `resolve`      | `resolve.rs`      | `resolve`      | -                   | P                |
//! | `eye_dome`     | `eye_dome.rs`     | `eye_dome`     | `boucheny2009` 3    | P, optional      |
//!
//! P is [`Method::Points`], S [`Method::PullPush`] (surfaces), E [`Method::Ewa`]; S is mixed with
//! dots if [`Frame::mixes_dots`]. A bare cloud has no normals; planes are not fitted to surfaces in
//! dense views. A view is dense if every pixel has a point, and crowded if points share pixels
//! ([`inputs::density`]). After the last pass the margin of surfaces is cropped
//! ([`picture::margin`]).

pub(crate) mod error;
pub mod ewa;
pub(crate) mod frame;
pub mod gpu;
pub mod inputs;
pub(crate) mod nearest;
pub(crate) mod pass;
pub mod passes;
pub mod picture;
pub(crate) mod plan;
pub(crate) mod renderer;
pub(crate) mod simd;

pub use error::RenderError;
pub use frame::{
    Background, ColourPlane, Dots, DrawNode, Frame, Method, POINT_SIZE_MAX, PassTimes, Picture,
    PointSize, Stats,
};
pub use inputs::colour::{Codebook, ColourBy, ColourMap, Gradient};
pub use inputs::splats::{Splat, splats};
pub use nearest::{NearestPoint, nearest_points};
pub use pass::{Pass, PassChoice, PassSet};
pub use plan::{FrameOptions, FramePlan, SceneHas, Variant};
pub use renderer::{Renderer, render};
