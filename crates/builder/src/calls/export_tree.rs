//! The nodes of a tree that an export reads, and their points: decoded, filtered and encoded, in
//! parallel. Nodes that the node table and the statistics exclude are not read.

use crate::calls::export_colours::{ColourConversion, PointClasses};
use crate::error::BuildError;
use esker_format::{EskerFile, Fault, FormatError, PagePoints, StatisticSides, runs};
use esker_points::attribute::names;
use esker_points::filter::{LatticeFilter, Side};
use esker_points::{AttrType, Attribute, Batch, Cell, MultisetHash, Node, Schema, Task};
use esker_scan::write::{Encode, Encoded};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Bytes of points that are decoded together, for each thread. Two such groups are in memory, in
/// several forms.
const GROUP_BYTES_A_THREAD: u64 = 8 << 20;
/// Bytes of the position of a decoded point.
const POSITION_BYTES: usize = 12;

/// A node with points that may pass the filter, or a run of them: see [`runs`].
#[derive(Clone, Debug)]
pub(super) struct SelectedNode {
    /// Its index.
    pub node: u32,
    /// Points to decode.
    pub run: Range<usize>,
    /// Their bytes when decoded.
    pub decoded_bytes: u64,
    /// The cell that the points must lie in, if only some do.
    pub within: Option<Cell>,
    /// Whether the filter must test each point.
    pub is_partial: bool,
    /// Where its page lies.
    pub page_offset: u64,
    /// Size of its page.
    pub page_bytes: u32,
}

/// Points of a node, ready to be written.
pub(super) struct EncodedNode {
    /// Those that passed the filter.
    pub encoded: Encoded,
    /// Their multiset hash.
    pub hash: MultisetHash,
    /// Number of points decoded that lie in the cell.
    pub read: u64,
}

/// The nodes of a tree with points that may pass `filter`, in the order of their pages.
/// Each comes in runs of points whose attributes take `attribute_bytes` each.
///
/// # Errors
/// If statistics cannot be read.
pub(super) fn select_nodes(
    tree: &EskerFile,
    filter: &LatticeFilter,
    attribute_bytes: usize,
) -> Result<Vec<SelectedNode>, BuildError> {
    let row_bytes = POSITION_BYTES + attribute_bytes;
    let nodes = &tree.table().nodes;
    let sides = StatisticSides::new(tree, filter)?;
    let mut selected = Vec::new();
    for (index, node) in (0u32..).zip(nodes) {
        let prefix = filter.prefix(node, nodes.get(node.parent as usize));
        let [min, max] = exact_box(tree, node);
        let by_box = if prefix == 0 { Side::Outside } else { filter.side_of_box(min, max) };
        let side = if by_box == Side::Outside { by_box } else { by_box.and(sides.own(index)) };
        if side == Side::Outside {
            continue;
        }
        selected.extend(runs(prefix, row_bytes).map(|run| SelectedNode {
            node: index,
            decoded_bytes: (run.len() * row_bytes) as u64,
            run,
            within: None,
            is_partial: side == Side::Across,
            page_offset: node.page_offset,
            page_bytes: node.page_bytes,
        }));
    }
    selected.sort_by_key(|n| (n.page_offset, n.run.start));
    Ok(selected)
}

/// A box on the exact lattice of a tree that holds a node's own points.
fn exact_box(tree: &EskerFile, node: &Node) -> [[u32; 3]; 2] {
    let corners = node.own_box();
    if !tree.is_growing() {
        return corners;
    }
    let (drawn, exact) = (tree.metadata().lattice, tree.exact_lattice());
    // Points are drawn at most a step of their coordinates beside their place.
    let moved = |corner: [u32; 3], by: f64| {
        let world = drawn.world(corner);
        [0, 1, 2].map(|axis| (exact.steps_axis(axis, world[axis]) + by).round() as u32)
    };
    [moved(corners[0], -2.0), moved(corners[1], 2.0)]
}

/// Export of one tree.
pub(super) struct TreeExport<'a> {
    /// Its file.
    pub file: &'a EskerFile,
    /// Points that are wanted.
    pub filter: &'a LatticeFilter,
    /// Attributes of all trees.
    pub schema: Arc<Schema>,
    /// The tree's attribute for each of these.
    pub own: Vec<Option<usize>>,
    /// Encodes batches.
    pub encode: Arc<dyn Encode>,
    /// Conversion of its colours, if they are not written as they are.
    pub colours: Option<Arc<ColourConversion>>,
}

