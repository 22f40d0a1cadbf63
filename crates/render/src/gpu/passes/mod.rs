//! The passes on the GPU, a file a pass: pipelines, bindings and dispatches of the shaders of the
//! same name.

pub(crate) mod antialias;
pub(crate) mod average;
pub(crate) mod bounds;
pub mod ewa;
pub(crate) mod exposure;
pub(crate) mod eye_dome;
pub(crate) mod fill_holes;
pub(crate) mod fit_planes;
pub mod gather;
pub(crate) mod grow;
pub(crate) mod overlay;
pub mod primitives;
pub mod project;
pub(crate) mod pull;
pub(crate) mod push;
pub mod resolve;
pub(crate) mod shade;
pub(crate) mod silhouette;
pub(crate) mod smooth_depth;
pub(crate) mod store;
pub mod tiles;
