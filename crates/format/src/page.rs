//! Pages: a node's points as planes and back, exact to the bit. Hot position and residual make the
//! lattice coordinate, the colour plane and its remainder 16-bit colour; every other attribute has
//! a plane.

use crate::bytes::{u16_at, u32_at};
use crate::codec::{self, Codec, Encoding, Scratch};
use crate::directory::{Directory, Entry};
use crate::error::Fault;
use crate::layout::{ALIGNMENT, AttributePlane, PageLayout, PlaneKind};
use crate::planes::Values;
use crate::points::PagePoints;
use esker_points::clip::CLIP_BYTES;
use esker_points::quant::{HOT_POSITION_BYTES, exact, read_residual, residual_bytes};
use esker_points::tangents::TANGENT_BYTES;
use std::ops::Range;

/// The whole page of a node: directory and planes, padded with zeros to a multiple of 64 bytes.
/// Cold planes are compressed by the layout's codec. [`crate::FileWriter::write_page`] refuses a
/// page of 4 GiB or more.
///
/// # Panics
/// If the points are not consistent with the layout, or not in the box that starts at `box_min` and
/// that `hot_shift` fits.
pub fn encode_page(
    layout: &PageLayout,
    box_min: [u32; 3],
    hot_shift: u8,
    points: &PagePoints,
) -> Vec<u8> {
    encode(layout, box_min, hot_shift, points, Some(layout.codec()))
}

/// Variant of [`encode_page`] with all planes raw: its size is [`PageLayout::raw_page_bytes`],
/// whatever the values.
///
/// # Panics
/// As for [`encode_page`].
pub fn encode_raw_page(
    layout: &PageLayout,
    box_min: [u32; 3],
    hot_shift: u8,
    points: &PagePoints,
) -> Vec<u8> {
    encode(layout, box_min, hot_shift, points, None)
}

