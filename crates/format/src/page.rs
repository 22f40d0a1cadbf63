//! Pages: a node's points as planes and back, exact to the bit. Hot position and residual make the lattice
//! coordinate, the colour plane and its remainder 16-bit colour; every other attribute has a plane.

use crate::directory::{Directory, Encoding, Entry, u16_at};
use crate::error::Fault;
use crate::layout::{ALIGNMENT, ColourSource, Home, PageLayout, PlaneKind, PlaneSpec};
use esker_points::quant::{
    HOT_POSITION_BYTES, exact, hot, oct_encode, push_residual, read_residual, residual,
};
use esker_points::{ColourDepth, MultisetHash};

/// A node's points, in their stored order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PagePoints {
    /// Lattice coordinates.
    pub positions: Vec<[u32; 3]>,
    /// Radius of each point, see [`esker_points::quant::radius_code`].
    pub radius_codes: Vec<u8>,
    /// Class of each point; empty where the file has one class.
    pub classes: Vec<u16>,
    /// One column an attribute of the file's schema, raw little-endian values; zero bytes where a
    /// point's class does not have the attribute.
    pub columns: Vec<Vec<u8>>,
}

impl PagePoints {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Class of a point.
    pub fn class(&self, point: usize) -> usize {
        self.classes.get(point).map_or(0, |&c| usize::from(c))
    }

    /// Whether every column has a value a point, and every class exists.
    pub fn is_consistent(&self, layout: &PageLayout) -> bool {
        let attributes = &layout.schema().attributes;
        let n = self.len();
        let classes_max = layout.classes().len().max(1);
        self.radius_codes.len() == n
            && self.classes.len() == if layout.classes().len() > 1 { n } else { 0 }
            && self.classes.iter().all(|&c| usize::from(c) < classes_max)
            && self.columns.len() == attributes.len()
            && attributes.iter().zip(&self.columns).all(|(a, c)| c.len() == n * a.ty.size())
    }

    /// The multiset hash of these points: what the footer's hash is the sum of.
    pub fn hash(&self, layout: &PageLayout) -> MultisetHash {
        let schema = layout.schema();
        let seeds: Vec<u64> = layout.classes().iter().map(|c| c.seed(schema)).collect();
        let sizes: Vec<usize> = schema.attributes.iter().map(|a| a.ty.size()).collect();
        let mut hash = MultisetHash::default();
        let mut record = Vec::new();
        for (i, position) in self.positions.iter().enumerate() {
            let class = self.class(i);
            record.clear();
            position.iter().for_each(|c| record.extend_from_slice(&c.to_le_bytes()));
            for &a in layout.classes().get(class).map_or(&[][..], |c| &c.present) {
                let (a, size) = (usize::from(a), sizes[usize::from(a)]);
                record.extend_from_slice(&self.columns[a][i * size..][..size]);
            }
            hash.add(seeds.get(class).copied().unwrap_or_default(), &record);
        }
        hash
    }
}

/// The whole page of a node: directory and planes, padded with zeros to a multiple of 64 bytes.
/// A page of 4 GiB or more is refused by [`crate::FileWriter::write_page`].
///
/// # Panics
/// If the points are not consistent with the layout, or not in the box that starts at `box_min` and
/// that `hot_shift` suits.
pub fn encode_page(
    layout: &PageLayout,
    box_min: [u32; 3],
    hot_shift: u8,
    points: &PagePoints,
) -> Vec<u8> {
    assert!(points.is_consistent(layout), "columns of a page differ in length");
    let mut page = vec![0; layout.directory_bytes()];
    page.reserve(layout.page_bytes_max(points.len()) as usize);
    let mut entries = Vec::with_capacity(layout.planes().len());
    let mut plane_bytes = Vec::new();
    for plane in layout.planes() {
        plane_bytes.clear();
        encode_plane(layout, plane, box_min, hot_shift, points, &mut plane_bytes);
        let encoding = if !plane.hot && is_constant(&plane_bytes, plane.value_bytes as usize) {
            plane_bytes.truncate(plane.value_bytes as usize);
            Encoding::Constant
        } else {
            Encoding::Raw
        };
        page.resize(page.len().next_multiple_of(ALIGNMENT as usize), 0);
        entries.push(Entry {
            encoding: Some(encoding),
            offset: u32::try_from(page.len()).unwrap_or(u32::MAX),
            bytes: u32::try_from(plane_bytes.len()).unwrap_or(u32::MAX),
            crc: crc32fast::hash(&plane_bytes),
        });
        page.extend_from_slice(&plane_bytes);
    }
    page.resize(page.len().next_multiple_of(ALIGNMENT as usize), 0);
    let directory = Directory { entries }.encode(layout, points.len());
    page[..directory.len()].copy_from_slice(&directory);
    page
}

