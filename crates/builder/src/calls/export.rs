//! From an .esker file, and those that it names, back to a scan format: tree by tree, the oldest
//! first, the nodes that a filter wants, in the order of their pages, are read and decoded in
//! parallel, encoded for the format, and written in order while the next ones are decoded. What the
//! node table and the statistics show to be unwanted is not read. Without a filter, count and
//! multiset hash of what was handed to the writer must be each footer's.

use crate::error::BuildError;
use esker_format::{EskerFile, Fault, Forest, FormatError, PagePoints, SourceRecord};
use esker_points::attribute::names;
use esker_points::filter::{LatticeFilter, Side};
use esker_points::{AttrType, Attribute, Batch, Filter, MultisetHash, Schema, Task};
use esker_scan::write::{self, Encode, Encoded, Origin, Outline, Output, Target};
use esker_scan::{Crs, ScanError};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Bytes of pages that are decoded together, a thread; two such groups are held, in several forms.
const GROUP_BYTES_A_THREAD: u64 = 2 << 20;

/// What an export did.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// Points of all trees.
    pub points_in: u64,
    /// Points written.
    pub points_out: u64,
    /// Multiset hash of the points written; the sum of the trees', where all were.
    pub hash: MultisetHash,
    /// Whether all were asked for.
    pub is_whole: bool,
    /// Trees.
    pub trees: u64,
    /// Nodes of all trees.
    pub nodes: u64,
    /// Nodes whose pages were read.
    pub nodes_read: u64,
    /// Bytes of these pages.
    pub bytes_read: u64,
    /// Bytes written.
    pub bytes_out: u64,
    /// Format, version and variant of what was written.
    pub format: String,
    /// What the user should know, a line each.
    pub notes: Vec<String>,
}

/// A node that is wanted.
#[derive(Clone, Copy, Debug)]
struct Take {
    node: u32,
    /// Points from the first on.
    prefix: usize,
    /// Whether each point must be asked.
    across: bool,
    page_offset: u64,
    page_bytes: u32,
}

/// Points of a node, ready to be written.
struct Part {
    encoded: Encoded,
    hash: MultisetHash,
    read: u64,
}

/// Writes the points that `filter` wants of all trees to `out`, in the format that its ending
/// names, in the current rayon pool. Nothing is left under the final name where it fails. A spacing
/// is that of each tree's sample.
///
/// # Errors
/// Where a file is damaged, the format cannot hold the attributes, no point is wanted although
/// there are some, the disk is full, or on request.
pub fn export(
    forest: &Forest,
    out: &Path,
    filter: &Filter,
    task: &dyn Task,
) -> Result<Exported, BuildError> {
    let target = Target::of(out)?;
    let wrong = |e: esker_points::FilterError| BuildError::Options(e.to_string());
    let on_lattice = filter.on(forest.lattice()).map_err(wrong)?;
    forest.files().try_for_each(EskerFile::check_verbatim)?;
    // A file names those that were there before it.
    let mut plans: Vec<(&EskerFile, Vec<Take>)> = Vec::with_capacity(forest.files().len());
    for file in forest.files() {
        plans.insert(0, (file, plan(file, &on_lattice)?));
    }
    let takes = || plans.iter().flat_map(|(_, takes)| takes);
    let points_max = takes().map(|t| t.prefix as u64).sum();
    let schema = Arc::new(forest.schema().clone());
    let outline = Outline { lattice: *forest.lattice(), schema: schema.clone(), points_max };
    let mut origins = plans.iter().flat_map(|(file, _)| {
        let sources = file.metadata().sources.iter().enumerate();
        sources.map(move |(i, record)| origin(file, i, record))
    });
    let started = write::create(out, target, &outline, &mut origins)?;

    task.phase("exporting", Some(points_max), "points");
    let is_whole = filter.is_all();
    let mut output = started.output;
    let (mut points_out, mut hash) = (0, MultisetHash::default());
    for (file, takes) in &plans {
        let reader = Reader::new(file, &on_lattice, schema.clone(), started.encode.clone());
        let (points, own) = reader.run(takes, &mut *output, task)?;
        if is_whole {
            prove(file, points, own)?;
        }
        points_out += points;
        hash += own;
    }
    let points_in = forest.points();
    if points_out == 0 && points_in > 0 {
        let path = forest.path().display();
        return Err(BuildError::Options(format!(
            "{path}: none of its {points_in} points is wanted; nothing was written"
        )));
    }
    task.check()?;
    let bytes_out = output.finish()?;
    let mut notes = started.notes;
    notes.extend(note_absent(forest, &started.fields));
    notes.extend(note_overlap(forest, filter));
    Ok(Exported {
        points_in,
        points_out,
        hash,
        is_whole,
        trees: plans.len() as u64,
        nodes: forest.table().nodes.len() as u64,
        nodes_read: takes().count() as u64,
        bytes_read: takes().map(|t| u64::from(t.page_bytes)).sum(),
        bytes_out,
        format: started.format,
        notes,
    })
}

