//! Writes text: a line of names, then a line per point, columns separated by a blank (a tab if a
//! name has blanks) or, for CSV, a comma. Coordinates have all digits of the lattice, values
//! counted in steps ([`super::scaling`]) have all of theirs, other numbers the fewest digits that
//! parse to the same number. A no-data value is an empty cell, or `nan` between blanks.

use super::coordinates::Coordinates;
use super::encode::{Encode, Encoded, Export, Origins, Outline, Output};
use super::numbers::float;
use super::partial::Partial;
use super::scaling::{Scaling, notes};
use super::stated::Stated;
use super::unique::{note_renamed, unique};
use crate::error::ScanError;
use esker_points::attribute::names;
use esker_points::{AttrType, Attribute, Batch, Column};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// What stands for no value between blanks, where an empty cell would be none.
const NO_VALUE: &str = "nan";
/// Name of the number of a return, for points without a number of returns.
const RETURN_NUMBER: &str = "return_number";

/// Begins a file.
///
/// # Errors
/// If it cannot be written.
pub fn create(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
    is_csv: bool,
) -> Result<Export, ScanError> {
    let stated = stated(origins)?;
    let schema = &*outline.schema;
    let attributes = &schema.attributes;
    let has_blanks = attributes.iter().any(|a| a.name.contains(char::is_whitespace));
    let mark = match is_csv {
        true => b',',
        false if has_blanks => b'\t',
        false => b' ',
    };
    let (names, changes) = column_names(outline);
    let names: Vec<&str> = PLACE.into_iter().chain(names.iter().map(String::as_str)).collect();
    let separator = char::from(mark).to_string();
    let line = names.join(&separator) + "\n";
    let mut file = Partial::create(path)?;
    file.write_all(line.as_bytes()).map_err(|e| file.error(e))?;
    let no_value = if mark == b' ' { NO_VALUE } else { "" };
    let how = if mark == b' ' { "written as nan" } else { "written as empty cells" };
    let encode = Lines { cells: CellWriter::new(outline, &stated, no_value), mark };
    let mut all_notes = notes(schema);
    all_notes.extend(stated.no_data_notes(schema, &format!("no-data values are {how}")));
    all_notes.extend(changes);
    all_notes.extend(dark_colours(outline));
    all_notes.extend(stated.crs_note(false).into_iter().chain(stated.times_note(schema, false)));
    Ok(Export {
        encode: Arc::new(encode),
        output: Box::new(TextOutput { file, names: line }),
        format: format!("text, {} columns, named", 3 + attributes.len()),
        fields: (0..outline.schema.attributes.len()).collect(),
        notes: all_notes,
    })
}

/// Names of the columns of coordinates.
const PLACE: [&str; 3] = ["x", "y", "z"];

/// What the sources state.
fn stated(origins: &mut Origins<'_>) -> Result<Stated, ScanError> {
    let mut stated = Stated::default();
    for origin in origins {
        stated.add(&origin?);
    }
    Ok(stated)
}

/// Names of the columns of all attributes, and notes on those that are not the attributes' own.
fn column_names(outline: &Outline) -> (Vec<String>, Vec<String>) {
    let attributes = &outline.schema.attributes;
    let own_name = |(i, a): (usize, &Attribute)| {
        // Without numbers of returns, the byte is the number of the return.
        let is_number =
            a.key() == (names::RETURNS, AttrType::U8) && outline.is_within(i, 0.0, 15.0);
        let name = if is_number { RETURN_NUMBER } else { &a.name };
        (column_name(name), a.ty)
    };
    let wanted: Vec<_> = attributes.iter().enumerate().map(own_name).collect();
    let own_names = attributes.iter().map(|a| a.name.as_str());
    let changed = note_renamed(own_names.zip(wanted.iter().map(|(name, _)| name.as_str())));
    let (names, renamed) = unique(&wanted, &PLACE, usize::MAX);
    (names, changed.into_iter().chain(renamed).collect())
}

/// Text of single points: the columns that [`create`] writes, without a file.
pub struct PointText {
    names: Vec<String>,
    cells: CellWriter,
}

impl PointText {
    /// Text of the points of an export.
    ///
    /// # Errors
    /// If a source cannot be read.
    pub fn new(outline: &Outline, origins: &mut Origins<'_>) -> Result<Self, ScanError> {
        let stated = stated(origins)?;
        let (names, _) = column_names(outline);
        Ok(Self { names, cells: CellWriter::new(outline, &stated, NO_VALUE) })
    }

    /// Names of the columns of the attributes, in the order of the outline's schema.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Coordinates of a point of a batch.
    ///
    /// # Panics
    /// If there is no such point.
    pub fn coordinates(&self, batch: &Batch, point: usize) -> [String; 3] {
        let p = batch.positions[point];
        [0, 1, 2].map(|axis| text_of(|out| self.cells.coordinates.text(axis, p[axis], out)))
    }

