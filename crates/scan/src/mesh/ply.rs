//! Reads the vertices and the faces of a PLY file (Turk 1994), ASCII and binary of either byte
//! order, element by element in the order of the header. Lists other than the corners of faces are
//! skipped.

use super::triangles::{RawMesh, TRIANGLES_MAX, VERTICES_MAX};
use crate::error::ScanError;
use crate::ply::header::{Element, Encoding, Header, HeaderError, Shape};
use crate::ply::records::too_few;
use crate::text::blocks::{LineBlock, LineBlocks};
use crate::text::naming::{axes, usual};
use crate::text::number::{fields, number};
use esker_points::attribute::names;
use esker_points::{AttrType, Task};
use std::io::{BufRead, ErrorKind};
use std::path::Path;

/// Greatest number of corners of a polygon; a longer list is damage.
const CORNERS_MAX: f64 = 65_536.0;
/// Elements between two looks at whether the task is cancelled.
const CHECK_EVERY: u64 = 1 << 16;

/// Reads the mesh of a stream at the beginning of a PLY file.
///
/// # Errors
/// If the file is cut or damaged, has no faces, or has more than a mesh may have.
pub(crate) fn read(
    path: &Path,
    mut stream: Box<dyn BufRead + Send>,
    task: &dyn Task,
) -> Result<RawMesh, ScanError> {
    let header = Header::read(&mut stream).map_err(|e| match e {
        HeaderError::Io(e) => ScanError::io(path, e),
        HeaderError::Damaged(what) => ScanError::damaged(path, what),
    })?;
    let [vertex, face] = ["vertex", "face"].map(|name| {
        let with_rows = |e: &Element| e.name.eq_ignore_ascii_case(name) && e.count > 0;
        header.elements.iter().position(with_rows)
    });
    let Some(face) = face else {
        let strips = header.elements.iter().any(|e| e.name == "tristrips");
        let remedy = if strips { "; triangle strips are not read, write triangles" } else { "" };
        return Err(ScanError::unsupported(path, format!("has no faces and is no mesh{remedy}")));
    };
    let vertex = vertex.ok_or_else(|| ScanError::damaged(path, "has faces but no vertices"))?;
    for (element, most) in [(vertex, VERTICES_MAX), (face, TRIANGLES_MAX)] {
        let Element { count, name, .. } = &header.elements[element];
        if *count > most as u64 {
            let what = format!("the header claims {count} elements `{name}`; {most} can be read");
            return Err(ScanError::unsupported(path, what));
        }
    }
    let mut rows = Rows::new(path, stream, &header);
    let mut mesh = RawMesh::default();
    for (i, element) in header.elements.iter().enumerate().take(vertex.max(face) + 1) {
        match i {
            _ if i == vertex => vertices(&mut rows, element, &mut mesh, task)?,
            _ if i == face => {
                let count = header.elements[vertex].count;
                faces(&mut rows, element, count, &mut mesh, task)?;
            }
            _ => rows.skip(element, task)?,
        }
    }
    Ok(mesh)
}

/// Factor from the values of a colour to 0 to 255.
fn to_byte(ty: AttrType) -> f64 {
    match ty {
        AttrType::U16 => 255.0 / 65535.0,
        AttrType::F32 | AttrType::F64 => 255.0,
        _ => 1.0,
    }
}

