//! Views, camera paths, and what gives points their colour.

pub mod camera;
pub mod colour;
mod colour_request;
pub mod legend;
pub mod path;
pub mod ranges;
