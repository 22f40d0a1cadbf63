//! What an export writes: the nodes of all trees that pass a filter, attributes and colours, the
//! sources, and the notes. Without a filter, count and multiset hash of the points that were
//! written must be those of each footer.

use crate::calls::export_aside::AsideExport;
use crate::calls::export_colours::ColourConversion;
use crate::calls::export_notes::{note_absent, note_overlap};
use crate::calls::export_tree::{SelectedNode, TreeExport, own_attributes, select_nodes};
use crate::error::BuildError;
use esker_format::{EskerFile, Forest, SourceRecord};
use esker_points::attribute::names;
use esker_points::filter::LatticeFilter;
use esker_points::{AttrType, Attribute, ColourDepth, Filter, MultisetHash, Schema, Task};
use esker_scan::write::{Encode, Encoded, Origin, Outline, Target};
use esker_scan::{Crs, ScanError};
use std::path::Path;
use std::sync::Arc;

/// Result of an export.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// Points of all trees.
    pub points_in: u64,
    /// Points written.
    pub points_out: u64,
    /// Points that the files keep beside their trees, and that were written too.
    pub set_aside_out: u64,
    /// Multiset hash of the points of the trees that were written; if all were, the sum of the
    /// trees' hashes.
    pub hash: MultisetHash,
    /// Whether the filter accepts all points.
    pub is_whole: bool,
    /// Whether the files state hashes, with which those of the points were compared.
    pub has_hashes: bool,
    /// Number of trees.
    pub trees: u64,
    /// Nodes of all trees.
    pub nodes: u64,
    /// Nodes whose pages were read.
    pub nodes_read: u64,
    /// Bytes of these pages.
    pub bytes_read: u64,
    /// Bytes written.
    pub bytes_out: u64,
    /// Format, version and variant of the output.
    pub format: String,
    /// Notes for the user, a line each.
    pub notes: Vec<String>,
}

/// What is exported: the nodes that may have points which pass the filter, and how these are
/// written.
pub(super) struct Selection<'a> {
    /// The files.
    pub forest: &'a Forest,
    filter: &'a Filter,
    on_lattice: LatticeFilter,
    /// Format of the output.
    pub target: Target,
    /// The trees, the oldest first, and their nodes.
    pub trees: Vec<(&'a EskerFile, Vec<SelectedNode>)>,
    /// Greatest number of points.
    pub points_max: u64,
    /// Attributes of all trees.
    schema: Arc<Schema>,
    /// Attributes that are written.
    written: Arc<Schema>,
    colours: Option<Arc<ColourConversion>>,
}

/// Sums over what was written.
#[derive(Default)]
pub(super) struct Written {
    points: u64,
    hash: MultisetHash,
    /// Points from beside the trees.
    pub set_aside: u64,
}

impl Written {
    /// Adds the points of a tree.
    ///
    /// # Errors
    /// If they are not all points of the tree although all are wanted.
    pub fn add(
        &mut self,
        selection: &Selection<'_>,
        tree: usize,
        points: u64,
        hash: MultisetHash,
    ) -> Result<(), BuildError> {
        if selection.filter.is_all() {
            prove(selection.trees[tree].0, points, hash)?;
        }
        self.points += points;
        self.hash += hash;
        Ok(())
    }
}

