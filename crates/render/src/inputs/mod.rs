//! What passes read beside the points: camera, colour maps, density, and look-ups of a point's values.

pub mod camera;
pub mod colour;
pub mod density;
pub mod lookup;
