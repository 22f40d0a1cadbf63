//! The bytes of the .esker file: writer, reader, verifier; the only crate that knows them. A node's
//! points go in as [`PagePoints`] and come out again to the bit. The file has pages of planes, the
//! node table, statistics, metadata and a footer, specified to the byte in `data-format/SPEC.md`;
//! reasons are in `docs/design/format.md`.

#[cfg(target_endian = "big")]
compile_error!("the node table is used as it lies on disk, little-endian");

mod aside;
mod bytes;
mod codec;
mod columns;
mod directory;
mod error;
pub mod footer;
mod forest;
mod forest_filter;
pub mod growing;
mod in_parts;
mod json;
mod kinds;
mod layout;
mod metadata;
mod node_values;
mod normals;
mod overview;
mod page;
mod part;
mod partial;
mod planes;
mod points;
mod reader;
mod sections;
mod sequential;

mod statistics;
mod strict;
mod table;
mod table_index;
mod table_parts;
mod table_top;
mod tree_ref;
mod values;
mod verify;
mod writer;

pub use aside::{SET_ASIDE_MAX, SetAside};
pub use codec::{Codec, Encoding};
pub use error::{Fault, FormatError};
pub use esker_points::read_at::{FileSource, ReadAt};
pub use footer::{Footer, VERSIONS};
pub use forest::Forest;
pub use forest_filter::{ForestFilter, ReadRule};
pub use layout::{PageLayout, PlaneKind, PlaneSpec, runs};
pub use metadata::{CrsRecord, Metadata, SourceRecord, TREES_MAX, TreeRef};
pub use node_values::StatisticSides;
pub use normals::Normals;
pub use overview::OverviewNode;
pub use page::{Page, encode_page, encode_raw_page};
pub use part::Wanted;
pub use points::PagePoints;
pub use reader::{EskerFile, Planes};

pub use statistics::{Histograms, NodeStatistics, Ranges, Statistics};
pub use table::NODE_BYTES_MAX;
pub use table_parts::PartSizes;
pub use table_top::TopNode;
pub use verify::{VerifyReport, verify};
pub use writer::FileWriter;
