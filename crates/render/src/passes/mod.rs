//! The passes on the CPU, one file a pass. Each has a twin of the same name in `gpu/passes`, and a
//! folder of the same name in `shaders`.

pub mod antialias;
pub(crate) mod average;
pub(crate) mod dots;
pub(crate) mod ellipse;
pub(crate) mod exposure;
pub(crate) mod eye_dome;
pub mod fill_holes;
pub mod fit_planes;
pub mod gather;
pub(crate) mod grow;
pub(crate) mod overlay;
pub mod project;
pub mod pull;
pub mod push;
pub mod resolve;
pub mod shade;
pub mod silhouette;
pub mod smooth_depth;
pub(crate) mod split;
pub mod tangent;
