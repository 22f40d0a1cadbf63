//! Views, camera paths, and what gives points their colour.

pub mod camera;
pub mod colour;
pub mod path;
pub mod ranges;