/// Whether there are several values, all alike.
fn is_constant(values: &[u8], size: usize) -> bool {
    values.len() > size && values[size..] == values[..values.len() - size]
}

fn encode_plane(
    layout: &PageLayout,
    plane: &PlaneSpec,
    box_min: [u32; 3],
    shift: u8,
    points: &PagePoints,
    out: &mut Vec<u8>,
) {
    match plane.kind {
        PlaneKind::Position => {
            for (p, &radius) in points.positions.iter().zip(&points.radius_codes) {
                for axis in 0..3 {
                    assert!(
                        (p[axis] - box_min[axis]) >> shift <= 0xffff,
                        "a point outside its box"
                    );
                    let q = hot(p[axis], box_min[axis], shift);
                    out.extend_from_slice(&q.to_le_bytes());
                }
                out.extend_from_slice(&[radius, 0]);
            }
        }
        PlaneKind::Residual if shift > 0 => {
            for p in &points.positions {
                let bits = [0, 1, 2].map(|axis| residual(p[axis], box_min[axis], shift));
                push_residual(bits, shift, out);
            }
        }
        PlaneKind::Colour => encode_colour(layout, points, out),
        PlaneKind::ColourRemainder => encode_remainder(layout, points, out),
        PlaneKind::Intensity => {
            let home = |&a: &usize| layout.home(a) == Home::Intensity;
            if let Some(a) = (0..points.columns.len()).find(home) {
                out.extend_from_slice(&points.columns[a]);
            }
        }
        PlaneKind::Normal => out.extend(normals(layout, points)),
        PlaneKind::Class => {
            points.classes.iter().for_each(|c| out.extend_from_slice(&c.to_le_bytes()));
        }
        PlaneKind::Attribute(a) => out.extend_from_slice(&points.columns[usize::from(a)]),
        PlaneKind::Residual => {}
        // What this version cannot make is left zero.
        PlaneKind::Tangents | PlaneKind::ClipLines | PlaneKind::Unknown(_) => {
            out.resize(points.len() * plane.value_bytes as usize, 0);
        }
    }
}

/// The bytes of the hot normal plane that the exact normals give.
pub(crate) fn normals(layout: &PageLayout, points: &PagePoints) -> Vec<u8> {
    let Some(xyz) = layout.schema().normals() else { return Vec::new() };
    let mut out = Vec::with_capacity(points.len() * 4);
    for i in 0..points.len() {
        let n = xyz.map(|a| {
            let b = &points.columns[a][i * 4..][..4];
            f32::from_le_bytes([b[0], b[1], b[2], b[3]])
        });
        oct_encode(n).iter().for_each(|c| out.extend_from_slice(&c.to_le_bytes()));
    }
    out
}

fn encode_colour(layout: &PageLayout, points: &PagePoints, out: &mut Vec<u8>) {
    for i in 0..points.len() {
        let Some(ColourSource { rgb, depth }) = layout.colour_of_class(points.class(i)) else {
            out.extend_from_slice(&[0; 4]);
            continue;
        };
        for a in rgb {
            out.push(match depth {
                None => points.columns[a][i],
                Some(ColourDepth::Sixteen) => points.columns[a][i * 2 + 1],
                Some(ColourDepth::Eight) => points.columns[a][i * 2],
            });
        }
        out.push(255);
    }
}

