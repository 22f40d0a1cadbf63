//! What a file says of its node table, so that it need not be read whole, and what was read of it
//! besides. Shared by all states of an opened file.

use crate::columns::ColumnPlaces;
use crate::statistics::Statistics;
use crate::table_parts::TableParts;
use crate::table_top::TableTop;
use esker_points::NodeTable;
use std::sync::{Arc, OnceLock};

/// What a file says of its node table.
pub(crate) struct TableIndex {
    /// Where its columns of statistics are.
    pub(crate) places: ColumnPlaces,
    /// Checksums of the parts of the table.
    pub(crate) parts: TableParts,
    /// The uppermost nodes.
    pub(crate) top: TableTop,
    /// The whole table, if it was read after a part of it.
    pub(crate) whole: OnceLock<Arc<NodeTable>>,
    /// Statistics that were read for a table of which only a part is known.
    pub(crate) statistics: OnceLock<Arc<Statistics>>,
}

impl TableIndex {
    /// What was read of the columns of a file.
    pub(crate) fn new(places: ColumnPlaces, parts: TableParts, top: TableTop) -> Self {
        Self { places, parts, top, whole: OnceLock::new(), statistics: OnceLock::new() }
    }
}
