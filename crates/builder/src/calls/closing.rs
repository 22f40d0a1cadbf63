//! A build in progress, and its end: proves that the tree holds the points that were read, closes
//! the file, and reports.

use crate::budget::memory::{self, Peak};
use crate::calls::metadata::{note_aside, notes};
use crate::calls::rounding::check_rounding;
use crate::error::BuildError;
use crate::options::{Options, Report};
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::tree::proof::{bounds_of, hash_of, prove, prove_merged};
use crate::tree::subtree::{Subtree, assemble};
use esker_format::{Metadata, Normals, Statistics};
use esker_points::palette::{Misfit, Palette};
use esker_points::{MultisetHash, NodeTable, Schema, Task};
use std::collections::BTreeMap;

/// A build in progress.
pub(crate) struct Build<'a> {
    /// Its files.
    pub(crate) store: &'a mut Store,
    pub(crate) options: &'a Options,
    pub(crate) task: &'a dyn Task,
    pub(crate) peak: Peak,
    /// Anonymous memory at the start.
    pub(crate) anon_bytes_before: u64,
    pub(crate) scratch_bytes_estimated: Option<u64>,
}

/// A tree that was proven to hold all points, and what the file stores with them.
pub(crate) struct ProvenTree {
    table: NodeTable,
    statistics: Statistics,
    bounds: Option<[[u32; 3]; 2]>,
    normals: Normals,
    has_clip_lines: bool,
    palette: Option<Palette>,
    palette_misfit: Option<Misfit>,
}

/// Number of points in the file, of refused points by reason, and the hash of those in the file.
pub(crate) type CountedPoints = (u64, BTreeMap<String, u64>, MultisetHash);

impl Build<'_> {
    /// Proves that a tree, built in `context`, holds `points` points with this hash.
    ///
    /// # Errors
    /// [`BuildError::Proof`] if it does not.
    pub(crate) fn prove_tree(
        &self,
        root: Option<Subtree>,
        context: Context,
        schema: &Schema,
        (points, hash): (u64, MultisetHash),
        palette_misfit: Option<Misfit>,
    ) -> Result<ProvenTree, BuildError> {
        let bounds = root.as_ref().and_then(bounds_of);
        let written = root.as_ref().map_or_else(MultisetHash::default, hash_of);
        let (table, own) = assemble(root);
        prove(&table, points, written, hash)?;
        if let Some(merged) = &self.options.inherited.merged {
            prove_merged(merged, points, hash)?;
        }
        let histograms = context.counts.into_inner();
        let statistics = Statistics::assemble(&table, schema, own, histograms);
        Ok(ProvenTree {
            table,
            statistics,
            bounds,
            normals: context.pages.normals(),
            has_clip_lines: context.clips.is_some(),
            palette: context.pages.palette().cloned(),
            palette_misfit,
        })
    }

    /// Closes the file with `metadata`, to which is added what was computed with the tree.
    /// `rounding_error_max` is the largest distance by which a coordinate was rounded.
    ///
    /// # Errors
    /// If coordinates were rounded by more than points are apart; if the disk is full, or on
    /// request.
    pub(crate) fn close(
        self,
        tree: ProvenTree,
        metadata: Metadata,
        points: CountedPoints,
        rounding_error_max: f64,
    ) -> Result<Report, BuildError> {
        let metadata = Metadata {
            normals: tree.normals,
            has_clip_lines: tree.has_clip_lines,
            has_tangents: self.options.tangents,
            palette: tree.palette.clone(),
            bounds: tree.bounds,
            ..metadata
        };
        let rounded = check_rounding(&tree.table, &metadata, self.options)?;
        self.peak.sample();
        self.task.check()?;
        let (table, statistics) = (&tree.table, &tree.statistics);
        let writer = &mut self.store.writer;
        let bytes_out = writer.finish(table, statistics, &metadata, points.0, points.2)?;
        let mut report = self.report(&tree, (&metadata, rounding_error_max), points, bytes_out);
        report.notes.extend(rounded);
        report.notes.extend(note_aside(&metadata));
        Ok(report)
    }

    /// Report of a finished build.
    fn report(
        &self,
        tree: &ProvenTree,
        (metadata, rounding_error_max): (&Metadata, f64),
        (points_out, points_refused, hash): CountedPoints,
        bytes_out: u64,
    ) -> Report {
        let scratch = &self.store.scratch;
        Report {
            points_in: points_out
                + points_refused.values().sum::<u64>()
                + metadata.set_aside.len() as u64,
            points_out,
            points_refused,
            points_set_aside: metadata.set_aside.len() as u64,
            hash,
            peak_anon_bytes: self.peak.bytes().saturating_sub(self.anon_bytes_before),
            peak_rss_bytes: memory::usage().rss_peak_bytes,
            scratch_bytes_estimated: self.scratch_bytes_estimated,
            scratch_bytes: scratch.bytes(),
            scratch_bytes_peak: scratch.bytes_peak(),
            disk_bytes_peak: scratch.disk_bytes_peak().max(bytes_out),
            bytes_out,
            nodes: tree.table.nodes.len() as u64,
            depth: tree.table.depths().into_iter().max().unwrap_or(0),
            rounding_error_max,
            palette_misfit: tree.palette_misfit,
            normals: tree.normals,
            has_tangents: self.options.tangents,
            notes: notes(metadata),
        }
    }
}
