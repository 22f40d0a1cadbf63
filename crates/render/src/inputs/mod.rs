//! Inputs of the passes: camera, colour maps, density of the view, attributes of points.

pub mod camera;
pub mod colour;
pub mod density;
pub mod lookup;
pub mod splats;
pub(crate) mod thinning;
