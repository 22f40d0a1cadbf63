//! Schema and metadata: what the file says of itself and of its sources, as JSON with exact numbers, and
//! beside it the blocks of the sources kept verbatim, as one run of bytes that the JSON points into.

use crate::codec::Codec;
use crate::error::Fault;
use crate::forest::TREES_MAX;
use crate::json::{BlockPlace, MetadataJson};
use crate::layout::{ATTRIBUTES_MAX, ATTRIBUTES_TIMES_CLASSES_MAX, PageLayout};
use crate::normals::Normals;
use esker_points::palette::Palette;
use esker_points::{ColourDepth, InputGrid, Lattice, PointClass, Schema};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Bytes of JSON that are written and read at most.
pub const METADATA_BYTES_MAX: u64 = 1 << 30;

/// Whole steps that a lattice is moved at most: beyond it `f64` has no whole steps.
const LATTICE_SHIFT_MAX: u64 = 1 << 54;

/// What the file says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// The integer grid of all coordinates.
    pub lattice: Lattice,
    /// The attributes of all points, in canonical order.
    pub schema: Schema,
    /// Which of them the points of each class have. A class plane is there only where there are several.
    pub classes: Vec<PointClass>,
    /// Least and greatest lattice coordinates of all points; `None` where there is no point.
    pub bounds: Option<[[u32; 3]; 2]>,
    /// Points that a node is meant to hold at most.
    pub node_capacity: u32,
    /// Where the normal plane comes from.
    pub normals: Normals,
    /// Whether there is a plane of clip lines.
    pub has_clip_lines: bool,
    /// Whether there is a plane of tangents.
    pub has_tangents: bool,
    /// The colours that a compact plane numbers, where there is such a plane.
    pub palette: Option<Palette>,
    /// How cold planes were compressed.
    pub codec: Codec,
    /// Where the points come from, in the order given.
    pub sources: Vec<SourceRecord>,
    /// Other files whose trees, over the same lattice, belong to this one: all of them, also those that the
    /// named ones name themselves.
    pub forest: Vec<TreeRef>,
    /// The program that wrote the file, with its version.
    pub generator: String,
}

/// A coordinate reference system as a source writes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CrsRecord {
    /// OGC WKT, or the GeoTIFF keys in readable form.
    pub text: String,
    /// Unit of length where the CRS tells it.
    pub unit: Option<String>,
}

/// What is known of a source, and what became of its points.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceRecord {
    /// As given by the user.
    pub path: String,
    /// Format, version and variant.
    pub format: String,
    /// Kind, grid and bounds of its coordinates.
    pub grid: InputGrid,
    /// Points taken from it.
    pub points: u64,
    /// Points refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Greatest distance by which a coordinate of it was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// What its 16-bit colour fields hold, where it has such.
    pub colour_depth: Option<ColourDepth>,
    /// Whether the user said so.
    pub colour_depth_forced: bool,
    /// Class of its points.
    pub class: u16,
    /// Its coordinate reference system, where it tells.
    pub crs: Option<CrsRecord>,
    /// What was left out and why, a line each.
    pub notes: Vec<String>,
    /// Blocks kept verbatim (header, VLRs ...): name and bytes. Written from here; an opened file leaves
    /// it empty, since blocks may be large: see [`crate::EskerFile::verbatim`].
    pub verbatim: Vec<(String, Vec<u8>)>,
}

/// Another .esker file whose tree belongs to this one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TreeRef {
    /// Path from this file's folder, its parts joined by `/`.
    pub path: String,
    /// Its [`crate::Footer::name_hash`].
    pub footer_hash: u128,
}

/// Metadata as read, with what the reader needs besides.
pub(crate) struct Decoded {
    pub metadata: Metadata,
    pub layout: PageLayout,
    pub blocks: Vec<Vec<BlockPlace>>,
}