impl TreeExport<'_> {
    /// Decodes, filters and encodes points of nodes in parallel.
    ///
    /// # Errors
    /// That of the first node with one, as [`TreeExport::encode_node`].
    pub fn encode_all(
        &self,
        group: &[SelectedNode],
        task: &dyn Task,
    ) -> Result<Vec<EncodedNode>, BuildError> {
        // All results are collected first, so that the first error in file order is reported.
        let nodes: Vec<_> = group.par_iter().map(|node| self.encode_node(node, task)).collect();
        nodes.into_iter().collect()
    }

    /// Decodes, filters and encodes points of a node.
    ///
    /// # Errors
    /// If its page cannot be read or is damaged; on request.
    pub fn encode_node(
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
        make_exact(self.file, selected.node, selected.run.clone(), &mut points)?;
        let mut read = points.len() as u64;
        if let Some(cell) = selected.within {
            let kept: Vec<bool> = points.positions.iter().map(|&p| cell.contains(p)).collect();
            keep(self.file, &mut points, &kept);
            read = points.len() as u64;
        }
        filter_points(self.file, self.filter, selected, &mut points)?;
        let hash = points.hash(self.file.layout());
        let batch = batch(self.file, points, &self.schema, &self.own, self.colours.as_deref());
        Ok(EncodedNode { encoded: self.encode.encode(&batch), hash, read })
    }
}

/// Gives the points of a run of a node the coordinates of [`EskerFile::exact_lattice`].
///
/// # Errors
/// If they cannot be read, or are not as many.
pub(super) fn make_exact(
    file: &EskerFile,
    node: u32,
    run: Range<usize>,
    points: &mut PagePoints,
) -> Result<(), BuildError> {
    let Some(exact) = file.exact_positions(node)? else { return Ok(()) };
    let exact = exact.get(run).filter(|exact| exact.len() == points.len());
    let changed = || {
        let path = file.path().display();
        BuildError::Differs(format!("{path}: it was changed while it was read"))
    };
    points.positions = exact.ok_or_else(changed)?.to_vec();
    Ok(())
}

/// Removes the points of a node that do not pass `filter`. The columns of the attributes that it
/// tests must be there.
///
/// # Errors
/// If there is no such node.
pub(super) fn filter_points(
    file: &EskerFile,
    filter: &LatticeFilter,
    selected: &SelectedNode,
    points: &mut PagePoints,
) -> Result<(), BuildError> {
    if !selected.is_partial {
        return Ok(());
    }
    let [min, max] = exact_box(file, file.node(selected.node)?);
    let test = filter.in_box(min, max);
    let layout = file.layout();
    let own = |name: &str| layout.schema().find_typed(name, AttrType::U8);
    let (classes, flags) = (own(names::CLASSIFICATION), own(names::FLAGS));
    let value = |attribute: Option<usize>, i: usize| {
        let has = |a: &usize| layout.has_attribute(points.class(i), *a);
        attribute.filter(has).and_then(|a| points.columns[a].get(i).copied())
    };
    let positions = points.positions.iter().enumerate();
    let tests = filter.value_tests(layout.schema());
    let sizes = layout.schema().attributes.iter().map(|a| a.ty.size()).collect::<Vec<_>>();
    let bytes = |a: usize, i: usize| {
        let has = layout.has_attribute(points.class(i), a);
        has.then(|| &points.columns[a][i * sizes[a]..][..sizes[a]])
    };
    let keeps = |(i, &p): (usize, &[u32; 3])| {
        test.keeps(p, value(classes, i), value(flags, i)) && tests.keep(|a| bytes(a, i))
    };
    let kept: Vec<bool> = positions.map(keeps).collect();
    keep(file, points, &kept);
    Ok(())
}

/// Removes the points at which `kept` is false, and those past its end.
fn keep(file: &EskerFile, points: &mut PagePoints, kept: &[bool]) {
    let attributes = file.layout().schema().attributes.iter();
    for (column, size) in points.columns.iter_mut().zip(attributes.map(|a| a.ty.size())) {
        compact(column, size, kept);
    }
    compact(&mut points.positions, 1, kept);
    compact(&mut points.radius_codes, 1, kept);
    compact(&mut points.classes, 1, kept);
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

/// Splits items that are decoded into groups that keep all threads busy and together take little
/// memory; `bytes` is what an item takes.
pub(super) fn groups<T>(items: &[T], bytes: impl Fn(&T) -> u64) -> impl Iterator<Item = &[T]> {
    let room = GROUP_BYTES_A_THREAD * rayon::current_num_threads() as u64;
    let mut rest = items;
    std::iter::from_fn(move || {
        let mut sum = 0;
        let within = |item: &&T| {
            sum += bytes(item);
            sum <= room
        };
        let n = rest.iter().take_while(within).count().max(1).min(rest.len());
        let (group, after) = rest.split_at(n);
        rest = after;
        (!group.is_empty()).then_some(group)
    })
}
