//! Converts raw point records to columns: a table, one per file, of the bytes of a record that make
//! each attribute, and the loops that gather them. Legacy bit fields (formats 0 to 5) are repacked
//! in the layout of formats 6 to 10; everything else is copied bit by bit (LAS 1.4 R15, tables 7 to
//! 17).

use super::header::format_bytes;
use esker_points::attribute::{AttrType, Attribute, names};
use esker_points::lattice::Placement;
use esker_points::{Batch, Column, Grid, Rounding, Schema};
use std::sync::Arc;

/// Records gathered before the next column's turn: they stay in the L1 cache meanwhile.
const BLOCK_POINTS: usize = 512;

/// How the values of an attribute are extracted from a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Take {
    /// Copied.
    Copy,
    /// `returns` of formats 0 to 5: two fields of three bits.
    LegacyReturns,
    /// `flags` of formats 0 to 5: scan bits of one byte, class bits of the next.
    LegacyFlags,
    /// `classification` of formats 0 to 5: the lower five bits.
    LegacyClass,
}

/// Location of the value of an attribute in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Offset in the record, in bytes.
    pub offset: usize,
    /// Size, in bytes.
    pub bytes: usize,
    /// How the value is extracted.
    pub take: Take,
}

/// The table of one file: its schema and, in the schema's order, the field of each attribute.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Attributes in canonical order.
    pub schema: Arc<Schema>,
    /// Size of a record, in bytes.
    pub record_bytes: usize,
    /// Offset of red, green and blue in a record, if it has colour.
    pub rgb_offset: Option<usize>,
    /// The field of each attribute.
    pub fields: Vec<Field>,
}

/// A batch and what was found while it was made.
pub struct Converted {
    /// The points.
    pub batch: Batch,
    /// What placing the points changed.
    pub rounding: Rounding,
    /// Greatest value of red, green and blue.
    pub colour_max: u16,
}

impl Layout {
    /// Makes the table of a point format (0 to 10) whose own fields are followed by the `extra`
    /// attributes without gaps.
    pub fn new(point_format: u8, record_bytes: usize, extra: Vec<Attribute>) -> Self {
        let mut table = Table::default();
        if point_format < 6 {
            table.legacy_core()
        } else {
            table.core()
        }
        if matches!(point_format, 1 | 3 | 4 | 5) {
            table.copy(names::GPS_TIME, AttrType::F64);
        }
        let has_colour = matches!(point_format, 2 | 3 | 5 | 7 | 8 | 10);
        let rgb_offset = has_colour.then_some(table.bytes);
        if has_colour {
            table.copy_all(&[names::RED, names::GREEN, names::BLUE], AttrType::U16);
        }
        if matches!(point_format, 8 | 10) {
            table.copy(names::NIR, AttrType::U16);
        }
        if matches!(point_format, 4 | 5 | 9 | 10) {
            table.copy(names::WAVE_DESCRIPTOR, AttrType::U8);
            table.copy(names::WAVE_OFFSET, AttrType::U64);
            table.copy(names::WAVE_SIZE, AttrType::U32);
            let floats =
                [names::WAVE_RETURN_POINT, names::WAVE_X_T, names::WAVE_Y_T, names::WAVE_Z_T];
            table.copy_all(&floats, AttrType::F32);
        }
        debug_assert_eq!(Some(table.bytes), format_bytes(point_format));
        for attribute in extra {
            table.push(attribute, Take::Copy);
        }
        debug_assert_eq!(table.bytes, record_bytes);
        table.finish(record_bytes, rgb_offset)
    }

    /// Converts whole records.
    pub fn convert(&self, records: &[u8], placement: &Placement, grid: &Grid) -> Converted {
        let mut batch =
            Batch::with_capacity(Arc::clone(&self.schema), records.len() / self.record_bytes);
        let (mut rounding, mut colour_max) = (Rounding::default(), 0);
        for block in records.chunks(BLOCK_POINTS * self.record_bytes) {
            for record in block.chunks_exact(self.record_bytes) {
                let placed = placement.integer(raw_position(record), grid, &mut rounding);
                batch.positions.push(placed);
            }
            for (field, column) in self.fields.iter().zip(&mut batch.columns) {
                field.gather(block, self.record_bytes, column);
            }
            colour_max = colour_max.max(self.colour_max(block));
        }
        debug_assert!(batch.is_consistent());
        Converted { batch, rounding, colour_max }
    }

    /// The columns of whole records, without their coordinates.
    pub fn columns(&self, records: &[u8]) -> Vec<Column> {
        let mut columns = vec![Column::new(); self.fields.len()];
        for block in records.chunks(BLOCK_POINTS * self.record_bytes) {
            for (field, column) in self.fields.iter().zip(&mut columns) {
                field.gather(block, self.record_bytes, column);
            }
        }
        columns
    }

    /// The greatest of red, green and blue in whole records; 0 without colour.
    pub fn colour_max(&self, records: &[u8]) -> u16 {
        let Some(at) = self.rgb_offset else { return 0 };
        records.chunks_exact(self.record_bytes).fold(0, |max, record| {
            let [r0, r1, g0, g1, b0, b1] = array(&record[at..]);
            let [r, g, b] = [[r0, r1], [g0, g1], [b0, b1]].map(u16::from_le_bytes);
            max.max(r).max(g).max(b)
        })
    }
}

