//! Schema and metadata: the file's description of itself and of its sources, as JSON with exact
//! numbers, and the blocks of the sources that are kept verbatim, as one range of bytes that the
//! JSON points into.

use crate::aside::{SET_ASIDE_MAX, SetAside};
use crate::codec::Codec;
use crate::error::Fault;
use crate::layout::{ATTRIBUTES_MAX, ATTRIBUTES_TIMES_CLASSES_MAX, PageLayout};
use crate::normals::Normals;
use esker_points::palette::Palette;
use esker_points::{ColourDepth, InputGrid, Lattice, MultisetHash, PointClass, Schema};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Greatest number of trees of a forest: each is an open file.
pub const TREES_MAX: usize = 512;
/// Greatest length of the JSON that is written and read, bytes.
pub const METADATA_BYTES_MAX: u64 = 1 << 30;

/// Greatest shift of a lattice in whole steps: `f64` has no whole steps beyond it.
const LATTICE_SHIFT_MAX: u64 = 1 << 54;

/// Range of the factors of a lattice.
const FACTORS: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

/// The file's description of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Integer grid of all coordinates.
    pub lattice: Lattice,
    /// Attributes of all points, in canonical order.
    pub schema: Schema,
    /// Classes: the attributes that their points have. There is a class plane only if there are
    /// several.
    pub classes: Vec<PointClass>,
    /// Least and greatest lattice coordinates of all points; `None` if there is no point.
    pub bounds: Option<[[u32; 3]; 2]>,
    /// Intended greatest number of points of a node.
    pub node_capacity: u32,
    /// Origin of the normal plane.
    pub normals: Normals,
    /// Whether there is a plane of clip lines.
    pub has_clip_lines: bool,
    /// Whether there is a plane of tangents.
    pub has_tangents: bool,
    /// Colours that the compact plane indexes, if there is such a plane.
    pub palette: Option<Palette>,
    /// Compression of cold planes.
    pub codec: Codec,
    /// Sources of the points, in the order given.
    pub sources: Vec<SourceRecord>,
    /// Points that are kept beside the tree, at most [`crate::SET_ASIDE_MAX`].
    pub set_aside: Vec<SetAside>,
    /// Other files over the same lattice whose trees belong to this one: all of them, including
    /// those that the named files name themselves.
    pub forest: Vec<TreeRef>,
    /// Program that wrote the file, with its version.
    pub generator: String,
}

/// Coordinate reference system as written by a source.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CrsRecord {
    /// OGC WKT, or the GeoTIFF keys in readable form.
    pub text: String,
    /// Unit of length, if the CRS has one.
    #[serde(deserialize_with = "crate::strict::nullable")]
    pub unit: Option<String>,
}

/// A source, and what became of its points.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceRecord {
    /// Path as given by the user.
    pub path: String,
    /// Format, version and variant.
    pub format: String,
    /// Kind, grid and bounds of its coordinates.
    pub grid: InputGrid,
    /// Points taken from it.
    pub points: u64,
    /// Points refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Greatest distance by which one of its coordinates was rounded, the file's unit.
    pub rounding_error_max: f64,
    /// Contents of its 16-bit colour fields, if it has any.
    pub colour_depth: Option<ColourDepth>,
    /// Whether the user specified that.
    pub colour_depth_forced: bool,
    /// Class of its points.
    pub class: u16,
    /// Coordinate reference system, if the source has one.
    pub crs: Option<CrsRecord>,
    /// Notes on data that were left out, one line each.
    pub notes: Vec<String>,
    /// Blocks kept verbatim (header, VLRs ...): name and bytes. Only for writing; empty in an
    /// opened file, since blocks may be large: see [`crate::EskerFile::verbatim`].
    pub verbatim: Vec<(String, Vec<u8>)>,
}

/// Reference to another .esker file whose tree belongs to this one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TreeRef {
    /// Path from this file's folder, its parts joined by `/`.
    pub path: String,
    /// [`crate::Footer::name_hash`] of the file.
    pub footer_hash: u128,
}

/// Version of a file on a lattice.
pub(crate) fn version_on(lattice: &Lattice) -> u32 {
    if lattice.is_scaled() { 2 } else { 1 }
}

impl Metadata {
    /// Layout of the file's pages.
    pub fn layout(&self) -> PageLayout {
        let layout = PageLayout::new(&self.schema, &self.classes);
        layout
            .with_codec(self.codec)
            .with_normals(self.normals)
            .with_clip_lines(self.has_clip_lines)
            .with_tangents(self.has_tangents)
            .with_palette(self.palette.clone())
    }

    /// Version of the format that the file needs.
    pub fn version(&self) -> u32 {
        version_on(&self.lattice)
    }

