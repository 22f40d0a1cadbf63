//! Text: a line of names, then a line a point, columns separated by a blank (a tab where a name has blanks) or,
//! for CSV, a comma. Coordinates have all the digits of the lattice, other numbers the fewest that give them
//! again.

use super::coordinates::{Coordinates, float, put};
use super::partial::Partial;
use super::{Encode, Encoded, Export, Origins, Outline, Output};
use crate::error::ScanError;
use esker_points::{AttrType, Batch};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Begins a file.
///
/// # Errors
/// Where it cannot be written.
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
    let names = ["x", "y", "z"].into_iter().chain(attributes.iter().map(|a| a.name.as_str()));
    let names: Vec<String> = names.map(column_name).collect();
    let separator = char::from(mark).to_string();
    let line = names.join(&separator) + "\n";
    let mut file = Partial::create(path)?;
    file.write_all(line.as_bytes()).map_err(|e| file.error(e))?;
    let types = attributes.iter().map(|a| a.ty).collect();
    let encode = Lines { coordinates: Coordinates::new(&outline.lattice, false), types, mark };
    Ok(Export {
        encode: Arc::new(encode),
        output: Box::new(TextOutput { file, names: line }),
        format: format!("text, {} columns, named", 3 + attributes.len()),
        fields: (0..outline.schema.attributes.len()).collect(),
        notes: Vec::new(),
    })
}

/// A name without what separates or quotes, and of something else than blanks.
fn column_name(name: &str) -> String {
    match name.trim() {
        "" => "_".into(),
        _ => name.replace(|c: char| matches!(c, ',' | ';' | '"' | '\'') || c.is_control(), "_"),
    }
}

struct Lines {
    coordinates: Coordinates,
    types: Vec<AttrType>,
    mark: u8,
}

impl Encode for Lines {
    fn encode(&self, batch: &Batch) -> Encoded {
        let mut bytes = Vec::with_capacity(batch.len() * 8 * (3 + self.types.len()));
        for (i, p) in batch.positions.iter().enumerate() {
            for (axis, &u) in p.iter().enumerate() {
                if axis > 0 {
                    bytes.push(self.mark);
                }
                self.coordinates.text(axis, u, &mut bytes);
            }
            for (&ty, column) in self.types.iter().zip(&batch.columns) {
                bytes.push(self.mark);
                number(ty, &column[i * ty.size()..][..ty.size()], &mut bytes);
            }
            bytes.push(b'\n');
        }
        Encoded { points: batch.len() as u64, bytes, ..Encoded::default() }
    }
}

/// Appends a raw value.
fn number(ty: AttrType, raw: &[u8], out: &mut Vec<u8>) {
    let mut wide = [0; 8];
    wide[..raw.len()].copy_from_slice(raw);
    let bits = u64::from_le_bytes(wide);
    match ty {
        AttrType::U8 | AttrType::U16 | AttrType::U32 | AttrType::U64 => {
            put(out, format_args!("{bits}"));
        }
        AttrType::I8 => put(out, format_args!("{}", bits as i8)),
        AttrType::I16 => put(out, format_args!("{}", bits as i16)),
        AttrType::I32 => put(out, format_args!("{}", bits as i32)),
        AttrType::I64 => put(out, format_args!("{}", bits as i64)),
        AttrType::F32 => float(f32::from_bits(bits as u32), out),
        AttrType::F64 => float(f64::from_bits(bits), out),
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
