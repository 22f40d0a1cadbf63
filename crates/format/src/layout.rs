//! Planes of the pages of a file, and their byte ranges: derived from schema and classes, stored in
//! the metadata. Hot planes are raw and come first, so that their ranges follow from a node's
//! record alone; cold planes are found through the page's directory.

use crate::codec::Codec;
use crate::error::Fault;
pub(crate) use crate::kinds::ATTRIBUTE_KIND;
pub use crate::kinds::{NO_ATTRIBUTE, PlaneKind, PlaneSpec};
use crate::normals::Normals;
use esker_points::attribute::names;
use esker_points::clip::CLIP_BYTES;
use esker_points::palette::Palette;
use esker_points::quant::{HOT_POSITION_BYTES, residual_bytes};
use esker_points::tangents::TANGENT_BYTES;
use esker_points::{AttrType, ColourDepth, PointClass, Schema};
use std::collections::BTreeMap;
use std::ops::Range;

/// Alignment of pages in the file, and of planes in their page, bytes.
pub const ALIGNMENT: u64 = 64;
/// Bytes of a page's directory before its entries.
pub const DIRECTORY_HEAD_BYTES: usize = 12;
/// Bytes of one entry of a page's directory.
pub const DIRECTORY_ENTRY_BYTES: usize = 20;
/// Greatest number of attributes, and of classes.
pub const ATTRIBUTES_MAX: usize = 65_000;
/// Greatest product of attributes and classes: bounds the table that a hostile file can make a
/// reader build.
pub const ATTRIBUTES_TIMES_CLASSES_MAX: usize = 1 << 22;
/// Greatest size of a point's value in a plane: bounds sums of lengths.
const VALUE_BYTES_MAX: u32 = 1 << 16;
/// Attributes that are decoded at a time, in bytes: 2^16 points, the default capacity of a node,
/// with 256 bytes each.
pub const RUN_BYTES: usize = 16 << 20;

/// Plane of clip lines: cold, since most nodes have none, and the plane is then one value.
pub(crate) const CLIP_LINES: PlaneSpec =
    PlaneSpec { kind: PlaneKind::ClipLines, hot: false, value_bytes: CLIP_BYTES as u32 };

/// Plane of tangents: hot, since a renderer that draws them needs all of it.
pub(crate) const TANGENTS: PlaneSpec =
    PlaneSpec { kind: PlaneKind::Tangents, hot: true, value_bytes: TANGENT_BYTES as u32 };

/// Plane of positions with colour indices: hot, since it is drawn in place of two hot planes.
pub(crate) const COMPACT: PlaneSpec =
    PlaneSpec { kind: PlaneKind::Compact, hot: true, value_bytes: HOT_POSITION_BYTES as u32 };

/// Runs of the points of a node with `node_points` points whose attributes take `row_bytes` each:
/// at most [`RUN_BYTES`] in all. Nodes of usual files are one run.
pub fn runs(node_points: usize, row_bytes: usize) -> impl Iterator<Item = Range<usize>> {
    let step = (RUN_BYTES / row_bytes.max(1)).max(1);
    (0..node_points).step_by(step).map(move |start| start..(start + step).min(node_points))
}

/// Attributes that hold the colour of a class of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ColourSource {
    /// Attributes red, green, blue.
    pub rgb: [usize; 3],
    /// Depth of 16-bit attributes; `None` for 8-bit attributes.
    pub depth: Option<ColourDepth>,
}

impl ColourSource {
    /// Byte of each value that the colour plane holds.
    pub fn drawn_byte(self) -> usize {
        usize::from(self.depth == Some(ColourDepth::Sixteen))
    }

    /// Value of a channel, little-endian, from its byte in the colour plane and that in the
    /// remainder; values of 8 bits are the first byte.
    pub fn value(self, hot: u8, cold: u8) -> [u8; 2] {
        match self.depth {
            None => [hot, 0],
            Some(ColourDepth::Sixteen) => [cold, hot],
            Some(ColourDepth::Eight) => [hot, cold],
        }
    }
}

/// Plane that holds an attribute's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AttributePlane {
    /// A plane of its own.
    Own,
    /// The hot intensity plane.
    Intensity,
    /// The colour plane and, for 16 bits, the remainder plane.
    Colour,
}

