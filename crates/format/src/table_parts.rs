//! Column of statistics with the checksums of parts of the node table, so that parts can be read
//! without the rest. In: the table, its sides and the histograms; out: the bytes of the column, and
//! back. SPEC section 11.

use crate::bytes::{u32_at, u64_at};
use crate::error::Fault;
use esker_points::node::Sides;
use esker_points::{Node, NodeTable};
use std::ops::Range;

/// How the node table of a file can be read in parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartSizes {
    /// Number of nodes from which on a file has parts.
    pub from_nodes: usize,
    /// Nodes of a part, 1 to 65,536.
    pub part_nodes: u32,
    /// Most nodes of the top of the table, 1 to 65,536.
    pub top_nodes: usize,
}

impl Default for PartSizes {
    /// Tables from 1.2 MB on. The top is more than an overview draws and takes 344 KiB, a part 40.
    fn default() -> Self {
        Self { from_nodes: 8192, part_nodes: 256, top_nodes: 2048 }
    }
}

/// Nodes of a part that readers take, at most: a part is 10 MiB.
const PART_NODES_MAX: u32 = 1 << 16;
const HEAD_BYTES: usize = 8;
const TAIL_BYTES: usize = 8;

/// Checksums of consecutive parts of a node table, all of the same number of nodes but the last.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TableParts {
    /// Nodes of the whole table.
    nodes: u32,
    part_nodes: u32,
    /// CRC-32 of the columns of histograms, one after the other.
    pub(crate) histograms: u32,
    /// CRC-32 of the records and of the sides of each part; of no sides 0.
    crcs: Vec<[u32; 2]>,
}

impl TableParts {
    /// Checksums of a table in parts of `part_nodes` nodes; `sides` is empty if the file has none.
    pub(crate) fn of(table: &NodeTable, sides: &[Sides], histograms: u32, part_nodes: u32) -> Self {
        let records = table.nodes.chunks(part_nodes as usize);
        let crc = |records: &[Node]| crc32fast::hash(bytemuck::cast_slice(records));
        let mut crcs: Vec<_> = records.map(|part| [crc(part), 0]).collect();
        for (crcs, sides) in crcs.iter_mut().zip(sides.chunks(part_nodes as usize)) {
            crcs[1] = crc32fast::hash(bytemuck::cast_slice(sides));
        }
        Self { nodes: table.nodes.len() as u32, part_nodes, histograms, crcs }
    }

    /// Nodes of a part.
    pub(crate) fn part_nodes(&self) -> u32 {
        self.part_nodes
    }

    /// Bytes of the column.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut column = self.part_nodes.to_le_bytes().to_vec();
        column.extend_from_slice(&self.histograms.to_le_bytes());
        column.extend_from_slice(bytemuck::cast_slice(&self.crcs));
        sealed(column)
    }

    /// Reads the column of a file of `nodes` nodes.
    pub(crate) fn decode(column: &[u8], nodes: u32) -> Result<Self, Fault> {
        let body = unsealed(column, "parts of the table")?;
        let fault = |what: &str| Err(Fault::new("statistics", what));
        if body.len() < HEAD_BYTES {
            return fault("the column of parts of the table is too short");
        }
        let (part_nodes, histograms) = (u32_at(body, 0), u32_at(body, 4));
        if part_nodes == 0 || part_nodes > PART_NODES_MAX {
            return fault("the parts of the table have an impossible number of nodes");
        }
        let (crcs, rest) = body[HEAD_BYTES..].as_chunks::<8>();
        if crcs.len() != nodes.div_ceil(part_nodes) as usize || !rest.is_empty() {
            return fault("the parts of the table are not as many as its nodes make");
        }
        let crcs = crcs.iter().map(|crc| [u32_at(crc, 0), u32_at(crc, 4)]).collect();
        Ok(Self { nodes, part_nodes, histograms, crcs })
    }

    /// Numbers of the parts that have nodes of a range, which is not empty.
    pub(crate) fn parts_of(&self, nodes: &Range<u32>) -> Range<u32> {
        nodes.start / self.part_nodes..nodes.end.div_ceil(self.part_nodes)
    }

    /// Nodes of some consecutive parts.
    pub(crate) fn nodes_of(&self, parts: &Range<u32>) -> Range<u32> {
        let at = |part: u32| part.saturating_mul(self.part_nodes).min(self.nodes);
        at(parts.start)..at(parts.end)
    }

    /// Checks the records and the sides of some consecutive parts; `sides` is empty if the file has
    /// none.
    pub(crate) fn check(
        &self,
        parts: &Range<u32>,
        records: &[Node],
        sides: &[Sides],
    ) -> Result<(), Fault> {
        let of_parts = self.crcs.get(parts.start as usize..parts.end as usize).unwrap_or_default();
        let part_nodes = self.part_nodes as usize;
        let mut of_sides = sides.chunks(part_nodes);
        for ((part, crcs), records) in (parts.start..).zip(of_parts).zip(records.chunks(part_nodes))
        {
            let sides = of_sides.next().map_or(0, |s| crc32fast::hash(bytemuck::cast_slice(s)));
            if [crc32fast::hash(bytemuck::cast_slice(records)), sides] != *crcs {
                let what = format!("the checksum of part {part} does not match");
                return Err(Fault::new("node table", what));
            }
        }
        Ok(())
    }
}

/// Adds the checksum of a column, and zeros up to a multiple of 8 bytes behind it.
pub(crate) fn sealed(mut column: Vec<u8>) -> Vec<u8> {
    let crc = crc32fast::hash(&column);
    column.extend_from_slice(&u64::from(crc).to_le_bytes());
    column
}

/// A column without its checksum, which is compared.
pub(crate) fn unsealed<'a>(column: &'a [u8], what: &str) -> Result<&'a [u8], Fault> {
    let (body, crc) = column.split_at(column.len().saturating_sub(TAIL_BYTES));
    if crc.len() != TAIL_BYTES || u64::from(crc32fast::hash(body)) != u64_at(crc, 0) {
        let what = format!("the checksum of the column of the {what} does not match");
        return Err(Fault::new("statistics", what));
    }
    Ok(body)
}
