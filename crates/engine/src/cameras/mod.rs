//! Views, camera paths, sources of colours, and legends.

pub mod boxes;
pub mod camera;
pub mod classes;
pub mod colour;
pub mod colour_request;
pub mod histogram;
pub mod legend;
pub mod path;
pub(crate) mod places;
pub(crate) mod ranges;
pub mod up;
pub mod vertical;
