//! Images that passes work on: the pyramid, marks, edges, windows of pixels, the surface to shade, the margin.

pub mod edges;
pub mod margin;
pub(crate) mod marks;
pub mod pyramid;
pub mod surface;
pub(crate) mod windows;
