//! Bytes of the statistics section: a directory of columns, then the columns, aligned to 8 bytes.
//! Columns of unknown kinds are skipped.

use crate::bytes::{u16_at, u32_at, u64_at};
use crate::error::Fault;
use crate::footer::Section;
use crate::layout::NO_ATTRIBUTE;
use crate::statistics::{BINS, Histograms, Ranges, Statistics};
use esker_points::attribute::names;
use esker_points::node::Sides;
use esker_points::read_at::ReadAt;
use esker_points::{AttrType, Schema};
use std::collections::BTreeMap;
use std::io;

/// First bytes of the section.
pub const STATISTICS_MAGIC: [u8; 4] = *b"ESST";
const HEAD_BYTES: usize = 16;
const ENTRY_BYTES: usize = 24;
const OWN_CLASSES: u16 = 5;
const SUBTREE_CLASSES: u16 = 6;
const HISTOGRAM: u16 = 7;
const SIDES: u16 = 8;
const HISTOGRAM_BYTES: usize = 16 + 8 * BINS;

impl Statistics {
    /// Bytes of the section.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut columns: Vec<(u16, u16, Vec<u8>)> = Vec::new();
        for (a, ranges) in self.ranges.iter().enumerate() {
            for (kind, column) in (1..).zip(ranges) {
                columns.push((kind, a as u16, column.clone()));
            }
        }
        for (kind, bits) in [OWN_CLASSES, SUBTREE_CLASSES].into_iter().zip(&self.class_bits) {
            if self.has_classes {
                columns.push((kind, NO_ATTRIBUTE, bytemuck::cast_slice(bits).to_vec()));
            }
        }
        for (a, counts) in self.histograms.counts.iter().enumerate() {
            let (lo, hi) = self.histograms.ranges.of(a);
            let mut column = [lo.to_le_bytes(), hi.to_le_bytes()].concat();
            counts.iter().for_each(|n| column.extend_from_slice(&n.to_le_bytes()));
            columns.push((HISTOGRAM, a as u16, column));
        }
        if let Some(sides) = &self.sides {
            columns.push((SIDES, NO_ATTRIBUTE, encode_sides(sides)));
        }
        self.lay_out(&columns)
    }

    fn lay_out(&self, columns: &[(u16, u16, Vec<u8>)]) -> Vec<u8> {
        let mut out = STATISTICS_MAGIC.to_vec();
        out.extend_from_slice(&(columns.len() as u32).to_le_bytes());
        out.extend_from_slice(&(self.nodes as u64).to_le_bytes());
        let mut offset = (HEAD_BYTES + columns.len() * ENTRY_BYTES) as u64;
        for (kind, attribute, column) in columns {
            out.extend_from_slice(&kind.to_le_bytes());
            out.extend_from_slice(&attribute.to_le_bytes());
            out.extend_from_slice(&[0; 4]);
            out.extend_from_slice(&offset.to_le_bytes());
            out.extend_from_slice(&(column.len() as u64).to_le_bytes());
            offset += (column.len() as u64).next_multiple_of(8);
        }
        for (_, _, column) in columns {
            out.extend_from_slice(column);
            out.resize(out.len().next_multiple_of(8), 0);
        }
        out
    }

    /// Reads and checks the section of a file with these attributes and this number of nodes.
    pub(crate) fn decode(bytes: &[u8], schema: &Schema, nodes: usize) -> Result<Self, Fault> {
        let columns = find_columns(bytes, nodes)?;
        let column = |kind: u16, attribute: u16, length: usize| {
            columns.get(&(kind, attribute)).copied().filter(|c| c.len() == length).ok_or_else(
                || {
                    let what =
                        format!("column {kind} of attribute {attribute} is missing or too short");
                    Fault::new("statistics", what)
                },
            )
        };
        let types: Vec<_> = schema.attributes.iter().map(|a| a.ty).collect();
        let mut ranges = Vec::new();
        let mut histograms = Histograms::new(Ranges::from_pairs(Vec::new()));
        let mut pairs = Vec::new();
        for (a, ty) in (0u16..).zip(&types) {
            let length = nodes * ty.size();
            let range = |kind| column(kind, a, length).map(<[u8]>::to_vec);
            ranges.push([range(1)?, range(2)?, range(3)?, range(4)?]);
            let histogram = column(HISTOGRAM, a, HISTOGRAM_BYTES)?;
            let real = |at| f64::from_bits(u64_at(histogram, at));
            pairs.push((real(0), real(8)));
            let mut counts = [0; BINS];
            counts.iter_mut().enumerate().for_each(|(i, n)| *n = u64_at(histogram, 16 + 8 * i));
            histograms.counts.push(counts);
        }
        histograms.ranges = Ranges::from_pairs(pairs);
        let has_classes = schema.find_typed(names::CLASSIFICATION, AttrType::U8).is_some();
        let mut class_bits = [Vec::new(), Vec::new()];
        if has_classes {
            for (kind, bits) in [OWN_CLASSES, SUBTREE_CLASSES].into_iter().zip(&mut class_bits) {
                let column = column(kind, NO_ATTRIBUTE, nodes * 32)?;
                *bits = column
                    .chunks_exact(32)
                    .map(|c| [0, 8, 16, 24].map(|at| u64_at(c, at)))
                    .collect();
            }
        }
        let sides =
            columns.get(&(SIDES, NO_ATTRIBUTE)).map(|c| decode_sides(c, nodes)).transpose()?;
        Ok(Self { types, nodes, ranges, has_classes, class_bits, histograms, sides })
    }
}

