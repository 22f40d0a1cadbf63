//! Encodes columns as point records, the inverse of [`crate::las::points`]. Attributes without a
//! field in the record are appended to it as extra bytes.

use crate::las::points::{Field, Layout, Take};
use crate::write::encode::{Encode, Encoded, Outline};
use esker_points::attribute::names;
use esker_points::lattice::ORIGIN;
use esker_points::{AttrType, Attribute, Batch, Schema};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Records filled before the next column's turn: they stay in the L1 cache meanwhile.
const BLOCK_POINTS: usize = 512;
/// Step of the scan angle of formats 6 to 10, in degrees.
const ANGLE_STEP: f64 = 0.006;

/// How a value is stored in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Put {
    /// The inverse of what the reader does.
    Back(Take),
    /// A colour of 8 bits in a field of 16: times 256, as the specification demands.
    Widened,
    /// Whole degrees as steps of 0.006 degrees, for points that have no other angle.
    Degrees,
    /// A small whole number of another type, in a field of 16 bits.
    Low,
}

/// Field that the values of a column are written to.
#[derive(Clone, Copy, Debug)]
struct Destination {
    column: usize,
    bytes: usize,
    offset: usize,
    put: Put,
}

/// Layout of the records of a file.
#[derive(Clone, Debug)]
pub struct Records {
    /// Point format, 0 to 10.
    pub point_format: u8,
    /// Size of a record, in bytes.
    pub record_bytes: usize,
    destinations: Vec<Destination>,
    /// Number of points without the number of a return, which LAS demands: they are written as
    /// return 1. `None` if the records of the sources are kept as they are.
    pub filled: Option<Arc<AtomicU64>>,
}

impl Records {
    /// The layout of a source, if its attributes are exactly those of the outline.
    pub fn of_source(point_format: u8, layout: &Layout, schema: &Schema) -> Option<Self> {
        let own = &layout.schema.attributes;
        if !own.iter().map(Attribute::key).eq(schema.attributes.iter().map(Attribute::key)) {
            return None;
        }
        let destinations =
            layout.fields.iter().enumerate().map(|(column, field)| back(column, field));
        let destinations = destinations.collect();
        let record_bytes = layout.record_bytes;
        Some(Self { point_format, record_bytes, destinations, filled: None })
    }

    /// The layout of a point format for any attributes; also returns those that become extra bytes.
    pub fn of_format(
        point_format: u8,
        base_bytes: usize,
        outline: &Outline,
    ) -> (Self, Vec<Attribute>) {
        let schema = &outline.schema;
        let base = Layout::new(point_format, base_bytes, Vec::new());
        let mut records = Self {
            point_format,
            record_bytes: base_bytes,
            destinations: Vec::new(),
            filled: Some(Arc::default()),
        };
        let mut extra = Vec::new();
        let mut found: Vec<Option<Destination>> = Vec::with_capacity(schema.attributes.len());
        for (column, attribute) in schema.attributes.iter().enumerate() {
            let of = |name: &str, ty| base.schema.find_typed(name, ty).map(|i| base.fields[i]);
            let name = attribute.name.as_str();
            let colour = [names::RED, names::GREEN, names::BLUE].contains(&name);
            let bytes = attribute.ty.size();
            let destination =
                |field: Field, put| Destination { column, bytes, offset: field.offset, put };
            found.push(match attribute.ty {
                AttrType::U8 if colour => {
                    of(name, AttrType::U16).map(|f| destination(f, Put::Widened))
                }
                AttrType::I8 if name == names::SCAN_ANGLE_RANK && point_format >= 6 => {
                    of(names::SCAN_ANGLE, AttrType::I16).map(|f| destination(f, Put::Degrees))
                }
                ty if name == names::INTENSITY && is_low(outline, column) => {
                    of(name, AttrType::U16).map(|field| Destination {
                        bytes: ty.size(),
                        ..destination(field, Put::Low)
                    })
                }
                ty => of(name, ty).map(|field| back(column, &field)),
            });
        }
        // A field holds one value of a point: what would be converted yields to the field's own.
        let is_taken = |new: &Destination| {
            let is_other =
                |own: &&Destination| matches!(own.put, Put::Back(_)) && own.offset == new.offset;
            let mut others = found.iter().flatten().filter(is_other);
            !matches!(new.put, Put::Back(_))
                && others.any(|own| outline.has_both(own.column, new.column))
        };
        let kept: Vec<_> = found.iter().map(|d| d.filter(|d| !is_taken(d))).collect();
        for ((column, attribute), kept) in schema.attributes.iter().enumerate().zip(kept) {
            records.destinations.push(kept.unwrap_or_else(|| {
                extra.push(attribute.clone());
                let (bytes, offset) = (attribute.ty.size(), records.record_bytes);
                records.record_bytes += bytes;
                Destination { column, bytes, offset, put: Put::Back(Take::Copy) }
            }));
        }
        (records, extra)
    }

    /// Whether colours of 8 bits are written with 16.
    pub fn widens_colours(&self) -> bool {
        self.destinations.iter().any(|destination| destination.put == Put::Widened)
    }

    /// Whether whole degrees of scan angles are rounded to steps of 0.006.
    pub fn rounds_angles(&self) -> bool {
        self.destinations.iter().any(|destination| destination.put == Put::Degrees)
    }

    /// For each column, the index of its field. A column that is converted has the field of another
    /// one.
    pub fn fields(&self) -> Vec<usize> {
        let same = |a: &Destination, b: &Destination| a.offset == b.offset && a.take() == b.take();
        let first = |destination: &Destination| {
            self.destinations.iter().position(|other| same(destination, other))
        };
        self.destinations.iter().filter_map(first).collect()
    }
}

