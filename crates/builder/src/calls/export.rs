//! From an `.esker` file, and the files that it names, back to a scan format: tree by tree, the
//! oldest first, the nodes that pass a filter are decoded and encoded in parallel, in the order of
//! their pages, and written while the next ones are decoded. Nodes that the node table and the
//! statistics exclude are not read. Without a filter, count and multiset hash of the points passed
//! to the writer must be those of each footer.

use crate::calls::export_aside::AsideExport;
use crate::calls::export_colours::{ColourConversion, PointClasses};
use crate::calls::export_notes::{note_absent, note_overlap};
use crate::error::BuildError;
use esker_format::{
    EskerFile, Fault, Forest, FormatError, PagePoints, SourceRecord, StatisticSides, runs,
};
use esker_points::attribute::names;
use esker_points::filter::{LatticeFilter, Side};
use esker_points::{AttrType, Attribute, Batch, ColourDepth, Filter, MultisetHash, Schema, Task};
use esker_scan::write::{self, Encode, Encoded, Origin, Outline, Output, Target};
use esker_scan::{Crs, ScanError};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Bytes of points that are decoded together, for each thread. Two such groups are in memory, in
/// several forms.
const GROUP_BYTES_A_THREAD: u64 = 8 << 20;
/// Bytes of the position of a decoded point.
const POSITION_BYTES: usize = 12;

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

/// A node with points that may pass the filter, or a run of them: see [`runs`].
#[derive(Clone, Debug)]
struct SelectedNode {
    node: u32,
    /// Points to decode.
    run: Range<usize>,
    /// Their bytes when decoded.
    decoded_bytes: u64,
    /// Whether the filter must test each point.
    is_partial: bool,
    page_offset: u64,
    page_bytes: u32,
}

/// Points of a node, ready to be written.
struct EncodedNode {
    encoded: Encoded,
    hash: MultisetHash,
    read: u64,
}

/// What a caller wants of an export beside its points.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExportOptions {
    /// Bits of colours; those that lose nothing by default.
    pub colour_depth: Option<ColourDepth>,
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
    let target = Target::of(out)?;
    let wrong = |e: esker_points::FilterError| {
        BuildError::Options(format!("{}: {e}", forest.path().display()))
    };
    let on_lattice = filter.on(forest.lattice(), forest.schema()).map_err(wrong)?;
    forest.files().try_for_each(EskerFile::check_verbatim)?;
    // A file names older files, so the last one listed is the oldest.
    let row_bytes = POSITION_BYTES + forest.schema().record_bytes();
    let mut trees: Vec<(&EskerFile, Vec<SelectedNode>)> = Vec::with_capacity(forest.files().len());
    for file in forest.files() {
        trees.insert(0, (file, select_nodes(file, &on_lattice, row_bytes)?));
    }
    let selected = || trees.iter().flat_map(|(_, nodes)| nodes);
    let pages = || selected().filter(|n| n.run.start == 0);
    let points_max = selected().map(|n| n.run.len() as u64).sum();
    let schema = Arc::new(forest.schema().clone());
    let colours = {
        let nodes = |nodes: &[SelectedNode]| {
            let mut nodes: Vec<u32> = nodes.iter().map(|n| n.node).collect();
            nodes.dedup();
            nodes
        };
        let selections: Vec<_> = trees.iter().map(|(file, all)| (*file, nodes(all))).collect();
        ColourConversion::choose(forest, &selections, target, options.colour_depth, task)?
            .map(Arc::new)
    };
    let written = colours.as_ref().map_or(&schema, |colours| colours.schema()).clone();
    let ranges = ranges(forest, &written, target)?;
    let classes = classes(forest, &written);
    let outline =
        Outline { lattice: *forest.lattice(), schema: written, points_max, ranges, classes };
    let mut origins = trees.iter().flat_map(|(file, _)| {
        let sources = file.metadata().sources.iter().enumerate();
        sources.map(move |(i, record)| origin(file, i, record))
    });
    let started = write::create(out, target, &outline, &mut origins)?;

    task.phase("exporting", Some(points_max), "points");
    let is_whole = filter.is_all();
    let mut output = started.output;
    let (mut points_out, mut hash) = (0, MultisetHash::default());
    for (file, nodes) in &trees {
        let mut tree = TreeExport::new(file, &on_lattice, schema.clone(), started.encode.clone());
        tree.colours.clone_from(&colours);
        let (points, own) = tree.run(nodes, &mut *output, task)?;
        if is_whole {
            prove(file, points, own)?;
        }
        points_out += points;
        hash += own;
    }
    let aside = AsideExport { forest, schema: &schema, colours: colours.as_deref(), is_whole };
    let (set_aside_out, aside_note) = aside.write(&*started.encode, &mut *output)?;
    let points_in = forest.points();
    if points_out == 0 && points_in > 0 {
        let path = forest.path().display();
        return Err(BuildError::Options(format!(
            "{path}: none of its {points_in} points is wanted; nothing was written"
        )));
    }
    task.check()?;
    let mut notes = started.notes;
    notes.extend(aside_note);
    notes.extend(colours.iter().flat_map(|colours| colours.notes()));
    notes.extend(output.remarks());
    let bytes_out = output.finish()?;
    let fields = match &colours {
        Some(colours) => colours.index_of.iter().map(|&i| started.fields[i]).collect(),
        None => started.fields,
    };
    notes.extend(note_absent(forest, &fields, target));
    notes.extend(note_overlap(forest, filter));
    Ok(Exported {
        points_in,
        points_out,
        set_aside_out,
        hash,
        is_whole,
        trees: trees.len() as u64,
        nodes: forest.table().nodes.len() as u64,
        nodes_read: pages().count() as u64,
        bytes_read: pages().map(|n| u64::from(n.page_bytes)).sum(),
        bytes_out,
        format: started.format,
        notes,
    })
}

