//! Export to COPC: the nodes of all trees become the voxels of one octree ([`voxels`]), each a chunk
//! that is decoded, encoded and compressed in parallel with others, and written in the order of the
//! pages.

use crate::calls::export_tree::{SelectedNode, TreeExport, groups};
use crate::calls::selection::{Exported, Selection, Written};
use crate::calls::voxels;
use crate::error::BuildError;
use esker_points::{MultisetHash, Task};
use esker_scan::write::las::copc::{self, Chunk, ChunkWriter, Compression, CopcOutput, VoxelKey};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// A voxel and the runs of points that come to it, with the numbers of their trees.
struct Voxel {
    key: VoxelKey,
    runs: Vec<(usize, SelectedNode)>,
}

/// A voxel, ready to be written.
struct VoxelChunk {
    key: VoxelKey,
    chunk: Chunk,
    /// Number and hash of the points of trees.
    sums: Vec<(usize, u64, MultisetHash)>,
    /// Number of points decoded.
    read: u64,
}

/// Writes `selection` to `out`; `crs` is the coordinate reference system to state, in WKT.
///
/// # Errors
/// As [`crate::export_with`].
pub(super) fn export_copc(
    selection: &Selection<'_>,
    out: &Path,
    crs: Option<&str>,
    task: &dyn Task,
) -> Result<Exported, BuildError> {
    let tables = selection.trees.iter().map(|(file, _)| file.table());
    let octree = voxels::octree(tables, selection.forest.lattice());
    let outline = selection.outline()?;
    let started = copc::create(out, &outline, &mut selection.origins(), octree, crs)?;
    task.phase("exporting", Some(selection.points_max), "points");
    let trees = 0..selection.trees.len();
    let writing = Writing {
        trees: trees.clone().map(|tree| selection.tree(tree, &started.encode)).collect(),
        compression: &started.compression,
        task,
    };
    let mut output = started.output;
    let sums = writing.run(&in_order(selection, &octree), &mut output)?;
    let mut written = Written::default();
    for (tree, (points, hash)) in trees.zip(sums) {
        written.add(selection, tree, points, hash)?;
    }
    // No variant of LAS holds points outside of the lattice.
    let (_, aside_note) = selection.aside(&*started.encode);
    selection.check_any(&written)?;
    task.check()?;
    let mut notes = started.notes;
    notes.extend(aside_note);
    notes.extend(selection.colour_notes());
    notes.extend(output.remarks());
    let bytes_out = output.finish()?;
    notes.extend(selection.end_notes(&started.fields));
    Ok(selection.report(&written, bytes_out, started.format, notes))
}

/// The voxels in the order of the pages of their first points.
fn in_order(selection: &Selection<'_>, octree: &copc::Octree) -> Vec<Voxel> {
    let mut all: BTreeMap<VoxelKey, Vec<(usize, SelectedNode)>> = BTreeMap::new();
    for (tree, (file, nodes)) in selection.trees.iter().enumerate() {
        let table = file.table();
        let levels = voxels::levels(table, octree);
        for selected in nodes {
            let index = selected.node as usize;
            for (key, range) in voxels::voxels(&table.nodes[index], levels[index], octree) {
                let run = range.start.max(selected.run.start)..range.end.min(selected.run.end);
                if run.is_empty() {
                    continue;
                }
                let share = run.len() as u64 * selected.decoded_bytes;
                let decoded_bytes = share / selected.run.len().max(1) as u64;
                let part = SelectedNode { run, decoded_bytes, ..selected.clone() };
                all.entry(key).or_default().push((tree, part));
            }
        }
    }
    let mut voxels: Vec<Voxel> = all.into_iter().map(|(key, runs)| Voxel { key, runs }).collect();
    voxels.sort_by_key(|v| v.runs.first().map(|(tree, n)| (*tree, n.page_offset, n.run.start)));
    voxels
}

/// What the threads need.
struct Writing<'a> {
    trees: Vec<TreeExport<'a>>,
    compression: &'a Compression,
    task: &'a dyn Task,
}

impl Writing<'_> {
    /// Reads and writes all voxels; returns number and hash of the points of each tree.
    fn run(
        &self,
        voxels: &[Voxel],
        output: &mut CopcOutput,
    ) -> Result<Vec<(u64, MultisetHash)>, BuildError> {
        let mut sums = vec![(0, MultisetHash::default()); self.trees.len()];
        let mut ready = Vec::new();
        let mut put = |chunks: Vec<VoxelChunk>| -> Result<(), BuildError> {
            for chunk in chunks {
                self.task.check()?;
                for (tree, points, hash) in chunk.sums {
                    sums[tree].0 += points;
                    sums[tree].1 += hash;
                }
                output.put(chunk.key, &chunk.chunk)?;
                self.task.advance(chunk.read);
            }
            Ok(())
        };
        let bytes = |voxel: &Voxel| voxel.runs.iter().map(|(_, n)| n.decoded_bytes).sum();
        for group in groups(voxels, bytes) {
            let before = std::mem::take(&mut ready);
            let (made, written) = rayon::join(|| self.compress_all(group), || put(before));
            written?;
            ready = made?;
        }
        put(ready)?;
        Ok(sums)
    }

    fn compress_all(&self, group: &[Voxel]) -> Result<Vec<VoxelChunk>, BuildError> {
        // All results are collected first, so that the first error in the order of writing is
        // reported.
        let chunks: Vec<_> = group.par_iter().map(|voxel| self.compress(voxel)).collect();
        chunks.into_iter().collect()
    }

    fn compress(&self, voxel: &Voxel) -> Result<VoxelChunk, BuildError> {
        let mut writer = ChunkWriter::new(self.compression)?;
        let (mut sums, mut read) = (Vec::with_capacity(voxel.runs.len()), 0);
        for (tree, run) in &voxel.runs {
            let node = self.trees[*tree].encode_node(run, self.task)?;
            writer.put(&node.encoded)?;
            sums.push((*tree, node.encoded.points, node.hash));
            read += node.read;
        }
        Ok(VoxelChunk { key: voxel.key, chunk: writer.finish()?, sums, read })
    }
}