/// Whether an intensity of another type than that of LAS fits the field, and is the only one.
fn is_low(outline: &Outline, column: usize) -> bool {
    let schema = &outline.schema;
    let is_whole = match schema.attributes[column].ty {
        AttrType::U16 | AttrType::F32 | AttrType::F64 => false,
        AttrType::U8 => true,
        _ => outline.is_within(column, 0.0, f64::from(u16::MAX)),
    };
    let all = schema.attributes.iter().filter(|a| a.name == names::INTENSITY);
    is_whole && all.count() == 1 && schema.attributes[column].scale == 1.0
}

fn back(column: usize, field: &Field) -> Destination {
    Destination { column, bytes: field.bytes, offset: field.offset, put: Put::Back(field.take) }
}

impl Records {
    /// Makes a point without the number of a return the first, of one if their number is not known
    /// either; returns whether it had none.
    fn fill_return(&self, record: &mut [u8]) -> bool {
        let bits = if self.point_format < 6 { 3 } else { 4 };
        let most = (1u8 << bits) - 1;
        let byte = &mut record[14];
        if *byte & most != 0 {
            return false;
        }
        let count = (*byte >> bits & most).max(1);
        *byte = *byte & !(most << bits | most) | count << bits | 1;
        true
    }
}

impl Encode for Records {
    fn encode(&self, batch: &Batch) -> Encoded {
        let stride = self.record_bytes;
        let mut out = Encoded { points: batch.len() as u64, ..Encoded::default() };
        out.bytes = vec![0; batch.len() * stride];
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        let blocks = out.bytes.chunks_mut(BLOCK_POINTS * stride);
        for (block, (records, positions)) in
            blocks.zip(batch.positions.chunks(BLOCK_POINTS)).enumerate()
        {
            for (record, p) in records.chunks_exact_mut(stride).zip(positions) {
                for axis in 0..3 {
                    low[axis] = low[axis].min(p[axis]);
                    high[axis] = high[axis].max(p[axis]);
                    record[4 * axis..][..4].copy_from_slice(&raw(p[axis]).to_le_bytes());
                }
            }
            let first = block * BLOCK_POINTS;
            for destination in &self.destinations {
                let values = &batch.columns[destination.column][first * destination.bytes..];
                destination.scatter(
                    &values[..positions.len() * destination.bytes],
                    records,
                    stride,
                );
            }
            if let Some(filled) = &self.filled {
                let filled_here = records.chunks_exact_mut(stride).map(|r| self.fill_return(r));
                filled.fetch_add(filled_here.map(u64::from).sum(), Ordering::Relaxed);
            }
            for record in records.chunks_exact(stride) {
                let number = record[14] & if self.point_format < 6 { 7 } else { 15 };
                if let Some(n) = usize::from(number).checked_sub(1) {
                    out.by_return[n] += 1;
                }
            }
        }
        out.bounds = (!batch.is_empty()).then_some([low, high]);
        out
    }
}

/// The raw coordinate of a lattice coordinate.
pub fn raw(u: u32) -> i32 {
    // The lattice is as wide as the coordinates of a record.
    (i64::from(u) - ORIGIN) as i32
}

impl Destination {
    /// How a reader extracts the field.
    fn take(&self) -> Take {
        match self.put {
            Put::Back(take) => take,
            Put::Widened | Put::Degrees | Put::Low => Take::Copy,
        }
    }

    /// Writes values into whole records, whose bytes are zero where nothing was written yet.
    fn scatter(self, values: &[u8], records: &mut [u8], stride: usize) {
        let rows = records.chunks_exact_mut(stride).map(|r| &mut r[self.offset..]);
        match (self.put, self.bytes) {
            (Put::Back(Take::Copy), 1) => copy::<1>(rows, values),
            (Put::Back(Take::Copy), 2) => copy::<2>(rows, values),
            (Put::Back(Take::Copy), 4) => copy::<4>(rows, values),
            (Put::Back(Take::Copy), _) => copy::<8>(rows, values),
            (Put::Back(Take::LegacyReturns), _) => {
                each(rows, values, |r, v| r[0] |= (v & 7) | (v >> 4 & 7) << 3);
            }
            (Put::Back(Take::LegacyFlags), _) => each(rows, values, |r, v| {
                r[0] |= v & 0xc0;
                r[1] |= v << 5;
            }),
            (Put::Back(Take::LegacyClass), _) => each(rows, values, |r, v| r[0] |= v & 0x1f),
            (Put::Widened, _) => each(rows, values, |r, v| r[1] |= v),
            (Put::Low, bytes) => {
                for (row, value) in rows.zip(values.chunks_exact(bytes)) {
                    for (byte, v) in row[..2].iter_mut().zip(value) {
                        *byte |= v;
                    }
                }
            }
            (Put::Degrees, _) => each(rows, values, |r, v| {
                if r[..2] == [0, 0] {
                    let steps = (f64::from(v as i8) / ANGLE_STEP).round() as i16;
                    r[..2].copy_from_slice(&steps.to_le_bytes());
                }
            }),
        }
    }
}

/// Sets bits only, so that zeros keep what another attribute wrote: a file may have a colour of 8
/// bits and one of 16.
fn copy<'a, const N: usize>(rows: impl Iterator<Item = &'a mut [u8]>, values: &[u8]) {
    for (row, value) in rows.zip(values.chunks_exact(N)) {
        for (byte, v) in row[..N].iter_mut().zip(value) {
            *byte |= v;
        }
    }
}

fn each<'a>(rows: impl Iterator<Item = &'a mut [u8]>, values: &[u8], put: impl Fn(&mut [u8], u8)) {
    rows.zip(values).for_each(|(row, &value)| put(row, value));
}