/// The planes of every page of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct PageLayout {
    schema: Schema,
    classes: Vec<PointClass>,
    planes: Vec<PlaneSpec>,
    plane_indices: BTreeMap<PlaneKind, usize>,
    /// Whether a class has an attribute, class by class.
    present: Vec<bool>,
    colours: Vec<Option<ColourSource>>,
    attribute_planes: Vec<AttributePlane>,
    normals: Normals,
    has_clip_lines: bool,
    has_tangents: bool,
    palette: Option<Palette>,
    codec: Codec,
}

impl PageLayout {
    /// Layout that this version writes for a schema and its classes, with the default codec.
    pub fn new(schema: &Schema, classes: &[PointClass]) -> Self {
        let attributes = schema.attributes.len();
        let mut present = vec![false; attributes * classes.len()];
        for (c, class) in classes.iter().enumerate() {
            class.present.iter().for_each(|&a| present[c * attributes + usize::from(a)] = true);
        }
        let has = |class: usize, a: usize| present[class * attributes + a];
        let colours: Vec<_> = classes
            .iter()
            .enumerate()
            .map(|(c, class)| colour_source(schema, class, |a| has(c, a)))
            .collect();
        let intensity = schema.find_typed(names::INTENSITY, AttrType::U16);
        let attribute_planes = (0..schema.attributes.len())
            .map(|a| match intensity {
                Some(i) if i == a => AttributePlane::Intensity,
                _ if lives_in_colour(a, &colours, |c| has(c, a)) => AttributePlane::Colour,
                _ => AttributePlane::Own,
            })
            .collect();
        let mut layout = Self {
            schema: schema.clone(),
            classes: classes.to_vec(),
            planes: Vec::new(),
            plane_indices: BTreeMap::new(),
            present,
            colours,
            attribute_planes,
            normals: schema.normals().map_or(Normals::None, |_| Normals::Source),
            has_clip_lines: false,
            has_tangents: false,
            palette: None,
            codec: Codec::default(),
        };
        layout.set_planes(layout.derive_planes());
        layout
    }

    /// Sets the origin of the normal plane, or removes it; exact normals stay, as attributes.
    pub fn with_normals(mut self, normals: Normals) -> Self {
        self.normals = normals;
        self.set_planes(self.derive_planes());
        self
    }

    /// Adds or removes the plane of clip lines.
    pub fn with_clip_lines(mut self, has_clip_lines: bool) -> Self {
        self.has_clip_lines = has_clip_lines;
        self.set_planes(self.derive_planes());
        self
    }

    /// Adds or removes the plane of tangents.
    pub fn with_tangents(mut self, has_tangents: bool) -> Self {
        self.has_tangents = has_tangents;
        self.set_planes(self.derive_planes());
        self
    }

    /// Adds a compact plane of this palette if points have colours, or removes it.
    pub fn with_palette(mut self, palette: Option<Palette>) -> Self {
        self.palette = palette.filter(|_| self.colours.iter().any(Option::is_some));
        self.set_planes(self.derive_planes());
        self
    }

    /// Sets the compression of cold planes.
    pub fn with_codec(mut self, codec: Codec) -> Self {
        self.codec = codec;
        self
    }

    fn set_planes(&mut self, planes: Vec<PlaneSpec>) {
        // Of several planes of one unknown kind the first is found, which is irrelevant since they
        // are skipped.
        self.plane_indices = planes.iter().enumerate().rev().map(|(i, p)| (p.kind, i)).collect();
        self.planes = planes;
    }

