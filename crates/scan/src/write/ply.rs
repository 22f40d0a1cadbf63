//! Writes PLY (Turk 1994), binary little-endian: vertices with a property for each attribute, in
//! the usual order, and the comments of the first source's header. Coordinates are singles, and
//! then exact, if all sources held singles; else doubles.

use super::coordinates::Coordinates;
use super::encode::{Encode, Encoded, Export, Origin, Origins, Outline, Output};
use super::partial::Partial;
use super::scaling::{Scaling, notes};
use super::stated::Stated;
use super::unique::{note_renamed, unique};
use crate::error::ScanError;
use crate::fields::HALVES;
use crate::ply::comments as ply_comments;
use crate::text::naming::axis;
use esker_points::attribute::names;
use esker_points::lattice::GridKind;
use esker_points::{AttrType, Attribute, Batch};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Digits of the greatest count.
const COUNT_DIGITS: usize = 20;
/// Whole numbers up to here are exact in `f64`, whatever rounding led to them.
const EXACT_MAX: f64 = (1u64 << 53) as f64 - 1.0;
/// Attributes that come first, in this order; the others follow by name.
const FIRST: [&str; 8] = [
    names::NX,
    names::NY,
    names::NZ,
    names::RED,
    names::GREEN,
    names::BLUE,
    "alpha",
    names::INTENSITY,
];

/// Begins a file.
///
/// # Errors
/// If it cannot be written.
pub fn create(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
) -> Result<Export, ScanError> {
    let mut comments = None;
    let (mut is_single, mut is_ply) = (true, true);
    let mut stated = Stated::default();
    for origin in origins {
        let origin = origin?;
        stated.add(&origin);
        let text = origin.block("PLY header").map(String::from_utf8_lossy);
        is_ply &= text.is_some();
        is_single &= holds_singles(&origin, text.as_deref());
        comments.get_or_insert_with(|| comments_of(text.as_deref()));
    }
    let mut comments = comments.unwrap_or_default();
    if let Some(crs) = stated.crs.as_ref().filter(|crs| !crs.text.is_empty()) {
        comments += &ply_comments::crs_lines(&crs.text);
    }
    if let Some(times) = stated.times(&outline.schema) {
        comments += &ply_comments::times_line(times);
    }
    let coordinates = Coordinates::new(&outline.lattice, is_single);
    let mut head = String::new();
    let place = if coordinates.single { AttrType::F32 } else { AttrType::F64 };
    for axis in ["x", "y", "z"] {
        let _ = writeln!(head, "property {} {axis}", type_name(place));
    }
    let attributes = &outline.schema.attributes;
    let column = |(index, a): (usize, &Attribute)| Column {
        index,
        bytes: a.ty.size(),
        form: Form::of(outline, index),
    };
    let mut columns: Vec<Column> = attributes.iter().enumerate().map(column).collect();
    let rank = |c: &Column| FIRST.iter().position(|n| *n == attributes[c.index].name);
    columns.sort_by_key(|c| rank(c).unwrap_or(FIRST.len()));
    let (mut wanted, mut first) = (Vec::new(), Vec::new());
    for (index, attribute) in attributes.iter().enumerate() {
        first.push(wanted.len());
        let name = property_name(attribute, is_ply);
        match Form::of(outline, index) {
            Form::Halves { .. } => {
                wanted.extend(HALVES.map(|end| (format!("{name}{end}"), attribute.ty)))
            }
            _ => wanted.push((name, attribute.ty)),
        }
    }
    let (names, renamed) = unique(&wanted, &["x", "y", "z"], usize::MAX);
    for column in &columns {
        let names = &names[first[column.index]..];
        for (ty, name) in column.types().zip(names) {
            let _ = writeln!(head, "property {} {name}", type_name(ty));
        }
    }
    head.push_str("end_header\n");
    let mut file = Partial::create(path)?;
    let output = |count| header(&comments, count, &head);
    file.write_all(output(0).as_bytes()).map_err(|e| file.error(e))?;
    let stride = 3 * place.size()
        + columns.iter().flat_map(Column::types).map(AttrType::size).sum::<usize>();
    let wide = note_wide(outline, &columns);
    let schema = &*outline.schema;
    let mut all_notes = [notes(schema), wide].concat();
    all_notes.extend(stated.no_data_notes(schema, "no-data values are written as numbers"));
    let new_names: Vec<String> = attributes.iter().map(|a| property_name(a, is_ply)).collect();
    let own_names = attributes.iter().map(|a| a.name.as_str());
    all_notes.extend(note_renamed(own_names.zip(new_names.iter().map(String::as_str))));
    all_notes.extend(renamed);
    all_notes.extend(stated.crs_note(true).into_iter().chain(stated.times_note(schema, true)));
    let encode = Vertices { coordinates, columns, stride };
    let output = PlyOutput { file, comments, head, count: 0 };
    Ok(Export {
        encode: Arc::new(encode),
        output: Box::new(output),
        format: "PLY 1.0, binary little-endian".into(),
        fields: (0..outline.schema.attributes.len()).collect(),
        notes: all_notes,
    })
}

