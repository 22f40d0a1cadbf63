//! Reads vertices as records of fixed length: the scalar properties in the file's order,
//! little-endian, without lists. Binary bodies of either byte order and ASCII bodies give the same
//! records, in blocks of bounded size; elements before the vertices are skipped.

use super::header::{Element, Encoding, Header, Shape};
use super::rest::Rest;
use crate::error::ScanError;
use crate::runs::Runs;
use crate::source::BATCH_POINTS;
use crate::text::blocks::{LineBlock, LineBlocks};
use esker_points::{AttrType, Task};
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

/// Size of a block of binary records, in bytes, unless one record is longer.
const BLOCK_BYTES: usize = 1 << 20;

/// One scalar property in a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Field {
    pub ty: AttrType,
    pub offset: usize,
}

/// Layout of a record.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    /// Its fields, in the file's order.
    pub fields: Vec<Field>,
    /// Its size, in bytes.
    pub stride: usize,
}

impl Record {
    /// The record with fields of these types.
    pub fn new(types: impl Iterator<Item = AttrType>) -> Self {
        let mut stride = 0;
        let fields = types.map(|ty| {
            let field = Field { ty, offset: stride };
            stride += ty.size();
            field
        });
        Self { fields: fields.collect(), stride }
    }

    /// Converts big-endian records to little-endian ones.
    pub fn swap_bytes(&self, records: &mut [u8]) {
        for record in records.chunks_exact_mut(self.stride) {
            for field in &self.fields {
                record[field.offset..][..field.ty.size()].reverse();
            }
        }
    }
}

/// A run of vertices as read from the file.
pub(crate) enum Raw {
    /// Records in the file's byte order.
    Binary(Vec<u8>),
    /// Lines, of which `rows` are vertices, after `skip` others.
    Lines { block: LineBlock, skip: u64, rows: u64 },
}

impl Raw {
    /// Number of vertices.
    pub fn len(&self, stride: usize) -> u64 {
        match self {
            Self::Binary(bytes) => (bytes.len() / stride) as u64,
            Self::Lines { rows, .. } => *rows,
        }
    }
}

/// Reads the vertices of a file, block by block.
pub(crate) struct Vertices<'a> {
    path: PathBuf,
    element: &'a Element,
    stride: usize,
    left: u64,
    /// Whether this is a share of the vertices, of which lines end where the body does.
    is_share: bool,
    body: Body,
}

enum Body {
    Binary(Box<dyn BufRead + Send>),
    /// Lines, of which `skip` precede the vertices; `more` lines of the last block come after them.
    Ascii {
        lines: LineBlocks<Box<dyn BufRead + Send>>,
        skip: u64,
        more: u64,
    },
}

impl<'a> Vertices<'a> {
    /// Begins at the body (`input`) and skips the elements before number `vertex`.
    ///
    /// # Errors
    /// If the skipped elements are truncated or damaged; [`ScanError::Cancelled`].
    pub fn new(
        path: &Path,
        mut input: Box<dyn BufRead + Send>,
        header: &'a Header,
        vertex: usize,
        task: &dyn Task,
    ) -> Result<Self, ScanError> {
        let (before, element) = (&header.elements[..vertex], &header.elements[vertex]);
        let stride = stride_of(element);
        let body = if header.encoding == Encoding::Ascii {
            // An element without properties has no lines.
            let rows = before.iter().filter(|e| !e.properties.is_empty()).map(|e| e.count);
            let skip = rows.fold(0, u64::saturating_add);
            let first_line = 1 + header.text.iter().filter(|&&b| b == b'\n').count() as u64;
            let lines = LineBlocks::new(input, path.to_owned(), first_line);
            Body::Ascii { lines, skip, more: 0 }
        } else {
            for e in before {
                skip_element(&mut input, e, header.encoding, task).map_err(|e| e.at(path))?;
            }
            Body::Binary(input)
        };
        let left = element.count;
        Ok(Self { path: path.to_owned(), element, stride, left, is_share: false, body })
    }

    /// Begins at a share of the vertices, which are element number `vertex`.
    pub fn of_share(path: &Path, share: Runs, header: &'a Header, vertex: usize) -> Self {
        let element = &header.elements[vertex];
        let records = share.units();
        let input: Box<dyn BufRead + Send> = Box::new(share);
        let (left, body) = if header.encoding == Encoding::Ascii {
            let lines = LineBlocks::new(input, path.to_owned(), 1);
            (u64::MAX, Body::Ascii { lines, skip: 0, more: 0 })
        } else {
            (records, Body::Binary(input))
        };
        let stride = stride_of(element);
        Self { path: path.to_owned(), element, stride, left, is_share: true, body }
    }

    /// The next vertices; `None` after the last.
    ///
    /// # Errors
    /// If there are fewer than the header claims, or if the file cannot be read.
    pub fn next(&mut self, encoding: Encoding) -> Result<Option<Raw>, ScanError> {
        if self.left == 0 {
            return Ok(None);
        }
        let raw = match &mut self.body {
            Body::Binary(input) => {
                let n = (BLOCK_BYTES / self.stride).clamp(1, BATCH_POINTS) as u64;
                let n = n.min(self.left) as usize;
                let read = match self.element.stride() {
                    Some(_) => read_fixed(input, n * self.stride),
                    None => read_without_lists(input, self.element, encoding, n),
                };
                let mut bytes = read.map_err(|e| e.at(&self.path))?;
                bytes.truncate(bytes.len() / self.stride * self.stride);
                (!bytes.is_empty()).then_some(Raw::Binary(bytes))
            }
            Body::Ascii { lines, skip, more } => loop {
                let Some(block) = lines.next()? else { break None };
                let skipped = block.rows.min(*skip);
                *skip -= skipped;
                let rows = (block.rows - skipped).min(self.left);
                *more = block.rows - skipped - rows;
                if rows > 0 {
                    break Some(Raw::Lines { block, skip: skipped, rows });
                }
            },
        };
        let Some(raw) = raw else {
            if self.is_share && matches!(self.body, Body::Ascii { .. }) {
                return Ok(None);
            }
            return Err(too_few(&self.path, self.element.count, self.element.count - self.left));
        };
        self.left -= raw.len(self.stride);
        Ok(Some(raw))
    }

