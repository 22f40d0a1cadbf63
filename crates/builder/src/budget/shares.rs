//! Shares of the memory of a build: for rows that are not yet built, and for chunks in progress.

use crate::input::plan::Plan;
use crate::options::Options;
use crate::sample::cell::LEAF_NODES;
use esker_scan::BESIDE_HELD_BYTES;

/// Most nodes, and most rows if that is more, of a chunk of several buckets, even if memory would
/// hold more.
const CHUNK_NODES: u64 = 24;
const CHUNK_ROWS: u64 = 1 << 20;
/// Memory that reading uses besides rows and what a reader holds of an input.
const READING_BYTES: u64 = 96 << 20;
// Some of the memory that scans leave must remain for rows.
const _: () = assert!(READING_BYTES < BESIDE_HELD_BYTES);
/// Most bytes of rows in memory if all go to scratch.
pub(crate) const SPILLED_BYTES_MAX: u64 = 320 << 20;
/// Bytes a point of a chunk, with its share of the halo, while normals are estimated.
const NORMALS_BYTES: f64 = 80.0;
/// More bytes a point while sharp edges are detected.
const EDGES_BYTES: f64 = 240.0;
/// More bytes a point while shapes of splats are estimated.
const SHAPES_BYTES: f64 = 48.0;

/// Shares of the memory. Rows that do not fit go to scratch. The file does not depend on the
/// shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Bytes of rows in memory while inputs are read or a bucket is split.
    pub buffer_bytes_max: u64,
    /// Bytes of chunks in progress. A chunk has at least the points of a
    /// leaf even if they need more.
    pub chunk_bytes_max: u64,
}

impl Shares {
    /// Shares of `memory_bytes`. The rest is for batches, cells above chunks with the samples that
    /// wait for them, and pages that wait for the disk.
    pub fn of(memory_bytes: u64) -> Self {
        let share = |share: f64| (memory_bytes as f64 * share) as u64;
        Self { buffer_bytes_max: share(0.3), chunk_bytes_max: share(0.45) }
    }

    /// Reduces the share of rows while a reader holds `held_bytes` of an input.
    pub fn beside(self, held_bytes: u64, memory_bytes: u64) -> Self {
        let room = memory_bytes.saturating_sub(READING_BYTES + held_bytes);
        Self { buffer_bytes_max: self.buffer_bytes_max.min(room), ..self }
    }

    /// Most rows of a chunk of several buckets, and of a chunk of one bucket. The second is also
    /// half of the most rows of all chunks in progress. Memory must hold the sorted rows, pages of
    /// about their size, and the samples. Small chunks keep more threads busy, and reuse memory.
    pub(crate) fn chunk_rows_max(&self, options: &Options, plan: &Plan) -> (u64, u64) {
        let rows = self.rows_of(4.2, options, plan);
        let nodes = |n| u64::from(options.node_capacity) * n;
        // A chunk must be able to hold a leaf.
        let least = nodes(LEAF_NODES as u64);
        let rows = rows.clamp(least, (1 << 32) - 1);
        let joined = (rows / 2).max(least);
        (joined.min(nodes(CHUNK_NODES).max(CHUNK_ROWS)), rows)
    }

    /// Rows that the memory for chunks holds `copies` times, with what is computed for them.
    fn rows_of(&self, copies: f64, options: &Options, plan: &Plan) -> u64 {
        let estimating = if plan.computed.is_any() { NORMALS_BYTES } else { 0.0 };
        let finding = if options.sharp_features { EDGES_BYTES } else { 0.0 };
        let shaping = if options.tangents { SHAPES_BYTES } else { 0.0 };
        let each = plan.row_bytes() as f64 * copies + 8.0 + 24.0 + estimating + finding + shaping;
        (self.chunk_bytes_max as f64 / each) as u64
    }
}