fn encode_remainder(layout: &PageLayout, points: &PagePoints, out: &mut Vec<u8>) {
    for i in 0..points.len() {
        match layout.colour_of_class(points.class(i)) {
            Some(ColourSource { rgb, depth: Some(depth) }) => {
                out.extend(rgb.map(|a| match depth {
                    ColourDepth::Sixteen => points.columns[a][i * 2],
                    ColourDepth::Eight => points.columns[a][i * 2 + 1],
                }))
            }
            _ => out.extend_from_slice(&[0; 3]),
        }
    }
}

/// A page as read: bytes and directory, checked against each other.
#[derive(Clone, Debug)]
pub struct Page<'a> {
    pub(crate) layout: &'a PageLayout,
    pub(crate) bytes: Vec<u8>,
    pub(crate) directory: Directory,
    pub(crate) points: usize,
    pub(crate) box_min: [u32; 3],
    pub(crate) hot_shift: u8,
}

impl Page<'_> {
    /// Its bytes as on disk.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Its directory.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// A plane's values, one a point; `None` where the file has no such plane.
    pub fn plane(&self, kind: PlaneKind) -> Option<Vec<u8>> {
        let index = self.layout.plane_index(kind)?;
        let entry = &self.directory.entries[index];
        Some(expand(entry, &self.bytes[entry.range()], self.points))
    }

    /// The exact points.
    ///
    /// # Errors
    /// Where a point names a class that does not exist, or a coordinate leaves the lattice.
    pub fn points(&self) -> Result<PagePoints, Fault> {
        let plane = |kind| self.plane(kind).unwrap_or_default();
        let position = plane(PlaneKind::Position);
        let residual = plane(PlaneKind::Residual);
        let mut points = PagePoints::default();
        for (i, record) in position.chunks_exact(HOT_POSITION_BYTES).enumerate() {
            let low = read_residual(&residual, i, self.hot_shift);
            let mut p = [0; 3];
            for axis in 0..3 {
                let min = self.box_min[axis];
                p[axis] = exact(u16_at(record, axis * 2), low[axis], min, self.hot_shift);
                if p[axis] < min {
                    return Err(Fault::new("position plane", "a point lies outside the lattice"));
                }
            }
            points.positions.push(p);
            points.radius_codes.push(record[6]);
        }
        let classes = plane(PlaneKind::Class);
        points.classes = classes.chunks_exact(2).map(|c| u16_at(c, 0)).collect();
        let count = self.layout.classes().len();
        if points.classes.iter().any(|&c| usize::from(c) >= count) {
            return Err(Fault::new("class plane", "a point's class does not exist"));
        }
        self.columns(&mut points);
        Ok(points)
    }

    fn columns(&self, points: &mut PagePoints) {
        let attributes = &self.layout.schema().attributes;
        points.columns = (0..attributes.len())
            .map(|a| match self.layout.home(a) {
                Home::Own => self.plane(PlaneKind::Attribute(a as u16)).unwrap_or_default(),
                Home::Intensity => self.plane(PlaneKind::Intensity).unwrap_or_default(),
                Home::Colour => vec![0; self.points * attributes[a].ty.size()],
            })
            .collect();
        let Some(colour) = self.plane(PlaneKind::Colour) else { return };
        let remainder = self.plane(PlaneKind::ColourRemainder).unwrap_or_default();
        for i in 0..self.points {
            let Some(ColourSource { rgb, depth }) = self.layout.colour_of_class(points.class(i))
            else {
                continue;
            };
            for (k, a) in rgb.into_iter().enumerate() {
                if self.layout.home(a) != Home::Colour {
                    continue;
                }
                let hot = colour[i * 4 + k];
                let column = &mut points.columns[a];
                match depth {
                    None => column[i] = hot,
                    Some(depth) => {
                        let cold = remainder[i * 3 + k];
                        let value = match depth {
                            ColourDepth::Sixteen => [cold, hot],
                            ColourDepth::Eight => [hot, cold],
                        };
                        column[i * 2..][..2].copy_from_slice(&value);
                    }
                }
            }
        }
    }
}

/// A plane's values, one a point.
pub(crate) fn expand(entry: &Entry, stored: &[u8], points: usize) -> Vec<u8> {
    match entry.encoding {
        Some(Encoding::Constant) => stored.repeat(points),
        _ => stored.to_vec(),
    }
}
