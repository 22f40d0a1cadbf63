//! Schema and metadata: what the file says of itself and of its sources, as JSON with exact numbers, and
//! beside it the blocks of the sources kept verbatim, as one run of bytes that the JSON points into.

use crate::error::Fault;
use crate::layout::{
    ATTRIBUTES_MAX, ATTRIBUTES_TIMES_CLASSES_MAX, PageLayout, PlaneKind, PlaneSpec,
};
use esker_points::lattice::GridKind;
use esker_points::{
    AttrType, Attribute, ColourDepth, Grid, InputGrid, Lattice, PointClass, Schema,
};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;

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
    /// Points that a node is meant to hold at most.
    pub node_capacity: u32,
    /// Where the points come from, in the order given.
    pub sources: Vec<SourceRecord>,
    /// Other files whose trees, over the same lattice, belong to this one. None are read yet.
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
    /// Path from this file.
    pub path: String,
    /// Its [`crate::Footer::name_hash`].
    pub footer_hash: u128,
}

/// A verbatim block's name and place in the verbatim section.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct BlockPlace {
    pub name: String,
    pub offset: u64,
    pub bytes: u64,
}

/// Metadata as read, with what the reader needs besides.
pub(crate) struct Decoded {
    pub metadata: Metadata,
    pub layout: PageLayout,
    pub blocks: Vec<Vec<BlockPlace>>,
}

/// A number that may be infinite or none, as a string then: JSON has no such numbers.
#[derive(Clone, Copy)]
struct Real(f64);

impl Serialize for Real {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        if self.0.is_finite() { s.serialize_f64(self.0) } else { s.collect_str(&self.0) }
    }
}