    fn derive_planes(&self) -> Vec<PlaneSpec> {
        let hot = |kind, value_bytes| PlaneSpec { kind, hot: true, value_bytes };
        let cold = |kind, value_bytes| PlaneSpec { kind, hot: false, value_bytes };
        let mut planes = vec![hot(PlaneKind::Position, HOT_POSITION_BYTES as u32)];
        if self.colours.iter().any(Option::is_some) {
            planes.push(hot(PlaneKind::Colour, 4));
        }
        if self.attribute_planes.contains(&AttributePlane::Intensity) {
            planes.push(hot(PlaneKind::Intensity, 2));
        }
        if self.normals != Normals::None {
            planes.push(hot(PlaneKind::Normal, 4));
        }
        planes.push(hot(PlaneKind::Residual, 0));
        if self.has_tangents {
            planes.push(TANGENTS);
        }
        if self.palette.is_some() {
            planes.push(COMPACT);
        }
        if self.has_clip_lines {
            planes.push(CLIP_LINES);
        }
        if self.classes.len() > 1 {
            planes.push(cold(PlaneKind::Class, 2));
        }
        if self.colours.iter().flatten().any(|c| c.depth.is_some()) {
            planes.push(cold(PlaneKind::ColourRemainder, 3));
        }
        for (a, attribute) in self.schema.attributes.iter().enumerate() {
            if self.attribute_planes[a] == AttributePlane::Own {
                planes.push(cold(PlaneKind::Attribute(a as u16), attribute.ty.size() as u32));
            }
        }
        planes
    }

    /// Sets the planes that a file's metadata list. Planes of unknown kinds may be among the known
    /// ones.
    ///
    /// # Errors
    /// If the known planes are not those of this layout.
    pub fn with_planes(mut self, planes: Vec<PlaneSpec>) -> Result<Self, Fault> {
        if !planes.iter().filter(|p| p.kind.is_written()).eq(self.planes.iter()) {
            return Err(Fault::new("metadata", "the list of planes does not suit the attributes"));
        }
        let first_cold = planes.iter().position(|p| !p.hot).unwrap_or(planes.len());
        if planes[first_cold..].iter().any(|p| p.hot) || planes.len() > ATTRIBUTES_MAX + 16 {
            return Err(Fault::new("metadata", "a hot plane comes after a cold one"));
        }
        if planes.iter().any(|p| p.value_bytes > VALUE_BYTES_MAX) {
            return Err(Fault::new("metadata", "a plane's values are longer than any can be"));
        }
        self.set_planes(planes);
        Ok(self)
    }

    /// Compression of cold planes when written.
    pub fn codec(&self) -> Codec {
        self.codec
    }

    /// Origin of the normal plane. For estimated normals [`crate::PagePoints`] have a column.
    pub fn normals(&self) -> Normals {
        self.normals
    }

    /// Whether there is a plane of clip lines. [`crate::PagePoints`] then have a column for it.
    pub fn has_clip_lines(&self) -> bool {
        self.has_clip_lines
    }

    /// Whether there is a plane of tangents. [`crate::PagePoints`] then have a column for it.
    pub fn has_tangents(&self) -> bool {
        self.has_tangents
    }

    /// Colours that the compact plane indexes, if there is such a plane.
    pub fn palette(&self) -> Option<&Palette> {
        self.palette.as_ref()
    }

    /// Attributes of the file.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Classes of points of the file.
    pub fn classes(&self) -> &[PointClass] {
        &self.classes
    }

    /// Planes of every page, in their order.
    pub fn planes(&self) -> &[PlaneSpec] {
        &self.planes
    }

    /// Whether the file's pages have this plane.
    pub fn has(&self, kind: PlaneKind) -> bool {
        self.plane_indices.contains_key(&kind)
    }

    /// Index of this plane in the page's directory.
    pub fn plane_index(&self, kind: PlaneKind) -> Option<usize> {
        self.plane_indices.get(&kind).copied()
    }

    /// Whether points of a class have an attribute.
    pub fn has_attribute(&self, class: usize, attribute: usize) -> bool {
        let attributes = self.schema.attributes.len();
        self.present.get(class * attributes + attribute).copied().unwrap_or(false)
    }

    /// Whether points of all classes have one of these attributes, given by name and type.
    pub fn all_have_one_of(&self, attributes: &[(&str, AttrType)]) -> bool {
        let own = attributes.iter().filter_map(|&(name, ty)| self.schema.find_typed(name, ty));
        let own: Vec<usize> = own.collect();
        let has_one = |class| own.iter().any(|&own| self.has_attribute(class, own));
        (0..self.classes.len()).all(has_one)
    }

