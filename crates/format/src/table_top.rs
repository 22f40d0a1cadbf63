//! Column of statistics with a copy of the uppermost nodes of the table, so that a view of a large
//! file can be chosen, and its extent estimated, without the rest. In: the table; out: the nodes,
//! what is below them, and the bytes of the column. SPEC section 11.

use crate::bytes::{u32_at, u64_at};
use crate::error::Fault;
use crate::layout::PageLayout;
use crate::table::{check_cells, check_node};
use crate::table_parts::{sealed, unsealed};
use esker_points::node::{NONE, Sides};
use esker_points::{Node, NodeTable};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Nodes that readers take, at most: 12 MiB.
const TOP_NODES_MAX: usize = 1 << 16;
const HEAD_BYTES: usize = 8;
const ENTRY_BYTES: usize = 16;

/// A node of the top of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TopNode {
    /// Its index in the file.
    pub index: u32,
    /// Points of the nodes below it, if its children are not in the top; 0 for others.
    pub points_below: u64,
    /// Spacing of the leaves below it, if its children are not in the top, the file's unit: that of
    /// the leaf with which, in the order of spacings, half of the points of these leaves are
    /// reached. 0 for others.
    pub leaf_spacing: f32,
}

/// The uppermost nodes of a table: with each node but the root its parent and its siblings.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TableTop {
    /// In the order of the table.
    pub(crate) entries: Vec<TopNode>,
    /// Their records, as in the file.
    pub(crate) nodes: Vec<Node>,
    /// Their sides; empty if the file has none.
    pub(crate) sides: Vec<Sides>,
}

impl TableTop {
    /// The nodes of a table that views take first: the children of the coarsest nodes, again and
    /// again, up to `most` nodes. `sides` is empty if the file has none.
    pub(crate) fn of(table: &NodeTable, sides: &[Sides], most: usize) -> Self {
        let mut indices = Vec::new();
        let mut open = BinaryHeap::new();
        // Bits of non-negative floats sort as the floats do.
        let key = |index: u32| (table.nodes[index as usize].spacing.to_bits(), Reverse(index));
        if !table.nodes.is_empty() {
            indices.push(0);
            open.push(key(0));
        }
        while let Some((_, Reverse(index))) = open.pop() {
            let children = table.nodes[index as usize].children();
            if indices.len() + children.len() > most {
                break;
            }
            open.extend(children.clone().map(key));
            indices.extend(children);
        }
        indices.sort_unstable();
        Self::with(table, sides, &indices)
    }

    /// The nodes of a table with these indices, ascending; each is in the table.
    pub(crate) fn with(table: &NodeTable, sides: &[Sides], indices: &[u32]) -> Self {
        let is_in = |index: u32| indices.binary_search(&index).is_ok();
        let below = below(table, is_in);
        let entry = |&index: &u32| below.get(index);
        Self {
            entries: indices.iter().map(entry).collect(),
            nodes: indices.iter().map(|&index| table.nodes[index as usize]).collect(),
            sides: indices.iter().filter_map(|&index| sides.get(index as usize).copied()).collect(),
        }
    }