fn vertices(
    rows: &mut Rows<'_>,
    element: &Element,
    mesh: &mut RawMesh,
    task: &dyn Task,
) -> Result<(), ScanError> {
    let scalars: Vec<(&str, AttrType)> = element
        .properties
        .iter()
        .filter_map(|p| match p.shape {
            Shape::Scalar(ty) => Some((p.name.as_str(), ty)),
            Shape::List { .. } => None,
        })
        .collect();
    let xyz = axes(scalars.iter().map(|(name, _)| *name)).ok_or_else(|| {
        ScanError::damaged(rows.path, "its vertices lack x, y or z (as numbers, not lists)")
    })?;
    let find = |wanted: [&str; 3]| {
        let at = |name| scalars.iter().position(|(n, _)| usual(n) == Some(name));
        Some([at(wanted[0])?, at(wanted[1])?, at(wanted[2])?])
    };
    let normal = find([names::NX, names::NY, names::NZ]);
    let colour = find([names::RED, names::GREEN, names::BLUE]);
    let mut row = Row::default();
    for i in 0..element.count {
        if i % CHECK_EVERY == 0 {
            task.check()?;
        }
        if !rows.next(element, None, &mut row)? {
            return Err(too_few(rows.path, element.count, i));
        }
        mesh.positions.push(xyz.map(|f| row.scalars[f]));
        if let Some(normal) = normal {
            mesh.normals.push(normal.map(|f| row.scalars[f] as f32));
        }
        if let Some(colour) = colour {
            // A conversion to u8 saturates, and makes 0 of what is not a number.
            let byte = |f: usize| (row.scalars[f] * to_byte(scalars[f].1)).round() as u8;
            mesh.colours.push(colour.map(byte));
        }
    }
    Ok(())
}

fn faces(
    rows: &mut Rows<'_>,
    element: &Element,
    vertices: u64,
    mesh: &mut RawMesh,
    task: &dyn Task,
) -> Result<(), ScanError> {
    let is_corners = |name: &str| matches!(name, "vertex_indices" | "vertex_index");
    let corners = element
        .properties
        .iter()
        .position(|p| matches!(p.shape, Shape::List { .. }) && is_corners(&p.name))
        .ok_or_else(|| ScanError::damaged(rows.path, "its faces have no list `vertex_indices`"))?;
    let mut row = Row::default();
    for i in 0..element.count {
        if i % CHECK_EVERY == 0 {
            task.check()?;
        }
        if !rows.next(element, Some(corners), &mut row)? {
            let claimed = element.count;
            let what = format!("the header claims {claimed} faces, the file holds {i}; it is cut");
            return Err(ScanError::damaged(rows.path, what));
        }
        let sound = |&c: &f64| c >= 0.0 && c < vertices as f64 && c.fract() == 0.0;
        if let Some(bad) = row.list.iter().find(|c| !sound(c)) {
            let what = format!("face {i} refers to vertex {bad} of {vertices} (from 0)");
            return Err(ScanError::damaged(rows.path, what));
        }
        for pair in row.list.get(1..).unwrap_or_default().windows(2) {
            mesh.triangles.push([row.list[0], pair[0], pair[1]].map(|c| c as u32));
        }
        if mesh.triangles.len() > TRIANGLES_MAX {
            let what = format!("has more than the {TRIANGLES_MAX} triangles that can be read");
            return Err(ScanError::unsupported(rows.path, what));
        }
    }
    Ok(())
}

/// Values of one element.
#[derive(Default)]
struct Row {
    /// Its scalars, in the order of the header.
    scalars: Vec<f64>,
    /// Items of the wanted list.
    list: Vec<f64>,
}

/// The body of a file, element by element.
struct Rows<'a> {
    path: &'a Path,
    body: Body,
}

enum Body {
    Binary {
        input: Box<dyn BufRead + Send>,
        is_big: bool,
    },
    Ascii {
        lines: LineBlocks<Box<dyn BufRead + Send>>,
        block: Option<LineBlock>,
        at: usize,
        line: u64,
    },
}

impl<'a> Rows<'a> {
    fn new(path: &'a Path, input: Box<dyn BufRead + Send>, header: &Header) -> Self {
        let body = if header.encoding == Encoding::Ascii {
            let first = 1 + header.text.iter().filter(|&&b| b == b'\n').count() as u64;
            let lines = LineBlocks::new(input, path.to_owned(), first);
            Body::Ascii { lines, block: None, at: 0, line: first }
        } else {
            Body::Binary { input, is_big: header.encoding == Encoding::BigEndian }
        };
        Self { path, body }
    }

