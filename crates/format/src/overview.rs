//! Nodes from which the extent of a forest's points and their distances are estimated, without
//! the records of all nodes of a large file.

use crate::forest::Forest;
use esker_points::Node;

/// A node from which a whole forest is estimated ([`Forest::overview`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverviewNode {
    /// Its index in the table of the forest.
    pub node: u32,
    /// Number of its own points.
    pub points: u64,
    /// Number of the points below it, of which its own are an even sample, if nodes below it do not
    /// belong to the overview.
    pub points_below: u64,
    /// Typical spacing of the leaves that it stands for, itself or below it, the file's unit;
    /// `None` if it stands for none.
    pub leaf_spacing: Option<f32>,
}

impl Forest {
    /// Nodes from which the extent of the points and their distances are estimated: of large files
    /// those of their top ([`crate::EskerFile::top`]), whatever else is known of their table, and
    /// of others all; in the order of the files.
    pub fn overview(&self) -> Vec<OverviewNode> {
        let mut nodes = Vec::new();
        for (file, first) in self.files_with_first() {
            let records = &file.table().nodes;
            let leaf = |node: &Node| (node.child_count == 0).then_some(node.spacing);
            let Some(top) = file.top() else {
                nodes.extend((first..).zip(records).map(|(node, record)| OverviewNode {
                    node,
                    points: record.points() as u64,
                    points_below: 0,
                    leaf_spacing: leaf(record),
                }));
                continue;
            };
            nodes.extend((0u32..).zip(top).map(|(place, of)| {
                let own = if file.is_partial() { place } else { of.index };
                let record = &records[own as usize];
                let below = (of.points_below > 0).then_some(of.leaf_spacing);
                OverviewNode {
                    node: first + own,
                    points: record.points() as u64,
                    points_below: of.points_below,
                    leaf_spacing: leaf(record).or(below),
                }
            }));
        }
        nodes
    }
}