    /// What follows the last vertex; reads to the end of the file. Nothing follows a share.
    ///
    /// # Errors
    /// If the file cannot be read; [`ScanError::Cancelled`].
    pub fn rest(&mut self, task: &dyn Task) -> Result<Option<Rest>, ScanError> {
        if self.is_share {
            return Ok(None);
        }
        match &mut self.body {
            Body::Ascii { lines, skip, more } => {
                let rest = Rest::of_lines(*more, lines, task)?;
                // Without vertices, lines of earlier elements are not skipped yet.
                let behind = |lines: u64| lines.saturating_sub(*skip);
                Ok(rest.and_then(|rest| match rest {
                    Rest::Lines { lines, is_whole } if behind(lines) > 0 => {
                        Some(Rest::Lines { lines: behind(lines), is_whole })
                    }
                    _ => None,
                }))
            }
            Body::Binary(input) => Rest::of_bytes(&self.path, input, self.element.stride(), task),
        }
    }
}

/// Size of a record of an element's scalars, in bytes.
fn stride_of(element: &Element) -> usize {
    let types = element.properties.iter().filter_map(|p| match p.shape {
        Shape::Scalar(ty) => Some(ty),
        Shape::List { .. } => None,
    });
    types.map(AttrType::size).sum()
}

/// The error of a header that claims more vertices than there are.
pub(crate) fn too_few(path: &Path, claimed: u64, available: u64) -> ScanError {
    let what =
        format!("the header claims {claimed} vertices, the file holds {available}; it is cut");
    ScanError::damaged(path, what)
}

/// Why a body cannot be read.
pub(crate) enum BodyError {
    Io(std::io::Error),
    Damaged(String),
    Cancelled(esker_points::Cancelled),
}

impl BodyError {
    fn at(self, path: &Path) -> ScanError {
        match self {
            Self::Io(e) => ScanError::io(path, e),
            Self::Damaged(what) => ScanError::damaged(path, what),
            Self::Cancelled(c) => c.into(),
        }
    }
}

fn skip_element(
    input: &mut impl BufRead,
    element: &Element,
    encoding: Encoding,
    task: &dyn Task,
) -> Result<(), BodyError> {
    let cut = || BodyError::Damaged(format!("ends within its element `{}`", element.name));
    if let Some(stride) = element.stride() {
        let bytes = stride.checked_mul(element.count).ok_or_else(cut)?;
        return if skip(input, bytes)? { Ok(()) } else { Err(cut()) };
    }
    for i in 0..element.count {
        if i % (1 << 16) == 0 {
            task.check().map_err(BodyError::Cancelled)?;
        }
        if !read_one(input, element, encoding, &mut None)? {
            return Err(cut());
        }
    }
    Ok(())
}

/// Up to `bytes` bytes; fewer at the end of the file.
fn read_fixed(input: &mut impl BufRead, bytes: usize) -> Result<Vec<u8>, BodyError> {
    let mut out = Vec::new();
    input.by_ref().take(bytes as u64).read_to_end(&mut out).map_err(BodyError::Io)?;
    Ok(out)
}

/// Up to `n` records without their lists; fewer at the end of the file.
fn read_without_lists(
    input: &mut impl BufRead,
    element: &Element,
    encoding: Encoding,
    n: usize,
) -> Result<Vec<u8>, BodyError> {
    let mut out = Some(Vec::new());
    for _ in 0..n {
        let whole = out.as_ref().map_or(0, Vec::len);
        if !read_one(input, element, encoding, &mut out)? {
            out.iter_mut().for_each(|o| o.truncate(whole));
            break;
        }
    }
    Ok(out.unwrap_or_default())
}

/// Reads one element, its scalars into `out`; `false` at the end of the file.
fn read_one(
    input: &mut impl BufRead,
    element: &Element,
    encoding: Encoding,
    out: &mut Option<Vec<u8>>,
) -> Result<bool, BodyError> {
    let mut value = [0; 8];
    for property in &element.properties {
        let (Shape::Scalar(ty) | Shape::List { count: ty, .. }) = property.shape;
        let value = &mut value[..ty.size()];
        match input.read_exact(value) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(false),
            other => other.map_err(BodyError::Io)?,
        }
        match property.shape {
            Shape::Scalar(_) => out.iter_mut().for_each(|o| o.extend_from_slice(value)),
            Shape::List { item, .. } => {
                if encoding == Encoding::BigEndian {
                    value.reverse();
                }
                let count = ty.to_f64(value);
                if count < 0.0 {
                    let name = &property.name;
                    return Err(BodyError::Damaged(format!("a list `{name}` has {count} items")));
                }
                // Saturates: the file also ends before more items than a u64 can count.
                if !skip(input, (count as u64).saturating_mul(item.size() as u64))? {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

/// Skips bytes; `false` if the file ends before.
fn skip(input: &mut impl BufRead, mut bytes: u64) -> Result<bool, BodyError> {
    while bytes > 0 {
        let here = match input.fill_buf() {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            other => other.map_err(BodyError::Io)?.len(),
        };
        if here == 0 {
            return Ok(false);
        }
        let n = bytes.min(here as u64);
        input.consume(n as usize);
        bytes -= n;
    }
    Ok(true)
}