/// Says where trees are thinned each by itself though they share a place.
fn note_overlap(forest: &Forest, filter: &Filter) -> Option<String> {
    let boxes: Vec<_> = forest.files().filter_map(|file| file.metadata().bounds).collect();
    let meet = |[low, high]: &[[u32; 3]; 2], [l, h]: &[[u32; 3]; 2]| {
        (0..3).all(|i| low[i] <= h[i] && l[i] <= high[i])
    };
    let overlap = (0..boxes.len()).any(|i| boxes[..i].iter().any(|other| meet(&boxes[i], other)));
    (filter.max_spacing.is_some() && overlap).then(|| {
        "the spacing is that of each tree by itself, and trees overlap: there are more points; esker build --merge makes one tree of them".into()
    })
}

/// Whether these are all points of a file.
fn prove(file: &EskerFile, points: u64, hash: MultisetHash) -> Result<(), BuildError> {
    let footer = file.footer();
    if (points, hash) == (footer.points, footer.hash) {
        return Ok(());
    }
    Err(BuildError::Differs(format!(
        "{}: its {points} points (hash {hash}) are not those that its footer tells ({}, hash {}); \
         nothing was written",
        file.path().display(),
        footer.points,
        footer.hash
    )))
}

/// What of a source can be restored.
fn origin(file: &EskerFile, index: usize, record: &SourceRecord) -> Result<Origin, ScanError> {
    let verbatim = file.verbatim(index).map_err(|e| BuildError::from(e).through_sink())?;
    let crs = record.crs.as_ref().map(|c| Crs { text: c.text.clone(), unit: c.unit.clone() });
    Ok(Origin { kind: record.grid.kind, crs, verbatim })
}

/// The nodes of a tree that are wanted, in the order of their pages.
fn plan(tree: &EskerFile, filter: &LatticeFilter) -> Result<Vec<Take>, BuildError> {
    let nodes = &tree.table().nodes;
    let statistics = filter.needs_classes().then(|| tree.statistics()).transpose()?;
    let all_have_one = tree.layout().all_have_one_of(&[(names::CLASSIFICATION, AttrType::U8)]);
    let mut takes = Vec::new();
    for (index, node) in (0u32..).zip(nodes) {
        let prefix = filter.prefix(node, nodes.get(node.parent as usize));
        let [min, max] = node.own_box();
        let by_box = if prefix == 0 { Side::Outside } else { filter.side_of_box(min, max) };
        let by_class = match &statistics {
            _ if by_box == Side::Outside => Side::Outside,
            Some(statistics) => filter.side_of_classes(statistics.own_classes(index), all_have_one),
            None => Side::Inside,
        };
        if by_class == Side::Outside {
            continue;
        }
        takes.push(Take {
            node: index,
            prefix,
            across: by_box == Side::Across || by_class == Side::Across,
            page_offset: node.page_offset,
            page_bytes: node.page_bytes,
        });
    }
    takes.sort_by_key(|t| t.page_offset);
    Ok(takes)
}

/// Attributes that some points lack, and which are zero there in the export; unless the field has
/// been made from another attribute of these points.
fn note_absent(forest: &Forest, fields: &[usize]) -> Option<String> {
    let attributes = &forest.schema().attributes;
    let names: Vec<_> = (0..attributes.len())
        .filter(|&at| {
            let of_field: Vec<_> = (0..attributes.len())
                .filter(|&other| fields.get(other) == fields.get(at))
                .map(|other| (attributes[other].name.as_str(), attributes[other].ty))
                .collect();
            // A tree without a point lacks nothing.
            forest
                .files()
                .any(|file| file.footer().points > 0 && !file.layout().all_have_one_of(&of_field))
        })
        .map(|at| attributes[at].name.as_str())
        .collect();
    let names = names.join(", ");
    (!names.is_empty()).then(|| format!("zero where a point's source had none: {names}"))
}

/// Reads a tree.
struct Reader<'a> {
    file: &'a EskerFile,
    filter: &'a LatticeFilter,
    /// The attributes of all trees.
    schema: Arc<Schema>,
    /// The tree's own for each of these.
    own: Vec<Option<usize>>,
    encode: Arc<dyn Encode>,
}

