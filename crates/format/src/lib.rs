//! The bytes of the .esker file: writer, reader, verify; the only crate that knows them. A node's points
//! go in as [`PagePoints`] and come out again to the bit; in between stand pages of planes, the node
//! table, statistics, metadata and a footer, specified to the byte in `data-format/SPEC.md`.

#[cfg(target_endian = "big")]
compile_error!("the node table is used as it lies on disk, little-endian");

pub mod codec;
pub mod columns;
pub mod directory;
pub mod error;
pub mod footer;
pub mod forest;
mod json;
mod kinds;
pub mod layout;
pub mod metadata;
pub mod normals;
pub mod page;
mod planes;
mod points;
pub mod read_at;
pub mod reader;
mod sections;
mod sequential;
pub mod shown;
pub mod statistics;
mod system;
pub mod table;
mod values;
pub mod verify;
pub mod writer;

pub use codec::{Codec, Encoding};
pub use error::FormatError;
pub use footer::{Footer, VERSION};
pub use forest::Forest;
pub use layout::{PageLayout, PlaneKind};
pub use metadata::{CrsRecord, Metadata, SourceRecord, TreeRef};
pub use normals::Normals;
pub use page::{Page, encode_page};
pub use points::PagePoints;
pub use read_at::{FileSource, ReadAt};
pub use reader::{EskerFile, Planes};
pub use shown::Shown;
pub use statistics::{Histograms, NodeStatistics, Ranges, Statistics};
pub use verify::{VerifyReport, verify};
pub use writer::FileWriter;