impl<'a> Selection<'a> {
    /// Selects the nodes of `forest` for an output at `out`.
    ///
    /// # Errors
    /// If the name of the output or the filter is wrong, or a file is damaged.
    pub fn new(
        forest: &'a Forest,
        out: &Path,
        filter: &'a Filter,
        colour_depth: Option<ColourDepth>,
        task: &dyn Task,
    ) -> Result<Self, BuildError> {
        let target = Target::of(out)?;
        let wrong = |e: esker_points::FilterError| {
            BuildError::Options(format!("{}: {e}", forest.path().display()))
        };
        let on_lattice = filter.on(&forest.exact_lattice(), forest.schema()).map_err(wrong)?;
        forest.files().try_for_each(EskerFile::check_verbatim)?;
        // A file names older files, so the last one listed is the oldest.
        let attribute_bytes = forest.schema().record_bytes();
        let mut trees: Vec<(&EskerFile, Vec<SelectedNode>)> =
            Vec::with_capacity(forest.files().len());
        for file in forest.files() {
            trees.insert(0, (file, select_nodes(file, &on_lattice, attribute_bytes)?));
        }
        let nodes = |nodes: &[SelectedNode]| {
            let mut nodes: Vec<u32> = nodes.iter().map(|n| n.node).collect();
            nodes.dedup();
            nodes
        };
        let selections: Vec<_> = trees.iter().map(|(file, all)| (*file, nodes(all))).collect();
        let colours = ColourConversion::choose(forest, &selections, target, colour_depth, task)?
            .map(Arc::new);
        let schema = Arc::new(forest.schema().clone());
        let written = colours.as_ref().map_or(&schema, |colours| colours.schema()).clone();
        let points_max =
            trees.iter().flat_map(|(_, nodes)| nodes).map(|n| n.run.len() as u64).sum();
        Ok(Self { forest, filter, on_lattice, target, trees, points_max, schema, written, colours })
    }

    /// What is known of the output before its first point.
    ///
    /// # Errors
    /// If statistics cannot be read.
    pub fn outline(&self) -> Result<Outline, BuildError> {
        Ok(Outline {
            lattice: self.forest.exact_lattice(),
            schema: self.written.clone(),
            points_max: self.points_max,
            ranges: ranges(self.forest, &self.written, self.target)?,
            classes: classes(self.forest, &self.written),
        })
    }

    /// The sources of all trees, the oldest first.
    pub fn origins(&self) -> impl Iterator<Item = Result<Origin, ScanError>> + '_ {
        self.trees.iter().flat_map(|(file, _)| {
            let sources = file.metadata().sources.iter().enumerate();
            sources.map(move |(i, record)| origin(file, i, record))
        })
    }

    /// The export of a tree.
    pub fn tree(&self, tree: usize, encode: &Arc<dyn Encode>) -> TreeExport<'_> {
        let file = self.trees[tree].0;
        TreeExport {
            file,
            filter: &self.on_lattice,
            schema: self.schema.clone(),
            own: own_attributes(file, &self.schema),
            encode: encode.clone(),
            colours: self.colours.clone(),
        }
    }

    /// The points beside the trees, and a note if there are some that are not written.
    pub fn aside(&self, encode: &dyn Encode) -> (Vec<Encoded>, Option<String>) {
        let colours = self.colours.as_deref();
        let is_whole = self.filter.is_all();
        AsideExport { forest: self.forest, schema: &self.schema, colours, is_whole }.encode(encode)
    }

    /// Refuses an output without points of files with points.
    ///
    /// # Errors
    /// If it is one.
    pub fn check_any(&self, written: &Written) -> Result<(), BuildError> {
        let points_in = self.forest.points();
        if written.points > 0 || points_in == 0 {
            return Ok(());
        }
        let path = self.forest.path().display();
        Err(BuildError::Options(format!(
            "{path}: none of its {points_in} points is wanted; nothing was written"
        )))
    }

    /// All notes of an export: those of its beginning, on colours, of the `remarks` on what was
    /// written, on attributes that points lack (by the field of each that is written), and on trees
    /// that overlap.
    pub fn notes(
        &self,
        beginning: impl IntoIterator<Item = String>,
        remarks: Vec<String>,
        fields: &[usize],
    ) -> Vec<String> {
        let colours = self.colours.iter().flat_map(|colours| colours.notes());
        let before = beginning.into_iter().chain(colours).chain(remarks);
        before.chain(self.end_notes(fields)).collect()
    }

    fn end_notes(&self, fields: &[usize]) -> Vec<String> {
        let fields = match &self.colours {
            Some(colours) => colours.index_of.iter().map(|&i| fields[i]).collect(),
            None => fields.to_vec(),
        };
        let absent = note_absent(self.forest, &fields, self.target);
        absent.into_iter().chain(note_overlap(self.forest, self.filter)).collect()
    }

    /// The result.
    pub fn report(
        &self,
        written: &Written,
        bytes_out: u64,
        format: String,
        notes: Vec<String>,
    ) -> Exported {
        let selected = self.trees.iter().flat_map(|(_, nodes)| nodes);
        let pages = || selected.clone().filter(|n| n.run.start == 0);
        Exported {
            points_in: self.forest.points(),
            points_out: written.points,
            set_aside_out: written.set_aside,
            hash: written.hash,
            is_whole: self.filter.is_all(),
            has_hashes: !self.forest.is_growing(),
            trees: self.trees.len() as u64,
            nodes: self.forest.table().nodes.len() as u64,
            nodes_read: pages().count() as u64,
            bytes_read: pages().map(|n| u64::from(n.page_bytes)).sum(),
            bytes_out,
            format,
            notes,
        }
    }
}

