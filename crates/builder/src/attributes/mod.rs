//! Attributes that a build computes: normals, clip lines, tangents, palettes; and the neighbour search they rest on.

pub(crate) mod clips;
pub mod density;
pub(crate) mod eigen;
pub(crate) mod knn;
pub(crate) mod knn_index;
pub(crate) mod knn_search;
pub mod normals;
pub(crate) mod palette;
pub(crate) mod sharp;
pub(crate) mod tangents;
