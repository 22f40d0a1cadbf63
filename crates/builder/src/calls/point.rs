//! One point of an `.esker` file as an export to text writes it: its exact coordinates and the
//! values of all attributes, the lattice integers, and the scans that it may be of.

use crate::calls::export_colours::ColourConversion;
use crate::calls::export_tree::{batch, own_attributes};
use crate::calls::selection::{classes, origin, ranges};
use crate::error::BuildError;
use esker_format::{EskerFile, Forest};
use esker_points::{AttrType, Schema, Task};
use esker_scan::ScanError;
use esker_scan::write::{Origin, Outline, PointText, Target};
use std::sync::Arc;

/// A point of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ExactPoint {
    /// Coordinates in its own file, on [`EskerFile::exact_lattice`].
    pub lattice: [u32; 3],
    /// Coordinates as an export to text writes them, moved as its cloud is.
    pub coordinates: [String; 3],
    /// Attributes, in the order of the export.
    pub values: Vec<ExactValue>,
    /// Indices of the sources of its file that it may be of, in their order: those whose points
    /// have its attributes, and of these the ones whose stated bounds hold it, if there are any.
    pub sources: Vec<usize>,
}

/// An attribute of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct ExactValue {
    /// Name of the column in an export to text.
    pub name: String,
    /// Name and type of the exported attribute.
    pub key: (String, AttrType),
    /// The exported value, as text; that of zero where the point has none.
    pub text: String,
    /// The value before scaling, little-endian.
    pub stored: Vec<u8>,
    /// Whether the scan of the point has the attribute.
    pub is_present: bool,
}

/// Reads point `point` of node `node` of the table of `forest`.
///
/// # Errors
/// If there is no such point, the file is damaged, or `task` is cancelled.
pub fn exact_point(
    forest: &Forest,
    node: u32,
    point: usize,
    task: &dyn Task,
) -> Result<ExactPoint, BuildError> {
    let name = forest.name_of(node);
    let file = forest.file_of(node);
    let page = file.read_page(name.index)?;
    let points = page.points_in(point..point.saturating_add(1));
    let mut points = points.map_err(|fault| file.damaged_page(name.index, fault))?;
    drop(page);
    let drawn = points.positions.first().copied();
    if let Some(exact) = file.exact_positions(name.index)? {
        points.positions = exact.get(point..).unwrap_or_default().iter().take(1).copied().collect();
    }
    let Some(&lattice) = points.positions.first() else {
        let path = file.path().display();
        return Err(BuildError::Options(format!("{path}: node {node} has no point {point}")));
    };
    let class = points.class(0);
    let schema = Arc::new(forest.schema().clone());
    let selections: Vec<_> = forest.files().map(|file| (file, Vec::new())).collect();
    let colours = ColourConversion::choose(forest, &selections, Target::Text, None, task)?;
    let written = colours.as_ref().map_or(&schema, ColourConversion::schema).clone();
    let outline = Outline {
        lattice: forest.exact_lattice(),
        schema: written.clone(),
        points_max: 1,
        ranges: ranges(forest, &written, Target::Text)?,
        classes: classes(forest, &written),
    };
    let text = PointText::new(&outline, &mut origins(forest))?;
    let own = own_attributes(file, &schema);
    let is_present = presence(file, class, &own, colours.as_ref(), &written);
    let mut batch = batch(file, points, &schema, &own, colours.as_ref());
    let columns = written.attributes.iter().zip(&batch.columns);
    let values = columns.zip(text.names()).zip(text.values(&batch, 0)).zip(is_present);
    let values = values.map(|((((attribute, column), name), text), is_present)| ExactValue {
        name: name.clone(),
        key: (attribute.name.clone(), attribute.ty),
        text,
        stored: column.clone(),
        is_present,
    });
    // A tree that is not in a file of its own is not moved.
    batch.positions[0] = if forest.is_growing() { lattice } else { forest.placed(node, lattice) };
    Ok(ExactPoint {
        lattice,
        coordinates: text.coordinates(&batch, 0),
        values: values.collect(),
        sources: sources(file, class, drawn.unwrap_or(lattice)),
    })
}

/// What an export restores of all sources, those of the oldest file first.
fn origins(forest: &Forest) -> impl Iterator<Item = Result<Origin, ScanError>> {
    let files: Vec<&EskerFile> = forest.files().collect();
    files.into_iter().rev().flat_map(|file| {
        let sources = file.metadata().sources.iter().enumerate();
        sources.map(move |(i, record)| origin(file, i, record))
    })
}

/// Whether points of a class have each of the `written` attributes.
fn presence(
    file: &EskerFile,
    class: usize,
    own: &[Option<usize>],
    colours: Option<&ColourConversion>,
    written: &Schema,
) -> Vec<bool> {
    let mut present = vec![false; written.attributes.len()];
    for (index, own) in own.iter().enumerate() {
        let at = colours.map_or(index, |colours| colours.index_of[index]);
        present[at] |= own.is_some_and(|own| file.layout().has_attribute(class, own));
    }
    present
}

/// Indices of the sources of `file` that a point may be of.
fn sources(file: &EskerFile, class: usize, lattice: [u32; 3]) -> Vec<usize> {
    let metadata = file.metadata();
    let place = metadata.lattice.world(lattice);
    let records = &metadata.sources;
    let of_class = (0..records.len())
        .filter(|&i| usize::from(records[i].class) == class && records[i].points > 0);
    let holds = |i: &usize| {
        let record = &records[*i];
        record.grid.bounds.is_none_or(|[low, high]| {
            (0..3).all(|axis| {
                // Bounds may be rounded otherwise than points.
                let room = record.rounding_error_max + metadata.lattice.scale[axis];
                low[axis] - room <= place[axis] && place[axis] <= high[axis] + room
            })
        })
    };
    let of_class: Vec<usize> = of_class.collect();
    let within: Vec<usize> = of_class.iter().copied().filter(holds).collect();
    if within.is_empty() { of_class } else { within }
}
