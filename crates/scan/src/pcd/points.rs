//! Reads the points of a PCD file as little-endian records of the values that are kept: from lines,
//! from records with padding, or from compressed points, which are stored field after field.

use super::header::{Data, Field, Header, ValueLocation};
use super::lzf::{BYTES_A_COPY, unpack};
use super::packed::{of_number, of_single, whole};
use crate::error::ScanError;
use crate::ply::ascii::put;
use crate::ply::header::{Element, Encoding};
use crate::ply::plan::{RecordPlan, Survey};
use crate::ply::rest::Rest;
use crate::runs::Runs;
use crate::source::BATCH_POINTS;
use crate::text::blocks::{LineBlock, LineBlocks};
use crate::text::layout::excerpt;
use crate::text::number::{fields, number};
use esker_points::{AttrType, Task};
use std::io::{BufRead, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Size of a block of records, in bytes, unless one record is longer.
const BLOCK_BYTES: usize = 1 << 20;

/// How the points of a file are stored, and which of their values are kept.
pub(crate) struct Layout {
    pub header: Header,
    /// The kept values, as an element of scalars.
    pub element: Element,
    pub locations: Vec<ValueLocation>,
    /// Fields of packed colours as singles.
    packed_singles: Vec<usize>,
    /// Whether these are integers that are written as numbers; decided by the survey.
    pub are_colours_numbers: bool,
}

/// Some points as read from the file.
pub(crate) enum Raw {
    Lines {
        block: LineBlock,
        rows: u64,
    },
    Records(Vec<u8>),
    /// The given points of the fields of all points.
    Fields {
        all: Arc<Vec<u8>>,
        points: Range<usize>,
    },
}

/// Reads the points of a file, block by block.
pub(crate) struct Points<'a> {
    path: PathBuf,
    layout: &'a Layout,
    left: u64,
    /// Whether this is a share of the points, of which lines end where the body does.
    is_share: bool,
    body: Body,
}

enum Body {
    Lines {
        lines: LineBlocks<Box<dyn BufRead + Send>>,
        more: u64,
    },
    Records(Box<dyn BufRead + Send>),
    /// All points, and the stream behind them.
    Fields(Arc<Vec<u8>>, Box<dyn BufRead + Send>),
}

impl Layout {
    /// The layout that a header describes.
    pub fn new(header: Header) -> Self {
        let (element, locations) = header.element();
        let fields = header.fields.iter().enumerate();
        let packed_singles = fields.filter(|(_, f)| f.is_packed_single()).map(|(i, _)| i).collect();
        Self { header, element, locations, packed_singles, are_colours_numbers: false }
    }

    /// Encoding of the values: ASCII for lines, otherwise little-endian.
    pub fn encoding(&self) -> Encoding {
        match self.header.data {
            Data::Ascii => Encoding::Ascii,
            Data::Binary | Data::Compressed => Encoding::LittleEndian,
        }
    }

    /// The records of some points; adds the decimals of lines and the packed colours to `found`.
    ///
    /// # Errors
    /// If a line is not what the header says.
    pub fn records(
        &self,
        path: &Path,
        plan: &RecordPlan,
        raw: &Raw,
        mut found: Option<&mut Survey>,
    ) -> Result<Vec<u8>, ScanError> {
        let mut out = Vec::new();
        match raw {
            Raw::Lines { block, rows } => {
                for (n, line) in block.lines().take(*rows as usize) {
                    self.parse_line(line, plan, &mut out, found.as_deref_mut())
                        .map_err(|why| ScanError::damaged(path, format!("line {n} {why}")))?;
                }
            }
            Raw::Records(records) => {
                let points = records.len() / self.header.stride;
                out.reserve(points * plan.record.stride);
                for record in records.chunks_exact(self.header.stride) {
                    let value = |field: &Field| &record[field.offset..][..field.bytes()];
                    self.put_values(value, &mut out, found.as_deref_mut());
                }
            }
            Raw::Fields { all, points } => {
                let count = all.len() / self.header.stride;
                out.reserve(points.len() * plan.record.stride);
                for point in points.clone() {
                    let value = |field: &Field| {
                        &all[field.offset * count + field.bytes() * point..][..field.bytes()]
                    };
                    self.put_values(value, &mut out, found.as_deref_mut());
                }
            }
        }
        Ok(out)
    }