/// Checks that `points` and `hash` are those of the footer of `file`.
fn prove(file: &EskerFile, points: u64, hash: MultisetHash) -> Result<(), BuildError> {
    let footer = file.footer();
    // Files of other formats state a number of points, and no hash.
    if points == footer.points && (hash == footer.hash || file.is_growing()) {
        return Ok(());
    }
    Err(BuildError::Differs(format!(
        "{}: its {points} points (hash {hash}) are not those that its footer states ({}, hash {}); \
         nothing was written",
        file.path().display(),
        footer.points,
        footer.hash
    )))
}

/// Restorable properties of a source: kind of grid, reference system, verbatim blocks.
pub(super) fn origin(
    file: &EskerFile,
    index: usize,
    record: &SourceRecord,
) -> Result<Origin, ScanError> {
    let verbatim = file.verbatim(index).map_err(|e| BuildError::from(e).through_sink())?;
    let crs = record.crs.as_ref().map(|c| Crs { text: c.text.clone(), unit: c.unit.clone() });
    Ok(Origin { kind: record.grid.kind, crs, verbatim })
}

/// Ranges of the attributes whose form in the export depends on them.
pub(super) fn ranges(
    forest: &Forest,
    schema: &Schema,
    target: Target,
) -> Result<Vec<Option<(f64, f64)>>, BuildError> {
    let is_needed = |a: &Attribute| match a.ty {
        AttrType::U64 | AttrType::I64 => true,
        // Text names the byte after what it holds.
        _ if a.key() == (names::RETURNS, AttrType::U8) => {
            matches!(target, Target::Text | Target::Csv)
        }
        _ => target.is_las() && a.name == names::INTENSITY,
    };
    if !schema.attributes.iter().any(is_needed) {
        return Ok(Vec::new());
    }
    let mut ranges: Vec<Option<(f64, f64)>> = vec![None; schema.attributes.len()];
    for file in forest.files().filter(|file| file.footer().points > 0) {
        let statistics = file.statistics()?;
        for (range, a) in ranges.iter_mut().zip(&schema.attributes).filter(|(_, a)| is_needed(a)) {
            let own = file.layout().schema().find_typed(&a.name, a.ty);
            // A point that lacks the attribute is written with 0.
            let (low, high) = own.and_then(|own| statistics.subtree(0, own)).unwrap_or((0.0, 0.0));
            let (least, greatest) = range.unwrap_or((0.0, 0.0));
            *range = Some((least.min(low), greatest.max(high)));
        }
    }
    Ok(ranges)
}

/// The attributes of `schema` that the points of each class have, each set once.
pub(super) fn classes(forest: &Forest, schema: &Schema) -> Vec<Vec<usize>> {
    let mut classes: Vec<Vec<usize>> = Vec::new();
    for layout in forest.files().map(EskerFile::layout) {
        for class in layout.classes() {
            let own = class.present.iter().map(|&a| &layout.schema().attributes[usize::from(a)]);
            let present: Vec<usize> =
                own.filter_map(|a| schema.find_typed(&a.name, a.ty)).collect();
            if !classes.contains(&present) {
                classes.push(present);
            }
        }
    }
    classes
}