/// The header for a count; its length does not depend on the count.
fn header(comments: &str, count: u64, properties: &str) -> String {
    let filling = COUNT_DIGITS - count.to_string().len();
    let program = concat!("comment written by Esker ", env!("CARGO_PKG_VERSION"));
    format!(
        "ply\nformat binary_little_endian 1.0\n{comments}{program}{:filling$}\nelement vertex {count}\n{properties}",
        ""
    )
}

/// Whether a source held its coordinates as singles and they were read as such.
fn holds_singles(origin: &Origin, ply_header: Option<&str>) -> bool {
    let is_single = |text: &str| {
        let mut axes = 0;
        for line in text.lines() {
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            if let ["property", ty, name] = words[..]
                && axis(name).is_some()
            {
                if !matches!(ty, "float" | "float32") {
                    return false;
                }
                axes += 1;
            }
        }
        axes >= 3
    };
    origin.kind == GridKind::Float && ply_header.is_some_and(is_single)
}

/// Comments of a PLY source, but for those that are written anew.
fn comments_of(ply_header: Option<&str>) -> String {
    let mut out = String::new();
    let is_comment = |line: &&str| {
        (line.starts_with("comment") || line.starts_with("obj_info")) && !ply_comments::is_own(line)
    };
    for line in ply_header.unwrap_or_default().lines().filter(is_comment) {
        out += &ply_comments::lines_of(line);
    }
    out
}

/// The name of a property. Names in PLY have no blanks; names from PLY sources are kept.
fn property_name(attribute: &Attribute, is_ply: bool) -> String {
    let blank = |c: char| c.is_whitespace() || c.is_control();
    if is_ply { attribute.name.clone() } else { attribute.name.replace(blank, "_") }
}

fn type_name(ty: AttrType) -> &'static str {
    match ty {
        AttrType::U8 => "uchar",
        AttrType::I8 => "char",
        AttrType::U16 => "ushort",
        AttrType::I16 => "short",
        AttrType::U32 => "uint",
        AttrType::I32 => "int",
        AttrType::F32 => "float",
        // PLY has no integers of 64 bits: see [`Form`].
        AttrType::U64 | AttrType::I64 | AttrType::F64 => "double",
    }
}

struct Vertices {
    coordinates: Coordinates,
    /// In the order of the properties.
    columns: Vec<Column>,
    stride: usize,
}

/// An attribute: its index in a batch, the size of a stored value in bytes, and how it is written.
struct Column {
    index: usize,
    bytes: usize,
    form: Form,
}

/// How an attribute is written.
#[derive(Clone, Copy, Debug)]
enum Form {
    /// As one property.
    One(Scaling),
    /// As a double that holds all values exactly: PLY has no integers of 64 bits.
    Double(AttrType),
    /// As two properties, the lower and the upper 32 bits, the upper one with the sign if the type
    /// has one.
    Halves { is_signed: bool },
}

