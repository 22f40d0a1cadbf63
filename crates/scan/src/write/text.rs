//! Writes text: a line of names, then a line per point, columns separated by a blank (a tab if a
//! name has blanks) or, for CSV, a comma. Coordinates have all digits of the lattice, values
//! counted in steps ([`super::scaling`]) have all of theirs, other numbers the fewest digits that
//! parse to the same number.

use super::coordinates::Coordinates;
use super::encode::{Encode, Encoded, Export, Origins, Outline, Output};
use super::numbers::float;
use super::partial::Partial;
use super::scaling::{Scaling, notes};
use super::unique::unique;
use crate::error::ScanError;
use esker_points::{Attribute, Batch, Column};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Begins a file.
///
/// # Errors
/// If it cannot be written.
pub fn create(
    path: &Path,
    outline: &Outline,
    _origins: &mut Origins<'_>,
    is_csv: bool,
) -> Result<Export, ScanError> {
    let attributes = &outline.schema.attributes;
    let has_blanks = attributes.iter().any(|a| a.name.contains(char::is_whitespace));
    let mark = match is_csv {
        true => b',',
        false if has_blanks => b'\t',
        false => b' ',
    };
    const PLACE: [&str; 3] = ["x", "y", "z"];
    let wanted: Vec<_> = attributes.iter().map(|a| (column_name(&a.name), a.ty)).collect();
    let (names, renamed) = unique(&wanted, &PLACE, usize::MAX);
    let names: Vec<&str> = PLACE.into_iter().chain(names.iter().map(String::as_str)).collect();
    let separator = char::from(mark).to_string();
    let line = names.join(&separator) + "\n";
    let mut file = Partial::create(path)?;
    file.write_all(line.as_bytes()).map_err(|e| file.error(e))?;
    let scaling = |(i, a): (usize, &Attribute)| (Scaling::of(&outline.schema, i), a.ty.size());
    let columns = attributes.iter().enumerate().map(scaling).collect();
    let encode = Lines { coordinates: Coordinates::new(&outline.lattice, false), columns, mark };
    Ok(Export {
        encode: Arc::new(encode),
        output: Box::new(TextOutput { file, names: line }),
        format: format!("text, {} columns, named", 3 + attributes.len()),
        fields: (0..outline.schema.attributes.len()).collect(),
        notes: [notes(&outline.schema), renamed].concat(),
    })
}

/// A name without separators and quotes, and not only of blanks.
fn column_name(name: &str) -> String {
    match name.trim() {
        "" => "_".into(),
        _ => name.replace(|c: char| matches!(c, ',' | ';' | '"' | '\'') || c.is_control(), "_"),
    }
}

struct Lines {
    coordinates: Coordinates,
    /// Scaling of each attribute, and the size of its stored values in bytes.
    columns: Vec<(Scaling, usize)>,
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
        let mut bytes = Vec::with_capacity(points * 8 * (3 + self.columns.len()));
        for i in 0..points {
            for axis in 0..3 {
                if axis > 0 {
                    bytes.push(self.mark);
                }
                place(i, axis, &mut bytes);
            }
            for ((scaling, size), column) in self.columns.iter().zip(columns) {
                bytes.push(self.mark);
                scaling.text(&column[i * size..][..*size], &mut bytes);
            }
            bytes.push(b'\n');
        }
        Encoded { points: points as u64, bytes, ..Encoded::default() }
    }
}

impl Encode for Lines {
    fn encode(&self, batch: &Batch) -> Encoded {
        self.encode_all(batch.len(), &batch.columns, |i, axis, out| {
            self.coordinates.text(axis, batch.positions[i][axis], out);
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
