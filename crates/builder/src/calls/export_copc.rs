//! Export to COPC: the nodes of all trees become the voxels of one octree
//! ([`crate::calls::voxels`]), each a chunk that is decoded, encoded and compressed in parallel
//! with others, and written in the order of the pages.

use crate::calls::export_tree::{SelectedNode, TreeExport, groups};
use crate::calls::selection::{Exported, Selection, Written};
use crate::calls::voxels::{Placement, Share};
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

/// Number and hash of points.
type Sum = (u64, MultisetHash);

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
    let tables: Vec<_> = selection.trees.iter().map(|(file, _)| file.table()).collect();
    let forest = selection.forest;
    let placement = Placement::new(&tables, forest.bounds(), forest.lattice());
    let outline = selection.outline()?;
    let started = copc::create(out, &outline, &mut selection.origins(), placement.octree, crs)?;
    task.phase("exporting", Some(selection.points_max), "points");
    let trees = 0..selection.trees.len();
    let writing = Writing {
        trees: trees.clone().map(|tree| selection.tree(tree, &started.encode)).collect(),
        compression: &started.compression,
        octree: placement.octree,
        task,
    };
    let mut output = started.output;
    let (sums, read) = writing.run(&in_order(selection, &placement), &mut output)?;
    if read != selection.points_max {
        let path = forest.path().display();
        let what =
            "some of its points lie outside of the box that it states for them: it is damaged";
        return Err(BuildError::Differs(format!("{path}: {what}; nothing was written")));
    }
    let mut written = Written::default();
    for (tree, (points, hash)) in trees.zip(sums) {
        written.add(selection, tree, points, hash)?;
    }
    // No variant of LAS holds points outside of the lattice.
    let (_, aside_note) = selection.aside(&*started.encode);
    selection.check_any(&written)?;
    task.check()?;
    let beginning = started.notes.into_iter().chain(aside_note);
    let notes = selection.notes(beginning, output.remarks(), &started.fields);
    let bytes_out = output.finish()?;
    Ok(selection.report(&written, bytes_out, started.format, notes))
}

/// The voxels in the order of the pages of their first points.
fn in_order(selection: &Selection<'_>, placement: &Placement) -> Vec<Voxel> {
    let mut all: BTreeMap<VoxelKey, Vec<(usize, SelectedNode)>> = BTreeMap::new();
    for (tree, (file, nodes)) in selection.trees.iter().enumerate() {
        for selected in nodes {
            let index = selected.node as usize;
            for share in placement.shares(tree, index, &file.table().nodes[index]) {
                let Share { key, range, within } = share;
                let run = range.start.max(selected.run.start)..range.end.min(selected.run.end);
                if run.is_empty() {
                    continue;
                }
                let bytes = run.len() as u64 * selected.decoded_bytes;
                let decoded_bytes = bytes / selected.run.len().max(1) as u64;
                let part = SelectedNode { run, decoded_bytes, within, ..selected.clone() };
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
    octree: copc::Octree,
    task: &'a dyn Task,
}

impl Writing<'_> {
    /// Reads and writes all voxels; returns number and hash of the points of each tree, and the
    /// number of points that were decoded.
    fn run(
        &self,
        voxels: &[Voxel],
        output: &mut CopcOutput,
    ) -> Result<(Vec<Sum>, u64), BuildError> {
        let (mut sums, mut read): (Vec<Sum>, u64) = Default::default();
        sums.resize_with(self.trees.len(), Sum::default);
        let mut ready = Vec::new();
        let mut put = |chunks: Vec<VoxelChunk>| -> Result<(), BuildError> {
            for chunk in chunks {
                self.task.check()?;
                for (tree, points, hash) in chunk.sums {
                    sums[tree].0 += points;
                    sums[tree].1 += hash;
                }
                output.put(chunk.key, &chunk.chunk)?;
                read += chunk.read;
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
        Ok((sums, read))
    }

    fn compress_all(&self, group: &[Voxel]) -> Result<Vec<VoxelChunk>, BuildError> {
        // All results are collected first, so that the first error in the order of writing is
        // reported.
        let chunks: Vec<_> = group.par_iter().map(|voxel| self.compress(voxel)).collect();
        chunks.into_iter().collect()
    }

    fn compress(&self, voxel: &Voxel) -> Result<VoxelChunk, BuildError> {
        let mut writer = ChunkWriter::new(self.compression, self.octree.cell(voxel.key))?;
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
