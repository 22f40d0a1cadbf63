//! From an `.esker` file, and the files that it names, back to a scan format: tree by tree, the
//! oldest first, the nodes that pass a filter are decoded and encoded in parallel, in the order of
//! their pages, and written while the next ones are decoded. Nodes that the node table and the
//! statistics exclude are not read. Without a filter, count and multiset hash of the points passed
//! to the writer must be those of each footer.

use crate::calls::export_copc::export_copc;
use crate::calls::export_tree::{EncodedNode, SelectedNode, TreeExport, groups};
use crate::calls::selection::{Exported, Selection, Written};
use crate::error::BuildError;
use esker_format::Forest;
use esker_points::{ColourDepth, Filter, MultisetHash, Task};
use esker_scan::write::las::copc;
use esker_scan::write::{self, Output};
use std::path::Path;

/// What a caller wants of an export beside its points.
#[derive(Clone, Debug, Default)]
pub struct ExportOptions {
    /// Bits of colours; those that lose nothing by default.
    pub colour_depth: Option<ColourDepth>,
    /// Coordinate reference system of a COPC output in WKT, in place of that of the scans.
    pub crs: Option<String>,
}

/// [`export_with`] usual options.
///
/// # Errors
/// As [`export_with`].
pub fn export(
    forest: &Forest,
    out: &Path,
    filter: &Filter,
    task: &dyn Task,
) -> Result<Exported, BuildError> {
    export_with(forest, out, filter, ExportOptions::default(), task)
}

/// Writes the points of all trees that pass `filter` to `out`, in the format that its extension
/// names, in the current rayon pool. After an error there is no file under the final name. A
/// spacing in the filter applies to each tree separately.
///
/// # Errors
/// If a file is damaged, the format cannot hold the attributes, no point passes the filter although
/// there are points, the disk is full, or on request.
pub fn export_with(
    forest: &Forest,
    out: &Path,
    filter: &Filter,
    options: ExportOptions,
    task: &dyn Task,
) -> Result<Exported, BuildError> {
    let selection = Selection::new(forest, out, filter, options.colour_depth, task)?;
    if copc::is_named(out) {
        if forest.is_growing() {
            let what = "is COPC already, whose voxels are not divided anew: build it, and export the built file";
            return Err(BuildError::Options(format!("{}: {what}", forest.path().display())));
        }
        return export_copc(&selection, out, options.crs.as_deref(), task);
    }
    if options.crs.is_some() {
        let what = "--crs gives the coordinate reference system of COPC: name the output .copc.laz, or leave it out";
        return Err(BuildError::Options(format!("{}: {what}", out.display())));
    }
    let outline = selection.outline()?;
    let started = write::create(out, selection.target, &outline, &mut selection.origins())?;
    task.phase("exporting", Some(selection.points_max), "points");
    let mut output = started.output;
    let mut written = Written::default();
    for tree in 0..selection.trees.len() {
        let nodes = &selection.trees[tree].1;
        let exported = selection.tree(tree, &started.encode);
        let (points, own) = run(&exported, nodes, &mut *output, task)?;
        written.add(&selection, tree, points, own)?;
    }
    let (aside, aside_note) = selection.aside(&*started.encode);
    for encoded in aside {
        written.set_aside += encoded.points;
        output.put(encoded)?;
    }
    selection.check_any(&written)?;
    task.check()?;
    let beginning = started.notes.into_iter().chain(aside_note);
    let notes = selection.notes(beginning, output.remarks(), &started.fields);
    let bytes_out = output.finish()?;
    Ok(selection.report(&written, bytes_out, started.format, notes))
}

/// Reads and writes the nodes of a tree; returns number and hash of the points written.
fn run(
    tree: &TreeExport<'_>,
    nodes: &[SelectedNode],
    output: &mut dyn Output,
    task: &dyn Task,
) -> Result<(u64, MultisetHash), BuildError> {
    let (mut points, mut hash) = (0, MultisetHash::default());
    let mut ready = Vec::new();
    let mut put = |nodes: Vec<EncodedNode>| -> Result<(), BuildError> {
        for node in nodes {
            task.check()?;
            points += node.encoded.points;
            hash += node.hash;
            output.put(node.encoded)?;
            task.advance(node.read);
        }
        Ok(())
    };
    for group in groups(nodes, |n| n.decoded_bytes.max(u64::from(n.page_bytes))) {
        let before = std::mem::take(&mut ready);
        let (decoded, written) = rayon::join(|| tree.encode_all(group, task), || put(before));
        written?;
        ready = decoded?;
    }
    put(ready)?;
    Ok((points, hash))
}