/// The column of sides: two words a node, then their checksum, so that the column can be read
/// alone.
fn encode_sides(sides: &[Sides]) -> Vec<u8> {
    let mut column: Vec<u8> = bytemuck::cast_slice(sides).to_vec();
    let crc = crc32fast::hash(&column);
    column.extend_from_slice(&u64::from(crc).to_le_bytes());
    column
}

fn decode_sides(column: &[u8], nodes: usize) -> Result<Vec<Sides>, Fault> {
    let fault = |what: &str| Fault::new("statistics", what);
    let words = nodes * size_of::<Sides>();
    if column.len() != words + 8 {
        return Err(fault("the column of sides is not as long as the table"));
    }
    let (words, crc) = column.split_at(words);
    if u64::from(crc32fast::hash(words)) != u64_at(crc, 0) {
        return Err(fault("the checksum of the column of sides does not match"));
    }
    Ok(words.chunks_exact(16).map(|c| [u64_at(c, 0), u64_at(c, 8)]).collect())
}

/// Reads the sides of a file's contours, and little else of its statistics, which may be long;
/// empty if the file has none.
///
/// # Errors
/// The outer error if they cannot be read, the inner one if they are damaged.
pub(crate) fn read_sides(
    source: &dyn ReadAt,
    section: Section,
    nodes: usize,
) -> io::Result<Result<Vec<Sides>, Fault>> {
    let read = |offset: u64, bytes: u64| {
        let is_inside = offset.checked_add(bytes).is_some_and(|end| end <= section.bytes);
        let mut run = vec![0; if is_inside { bytes as usize } else { 0 }];
        source.read_exact_at(&mut run, section.offset + offset.min(section.bytes))?;
        io::Result::Ok(is_inside.then_some(run))
    };
    let fault = |what: &str| Ok(Err(Fault::new("statistics", what)));
    let Some(head) = read(0, HEAD_BYTES as u64)? else {
        return fault("it does not begin as it should");
    };
    let bytes = u64::from(u32_at(&head, 4)) * ENTRY_BYTES as u64;
    let Some(directory) = read(HEAD_BYTES as u64, bytes)? else {
        return fault("it is shorter than its directory");
    };
    let mut entries = directory.chunks_exact(ENTRY_BYTES);
    let Some(entry) = entries.find(|e| (u16_at(e, 0), u16_at(e, 2)) == (SIDES, NO_ATTRIBUTE))
    else {
        return Ok(Ok(Vec::new()));
    };
    match read(u64_at(entry, 8), u64_at(entry, 16))? {
        Some(column) => Ok(decode_sides(&column, nodes)),
        None => fault("a column is not where it should be"),
    }
}

type Columns<'a> = BTreeMap<(u16, u16), &'a [u8]>;

fn find_columns(bytes: &[u8], nodes: usize) -> Result<Columns<'_>, Fault> {
    let fault = |what: &str| Fault::new("statistics", what);
    if bytes.len() < HEAD_BYTES || bytes[..4] != STATISTICS_MAGIC {
        return Err(fault("it does not begin as it should"));
    }
    let count = u32_at(bytes, 4) as usize;
    if u64_at(bytes, 8) != nodes as u64 {
        return Err(fault("its count of nodes is not the table's"));
    }
    let directory = count
        .checked_mul(ENTRY_BYTES)
        .and_then(|length| bytes.get(HEAD_BYTES..)?.get(..length))
        .ok_or_else(|| fault("it is shorter than its directory"))?;
    let mut columns = Columns::new();
    let mut end = HEAD_BYTES + directory.len();
    for entry in directory.chunks_exact(ENTRY_BYTES) {
        let place = (u64_at(entry, 8), u64_at(entry, 16));
        let column = usize::try_from(place.1)
            .ok()
            .filter(|_| place.0 == end as u64 && u32_at(entry, 4) == 0)
            .and_then(|length| bytes.get(end..)?.get(..length))
            .ok_or_else(|| fault("a column is not where it should be"))?;
        end += column.len();
        let padding = end.next_multiple_of(8) - end;
        if bytes.get(end..end + padding).is_none_or(|p| p.iter().any(|&b| b != 0)) {
            return Err(fault("the padding of a column is not zero"));
        }
        end += padding;
        if columns.insert((u16_at(entry, 0), u16_at(entry, 2)), column).is_some() {
            return Err(fault("a column occurs twice"));
        }
    }
    if end != bytes.len() {
        return Err(fault("its columns do not fill it"));
    }
    Ok(columns)
}
