//! How the memory that a build may use is shared out.

use crate::attributes::normals::NormalsMode;
use crate::calls::build::Options;
use crate::sample::cell::LEAF_NODES;
use esker_scan::BESIDE_HELD_BYTES;

/// Nodes and rows of a chunk at most, where memory would hold more and no bucket is larger.
const CHUNK_NODES: u64 = 24;
const CHUNK_ROWS: u64 = 1 << 20;
/// Memory that reading takes beside rows and what a reader holds.
const READING_BYTES: u64 = 96 << 20;
// Rows have some of what scans leave beside what they hold.
const _: () = assert!(READING_BYTES < BESIDE_HELD_BYTES);
/// Rows in memory where all go to scratch.
pub(crate) const SPILLED_BYTES_MAX: u64 = 320 << 20;
/// Bytes a point of a chunk while normals are estimated, its halo's share among them.
const NORMALS_BYTES: f64 = 80.0;

/// The same while edges are found, more.
const EDGES_BYTES: f64 = 240.0;
/// The same while shapes are told, more.
const SHAPES_BYTES: f64 = 48.0;

/// How the memory is shared out. What does not fit goes to scratch: nodes don't depend on it, only
/// where their pages stand in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Bytes of rows kept while inputs are read or a chunk is parted.
    pub buffer_bytes_max: u64,
    /// Bytes for building chunks while those behind are loaded; one has at least a leaf's points,
    /// whatever this says.
    pub chunk_bytes_max: u64,
}

impl Shares {
    /// Of this much memory; what is left is for batches, cells above and what
    /// they wait for, and pages on their way.
    pub fn of(memory_bytes: u64) -> Self {
        let part = |share: f64| (memory_bytes as f64 * share) as u64;
        Self { buffer_bytes_max: part(0.3), chunk_bytes_max: part(0.45) }
    }

    /// What is left of this memory for rows while a reader holds so much of an input.
    pub fn beside(self, held_bytes: u64, memory_bytes: u64) -> Self {
        let room = memory_bytes.saturating_sub(READING_BYTES + held_bytes);
        Self { buffer_bytes_max: self.buffer_bytes_max.min(room), ..self }
    }

    /// Rows of a chunk of several buckets, and half of those of all chunks that are under way, or
    /// those of one bucket alone. Their sorted rows, pages of about the rows' size, and the samples
    /// must fit. Small chunks share out better among threads; where memory is ample, they use the
    /// same memory again.
    pub(crate) fn chunk_rows_max(&self, options: &Options, row_bytes: usize) -> (u64, u64) {
        let rows = self.rows_of(4.2, options, row_bytes);
        let nodes = |n| u64::from(options.node_capacity) * n;
        // A cell that is not split is not cut either.
        let least = nodes(LEAF_NODES as u64);
        let rows = rows.clamp(least, (1 << 32) - 1);
        let joined = (rows / 2).max(least);
        (joined.min(nodes(CHUNK_NODES).max(CHUNK_ROWS)), rows)
    }

    /// Rows of a chunk of each of which there are so many copies.
    fn rows_of(&self, copies: f64, options: &Options, row_bytes: usize) -> u64 {
        let estimating = if options.normals == NormalsMode::Estimate { NORMALS_BYTES } else { 0.0 };
        let finding = if options.sharp_features { EDGES_BYTES } else { 0.0 };
        let shaping = if options.tangents { SHAPES_BYTES } else { 0.0 };
        let each = row_bytes as f64 * copies + 8.0 + 24.0 + estimating + finding + shaping;
        (self.chunk_bytes_max as f64 / each) as u64
    }
}