    /// Bytes of the directory of every page.
    pub fn directory_bytes(&self) -> usize {
        DIRECTORY_HEAD_BYTES + self.planes.len() * DIRECTORY_ENTRY_BYTES + 4
    }

    /// Raw bytes of a plane of `points` points.
    pub(crate) fn raw_bytes(plane: &PlaneSpec, points: usize, hot_shift: u8) -> u64 {
        let value = match plane.kind {
            PlaneKind::Residual => residual_bytes(hot_shift) as u64,
            _ => u64::from(plane.value_bytes),
        };
        value * points as u64
    }

    /// Byte range of a hot plane or the residual relative to the start of the page of a node with
    /// `node_points` points. `None` if the file has no such plane or it is cold (only the page's
    /// directory has its range). Empty for the residual of a node that drops no bits.
    pub fn plane_range(
        &self,
        kind: PlaneKind,
        node_points: usize,
        hot_shift: u8,
    ) -> Option<Range<u64>> {
        let mut end = self.directory_bytes() as u64;
        for plane in self.planes.iter().take_while(|p| p.hot) {
            let start = end.next_multiple_of(ALIGNMENT);
            end = start + Self::raw_bytes(plane, node_points, hot_shift);
            if plane.kind == kind {
                return Some(start..end);
            }
        }
        None
    }

    /// Bytes from the start of the page to the end of its last hot plane (with the residual): what
    /// one read must fetch to draw the node.
    pub fn hot_bytes(&self, node_points: usize, hot_shift: u8) -> u64 {
        let mut end = self.directory_bytes() as u64;
        for plane in self.planes.iter().take_while(|p| p.hot) {
            end = end.next_multiple_of(ALIGNMENT) + Self::raw_bytes(plane, node_points, hot_shift);
        }
        end
    }

    /// Greatest size of the page of a node with `node_points` points.
    pub fn page_bytes_max(&self, node_points: usize) -> u64 {
        self.raw_page_bytes(node_points, 16)
    }

    /// Size of the page of a node with `node_points` points if all its planes are raw.
    pub fn raw_page_bytes(&self, node_points: usize, hot_shift: u8) -> u64 {
        let mut end = self.directory_bytes() as u64;
        for plane in &self.planes {
            end = end.next_multiple_of(ALIGNMENT) + Self::raw_bytes(plane, node_points, hot_shift);
        }
        end.next_multiple_of(ALIGNMENT)
    }

    /// Attributes that hold red, green and blue of points of a class, and the byte of each that is
    /// drawn; `None` if they have no colour.
    pub fn drawn_colour(&self, class: usize) -> Option<([usize; 3], usize)> {
        self.colour_of_class(class).map(|c| (c.rgb, c.drawn_byte()))
    }

    pub(crate) fn colour_of_class(&self, class: usize) -> Option<ColourSource> {
        self.colours.get(class).copied().flatten()
    }

    pub(crate) fn plane_of(&self, attribute: usize) -> AttributePlane {
        self.attribute_planes[attribute]
    }
}

/// Colour of a class: in 16-bit attributes if it has all three, otherwise in 8-bit ones.
fn colour_source(
    schema: &Schema,
    class: &PointClass,
    has: impl Fn(usize) -> bool,
) -> Option<ColourSource> {
    [AttrType::U16, AttrType::U8].into_iter().find_map(|ty| {
        let find = |name| schema.find_typed(name, ty).filter(|&a| has(a));
        let rgb = [find(names::RED)?, find(names::GREEN)?, find(names::BLUE)?];
        Some(ColourSource { rgb, depth: (ty == AttrType::U16).then_some(class.colour_depth) })
    })
}

/// Whether the colour plane (with its remainder) holds every value of an attribute: each class that
/// has the attribute has its colour there.
fn lives_in_colour(
    a: usize,
    colours: &[Option<ColourSource>],
    has: impl Fn(usize) -> bool,
) -> bool {
    let mut having = colours.iter().enumerate().filter(|&(c, _)| has(c)).map(|(_, colour)| colour);
    let serves = |colour: &Option<ColourSource>| colour.is_some_and(|c| c.rgb.contains(&a));
    having.next().is_some_and(serves) && having.all(serves)
}
