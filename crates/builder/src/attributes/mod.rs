//! Attributes that a build computes: normals, clip lines, tangents and palettes; and the search for
//! nearest neighbours that they use.

pub mod blocks;
pub(crate) mod clips;
pub mod density;
pub mod eigen;
pub(crate) mod knn;
pub(crate) mod knn_index;
pub(crate) mod knn_search;
pub mod normals;
pub(crate) mod palette;
pub(crate) mod sharp;
#[cfg(test)]
pub(crate) mod surfaces;
pub(crate) mod tangents;
