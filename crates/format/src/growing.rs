//! Trees of other formats, drawn without conversion: their pages are made when they are read, and
//! their node table grows and becomes exact meanwhile. A [`crate::Forest`] shows one state of the
//! table; [`crate::Forest::newer`] gives the next one.

use crate::metadata::Metadata;
use crate::statistics::Statistics;
use esker_points::read_at::ReadAt;
use esker_points::{Lattice, NodeTable};
use std::io;
use std::sync::Arc;

/// A tree whose pages are made when they are read, at the offsets that the node table has.
///
/// What is known of a node before its page is made: its cell, its number of points, a contour
/// around the whole cell, an estimate of its spacing. Making the page replaces contour, spacing and
/// levels. Nodes are only added, behind the others; cells, numbers of points, pages and the boxes
/// of positions stay as they are.
pub trait Growing: ReadAt {
    /// The node table and the number of its version, if that is not `known`.
    fn table(&self, known: Option<u64>) -> Option<(u64, Arc<NodeTable>)>;

    /// Makes what is not known yet of nodes: their pages, and the nodes below those that stand for
    /// more of the tree.
    ///
    /// # Errors
    /// If they cannot be read.
    fn complete(&self, nodes: &[u32]) -> io::Result<()>;

    /// Most bytes of pages that are kept in memory.
    fn kept_bytes_max(&self) -> u64;

    /// Coordinates of the points of a node as the file has them, in the order of its page.
    ///
    /// # Errors
    /// If they cannot be read.
    fn own_positions(&self, node: u32) -> io::Result<Vec<[i32; 3]>>;

    /// Lattice of the coordinates that the file has: each is moved by 2^31.
    fn own_lattice(&self) -> Lattice;

    /// Whether the file is another one than that which was opened.
    ///
    /// # Errors
    /// If it cannot be read, or is shorter now.
    fn is_changed(&self) -> io::Result<bool>;

    /// Statistics of the nodes of a table: nodes whose points are not known may have any value.
    /// Histograms are those of the points known when it was opened.
    fn statistics(&self, table: &NodeTable) -> Statistics;
}

/// What is known of a tree before its pages are made.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Its description. Its lattice is that of the node table.
    pub metadata: Metadata,
    /// Number of points of the whole tree.
    pub points: u64,
    /// Bytes of the file that it is made of.
    pub file_bytes: u64,
}