/// Checks that `points` and `hash` are those of the footer of `file`.
fn prove(file: &EskerFile, points: u64, hash: MultisetHash) -> Result<(), BuildError> {
    let footer = file.footer();
    if (points, hash) == (footer.points, footer.hash) {
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

/// The nodes of a tree with points that may pass `filter`, in the order of their pages.
/// Each comes in runs of points of `row_bytes`.
fn select_nodes(
    tree: &EskerFile,
    filter: &LatticeFilter,
    row_bytes: usize,
) -> Result<Vec<SelectedNode>, BuildError> {
    let nodes = &tree.table().nodes;
    let sides = StatisticSides::new(tree, filter)?;
    let mut selected = Vec::new();
    for (index, node) in (0u32..).zip(nodes) {
        let prefix = filter.prefix(node, nodes.get(node.parent as usize));
        let [min, max] = node.own_box();
        let by_box = if prefix == 0 { Side::Outside } else { filter.side_of_box(min, max) };
        let side = if by_box == Side::Outside { by_box } else { by_box.and(sides.own(index)) };
        if side == Side::Outside {
            continue;
        }
        selected.extend(runs(prefix, row_bytes).map(|run| SelectedNode {
            node: index,
            decoded_bytes: (run.len() * row_bytes) as u64,
            run,
            is_partial: side == Side::Across,
            page_offset: node.page_offset,
            page_bytes: node.page_bytes,
        }));
    }
    selected.sort_by_key(|n| (n.page_offset, n.run.start));
    Ok(selected)
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

/// Export of one tree.
struct TreeExport<'a> {
    file: &'a EskerFile,
    filter: &'a LatticeFilter,
    /// Attributes of all trees.
    schema: Arc<Schema>,
    /// The tree's attribute for each of these.
    own: Vec<Option<usize>>,
    encode: Arc<dyn Encode>,
    /// Conversion of its colours, if they are not written as they are.
    colours: Option<Arc<ColourConversion>>,
}

impl<'a> TreeExport<'a> {
    fn new(
        file: &'a EskerFile,
        filter: &'a LatticeFilter,
        schema: Arc<Schema>,
        encode: Arc<dyn Encode>,
    ) -> Self {
        let own = own_attributes(file, &schema);
        Self { file, filter, schema, own, encode, colours: None }
    }

    /// Reads and writes the nodes; returns number and hash of the points written.
    fn run(
        &self,
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
        for group in groups(nodes) {
            let before = std::mem::take(&mut ready);
            let (decoded, written) = rayon::join(|| self.decode(group, task), || put(before));
            written?;
            ready = decoded?;
        }
        put(ready)?;
        Ok((points, hash))
    }

    fn decode(
        &self,
        group: &[SelectedNode],
        task: &dyn Task,
    ) -> Result<Vec<EncodedNode>, BuildError> {
        // All results are collected first, so that the first error in file order is reported.
        let nodes: Vec<_> = group.par_iter().map(|node| self.encode_node(node, task)).collect();
        nodes.into_iter().collect()
    }

    fn encode_node(
        &self,
        selected: &SelectedNode,
        task: &dyn Task,
    ) -> Result<EncodedNode, BuildError> {
        task.check()?;
        let page = self.file.read_page(selected.node)?;
        let damaged = |fault: Fault| FormatError::Damaged {
            path: self.file.path().to_owned(),
            section: format!("page of node {}, {}", selected.node, fault.section),
            fault: fault.fault,
        };
        let mut points = page.points_in(selected.run.clone()).map_err(damaged)?;
        drop(page);
        self.filter_points(selected, &mut points)?;
        let hash = points.hash(self.file.layout());
        let batch = batch(self.file, points, &self.schema, &self.own, self.colours.as_deref());
        let read = selected.run.len() as u64;
        Ok(EncodedNode { encoded: self.encode.encode(&batch), hash, read })
    }

    /// Removes the points that do not pass the filter.
    fn filter_points(
        &self,
        selected: &SelectedNode,
        points: &mut PagePoints,
    ) -> Result<(), BuildError> {
        if !selected.is_partial {
            return Ok(());
        }
        let [min, max] = self.file.node(selected.node)?.own_box();
        let test = self.filter.in_box(min, max);
        let layout = self.file.layout();
        let own = |name: &str| layout.schema().find_typed(name, AttrType::U8);
        let (classes, flags) = (own(names::CLASSIFICATION), own(names::FLAGS));
        let value = |attribute: Option<usize>, i: usize| {
            let has = |a: &usize| layout.has_attribute(points.class(i), *a);
            attribute.filter(has).map(|a| points.columns[a][i])
        };
        let positions = points.positions.iter().enumerate();
        let tests = self.filter.value_tests(layout.schema());
        let sizes = layout.schema().attributes.iter().map(|a| a.ty.size()).collect::<Vec<_>>();
        let bytes = |a: usize, i: usize| {
            let has = layout.has_attribute(points.class(i), a);
            has.then(|| &points.columns[a][i * sizes[a]..][..sizes[a]])
        };
        let keeps = |(i, &p): (usize, &[u32; 3])| {
            test.keeps(p, value(classes, i), value(flags, i)) && tests.keep(|a| bytes(a, i))
        };
        let kept: Vec<bool> = positions.map(keeps).collect();
        self.keep(points, &kept);
        Ok(())
    }

    /// Removes the points at which `kept` is false, and those past its end.
    fn keep(&self, points: &mut PagePoints, kept: &[bool]) {
        let attributes = self.file.layout().schema().attributes.iter();
        for (column, size) in points.columns.iter_mut().zip(attributes.map(|a| a.ty.size())) {
            compact(column, size, kept);
        }
        compact(&mut points.positions, 1, kept);
        compact(&mut points.radius_codes, 1, kept);
        compact(&mut points.classes, 1, kept);
    }
}

/// The points of `file` with the attributes of all trees; zeros for those that this tree lacks.
/// `own` has the tree's attribute for each of `schema`; `colours` converts them, if they are not
/// written as they are.
pub(super) fn batch(
    file: &EskerFile,
    mut points: PagePoints,
    schema: &Arc<Schema>,
    own: &[Option<usize>],
    colours: Option<&ColourConversion>,
) -> Batch {
    let classes = PointClasses::of_points(&points);
    let count = points.len();
    let column = |(own, attribute): (&Option<usize>, &Attribute)| match own {
        Some(own) => std::mem::take(&mut points.columns[*own]),
        None => vec![0; count * attribute.ty.size()],
    };
    let columns = own.iter().zip(&schema.attributes).map(column).collect();
    let mut batch = Batch::with_capacity(schema.clone(), 0);
    (batch.positions, batch.columns) = (points.positions, columns);
    match colours {
        Some(colours) => colours.convert(file, &classes, batch),
        None => batch,
    }
}

/// The tree's attribute for each of `schema`.
pub(super) fn own_attributes(file: &EskerFile, schema: &Schema) -> Vec<Option<usize>> {
    let find = |a: &Attribute| file.layout().schema().find_typed(&a.name, a.ty);
    schema.attributes.iter().map(find).collect()
}

/// Removes the items of `values`, of `size` values each, at which `kept` is false, and those past
/// its end. `values` may be empty.
fn compact<T: Copy>(values: &mut Vec<T>, size: usize, kept: &[bool]) {
    let mut end = 0;
    if !values.is_empty() {
        for (i, _) in kept.iter().enumerate().filter(|(_, kept)| **kept) {
            values.copy_within(i * size..(i + 1) * size, end);
            end += size;
        }
    }
    values.truncate(end);
}

/// Splits the runs into groups that keep all threads busy and together take little memory.
fn groups(nodes: &[SelectedNode]) -> impl Iterator<Item = &[SelectedNode]> {
    let room = GROUP_BYTES_A_THREAD * rayon::current_num_threads() as u64;
    let mut rest = nodes;
    std::iter::from_fn(move || {
        let mut bytes = 0;
        let within = |node: &&SelectedNode| {
            bytes += node.decoded_bytes.max(u64::from(node.page_bytes));
            bytes <= room
        };
        let n = rest.iter().take_while(within).count().max(1).min(rest.len());
        let (group, after) = rest.split_at(n);
        rest = after;
        (!group.is_empty()).then_some(group)
    })
}