    /// Skips all rows of an element.
    fn skip(&mut self, element: &Element, task: &dyn Task) -> Result<(), ScanError> {
        // An element without properties has neither bytes nor lines, whatever its count.
        let count = if element.properties.is_empty() { 0 } else { element.count };
        let mut row = Row::default();
        for i in 0..count {
            if i % CHECK_EVERY == 0 {
                task.check()?;
            }
            if !self.next(element, None, &mut row)? {
                let what = format!("ends within its element `{}`", element.name);
                return Err(ScanError::damaged(self.path, what));
            }
        }
        Ok(())
    }

    /// Reads a row, with the list of property `wanted`; `false` at the end of the file.
    fn next(
        &mut self,
        element: &Element,
        wanted: Option<usize>,
        row: &mut Row,
    ) -> Result<bool, ScanError> {
        row.scalars.clear();
        row.list.clear();
        match &mut self.body {
            Body::Binary { input, is_big } => match binary(input, *is_big, element, wanted, row) {
                Ok(()) => Ok(true),
                Err(Fault::Io(e)) if e.kind() == ErrorKind::UnexpectedEof => Ok(false),
                Err(Fault::Io(e)) => Err(ScanError::io(self.path, e)),
                Err(Fault::Damaged(what)) => Err(ScanError::damaged(self.path, what)),
            },
            Body::Ascii { lines, block, at, line } => loop {
                let Some(current) = block else {
                    *block = lines.next()?;
                    *at = 0;
                    match block {
                        Some(next) => *line = next.first_line,
                        None => return Ok(false),
                    }
                    continue;
                };
                let rest = &current.bytes[*at..];
                if rest.is_empty() {
                    *block = None;
                    continue;
                }
                let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
                let (text, number) = (rest[..end].trim_ascii(), *line);
                *at += (end + 1).min(rest.len());
                *line += 1;
                if text.is_empty() {
                    continue;
                }
                let read = ascii(text, element, wanted, row);
                let damaged = |what| ScanError::damaged(self.path, format!("line {number} {what}"));
                return read.map(|()| true).map_err(damaged);
            },
        }
    }
}

enum Fault {
    Io(std::io::Error),
    Damaged(String),
}

fn binary(
    input: &mut impl BufRead,
    is_big: bool,
    element: &Element,
    wanted: Option<usize>,
    row: &mut Row,
) -> Result<(), Fault> {
    let mut value = |ty: AttrType| {
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..ty.size()];
        input.read_exact(bytes).map_err(Fault::Io)?;
        if is_big {
            bytes.reverse();
        }
        Ok(ty.to_f64(bytes))
    };
    for (i, property) in element.properties.iter().enumerate() {
        match property.shape {
            Shape::Scalar(ty) => row.scalars.push(value(ty)?),
            Shape::List { count, item } => {
                let count = value(count)?;
                check_items(&property.name, count).map_err(Fault::Damaged)?;
                for _ in 0..count as u64 {
                    let value = value(item)?;
                    if wanted == Some(i) {
                        row.list.push(value);
                    }
                }
            }
        }
    }
    Ok(())
}

fn ascii(
    text: &[u8],
    element: &Element,
    wanted: Option<usize>,
    row: &mut Row,
) -> Result<(), String> {
    let mut words = fields(text);
    let mut value = || {
        let word = words
            .next()
            .ok_or_else(|| format!("has fewer numbers than an element `{}`", element.name))?;
        number(word).ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]);
            format!("has `{}`, which is no number", shown.escape_debug())
        })
    };
    for (i, property) in element.properties.iter().enumerate() {
        match property.shape {
            Shape::Scalar(_) => row.scalars.push(value()?),
            Shape::List { .. } => {
                let count = value()?;
                check_items(&property.name, count)?;
                for _ in 0..count as u64 {
                    let value = value()?;
                    if wanted == Some(i) {
                        row.list.push(value);
                    }
                }
            }
        }
    }
    match words.next() {
        Some(_) => Err(format!("has more numbers than an element `{}`", element.name)),
        None => Ok(()),
    }
}

fn check_items(name: &str, count: f64) -> Result<(), String> {
    if (0.0..=CORNERS_MAX).contains(&count) {
        return Ok(());
    }
    Err(format!("has a list `{name}` of {count} items; at most {CORNERS_MAX} are read"))
}