/// Encodes a page, with cold planes by `codec` or raw.
fn encode(
    layout: &PageLayout,
    box_min: [u32; 3],
    hot_shift: u8,
    points: &PagePoints,
    codec: Option<Codec>,
) -> Vec<u8> {
    assert!(points.is_consistent(layout), "columns of a page differ in length");
    let values = Values { layout, box_min, hot_shift, points };
    let mut page = Vec::with_capacity(layout.page_bytes_max(points.len()) as usize);
    page.resize(layout.directory_bytes(), 0);
    let mut entries = Vec::with_capacity(layout.planes().len());
    let mut scratch = Scratch::default();
    for plane in layout.planes() {
        page.resize(page.len().next_multiple_of(ALIGNMENT as usize), 0);
        let start = page.len();
        values.push(plane, &mut page);
        let encoding = match codec {
            Some(codec) if !plane.hot => {
                let codec = if plane.kind.is_written() { codec } else { Codec::None };
                codec::encode(codec, plane.value_bytes as usize, &mut page, start, &mut scratch)
            }
            _ => Encoding::Raw,
        };
        entries.push(Entry {
            encoding,
            offset: u32::try_from(start).unwrap_or(u32::MAX),
            bytes: u32::try_from(page.len() - start).unwrap_or(u32::MAX),
            crc: crc32fast::hash(&page[start..]),
        });
    }
    page.resize(page.len().next_multiple_of(ALIGNMENT as usize), 0);
    let directory = Directory { entries }.encode(layout, points.len());
    page[..directory.len()].copy_from_slice(&directory);
    page.shrink_to_fit();
    page
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
    /// Bytes as on disk.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Directory.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Values of a plane, one a point; `None` if the file has no such plane.
    ///
    /// # Errors
    /// If it does not decode.
    pub fn plane(&self, kind: PlaneKind) -> Result<Option<Vec<u8>>, Fault> {
        let Some(index) = self.layout.plane_index(kind) else { return Ok(None) };
        let entry = &self.directory.entries[index];
        let value_bytes = self.layout.planes()[index].value_bytes as usize;
        codec::decode(entry.encoding, &self.bytes[entry.range()], value_bytes, self.points)
            .map(Some)
            .map_err(|fault| fault.of_plane(&kind.name()))
    }

    /// Values of a plane for some of the points; `None` if the file has no such plane.
    ///
    /// # Errors
    /// If it does not decode.
    pub(crate) fn plane_in(
        &self,
        kind: PlaneKind,
        range: Range<usize>,
    ) -> Result<Option<Vec<u8>>, Fault> {
        let Some(index) = self.layout.plane_index(kind) else { return Ok(None) };
        let entry = &self.directory.entries[index];
        let value_bytes = PageLayout::raw_bytes(&self.layout.planes()[index], 1, self.hot_shift);
        let stored = &self.bytes[entry.range()];
        codec::decode_range(entry.encoding, stored, value_bytes as usize, self.points, range)
            .map(Some)
            .map_err(|fault| fault.of_plane(&kind.name()))
    }

    /// The exact points.
    ///
    /// # Errors
    /// If a point has a class that does not exist, or a coordinate leaves the lattice.
    pub fn points(&self) -> Result<PagePoints, Fault> {
        self.points_in(0..self.points)
    }

    /// Some of the exact points. Together with [`crate::runs`] this bounds the memory: a value
    /// that all points share is stored once, so a short page may have gigabytes of attributes.
    ///
    /// # Errors
    /// If a point has a class that does not exist, or a coordinate leaves the lattice.
    pub fn points_in(&self, range: Range<usize>) -> Result<PagePoints, Fault> {
        let range = range.start.min(self.points)..range.end.min(self.points);
        let plane = |kind| Ok::<_, Fault>(self.plane_in(kind, range.clone())?.unwrap_or_default());
        let position = plane(PlaneKind::Position)?;
        let residual = plane(PlaneKind::Residual)?;
        let mut points = PagePoints {
            positions: self.positions(&position, &residual)?,
            radius_codes: position.chunks_exact(HOT_POSITION_BYTES).map(|p| p[6]).collect(),
            classes: self.classes(&plane(PlaneKind::Class)?)?,
            ..PagePoints::default()
        };
        if self.layout.normals().is_estimated() {
            let normals = plane(PlaneKind::Normal)?;
            let codes = normals.as_chunks::<4>().0.iter();
            points.normals = codes.map(|c| [0, 2].map(|at| u16_at(c, at) as i16)).collect();
        }
        if self.layout.has_clip_lines() {
            let lines = plane(PlaneKind::ClipLines)?;
            let words = lines.as_chunks::<CLIP_BYTES>().0.iter();
            points.clip_lines = words.map(|w| [0, 4, 8, 12].map(|at| u32_at(w, at))).collect();
        }
        if self.layout.has_tangents() {
            let tangents = plane(PlaneKind::Tangents)?;
            points.tangents = tangents.as_chunks::<TANGENT_BYTES>().0.to_vec();
        }
        points.columns = self.columns(&points.classes, &range, None)?;
        Ok(points)
    }

    /// Positions and classes of some of the points, and the columns of the attributes at which
    /// `wanted` is true.
    ///
    /// # Errors
    /// As [`Page::points_in`].
    pub(crate) fn part_in(
        &self,
        range: Range<usize>,
        wanted: &[bool],
    ) -> Result<PagePoints, Fault> {
        let range = range.start.min(self.points)..range.end.min(self.points);
        let plane = |kind| Ok::<_, Fault>(self.plane_in(kind, range.clone())?.unwrap_or_default());
        let position = plane(PlaneKind::Position)?;
        let residual = plane(PlaneKind::Residual)?;
        let positions = self.positions(&position, &residual)?;
        let classes = self.classes(&plane(PlaneKind::Class)?)?;
        let columns = self.columns(&classes, &range, Some(wanted))?;
        Ok(PagePoints { positions, classes, columns, ..PagePoints::default() })
    }

    /// Lattice coordinates from hot positions and residuals of the same points.
    fn positions(&self, position: &[u8], residual: &[u8]) -> Result<Vec<[u32; 3]>, Fault> {
        let (min, shift) = (self.box_min, self.hot_shift);
        let hot = position.as_chunks::<HOT_POSITION_BYTES>().0.iter();
        let at = |hot: &[u8; HOT_POSITION_BYTES], low: [u16; 3]| {
            [0, 1, 2].map(|i| exact(u16_at(hot, i * 2), low[i], min[i], shift))
        };
        // A plane of each size has its own loop, which the compiler turns into vectors.
        let positions: Vec<_> = match residual_bytes(shift) {
            0 => hot.map(|hot| at(hot, [0; 3])).collect(),
            4 => {
                let low = residual.as_chunks::<4>().0.iter();
                hot.zip(low).map(|(hot, low)| at(hot, read_residual(low, 0, shift))).collect()
            }
            _ => {
                let low = residual.as_chunks::<6>().0.iter();
                hot.zip(low).map(|(hot, low)| at(hot, read_residual(low, 0, shift))).collect()
            }
        };
        let is_outside = |p: &[u32; 3]| (p[0] < min[0]) | (p[1] < min[1]) | (p[2] < min[2]);
        if positions.iter().fold(false, |any, p| any | is_outside(p)) {
            return Err(Fault::new("position plane", "a point lies outside the lattice"));
        }
        Ok(positions)
    }

    /// Classes of points from their plane.
    fn classes(&self, plane: &[u8]) -> Result<Vec<u16>, Fault> {
        let classes: Vec<u16> = plane.chunks_exact(2).map(|c| u16_at(c, 0)).collect();
        let count = self.layout.classes().len();
        if classes.iter().any(|&c| usize::from(c) >= count) {
            return Err(Fault::new("class plane", "a point's class does not exist"));
        }
        Ok(classes)
    }

    /// Columns of the points `range`, whose classes are `classes`: of the `wanted` attributes, or
    /// of all. Others are empty.
    fn columns(
        &self,
        classes: &[u16],
        range: &Range<usize>,
        wanted: Option<&[bool]>,
    ) -> Result<Vec<Vec<u8>>, Fault> {
        let count = range.len();
        let plane = |kind| Ok::<_, Fault>(self.plane_in(kind, range.clone())?.unwrap_or_default());
        let attributes = &self.layout.schema().attributes;
        let is_wanted = |a: usize| wanted.is_none_or(|wanted| wanted[a]);
        let in_colour =
            |a: usize| is_wanted(a) && self.layout.plane_of(a) == AttributePlane::Colour;
        let mut columns = (0..attributes.len())
            .map(|a| match self.layout.plane_of(a) {
                _ if !is_wanted(a) => Ok(Vec::new()),
                AttributePlane::Own => plane(PlaneKind::Attribute(a as u16)),
                AttributePlane::Intensity => plane(PlaneKind::Intensity),
                AttributePlane::Colour => Ok(vec![0; count * attributes[a].ty.size()]),
            })
            .collect::<Result<Vec<_>, _>>()?;
        if !(0..attributes.len()).any(in_colour) {
            return Ok(columns);
        }
        let Some(colour) = self.plane_in(PlaneKind::Colour, range.clone())? else {
            return Ok(columns);
        };
        let remainder = plane(PlaneKind::ColourRemainder)?;
        let (colour, remainder) = (colour.as_chunks::<4>().0, remainder.as_chunks::<3>().0);
        let cold = |i: usize, channel: usize| remainder.get(i).map_or(0, |cold| cold[channel]);
        if classes.is_empty() {
            let Some(source) = self.layout.colour_of_class(0) else { return Ok(columns) };
            for (channel, a) in (0..).zip(source.rgb).filter(|(_, a)| in_colour(*a)) {
                let size = attributes[a].ty.size();
                for (i, value) in columns[a].chunks_exact_mut(size).enumerate() {
                    let all = source.value(colour[i][channel], cold(i, channel));
                    value.copy_from_slice(&all[..size]);
                }
            }
            return Ok(columns);
        }
        for (i, &class) in classes.iter().enumerate() {
            let Some(source) = self.layout.colour_of_class(usize::from(class)) else { continue };
            for (channel, a) in (0..).zip(source.rgb).filter(|(_, a)| in_colour(*a)) {
                let value = source.value(colour[i][channel], cold(i, channel));
                let size = attributes[a].ty.size();
                columns[a][i * size..][..size].copy_from_slice(&value[..size]);
            }
        }
        Ok(columns)
    }
}