impl Metadata {
    /// The layout of the pages that such a file has.
    pub fn layout(&self) -> PageLayout {
        let layout = PageLayout::new(&self.schema, &self.classes);
        layout
            .with_codec(self.codec)
            .with_normals(self.normals)
            .with_clip_lines(self.has_clip_lines)
            .with_tangents(self.has_tangents)
            .with_palette(self.palette.clone())
    }

    /// The greatest of the sources' rounding errors.
    pub(crate) fn rounding_error_max(&self) -> f64 {
        self.sources.iter().map(|s| s.rounding_error_max).fold(0.0, f64::max)
    }

    /// Points belong to a class.
    pub(crate) fn check_classes(&self, points: u64) -> Result<(), Fault> {
        if points > 0 && self.classes.is_empty() {
            return Err(Fault::new("metadata", "there are points but no class of points"));
        }
        Ok(())
    }

    /// The JSON and the verbatim section.
    pub(crate) fn encode(&self) -> Result<(Vec<u8>, Vec<u8>), Fault> {
        self.check()?;
        let mut blob = Vec::new();
        let json = MetadataJson::of(self, &mut blob);
        let json = serde_json::to_vec(&json).map_err(|e| Fault::new("metadata", e.to_string()))?;
        if json.len() as u64 > METADATA_BYTES_MAX {
            return Err(Fault::new("metadata", "they are longer than any reader takes"));
        }
        Ok((json, blob))
    }

    /// Reads and checks the JSON; `verbatim_bytes` is the length of the verbatim section.
    pub(crate) fn decode(json: &[u8], verbatim_bytes: u64) -> Result<Decoded, Fault> {
        let json: MetadataJson =
            serde_json::from_slice(json).map_err(|e| Fault::new("metadata", e.to_string()))?;
        let (metadata, planes, blocks) = json.parts()?;
        check_blocks(&blocks, verbatim_bytes)?;
        metadata.check()?;
        let layout = metadata.layout().with_planes(planes)?;
        Ok(Decoded { metadata, layout, blocks })
    }

    /// Everything that other parts rely on.
    fn check(&self) -> Result<(), Fault> {
        let fault = |what: &str| Err(Fault::new("metadata", what));
        let lattice = &self.lattice;
        for axis in 0..3 {
            let numbers = lattice.scale[axis].is_normal() && lattice.offset[axis].is_finite();
            let shift = lattice.shift[axis].unsigned_abs();
            if !numbers || lattice.scale[axis] < 0.0 || shift > LATTICE_SHIFT_MAX {
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
            return fault("normals are said to be the source's, which has none");
        }
        let classes_max = self.classes.len().max(1);
        if self.sources.iter().any(|s| usize::from(s.class) >= classes_max) {
            return fault("a source names a class that does not exist");
        }
        self.check_forest()
    }
}

impl Metadata {
    /// The named files are few enough, each by a way from this one's folder, and none twice.
    fn check_forest(&self) -> Result<(), Fault> {
        let fault = |what: &str| Err(Fault::new("metadata", what));
        if self.forest.len() >= TREES_MAX {
            return fault("it names more files than a forest can have");
        }
        if self.forest.iter().any(|t| t.path.is_empty() || Path::new(&t.path).has_root()) {
            return fault("it names a file by no way from its own folder");
        }
        let hashes: HashSet<_> = self.forest.iter().map(|t| t.footer_hash).collect();
        if hashes.len() < self.forest.len() {
            return fault("it names a file twice");
        }
        Ok(())
    }
}

fn check_blocks(blocks: &[Vec<BlockPlace>], verbatim_bytes: u64) -> Result<(), Fault> {
    let mut end = 0u64;
    for block in blocks.iter().flatten() {
        // One after the other: no two overlap, so reading all never takes more than the section has.
        if block.offset != end {
            return Err(Fault::new("metadata", "verbatim blocks do not follow each other"));
        }
        end = end
            .checked_add(block.bytes)
            .ok_or_else(|| Fault::new("metadata", "a verbatim block is too long"))?;
    }
    if end != verbatim_bytes {
        return Err(Fault::new("metadata", "verbatim blocks do not fill their section"));
    }
    Ok(())
}
