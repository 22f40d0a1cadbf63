//! Compares a table with the rest of its folder: the boxes of LAS headers, the columns that most
//! tables have, and where their points lie.

use super::table::Table;
use crate::las;
use std::path::PathBuf;

/// Extents by which the points of a table may lie beside the rest of the folder: neighbours of a
/// tile lie one extent away.
const EXTENTS_MAX: f64 = 20.0;
/// Distance that is near whatever the extent: small scans of a site, metres.
const NEAR: f64 = 1000.0;

/// Names of the columns of a table, if they have any, and their number.
type Columns = (Option<Vec<String>>, usize);

/// What scans of a folder look like.
pub(super) struct Rest {
    /// Whether there are scans that are no tables.
    has_scans: bool,
    /// Bounds of the scans whose headers state them, from above.
    bounds: Option<[[f64; 2]; 2]>,
    /// Columns of the tables with most bytes, if there are several tables.
    columns: Option<Columns>,
}

impl Rest {
    /// Looks at the scans and the tables of a folder.
    pub fn new(scans: &[PathBuf], tables: &[(PathBuf, Table)]) -> Self {
        let mut bounds: Option<[[f64; 2]; 2]> = None;
        for [low, high] in scans.iter().filter_map(|path| las::header_bounds(path)) {
            let [min, max] = bounds.get_or_insert([[low[0], low[1]], [high[0], high[1]]]);
            for i in 0..2 {
                (min[i], max[i]) = (min[i].min(low[i]), max[i].max(high[i]));
            }
        }
        let mut kinds: Vec<(Columns, u64)> = Vec::new();
        for (_, table) in tables {
            let key = key_of(table);
            match kinds.iter_mut().find(|(other, _)| *other == key) {
                Some((_, bytes)) => *bytes += table.bytes,
                None => kinds.push((key, table.bytes)),
            }
        }
        let columns = kinds.into_iter().max_by_key(|(_, bytes)| *bytes).map(|(key, _)| key);
        let columns = columns.filter(|_| tables.len() > 1);
        Self { has_scans: !scans.is_empty(), bounds, columns }
    }

    /// Why a table is no scan like the rest of the folder; `None` if it may be one.
    pub fn why_not(&self, table: &Table) -> Option<&'static str> {
        let is_like_tables = self.columns.as_ref().is_none_or(|columns| *columns == key_of(table));
        let is_alone = !self.has_scans && is_like_tables;
        if is_alone {
            return None;
        }
        if table.is_path() && (self.has_scans || !is_like_tables) {
            return Some("trajectories");
        }
        if table.names_places() {
            return None;
        }
        if !is_like_tables || self.has_scans && !table.is_usual() {
            return Some("tables with other columns than the rest");
        }
        let is_far = self.bounds.is_some_and(|bounds| is_far(table, bounds));
        is_far.then_some("tables far from the rest")
    }
}

fn key_of(table: &Table) -> Columns {
    (table.names.clone(), table.columns())
}

/// Whether most rows of a table, read as x and y first, lie far beside a box.
fn is_far(table: &Table, [min, max]: [[f64; 2]; 2]) -> bool {
    let extent = (max[0] - min[0]).max(max[1] - min[1]);
    let reach = (EXTENTS_MAX * extent).max(NEAR);
    let is_near = |row: &&Vec<f64>| {
        row.len() > 1 && (0..2).all(|i| min[i] - reach <= row[i] && row[i] <= max[i] + reach)
    };
    table.rows.iter().filter(is_near).count() * 2 < table.rows.len()
}