    /// Appends the kept values of a point, of which `of_field` gives the bytes of a field.
    fn put_values<'b>(
        &self,
        of_field: impl Fn(&Field) -> &'b [u8],
        out: &mut Vec<u8>,
        found: Option<&mut Survey>,
    ) {
        let single = |field: &Field| AttrType::F32.to_f64(of_field(field));
        if let Some(found) = found {
            for &field in &self.packed_singles {
                found.packed.add(single(&self.header.fields[field]));
            }
        }
        for location in &self.locations {
            let field = &self.header.fields[location.field];
            if self.are_colours_numbers && field.is_packed_single() {
                out.push(of_number(single(field))[location.at]);
            } else {
                out.extend_from_slice(&of_field(field)[location.at..][..location.bytes]);
            }
        }
    }

    /// Parses a line into a record; adds decimals and packed colours to `found`.
    fn parse_line(
        &self,
        line: &[u8],
        plan: &RecordPlan,
        out: &mut Vec<u8>,
        mut found: Option<&mut Survey>,
    ) -> Result<(), String> {
        let mut words = fields(line);
        let mut target = 0;
        for field in &self.header.fields {
            for _ in 0..field.count {
                let word = words.next().ok_or("has fewer numbers than the header has fields")?;
                let is_held = if field.is_padding() {
                    true
                } else if let Some(has_alpha) = field.packed() {
                    target += if has_alpha { 4 } else { 3 };
                    if let (Some(found), true) = (&mut found, field.is_packed_single()) {
                        found.packed.add(number(word).unwrap_or(f64::NAN));
                    }
                    let bytes = self.unpacked(word, field.ty);
                    bytes.is_some_and(|[blue, green, red, alpha]| {
                        out.extend_from_slice(&[red, green, blue]);
                        out.extend(has_alpha.then_some(alpha));
                        true
                    })
                } else {
                    if let Some(found) = &mut found {
                        plan.add_decimals(target, word, found);
                    }
                    target += 1;
                    put(word, field.ty, plan.record.fields[target - 1].ty, out)
                };
                if !is_held {
                    let (word, ty) = (excerpt(word), field.ty.name());
                    return Err(format!("has `{word}` for {}, which is {ty}", field.name));
                }
            }
        }
        match words.next() {
            Some(_) => Err("has more numbers than the header has fields".into()),
            None => Ok(()),
        }
    }

    /// The bytes of a packed colour: blue, green, red, alpha.
    fn unpacked(&self, word: &[u8], ty: AttrType) -> Option<[u8; 4]> {
        // Old files write the packed colour as the single with its bits, others as an integer.
        match ty {
            AttrType::F32 if self.are_colours_numbers => number(word).map(of_number),
            AttrType::F32 => of_single(word),
            _ => number(word).and_then(whole).map(u32::to_le_bytes),
        }
    }
}

impl<'a> Points<'a> {
    /// Begins at the points.
    ///
    /// # Errors
    /// If compressed points are damaged, or if the file cannot be read.
    pub fn new(
        path: &Path,
        mut input: Box<dyn BufRead + Send>,
        layout: &'a Layout,
    ) -> Result<Self, ScanError> {
        let header = &layout.header;
        let body = match header.data {
            Data::Ascii => {
                let first_line = 1 + header.text.iter().filter(|&&b| b == b'\n').count() as u64;
                let lines = LineBlocks::new(input, path.to_owned(), first_line);
                Body::Lines { lines, more: 0 }
            }
            Data::Binary => Body::Records(input),
            Data::Compressed if header.points == 0 => Body::Fields(Arc::default(), input),
            Data::Compressed => {
                let [packed, bytes] = sizes(path, &mut input, header)?;
                let mut all = Vec::new();
                let read = input.by_ref().take(packed).read_to_end(&mut all);
                read.map_err(|e| ScanError::io(path, e))?;
                if (all.len() as u64) < packed {
                    return Err(too_few(path, header.points, 0));
                }
                let damaged = || ScanError::damaged(path, "its compressed points are damaged");
                Body::Fields(Arc::new(unpack(&all, bytes as usize).ok_or_else(damaged)?), input)
            }
        };
        let left = header.points;
        Ok(Self { path: path.to_owned(), layout, left, is_share: false, body })
    }