    /// Greatest of the sources' rounding errors.
    pub(crate) fn rounding_error_max(&self) -> f64 {
        self.sources.iter().map(|s| s.rounding_error_max).fold(0.0, f64::max)
    }

    /// Checks that points have a class.
    pub(crate) fn check_classes(&self, points: u64) -> Result<(), Fault> {
        if points > 0 && self.classes.is_empty() {
            return Err(Fault::new("metadata", "there are points but no class of points"));
        }
        Ok(())
    }

    /// Checks everything that other parts rely on.
    pub(crate) fn check(&self) -> Result<(), Fault> {
        let fault = |what: &str| Err(Fault::new("metadata", what));
        let lattice = &self.lattice;
        for axis in 0..3 {
            let numbers = lattice.scale[axis].is_normal() && lattice.offset[axis].is_finite();
            let shift = lattice.shift[axis].unsigned_abs();
            let factor = lattice.factor[axis];
            if !numbers
                || lattice.scale[axis] < 0.0
                || shift > LATTICE_SHIFT_MAX
                || !FACTORS.contains(&factor)
                || !(lattice.scale[axis] * factor).is_normal()
                || !(lattice.offset[axis] * factor).is_finite()
            {
                return fault("the lattice's numbers are not usable");
            }
        }
        let attributes = &self.schema.attributes;
        if attributes.len() > ATTRIBUTES_MAX
            || self.classes.len() > ATTRIBUTES_MAX
            || attributes.len() * self.classes.len() > ATTRIBUTES_TIMES_CLASSES_MAX
        {
            return fault("there are more attributes or classes than a file can have");
        }
        if attributes.windows(2).any(|w| w[0].key() >= w[1].key()) {
            return fault("the attributes are not in canonical order");
        }
        for class in &self.classes {
            let last = class.present.last().map_or(0, |&i| usize::from(i) + 1);
            if last > attributes.len() || class.present.windows(2).any(|w| w[0] >= w[1]) {
                return fault("a class names attributes that do not exist, or twice");
            }
        }
        if self.normals == Normals::Source && self.schema.normals().is_none() {
            return fault(
                "the normals are the source's according to the metadata, but it has none",
            );
        }
        let is_error = |v: f64| v.is_finite() && v.is_sign_positive();
        if !self.sources.iter().all(|s| is_error(s.rounding_error_max)) {
            return fault("a rounding error is no number from 0 on");
        }
        let classes_max = self.classes.len().max(1);
        if self.sources.iter().any(|s| usize::from(s.class) >= classes_max) {
            return fault("a source names a class that does not exist");
        }
        self.check_set_aside()?;
        self.check_forest()
    }
}

impl Metadata {
    /// Checks that the named files are few enough, each given by a relative path, and none twice.
    fn check_forest(&self) -> Result<(), Fault> {
        let fault = |what: &str| Err(Fault::new("metadata", what));
        if self.forest.len() >= TREES_MAX {
            return fault("it names more files than a forest can have");
        }
        if self.forest.iter().any(|t| t.path.is_empty() || Path::new(&t.path).has_root()) {
            return fault("it names a file by a path that is not relative to its own folder");
        }
        let hashes: HashSet<_> = self.forest.iter().map(|t| t.footer_hash).collect();
        if hashes.len() < self.forest.len() {
            return fault("it names a file twice");
        }
        Ok(())
    }
}

impl Metadata {
    /// Hash of the points that are set aside.
    pub fn set_aside_hash(&self) -> MultisetHash {
        let mut hash = MultisetHash::default();
        for point in &self.set_aside {
            if let Some(class) = self.class_of(point) {
                point.add_to(&mut hash, class.seed(&self.schema));
            }
        }
        hash
    }

    fn class_of(&self, point: &SetAside) -> Option<&PointClass> {
        self.classes.get(usize::from(self.sources.get(point.source as usize)?.class))
    }

    /// Checks that each point that is set aside has a source, finite coordinates and a value for
    /// each attribute.
    fn check_set_aside(&self) -> Result<(), Fault> {
        let bytes = |class: &PointClass| {
            let attributes = class.present.iter().map(|&a| &self.schema.attributes[usize::from(a)]);
            attributes.map(|a| a.ty.size()).sum::<usize>()
        };
        let is_sound = |point: &SetAside| {
            point.place.iter().all(|c| c.is_finite())
                && self.class_of(point).is_some_and(|class| point.values.len() == bytes(class))
        };
        if self.set_aside.len() > SET_ASIDE_MAX || !self.set_aside.iter().all(is_sound) {
            let what = "a point that is set aside has no source, place or values";
            return Err(Fault::new("metadata", what));
        }
        Ok(())
    }
}
