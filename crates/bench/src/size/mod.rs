//! The benchmark of size. Each smaller form of the hot planes (`packing`) is drawn beside the
//! planes as they are, over an overview, a closer view and a near one: error of the picture, of
//! positions, colours and normals, against bytes a point. `kanzok2015` needs 24 bytes a point; a
//! file of Esker 8, with colour 12, with normals too 16.

mod measure;
mod packing;
mod report;

pub use measure::{SizeBenchRequest, measure};
pub use report::{SizeReport, text};