impl<'de> Deserialize<'de> for Real {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Either {
            Number(f64),
            Text(String),
        }
        match Either::deserialize(d)? {
            Either::Number(v) => Ok(Self(v)),
            Either::Text(t) => t.parse().map(Self).map_err(serde::de::Error::custom),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct AttributeJson {
    name: String,
    #[serde(rename = "type")]
    ty: AttrType,
    description: String,
    scale: Real,
    offset: Real,
}

#[derive(Serialize, Deserialize)]
struct PlaneJson {
    kind: u16,
    attribute: Option<u16>,
    hot: bool,
    value_bytes: u32,
}

#[derive(Serialize, Deserialize)]
struct GridJson {
    name: String,
    kind: GridKind,
    scale: [Real; 3],
    offset: [Real; 3],
    bounds: Option<[[Real; 3]; 2]>,
}

#[derive(Serialize, Deserialize)]
struct SourceJson {
    path: String,
    format: String,
    grid: GridJson,
    points: u64,
    refused: BTreeMap<String, u64>,
    rounding_error_max: Real,
    colour_depth: Option<ColourDepth>,
    colour_depth_forced: bool,
    class: u16,
    crs: Option<CrsRecord>,
    notes: Vec<String>,
    verbatim: Vec<BlockPlace>,
}

#[derive(Serialize, Deserialize)]
struct TreeJson {
    path: String,
    footer_hash: String,
}

#[derive(Serialize, Deserialize)]
struct MetadataJson {
    generator: String,
    lattice: Lattice,
    node_capacity: u32,
    attributes: Vec<AttributeJson>,
    classes: Vec<PointClass>,
    planes: Vec<PlaneJson>,
    sources: Vec<SourceJson>,
    forest: Vec<TreeJson>,
}

impl Metadata {
    /// The layout of the pages that such a file has.
    pub fn layout(&self) -> PageLayout {
        PageLayout::new(&self.schema, &self.classes)
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
        let sources = self.sources.iter().map(|s| s.to_json(&mut blob)).collect();
        let layout = self.layout();
        let planes = layout.planes().iter().map(|p| PlaneJson {
            kind: p.kind.number(),
            attribute: if let PlaneKind::Attribute(a) = p.kind { Some(a) } else { None },
            hot: p.hot,
            value_bytes: p.value_bytes,
        });
        let json = MetadataJson {
            generator: self.generator.clone(),
            lattice: self.lattice,
            node_capacity: self.node_capacity,
            attributes: self.schema.attributes.iter().map(attribute_json).collect(),
            classes: self.classes.clone(),
            planes: planes.collect(),
            sources,
            forest: self
                .forest
                .iter()
                .map(|t| TreeJson {
                    path: t.path.clone(),
                    footer_hash: format!("{:032x}", t.footer_hash),
                })
                .collect(),
        };
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
        let blocks: Vec<Vec<BlockPlace>> =
            json.sources.iter().map(|s| s.verbatim.clone()).collect();
        check_blocks(&blocks, verbatim_bytes)?;
        let forest = json.forest.into_iter().map(|t| {
            let footer_hash = u128::from_str_radix(&t.footer_hash, 16)
                .map_err(|e| Fault::new("metadata", format!("forest: {e}")))?;
            Ok(TreeRef { path: t.path, footer_hash })
        });
        let metadata = Self {
            lattice: json.lattice,
            schema: Schema { attributes: json.attributes.into_iter().map(attribute).collect() },
            classes: json.classes,
            node_capacity: json.node_capacity,
            sources: json.sources.into_iter().map(source_record).collect(),
            forest: forest.collect::<Result<_, Fault>>()?,
            generator: json.generator,
        };
        metadata.check()?;
        let planes = json.planes.iter().map(|p| PlaneSpec {
            kind: PlaneKind::from_number(p.kind, p.attribute.unwrap_or(u16::MAX)),
            hot: p.hot,
            value_bytes: p.value_bytes,
        });
        let layout =
            PageLayout::with_planes(&metadata.schema, &metadata.classes, planes.collect())?;
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
        let classes_max = self.classes.len().max(1);
        if self.sources.iter().any(|s| usize::from(s.class) >= classes_max) {
            return fault("a source names a class that does not exist");
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

fn attribute_json(a: &Attribute) -> AttributeJson {
    AttributeJson {
        name: a.name.clone(),
        ty: a.ty,
        description: a.description.clone(),
        scale: Real(a.scale),
        offset: Real(a.offset),
    }
}

fn attribute(a: AttributeJson) -> Attribute {
    Attribute {
        name: a.name,
        ty: a.ty,
        description: a.description,
        scale: a.scale.0,
        offset: a.offset.0,
    }
}

impl SourceRecord {
    fn to_json(&self, blob: &mut Vec<u8>) -> SourceJson {
        let reals = |v: [f64; 3]| v.map(Real);
        let verbatim = self.verbatim.iter().map(|(name, bytes)| {
            let offset = blob.len() as u64;
            blob.extend_from_slice(bytes);
            BlockPlace { name: name.clone(), offset, bytes: bytes.len() as u64 }
        });
        SourceJson {
            path: self.path.clone(),
            format: self.format.clone(),
            verbatim: verbatim.collect(),
            grid: GridJson {
                name: self.grid.name.clone(),
                kind: self.grid.kind,
                scale: reals(self.grid.grid.scale),
                offset: reals(self.grid.grid.offset),
                bounds: self.grid.bounds.map(|b| b.map(reals)),
            },
            points: self.points,
            refused: self.refused.clone(),
            rounding_error_max: Real(self.rounding_error_max),
            colour_depth: self.colour_depth,
            colour_depth_forced: self.colour_depth_forced,
            class: self.class,
            crs: self.crs.clone(),
            notes: self.notes.clone(),
        }
    }
}

fn source_record(s: SourceJson) -> SourceRecord {
    let plain = |v: [Real; 3]| v.map(|r| r.0);
    SourceRecord {
        path: s.path,
        format: s.format,
        grid: InputGrid {
            name: s.grid.name,
            kind: s.grid.kind,
            grid: Grid { scale: plain(s.grid.scale), offset: plain(s.grid.offset) },
            bounds: s.grid.bounds.map(|b| b.map(plain)),
        },
        points: s.points,
        refused: s.refused,
        rounding_error_max: s.rounding_error_max.0,
        colour_depth: s.colour_depth,
        colour_depth_forced: s.colour_depth_forced,
        class: s.class,
        crs: s.crs,
        notes: s.notes,
        verbatim: Vec::new(),
    }
}
