//! Types that all of Esker shares: the integer lattice of all coordinates, attributes and columnar
//! batches of points, Morton codes, cells of the octree, the node table, the multiset hash,
//! filters, and what counts as a file. This crate knows no file format, no thread and no device.

pub mod address;
pub mod attribute;
mod batch;
mod cell;
pub mod clip;
pub mod codes;
pub mod fetch;
pub mod filter;
pub mod hash;
pub mod lattice;
pub mod morton;
pub mod named;
pub mod node;
pub mod objects;
pub mod palette;
pub mod place;
pub mod positioned;
pub mod quant;
pub mod read_at;
mod schema;
pub mod spread;
pub mod strata;
pub mod tangents;
pub mod task;
pub mod unfinished;

pub use attribute::{AttrType, Attribute};
pub use batch::{Batch, Column, Rounding};
pub use cell::Cell;
pub use clip::{Clip, ClipLine, ClipWords, Grain};
pub use codes::{Codes, Coding};
pub use filter::{Filter, FilterError};
pub use hash::MultisetHash;
pub use lattice::{Grid, InputGrid, Lattice};
pub use node::{Contour, Node, NodeName, NodeTable};
pub use schema::{ColourDepth, Conflict, PointClass, Schema};
pub use spread::Spread;
pub use task::{Cancelled, Task};
