//! Bytes of the statistics section: a directory of columns, then the columns, aligned to 8 bytes.
//! Columns of unknown kinds are skipped.

use crate::bytes::{u16_at, u32_at, u64_at};
use crate::error::Fault;
use crate::footer::Section;
use crate::layout::NO_ATTRIBUTE;
use crate::statistics::{BINS, Histograms, Ranges, Statistics};
use crate::table_parts::{PartSizes, TableParts};
use crate::table_top::TableTop;
use esker_points::attribute::names;
use esker_points::node::Sides;
use esker_points::read_at::ReadAt;
use esker_points::{AttrType, NodeTable, Schema};
use std::collections::BTreeMap;
use std::io;
use std::ops::Range;

/// First bytes of the section.
pub const STATISTICS_MAGIC: [u8; 4] = *b"ESST";
const HEAD_BYTES: usize = 16;
const ENTRY_BYTES: usize = 24;
const OWN_CLASSES: u16 = 5;
const SUBTREE_CLASSES: u16 = 6;
const HISTOGRAM: u16 = 7;
const SIDES: u16 = 8;
const TABLE_PARTS: u16 = 9;
const TABLE_TOP: u16 = 10;
const HISTOGRAM_BYTES: usize = 16 + 8 * BINS;

impl Statistics {
    /// Bytes of the section; with the columns by which a part of the table can be read, if it is to
    /// have them.
    pub(crate) fn encode(&self, table: &NodeTable, parts: Option<PartSizes>) -> Vec<u8> {
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
        if let Some(PartSizes { part_nodes, top_nodes, .. }) = parts {
            let mut histograms = crc32fast::Hasher::new();
            let of_histograms = columns.iter().filter(|(kind, ..)| *kind == HISTOGRAM);
            of_histograms.for_each(|(_, _, column)| histograms.update(column));
            let sides = self.sides.as_deref().unwrap_or_default();
            let parts = TableParts::of(table, sides, histograms.finalize(), part_nodes);
            columns.push((TABLE_PARTS, NO_ATTRIBUTE, parts.encode()));
            columns.push((TABLE_TOP, NO_ATTRIBUTE, TableTop::of(table, sides, top_nodes).encode()));
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
        let mut histograms = Vec::new();
        for (a, ty) in (0u16..).zip(&types) {
            let length = nodes * ty.size();
            let range = |kind| column(kind, a, length).map(<[u8]>::to_vec);
            ranges.push([range(1)?, range(2)?, range(3)?, range(4)?]);
            histograms.push(column(HISTOGRAM, a, HISTOGRAM_BYTES)?);
        }
        let histograms = decode_histograms(&histograms);
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

/// Histograms of their columns, each of the right length.
fn decode_histograms(columns: &[&[u8]]) -> Histograms {
    let pair = |column: &&[u8]| [0, 8].map(|at| f64::from_bits(u64_at(column, at))).into();
    let mut histograms = Histograms::new(Ranges::from_pairs(columns.iter().map(pair).collect()));
    for (counts, column) in histograms.counts.iter_mut().zip(columns) {
        counts.iter_mut().enumerate().for_each(|(i, n)| *n = u64_at(column, 16 + 8 * i));
    }
    histograms
}

/// Where the columns of a section are, so that some can be read without the rest, which may be
/// long.
#[derive(Clone, Debug)]
pub(crate) struct ColumnPlaces {
    section: Section,
    nodes: usize,
    /// Kind, attribute, and place in the section.
    entries: Vec<(u16, u16, Range<u64>)>,
}

/// Result of reading columns: the outer error if they cannot be read, the inner one if they are
/// damaged.
pub(crate) type Read<T> = io::Result<Result<T, Fault>>;

impl ColumnPlaces {
    /// Reads the directory of the statistics of a file of `nodes` nodes.
    pub(crate) fn read(source: &dyn ReadAt, section: Section, nodes: usize) -> Read<Self> {
        let mut of = Self { section, nodes, entries: Vec::new() };
        let fault = |what: &str| Ok(Err(Fault::new("statistics", what)));
        let Some(head) = of.bytes(source, 0..HEAD_BYTES as u64)? else {
            return fault("it does not begin as it should");
        };
        let bytes = u64::from(u32_at(&head, 4)) * ENTRY_BYTES as u64;
        let Some(directory) = of.bytes(source, HEAD_BYTES as u64..HEAD_BYTES as u64 + bytes)?
        else {
            return fault("it is shorter than its directory");
        };
        for entry in directory.chunks_exact(ENTRY_BYTES) {
            let (offset, bytes) = (u64_at(entry, 8), u64_at(entry, 16));
            let Some(end) = offset.checked_add(bytes).filter(|&end| end <= section.bytes) else {
                return fault("a column is not where it should be");
            };
            of.entries.push((u16_at(entry, 0), u16_at(entry, 2), offset..end));
        }
        Ok(Ok(of))
    }

    /// Bytes of a range of the section; `None` if they are not in it.
    fn bytes(&self, source: &dyn ReadAt, range: Range<u64>) -> io::Result<Option<Vec<u8>>> {
        if range.start > range.end || range.end > self.section.bytes {
            return Ok(None);
        }
        let mut bytes = vec![0; (range.end - range.start) as usize];
        source.read_exact_at(&mut bytes, self.section.offset + range.start)?;
        Ok(Some(bytes))
    }

    fn place(&self, kind: u16, attribute: u16) -> Option<Range<u64>> {
        let mut entries = self.entries.iter();
        entries.find(|of| (of.0, of.1) == (kind, attribute)).map(|of| of.2.clone())
    }

    /// Bytes of a column that is not of an attribute; `None` if there is none.
    fn column(&self, source: &dyn ReadAt, kind: u16) -> io::Result<Option<Vec<u8>>> {
        match self.place(kind, NO_ATTRIBUTE) {
            Some(place) => self.bytes(source, place),
            None => Ok(None),
        }
    }

    /// Says that the columns of parts of the table and of its top are read next.
    pub(crate) fn will_read_parts(&self, source: &dyn ReadAt) {
        let kinds = [TABLE_PARTS, TABLE_TOP].into_iter();
        let places = kinds.filter_map(|kind| self.place(kind, NO_ATTRIBUTE));
        let at = self.section.offset;
        let ranges: Vec<_> = places.map(|range| at + range.start..at + range.end).collect();
        source.will_read(&ranges);
    }

    /// The parts of the table and its top, if the file has both.
    pub(crate) fn parts(&self, source: &dyn ReadAt) -> Read<Option<(TableParts, TableTop)>> {
        let columns = (self.column(source, TABLE_PARTS)?, self.column(source, TABLE_TOP)?);
        let (Some(parts), Some(top)) = columns else { return Ok(Ok(None)) };
        let has_sides = self.place(SIDES, NO_ATTRIBUTE).is_some();
        let parts = TableParts::decode(&parts, self.nodes as u32);
        Ok(parts.and_then(|parts| Ok(Some((parts, TableTop::decode(&top, has_sides)?)))))
    }

    /// The sides of all contours; empty if the file has none.
    pub(crate) fn sides(&self, source: &dyn ReadAt) -> Read<Vec<Sides>> {
        let column = self.column(source, SIDES)?;
        Ok(column.map_or(Ok(Vec::new()), |column| decode_sides(&column, self.nodes)))
    }

    /// Where the sides of some nodes are in the file; `None` if the file has none.
    pub(crate) fn sides_of(&self, nodes: &Range<u32>) -> Result<Option<Range<u64>>, Fault> {
        let Some(place) = self.place(SIDES, NO_ATTRIBUTE) else { return Ok(None) };
        let bytes = (self.nodes * size_of::<Sides>()) as u64;
        if place.end - place.start != bytes + 8 {
            return Err(Fault::new("statistics", "the sides are not as long as the table"));
        }
        let first = self.section.offset + place.start;
        let at = |node: u32| first + u64::from(node) * size_of::<Sides>() as u64;
        Ok(Some(at(nodes.start)..at(nodes.end)))
    }

    /// The histograms of a file with `attributes` attributes, whose columns have this checksum.
    pub(crate) fn histograms(
        &self,
        source: &dyn ReadAt,
        attributes: usize,
        crc: u32,
    ) -> Read<Histograms> {
        let fault = |what: &str| Ok(Err(Fault::new("statistics", what)));
        let places = (0..attributes as u16).map(|attribute| self.place(HISTOGRAM, attribute));
        let is_whole = |place: &Range<u64>| place.end - place.start == HISTOGRAM_BYTES as u64;
        let places = places.map(|place| place.filter(is_whole)).collect::<Option<Vec<_>>>();
        let Some(places) = places else { return fault("a histogram is missing or too short") };
        // One read, as writers write them one after the other.
        let start = places.iter().map(|place| place.start).min().unwrap_or(0);
        let end = places.iter().map(|place| place.end).max().unwrap_or(0);
        if end - start > (attributes * HISTOGRAM_BYTES) as u64 {
            return fault("the histograms do not stand together");
        }
        let Some(bytes) = self.bytes(source, start..end)? else {
            return fault("a column is not where it should be");
        };
        let column = |place: &Range<u64>| {
            let at = (place.start - start) as usize;
            &bytes[at..at + HISTOGRAM_BYTES]
        };
        let columns: Vec<_> = places.iter().map(column).collect();
        let mut hasher = crc32fast::Hasher::new();
        columns.iter().for_each(|column| hasher.update(column));
        if hasher.finalize() != crc {
            return fault("the checksum of the histograms does not match");
        }
        Ok(Ok(decode_histograms(&columns)))
    }
}

/// Checks the columns of parts of the table and of its top against the table and the statistics of
/// a section; `bytes` is the section, which was decoded before.
pub(crate) fn check_parts(
    bytes: &[u8],
    table: &NodeTable,
    statistics: &Statistics,
) -> Result<(), Fault> {
    let columns = find_columns(bytes, table.nodes.len())?;
    let column = |kind: u16| columns.get(&(kind, NO_ATTRIBUTE)).copied();
    let sides = statistics.sides.as_deref().unwrap_or_default();
    if column(TABLE_PARTS).is_some() != column(TABLE_TOP).is_some() {
        return Err(Fault::new("statistics", "it has parts of the table or its top, and not both"));
    }
    if let Some(column) = column(TABLE_PARTS) {
        let mut histograms = crc32fast::Hasher::new();
        (0..statistics.types.len() as u16)
            .filter_map(|attribute| columns.get(&(HISTOGRAM, attribute)))
            .for_each(|column| histograms.update(column));
        let stored = TableParts::decode(column, table.nodes.len() as u32)?;
        let again = TableParts::of(table, sides, histograms.finalize(), stored.part_nodes());
        if again != stored {
            return Err(Fault::new(
                "statistics",
                "the parts of the table are not those of the table",
            ));
        }
    }
    if let Some(column) = column(TABLE_TOP) {
        let stored = TableTop::decode(column, statistics.sides.is_some())?;
        let indices: Vec<u32> = stored.entries.iter().map(|entry| entry.index).collect();
        let is_within = indices.last().is_some_and(|&last| (last as usize) < table.nodes.len());
        // Bytes, since two zeros are equal as numbers.
        if !is_within || TableTop::with(table, sides, &indices).encode() != column {
            return Err(Fault::new("statistics", "the top of the table is not that of the table"));
        }
    }
    Ok(())
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