    /// Bytes of the column.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut column = (self.entries.len() as u32).to_le_bytes().to_vec();
        column.extend_from_slice(&[0; 4]);
        for entry in &self.entries {
            column.extend_from_slice(&entry.points_below.to_le_bytes());
            column.extend_from_slice(&entry.leaf_spacing.to_le_bytes());
            column.extend_from_slice(&entry.index.to_le_bytes());
        }
        column.extend_from_slice(bytemuck::cast_slice(&self.nodes));
        column.extend_from_slice(bytemuck::cast_slice(&self.sides));
        sealed(column)
    }

    /// Reads the column; its nodes are not checked.
    pub(crate) fn decode(column: &[u8], has_sides: bool) -> Result<Self, Fault> {
        let body = unsealed(column, "top of the table")?;
        let fault = |what: &str| Err(Fault::new("statistics", what));
        let count = body.get(..HEAD_BYTES).map_or(0, |head| u32_at(head, 0) as usize);
        let sides_bytes = if has_sides { size_of::<Sides>() } else { 0 };
        if count == 0 || count > TOP_NODES_MAX || u32_at(body, 4) != 0 {
            return fault("the top of the table has an impossible number of nodes");
        }
        if body.len() != HEAD_BYTES + count * (ENTRY_BYTES + size_of::<Node>() + sides_bytes) {
            return fault("the top of the table is not as long as its nodes");
        }
        let (entries, rest) = body[HEAD_BYTES..].split_at(count * ENTRY_BYTES);
        let (nodes, sides) = rest.split_at(count * size_of::<Node>());
        let entry = |bytes: &[u8; ENTRY_BYTES]| TopNode {
            points_below: u64_at(bytes, 0),
            leaf_spacing: f32::from_bits(u32_at(bytes, 8)),
            index: u32_at(bytes, 12),
        };
        let entries: Vec<_> = entries.as_chunks().0.iter().map(entry).collect();
        let nodes = nodes.chunks_exact(size_of::<Node>()).map(bytemuck::pod_read_unaligned);
        let sides = sides.as_chunks::<16>().0.iter().map(|s| [u64_at(s, 0), u64_at(s, 8)]);
        let is_sound = |of: &TopNode| of.leaf_spacing.is_finite() && of.leaf_spacing >= 0.0;
        if !entries.iter().all(is_sound) || !entries.is_sorted_by(|a, b| a.index < b.index) {
            return fault("the nodes of the top of the table are not in its order");
        }
        Ok(Self { nodes: nodes.collect(), sides: sides.collect(), entries })
    }

    /// Place of a node of the file among these.
    pub(crate) fn place_of(&self, index: u32) -> Option<usize> {
        self.entries.binary_search_by_key(&index, |entry| entry.index).ok()
    }

    /// Whether the nodes are those of the table of their file.
    pub(crate) fn is_of(&self, table: &NodeTable) -> bool {
        let is_it = |(entry, node): (&TopNode, &Node)| {
            table
                .nodes
                .get(entry.index as usize)
                .is_some_and(|stored| bytemuck::bytes_of(stored) == bytemuck::bytes_of(node))
        };
        self.entries.iter().zip(&self.nodes).all(is_it)
    }

    /// The table of these nodes alone, checked by the rules of node tables; `nodes` is the number
    /// of nodes of the whole table. Nodes whose children are not among these lack them.
    pub(crate) fn table(
        &self,
        nodes: u32,
        layout: &PageLayout,
        pages_end: u64,
    ) -> Result<NodeTable, Fault> {
        let in_file: Vec<u32> = self.entries.iter().map(|entry| entry.index).collect();
        let fault = |index: u32, what: &str| {
            Fault::new("top of the node table", format!("node {index}: {what}"))
        };
        let mut table = self.nodes.clone();
        for (place, (node, &index)) in self.nodes.iter().zip(&in_file).enumerate() {
            check_node(node, index, nodes, layout, pages_end).map_err(|what| fault(index, what))?;
            let above = self.place_of(node.parent).filter(|&above| above < place);
            let is_linked = match above {
                _ if place == 0 => index == 0 && node.parent == NONE && !node.is_continuation(),
                None => false,
                // All children of its parent are here, or none.
                Some(above) => self.nodes[above].children().contains(&index),
            };
            if !is_linked {
                return Err(fault(index, "its parent does not list it"));
            }
            table[place].parent = above.map_or(NONE, |above| above as u32);
            let count = usize::from(node.child_count);
            if count == 0 {
                continue;
            }
            let first = in_file.binary_search(&node.first_child);
            table[place].first_child = first.map_or(NONE, |first| first as u32);
            let Ok(first) = first else {
                let below = in_file.partition_point(|&other| other < node.first_child);
                if in_file.get(below).is_some_and(|other| node.children().contains(other)) {
                    return Err(fault(index, "only some of its children are in the top"));
                }
                continue;
            };
            let are_all = in_file.get(first..first + count);
            if are_all.is_none_or(|of| !node.children().eq(of.iter().copied())) {
                return Err(fault(index, "only some of its children are in the top"));
            }
            check_cells(node, &self.nodes[first..first + count])
                .map_err(|what| fault(index, what))?;
        }
        Ok(NodeTable { sides: self.sides.clone(), in_file, ..NodeTable::of_tree(table) })
    }
}

/// What is below the nodes at the lower end of the top of a table.
struct Below {
    points: BTreeMap<u32, u64>,
    spacings: BTreeMap<u32, f32>,
}

impl Below {
    fn get(&self, index: u32) -> TopNode {
        TopNode {
            index,
            points_below: self.points.get(&index).copied().unwrap_or(0),
            leaf_spacing: self.spacings.get(&index).copied().unwrap_or(0.0),
        }
    }
}

/// Sums what is below the nodes of a top, which `is_in` tells.
fn below(table: &NodeTable, is_in: impl Fn(u32) -> bool) -> Below {
    // The node of the top above each other node; parents come before their children.
    let mut above = vec![NONE; table.nodes.len()];
    let (mut points, mut leaves) = (BTreeMap::new(), Vec::new());
    for (index, node) in (0u32..).zip(&table.nodes) {
        if is_in(index) {
            continue;
        }
        let of_parent = above.get(node.parent as usize).copied().filter(|&top| top != NONE);
        let top = of_parent.unwrap_or(node.parent);
        above[index as usize] = top;
        *points.entry(top).or_insert(0) += node.points() as u64;
        if node.child_count == 0 {
            leaves.push((top, node.spacing, node.points() as u64));
        }
    }
    leaves.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let spacing = |of: &[(u32, f32, u64)]| {
        let half = of.iter().map(|leaf| leaf.2).sum::<u64>().div_ceil(2);
        let mut reached = 0;
        let middle = of.iter().find(|leaf| {
            reached += leaf.2;
            reached >= half
        });
        (of[0].0, middle.map_or(0.0, |leaf| leaf.1))
    };
    let spacings = leaves.chunk_by(|a, b| a.0 == b.0).map(spacing);
    Below { points, spacings: spacings.collect() }
}