    /// Begins at a share of points that are not compressed.
    pub fn of_share(path: &Path, share: Runs, layout: &'a Layout) -> Self {
        let records = share.units();
        let input: Box<dyn BufRead + Send> = Box::new(share);
        let (left, body) = if layout.header.data == Data::Ascii {
            let lines = LineBlocks::new(input, path.to_owned(), 1);
            (u64::MAX, Body::Lines { lines, more: 0 })
        } else {
            (records, Body::Records(input))
        };
        Self { path: path.to_owned(), layout, left, is_share: true, body }
    }

    /// The next points; `None` after the last.
    ///
    /// # Errors
    /// If there are fewer than the header claims, or if the file cannot be read.
    pub fn next(&mut self) -> Result<Option<Raw>, ScanError> {
        let Header { stride, points, .. } = self.layout.header;
        if self.left == 0 {
            return Ok(None);
        }
        let block = (BLOCK_BYTES / stride).clamp(1, BATCH_POINTS) as u64;
        let count = self.left.min(block);
        let raw = match &mut self.body {
            Body::Lines { lines, more } => loop {
                let Some(block) = lines.next()? else { break None };
                let rows = block.rows.min(self.left);
                *more = block.rows - rows;
                if rows > 0 {
                    break Some((Raw::Lines { block, rows }, rows));
                }
            },
            Body::Records(input) => {
                let mut bytes = Vec::new();
                let read = input.take(count * stride as u64).read_to_end(&mut bytes);
                read.map_err(|e| ScanError::io(&self.path, e))?;
                bytes.truncate(bytes.len() / stride * stride);
                let there = (bytes.len() / stride) as u64;
                (there > 0).then_some((Raw::Records(bytes), there))
            }
            Body::Fields(all, _) => {
                let first = (points - self.left) as usize;
                let raw = Raw::Fields { all: all.clone(), points: first..first + count as usize };
                Some((raw, count))
            }
        };
        let Some((raw, there)) = raw else {
            if self.is_share && matches!(self.body, Body::Lines { .. }) {
                return Ok(None);
            }
            return Err(too_few(&self.path, points, points - self.left));
        };
        self.left -= there;
        Ok(Some(raw))
    }

    /// What follows the last point; reads to the end of the file. Nothing follows a share.
    ///
    /// # Errors
    /// If the file cannot be read; [`ScanError::Cancelled`].
    pub fn rest(&mut self, task: &dyn Task) -> Result<Option<Rest>, ScanError> {
        if self.is_share {
            return Ok(None);
        }
        match &mut self.body {
            Body::Lines { lines, more } => Rest::of_lines(*more, lines, task),
            Body::Records(input) => {
                let stride = self.layout.header.stride as u64;
                Rest::of_bytes(&self.path, input, Some(stride), task)
            }
            // A cloud of no points may keep its two sizes. PCL pads compressed points with zeros.
            Body::Fields(..) if self.layout.header.points == 0 => Ok(None),
            Body::Fields(_, input) => Rest::of_bytes(&self.path, input, None, task),
        }
    }
}

/// Sizes of compressed points, compressed and decompressed, from their head and checked against the
/// header, in bytes.
///
/// # Errors
/// If both differ, or if the file is truncated.
pub(crate) fn sizes(
    path: &Path,
    input: &mut impl Read,
    header: &Header,
) -> Result<[u64; 2], ScanError> {
    let mut head = [0; 8];
    match input.read_exact(&mut head) {
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            return Err(too_few(path, header.points, 0));
        }
        read => read.map_err(|e| ScanError::io(path, e))?,
    }
    let [packed, bytes] =
        [0, 4].map(|at| head[at..at + 4].iter().rev().fold(0, |n, &byte| n << 8 | u64::from(byte)));
    if header.points.checked_mul(header.stride as u64) != Some(bytes) {
        let points = header.points;
        let what = format!(
            "the header claims {points} points of {} bytes, but its compressed points are {bytes} bytes",
            header.stride
        );
        return Err(ScanError::damaged(path, what));
    }
    if bytes > packed.saturating_mul(BYTES_A_COPY) {
        return Err(ScanError::damaged(path, "its compressed points are damaged"));
    }
    Ok([packed, bytes])
}

/// The error of a header that claims more points than there are.
pub(crate) fn too_few(path: &Path, claimed: u64, available: u64) -> ScanError {
    let what = format!("the header claims {claimed} points, the file holds {available}; it is cut");
    ScanError::damaged(path, what)
}
