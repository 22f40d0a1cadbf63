//! Images that passes work on: the pyramid and depth images, bit masks of pixels, edges, windows of
//! pixels, the surface to shade, the margin.

pub(crate) mod depth_image;
pub mod edges;
pub mod margin;
pub(crate) mod marks;
pub mod pyramid;
pub mod radii;
pub mod surface;
pub(crate) mod windows;