impl Form {
    fn of(outline: &Outline, attribute: usize) -> Self {
        let scaling = Scaling::of(&outline.schema, attribute);
        match scaling.ty() {
            ty @ (AttrType::U64 | AttrType::I64)
                if outline.is_within(attribute, -EXACT_MAX, EXACT_MAX) =>
            {
                Self::Double(ty)
            }
            ty @ (AttrType::U64 | AttrType::I64) => Self::Halves { is_signed: ty == AttrType::I64 },
            _ => Self::One(scaling),
        }
    }
}

impl Column {
    /// Types of its properties.
    fn types(&self) -> impl Iterator<Item = AttrType> + use<> {
        let (first, second) = match self.form {
            Form::One(scaling) => (scaling.ty(), None),
            Form::Double(_) => (AttrType::F64, None),
            Form::Halves { is_signed: true } => (AttrType::U32, Some(AttrType::I32)),
            Form::Halves { is_signed: false } => (AttrType::U32, Some(AttrType::U32)),
        };
        std::iter::once(first).chain(second)
    }

    fn put(&self, stored: &[u8], out: &mut Vec<u8>) {
        match self.form {
            Form::One(scaling) => scaling.bytes(stored, out),
            Form::Double(ty) => out.extend_from_slice(&ty.to_f64(stored).to_le_bytes()),
            // Little-endian: the lower half comes first.
            Form::Halves { .. } => out.extend_from_slice(stored),
        }
    }
}

/// Notes on the attributes that PLY has no type for.
fn note_wide(outline: &Outline, columns: &[Column]) -> Vec<String> {
    let names = |is_wanted: fn(&Form) -> bool| {
        let wanted = columns.iter().filter(|c| is_wanted(&c.form));
        let names = wanted.map(|c| outline.schema.attributes[c.index].name.as_str());
        names.collect::<Vec<_>>().join(", ")
    };
    let doubles = names(|form| matches!(form, Form::Double(_)));
    let halves = names(|form| matches!(form, Form::Halves { .. }));
    let mut notes = Vec::new();
    if !doubles.is_empty() {
        notes.push(format!("PLY has no integers of 64 bits; written as exact doubles: {doubles}"));
    }
    if !halves.is_empty() {
        let [low, high] = HALVES;
        notes.push(format!(
            "PLY has no integers of 64 bits; written as two of 32 bits, {low} and {high}: {halves}"
        ));
    }
    notes
}

impl Vertices {
    /// Encodes `points` points; `place` gives a coordinate of a point.
    fn encode_all(
        &self,
        points: usize,
        columns: &[esker_points::Column],
        place: impl Fn(usize, usize) -> f64,
    ) -> Encoded {
        let mut bytes = Vec::with_capacity(points * self.stride);
        for i in 0..points {
            for axis in 0..3 {
                let value = place(i, axis);
                if self.coordinates.single {
                    bytes.extend_from_slice(&(value as f32).to_le_bytes());
                } else {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
            for column in &self.columns {
                let stored = &columns[column.index][i * column.bytes..][..column.bytes];
                column.put(stored, &mut bytes);
            }
        }
        Encoded { points: points as u64, bytes, ..Encoded::default() }
    }
}

impl Encode for Vertices {
    fn encode(&self, batch: &Batch) -> Encoded {
        let value = |i: usize, axis: usize| self.coordinates.value(axis, batch.positions[i][axis]);
        self.encode_all(batch.len(), &batch.columns, value)
    }

    fn encode_outside(
        &self,
        places: &[[f64; 3]],
        columns: &[esker_points::Column],
    ) -> Option<Encoded> {
        let is_exact = |c: &f64| !self.coordinates.single || f64::from(*c as f32) == *c;
        let are_exact = places.iter().flatten().all(is_exact);
        are_exact.then(|| self.encode_all(places.len(), columns, |i, axis| places[i][axis]))
    }
}

struct PlyOutput {
    file: Partial,
    comments: String,
    head: String,
    count: u64,
}

impl Output for PlyOutput {
    fn put(&mut self, points: Encoded) -> Result<(), ScanError> {
        self.count += points.points;
        self.file.write_all(&points.bytes).map_err(|e| self.file.error(e))
    }

    fn finish(self: Box<Self>) -> Result<u64, ScanError> {
        let head = header(&self.comments, self.count, &self.head);
        self.file.finish(head.as_bytes())
    }
}