/// The raw coordinates of a record.
pub fn raw_position(record: &[u8]) -> [i32; 3] {
    [0, 4, 8].map(|at| i32::from_le_bytes(array(&record[at..])))
}

/// First `N` bytes. Cannot panic: records are never shorter than their fields (checked in the
/// header).
fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[..N]);
    out
}

impl Field {
    /// Appends the values of whole records to `column`.
    fn gather(self, records: &[u8], stride: usize, column: &mut Column) {
        let before = column.len();
        column.resize(before + records.len() / stride * self.bytes, 0);
        let column = &mut column[before..];
        let rows = records.chunks_exact(stride).map(|r| &r[self.offset..]);
        match (self.take, self.bytes) {
            (Take::Copy, 1) => copy::<1>(rows, column),
            (Take::Copy, 2) => copy::<2>(rows, column),
            (Take::Copy, 4) => copy::<4>(rows, column),
            (Take::Copy, _) => copy::<8>(rows, column),
            (Take::LegacyReturns, _) => map(rows, column, |r| (r[0] & 7) | (r[0] >> 3 & 7) << 4),
            (Take::LegacyFlags, _) => map(rows, column, |r| (r[0] & 0xc0) | r[1] >> 5),
            (Take::LegacyClass, _) => map(rows, column, |r| r[0] & 0x1f),
        }
    }
}

fn copy<'a, const N: usize>(rows: impl Iterator<Item = &'a [u8]>, column: &mut [u8]) {
    for (value, row) in column.chunks_exact_mut(N).zip(rows) {
        value.copy_from_slice(&row[..N]);
    }
}

fn map<'a>(
    rows: impl Iterator<Item = &'a [u8]>,
    column: &mut [u8],
    value_of: impl Fn(&[u8]) -> u8,
) {
    for (value, row) in column.iter_mut().zip(rows) {
        *value = value_of(row);
    }
}

/// Fields in the record's order, while the table is made.
struct Table {
    attributes: Vec<Attribute>,
    fields: Vec<Field>,
    /// Offset after the last field.
    bytes: usize,
}

impl Default for Table {
    fn default() -> Self {
        // Coordinates come first and are no attribute.
        Self { attributes: vec![], fields: vec![], bytes: 12 }
    }
}

impl Table {
    fn push(&mut self, attribute: Attribute, take: Take) {
        let bytes = attribute.ty.size();
        self.fields.push(Field { offset: self.bytes, bytes, take });
        self.attributes.push(attribute);
        self.bytes += bytes;
    }

    fn copy(&mut self, name: &str, ty: AttrType) {
        self.push(Attribute::new(name, ty), Take::Copy);
    }

    fn copy_all(&mut self, names: &[&str], ty: AttrType) {
        names.iter().for_each(|name| self.copy(name, ty));
    }

    /// Formats 0 to 5: returns and scan bits share a byte, class and class bits the next.
    fn legacy_core(&mut self) {
        self.copy(names::INTENSITY, AttrType::U16);
        self.push(Attribute::new(names::RETURNS, AttrType::U8), Take::LegacyReturns);
        self.bytes -= 1;
        self.push(Attribute::new(names::FLAGS, AttrType::U8), Take::LegacyFlags);
        self.push(Attribute::new(names::CLASSIFICATION, AttrType::U8), Take::LegacyClass);
        self.copy(names::SCAN_ANGLE_RANK, AttrType::I8);
        self.copy(names::USER_DATA, AttrType::U8);
        self.copy(names::POINT_SOURCE_ID, AttrType::U16);
    }

    /// Formats 6 to 10.
    fn core(&mut self) {
        self.copy(names::INTENSITY, AttrType::U16);
        self.copy_all(
            &[names::RETURNS, names::FLAGS, names::CLASSIFICATION, names::USER_DATA],
            AttrType::U8,
        );
        self.copy(names::SCAN_ANGLE, AttrType::I16);
        self.copy(names::POINT_SOURCE_ID, AttrType::U16);
        self.copy(names::GPS_TIME, AttrType::F64);
    }

    /// Brings the fields into the schema's canonical order.
    fn finish(self, record_bytes: usize, rgb_offset: Option<usize>) -> Layout {
        let named = unique(self.attributes);
        let schema = Schema::new(named.clone());
        let mut placed: Vec<_> = named.iter().zip(&self.fields).collect();
        placed.sort_by(|(a, _), (b, _)| a.key().cmp(&b.key()));
        let fields = placed.into_iter().map(|(_, field)| *field).collect();
        Layout { schema: Arc::new(schema), record_bytes, rgb_offset, fields }
    }
}

/// Numbers equal names of equal type as [`Schema::new`] does, so that sorting keeps fields and
/// attributes together.
fn unique(mut attributes: Vec<Attribute>) -> Vec<Attribute> {
    let mut seen = std::collections::HashSet::new();
    for a in &mut attributes {
        let base = a.name.clone();
        let mut n = 2;
        while !seen.insert((a.name.clone(), a.ty)) {
            a.name = format!("{base}#{n}");
            n += 1;
        }
    }
    attributes
}