impl<'a> Reader<'a> {
    fn new(
        file: &'a EskerFile,
        filter: &'a LatticeFilter,
        schema: Arc<Schema>,
        encode: Arc<dyn Encode>,
    ) -> Self {
        let find = |a: &Attribute| file.layout().schema().find_typed(&a.name, a.ty);
        let own = schema.attributes.iter().map(find).collect();
        Self { file, filter, schema, own, encode }
    }

    /// Reads and writes: number and hash of the points.
    fn run(
        &self,
        takes: &[Take],
        output: &mut dyn Output,
        task: &dyn Task,
    ) -> Result<(u64, MultisetHash), BuildError> {
        let (mut points, mut hash) = (0, MultisetHash::default());
        let mut ready = Vec::new();
        let mut put = |parts: Vec<Part>| -> Result<(), BuildError> {
            for part in parts {
                task.check()?;
                points += part.encoded.points;
                hash += part.hash;
                output.put(part.encoded)?;
                task.advance(part.read);
            }
            Ok(())
        };
        for group in groups(takes) {
            let before = std::mem::take(&mut ready);
            let (decoded, written) = rayon::join(|| self.decode(group, task), || put(before));
            written?;
            ready = decoded?;
        }
        put(ready)?;
        Ok((points, hash))
    }

    fn decode(&self, group: &[Take], task: &dyn Task) -> Result<Vec<Part>, BuildError> {
        // Collected before errors are looked at: the first in the file's order is reported.
        let parts: Vec<_> = group.par_iter().map(|take| self.part(take, task)).collect();
        parts.into_iter().collect()
    }

    fn part(&self, take: &Take, task: &dyn Task) -> Result<Part, BuildError> {
        task.check()?;
        let page = self.file.read_page(take.node)?;
        let damaged = |fault: Fault| FormatError::Damaged {
            path: self.file.path().to_owned(),
            section: format!("page of node {}, {}", take.node, fault.section),
            fault: fault.fault,
        };
        let mut points = page.points().map_err(damaged)?;
        drop(page);
        self.choose(take, &mut points)?;
        let hash = points.hash(self.file.layout());
        let batch = self.batch(points);
        Ok(Part { encoded: self.encode.encode(&batch), hash, read: take.prefix as u64 })
    }

    /// The points with the attributes of all trees, zeros where this one has none.
    fn batch(&self, mut points: PagePoints) -> Batch {
        let count = points.len();
        let column = |(own, attribute): (&Option<usize>, &Attribute)| match own {
            Some(own) => std::mem::take(&mut points.columns[*own]),
            None => vec![0; count * attribute.ty.size()],
        };
        let columns = self.own.iter().zip(&self.schema.attributes).map(column).collect();
        Batch { schema: self.schema.clone(), positions: points.positions, columns }
    }

    /// Leaves the points that are wanted.
    fn choose(&self, take: &Take, points: &mut PagePoints) -> Result<(), BuildError> {
        if take.prefix < points.len() {
            let all = vec![true; take.prefix];
            self.keep(points, &all);
        }
        if !take.across {
            return Ok(());
        }
        let [min, max] = self.file.node(take.node)?.own_box();
        let test = self.filter.in_box(min, max);
        let layout = self.file.layout();
        let classes = layout.schema().find_typed(names::CLASSIFICATION, AttrType::U8);
        let class_of = |i: usize| {
            let has = |a: &usize| layout.has_attribute(points.class(i), *a);
            classes.filter(has).map(|a| points.columns[a][i])
        };
        let kept: Vec<bool> =
            points.positions.iter().enumerate().map(|(i, &p)| test.keeps(p, class_of(i))).collect();
        self.keep(points, &kept);
        Ok(())
    }

    /// Leaves the points at which `kept` is true; those past its end go.
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

/// Leaves the items, `size` values each, at which `kept` is true; where there are none, none.
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

/// Cuts the nodes into groups of about as many bytes of pages as all threads take.
fn groups(takes: &[Take]) -> impl Iterator<Item = &[Take]> {
    let room = GROUP_BYTES_A_THREAD * rayon::current_num_threads() as u64;
    let mut rest = takes;
    std::iter::from_fn(move || {
        let mut bytes = 0;
        let within = |t: &&Take| {
            bytes += u64::from(t.page_bytes);
            bytes <= room
        };
        let n = rest.iter().take_while(within).count().max(1).min(rest.len());
        let (group, after) = rest.split_at(n);
        rest = after;
        (!group.is_empty()).then_some(group)
    })
}
