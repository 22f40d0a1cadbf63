//! Files whose node table can be read in parts: what is known of it, the whole of it, and
//! statistics without the rest of their section. `docs/design/format.md`.

use crate::error::{Fault, FormatError};
use crate::reader::EskerFile;
use crate::sections::of_columns;
use crate::statistics::{Histograms, Statistics};
use crate::table_index::TableIndex;
use crate::table_top::TopNode;
use esker_points::NodeTable;
use std::sync::Arc;

impl EskerFile {
    /// Whether only a part of its node table is known: nodes lack their children
    /// ([`esker_points::Node::lacks_children`]) until these are read ([`EskerFile::complete`]), and
    /// have the indices in which they came ([`NodeTable::in_file`]).
    pub fn is_partial(&self) -> bool {
        self.partial.is_some()
    }

    /// The same file with its whole node table, which is read once.
    ///
    /// # Errors
    /// If it cannot be read or is damaged.
    pub fn whole(&self) -> Result<Self, FormatError> {
        let Some(index) = self.index.as_ref().filter(|_| self.is_partial()) else {
            return Ok(self.clone());
        };
        let table = match index.whole.get() {
            Some(table) => Arc::clone(table),
            None => {
                let table = self.read_indexed(index)?;
                Arc::clone(index.whole.get_or_init(|| table))
            }
        };
        let mut whole = self.clone();
        (whole.table, whole.partial) = (table, None);
        Ok(whole)
    }

    /// Reads the whole node table of a file that names its uppermost nodes, and compares these.
    pub(crate) fn read_indexed(&self, index: &TableIndex) -> Result<Arc<NodeTable>, FormatError> {
        let table = self.read_whole(&index.places)?;
        if !index.top.is_of(&table) {
            let fault = Fault::new("statistics", "the top of the table is that of another one");
            return Err(fault.damaged(self.path()));
        }
        Ok(table.into())
    }

    /// The uppermost nodes of the table, in its order, if the file names them: for estimates of
    /// large files. Of a partial table these are the first nodes.
    pub fn top(&self) -> Option<&[TopNode]> {
        self.index.as_ref().map(|index| index.top.entries.as_slice())
    }

    /// The statistics; those of a partial table are read once.
    pub(crate) fn shared_statistics(&self) -> Result<Arc<Statistics>, FormatError> {
        let Some(index) = self.index.as_ref().filter(|_| self.is_partial()) else {
            return Ok(Arc::new(self.statistics()?));
        };
        if let Some(statistics) = index.statistics.get() {
            return Ok(Arc::clone(statistics));
        }
        let statistics = Arc::new(self.statistics()?);
        Ok(Arc::clone(index.statistics.get_or_init(|| statistics)))
    }

    /// Reads the histograms: alone, where the file has a checksum of them.
    ///
    /// # Errors
    /// As for [`EskerFile::statistics`].
    pub fn histograms(&self) -> Result<Histograms, FormatError> {
        let Some(index) = &self.index else { return Ok(self.statistics()?.histograms().clone()) };
        let (source, count) = (self.source.as_ref(), self.layout().schema().attributes.len());
        let read = index.places.histograms(source, count, index.parts.histograms);
        of_columns(self.path(), read)
    }
}