    /// Values of the attributes of a point of a batch.
    ///
    /// # Panics
    /// If there is no such point.
    pub fn values(&self, batch: &Batch, point: usize) -> Vec<String> {
        let columns = 0..self.cells.columns.len();
        columns.map(|i| text_of(|out| self.cells.value(&batch.columns, i, point, out))).collect()
    }
}

/// Text that `write` appends.
fn text_of(write: impl FnOnce(&mut Vec<u8>)) -> String {
    let mut out = Vec::new();
    write(&mut out);
    String::from_utf8_lossy(&out).into_owned()
}

/// A note on colours of 16 bits that look like ones of 8.
fn dark_colours(outline: &Outline) -> Option<String> {
    let is_dark = |name: &&str| {
        let own = outline.schema.find_typed(name, AttrType::U16);
        own.is_some_and(|i| outline.is_within(i, 0.0, u8::MAX.into()))
    };
    let all = [names::RED, names::GREEN, names::BLUE].iter().all(is_dark);
    let note = "colours of 16 bits are all below 256: text with them is read as colours of 8 bits";
    all.then(|| note.into())
}

/// A name without separators and quotes, and not only of blanks.
fn column_name(name: &str) -> String {
    match name.trim() {
        "" => "_".into(),
        _ => name.replace(|c: char| matches!(c, ',' | ';' | '"' | '\'') || c.is_control(), "_"),
    }
}

/// Writes the cells of points.
struct CellWriter {
    coordinates: Coordinates,
    columns: Vec<TextColumn>,
    /// What stands for no value.
    no_value: &'static str,
}

/// An attribute: its scaling, the size of a stored value in bytes, and the stored value that stands
/// for no value.
struct TextColumn {
    scaling: Scaling,
    bytes: usize,
    no_data: Option<Vec<u8>>,
}

impl CellWriter {
    fn new(outline: &Outline, stated: &Stated, no_value: &'static str) -> Self {
        let schema = &*outline.schema;
        let column = |(i, a): (usize, &Attribute)| TextColumn {
            scaling: Scaling::of(schema, i),
            bytes: a.ty.size(),
            no_data: stated.no_data(schema, i).map(<[u8]>::to_vec),
        };
        let columns = schema.attributes.iter().enumerate().map(column).collect();
        Self { coordinates: Coordinates::new(&outline.lattice, false), columns, no_value }
    }

    /// Appends the value of an attribute of a point.
    fn value(&self, columns: &[Column], attribute: usize, point: usize, out: &mut Vec<u8>) {
        let own = &self.columns[attribute];
        let stored = &columns[attribute][point * own.bytes..][..own.bytes];
        if own.no_data.as_deref() == Some(stored) {
            out.extend_from_slice(self.no_value.as_bytes());
        } else {
            own.scaling.text(stored, out);
        }
    }
}

struct Lines {
    cells: CellWriter,
    mark: u8,
}

impl Lines {
    /// Encodes `points` points; `place` appends a coordinate of a point.
    fn encode_all(
        &self,
        points: usize,
        columns: &[Column],
        place: impl Fn(usize, usize, &mut Vec<u8>),
    ) -> Encoded {
        let attributes = self.cells.columns.len().min(columns.len());
        let mut bytes = Vec::with_capacity(points * 8 * (3 + attributes));
        for i in 0..points {
            for axis in 0..3 {
                if axis > 0 {
                    bytes.push(self.mark);
                }
                place(i, axis, &mut bytes);
            }
            for attribute in 0..attributes {
                bytes.push(self.mark);
                self.cells.value(columns, attribute, i, &mut bytes);
            }
            bytes.push(b'\n');
        }
        Encoded { points: points as u64, bytes, ..Encoded::default() }
    }
}

impl Encode for Lines {
    fn encode(&self, batch: &Batch) -> Encoded {
        self.encode_all(batch.len(), &batch.columns, |i, axis, out| {
            self.cells.coordinates.text(axis, batch.positions[i][axis], out);
        })
    }

    fn encode_outside(&self, places: &[[f64; 3]], columns: &[Column]) -> Option<Encoded> {
        Some(self.encode_all(places.len(), columns, |i, axis, out| float(places[i][axis], out)))
    }
}

struct TextOutput {
    file: Partial,
    names: String,
}

impl Output for TextOutput {
    fn put(&mut self, points: Encoded) -> Result<(), ScanError> {
        self.file.write_all(&points.bytes).map_err(|e| self.file.error(e))
    }

    fn finish(self: Box<Self>) -> Result<u64, ScanError> {
        self.file.finish(self.names.as_bytes())
    }
}
