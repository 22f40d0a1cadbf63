//! The metadata's JSON, encoded and decoded: one structure an object, separate from the types of
//! the rest of the program, so that these can change without changing the file.

use crate::aside::SetAsideJson;
use crate::codec::Codec;
use crate::error::Fault;
use crate::layout::{
    ATTRIBUTE_KIND, CLIP_LINES, COMPACT, NO_ATTRIBUTE, PageLayout, PlaneKind, PlaneSpec, TANGENTS,
};
use crate::metadata::{CrsRecord, METADATA_BYTES_MAX, Metadata, SourceRecord, TreeRef};
use crate::normals::Normals;
use crate::strict::{
    Real, from_json, nullable, nullable_object, nullable_word, object, objects, word,
};
use esker_points::lattice::GridKind;
use esker_points::palette::Palette;
use esker_points::{
    AttrType, Attribute, ColourDepth, Grid, InputGrid, Lattice, PointClass, Schema,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name and byte range of a block in the verbatim section.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct BlockPlace {
    pub name: String,
    pub offset: u64,
    pub bytes: u64,
}

#[derive(Serialize, Deserialize)]
struct AttributeJson {
    name: String,
    #[serde(rename = "type", deserialize_with = "word")]
    ty: AttrType,
    description: String,
    scale: Real,
    offset: Real,
}

#[derive(Serialize, Deserialize)]
struct ClassJson {
    present: Vec<u16>,
    #[serde(deserialize_with = "word")]
    colour_depth: ColourDepth,
}

#[derive(Serialize, Deserialize)]
struct PlaneJson {
    kind: u16,
    #[serde(deserialize_with = "nullable")]
    attribute: Option<u16>,
    hot: bool,
    value_bytes: u32,
}

#[derive(Serialize, Deserialize)]
struct GridJson {
    name: String,
    #[serde(deserialize_with = "word")]
    kind: GridKind,
    scale: [Real; 3],
    offset: [Real; 3],
    #[serde(deserialize_with = "nullable")]
    bounds: Option<[[Real; 3]; 2]>,
}

#[derive(Serialize, Deserialize)]
struct LatticeJson {
    scale: [f64; 3],
    offset: [f64; 3],
    shift: [i64; 3],
    /// Of version 2, where [`FactorsJson`] reads it; version 1 ignores a member of this name.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    factor: Option<[f64; 3]>,
}

/// What version 2 adds.
#[derive(Deserialize)]
struct FactorsJson {
    #[serde(deserialize_with = "object")]
    lattice: FactorJson,
}

#[derive(Deserialize)]
struct FactorJson {
    factor: [f64; 3],
}

#[derive(Serialize, Deserialize)]
struct SourceJson {
    path: String,
    format: String,
    #[serde(deserialize_with = "object")]
    grid: GridJson,
    points: u64,
    refused: BTreeMap<String, u64>,
    rounding_error_max: Real,
    #[serde(deserialize_with = "nullable_word")]
    colour_depth: Option<ColourDepth>,
    colour_depth_forced: bool,
    class: u16,
    #[serde(deserialize_with = "nullable_object")]
    crs: Option<CrsRecord>,
    notes: Vec<String>,
    #[serde(deserialize_with = "objects")]
    verbatim: Vec<BlockPlace>,
}

#[derive(Serialize, Deserialize)]
struct TreeJson {
    path: String,
    footer_hash: String,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct MetadataJson {
    generator: String,
    #[serde(deserialize_with = "object")]
    lattice: LatticeJson,
    #[serde(deserialize_with = "nullable")]
    bounds: Option<[[u32; 3]; 2]>,
    node_capacity: u32,
    #[serde(deserialize_with = "objects")]
    attributes: Vec<AttributeJson>,
    #[serde(deserialize_with = "objects")]
    classes: Vec<ClassJson>,
    normals: String,
    compress: String,
    #[serde(deserialize_with = "objects")]
    planes: Vec<PlaneJson>,
    #[serde(deserialize_with = "objects")]
    sources: Vec<SourceJson>,
    /// Absent if there is none.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "nullable_object"
    )]
    set_aside: Option<SetAsideJson>,
    #[serde(deserialize_with = "objects")]
    forest: Vec<TreeJson>,
    /// Files without a compact plane have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    palette: Option<Vec<[u8; 3]>>,
}

/// Contents of the JSON: metadata, planes in their order, verbatim blocks source by source.
pub(crate) type Parts = (Metadata, Vec<PlaneSpec>, Vec<Vec<BlockPlace>>);

impl MetadataJson {
    /// The JSON of `metadata`; verbatim blocks go to `blob`.
    pub(crate) fn of(metadata: &Metadata, blob: &mut Vec<u8>) -> Self {
        let layout = metadata.layout();
        Self {
            generator: metadata.generator.clone(),
            lattice: lattice_json(&metadata.lattice),
            bounds: metadata.bounds,
            node_capacity: metadata.node_capacity,
            attributes: metadata.schema.attributes.iter().map(attribute_json).collect(),
            classes: metadata.classes.iter().map(class_json).collect(),
            normals: metadata.normals.name().into(),
            compress: metadata.codec.name().into(),
            planes: layout.planes().iter().map(plane_json).collect(),
            sources: metadata.sources.iter().map(|s| s.to_json(blob)).collect(),
            set_aside: SetAsideJson::of(&metadata.set_aside, metadata.set_aside_hash()),
            forest: metadata.forest.iter().map(tree_json).collect(),
            palette: layout.palette().map(|p| p.colours().to_vec()),
        }
    }

    /// Contents, not yet checked.
    pub(crate) fn parts(mut self) -> Result<Parts, Fault> {
        let blocks = self.sources.iter_mut().map(|s| std::mem::take(&mut s.verbatim)).collect();
        let aside = self.set_aside.take().map(SetAsideJson::points).transpose()?;
        let (set_aside, set_aside_hash) = aside.unzip();
        let set_aside = set_aside.unwrap_or_default();
        let palette = self.palette.take().and_then(Palette::new);
        if self.planes.iter().any(|p| p.kind != ATTRIBUTE_KIND && p.attribute.is_some()) {
            let what = "a plane belongs to an attribute, but is of another kind";
            return Err(Fault::new("metadata", what));
        }
        let planes: Vec<_> = self.planes.iter().map(|p| plane_spec(p, palette.is_some())).collect();
        let schema = Schema { attributes: self.attributes.into_iter().map(attribute).collect() };
        let normals = Normals::from_name(&self.normals)
            .ok_or_else(|| Fault::new("metadata", "the origin of normals is unknown"))?;
        let metadata = Metadata {
            lattice: lattice(self.lattice),
            bounds: self.bounds,
            schema,
            classes: self.classes.into_iter().map(point_class).collect(),
            node_capacity: self.node_capacity,
            normals,
            has_clip_lines: planes.contains(&CLIP_LINES),
            has_tangents: planes.contains(&TANGENTS),
            palette: palette.filter(|_| planes.contains(&COMPACT)),
            codec: Codec::from_name(&self.compress),
            sources: self.sources.into_iter().map(source_record).collect(),
            set_aside,
            forest: self.forest.into_iter().map(tree_ref).collect::<Result<_, _>>()?,
            generator: self.generator,
        };
        if let Some(hash) = set_aside_hash {
            metadata.check()?;
            if metadata.set_aside_hash().to_string() != hash {
                let what = "the points that are set aside have another hash";
                return Err(Fault::new("metadata", what));
            }
        }
        Ok((metadata, planes, blocks))
    }
}

/// Metadata as read, with what else the reader needs.
pub(crate) struct Decoded {
    pub metadata: Metadata,
    pub layout: PageLayout,
    pub blocks: Vec<Vec<BlockPlace>>,
}

impl Metadata {
    /// Bytes of the JSON and of the verbatim section.
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

    /// Reads and checks the JSON of a file of this version; `verbatim_bytes` is the length of the
    /// verbatim section.
    pub(crate) fn decode(json: &[u8], verbatim_bytes: u64, version: u32) -> Result<Decoded, Fault> {
        let mut members: MetadataJson = from_json(json)?;
        if version > 1 {
            members.lattice.factor = Some(from_json::<FactorsJson>(json)?.lattice.factor);
        }
        let (metadata, planes, blocks) = members.parts()?;
        check_blocks(&blocks, verbatim_bytes)?;
        metadata.check()?;
        if metadata.version() != version {
            return Err(Fault::new("metadata", "all factors of the lattice are 1"));
        }
        let layout = metadata.layout().with_planes(planes)?;
        Ok(Decoded { metadata, layout, blocks })
    }
}

fn check_blocks(blocks: &[Vec<BlockPlace>], verbatim_bytes: u64) -> Result<(), Fault> {
    let mut end = 0u64;
    for block in blocks.iter().flatten() {
        // One after the other: no two overlap, so reading all never takes more than the section
        // has.
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

fn lattice_json(lattice: &Lattice) -> LatticeJson {
    let Lattice { scale, offset, shift, factor } = *lattice;
    LatticeJson { scale, offset, shift, factor: lattice.is_scaled().then_some(factor) }
}

fn lattice(json: LatticeJson) -> Lattice {
    let LatticeJson { scale, offset, shift, factor } = json;
    Lattice { scale, offset, shift, factor: factor.unwrap_or([1.0; 3]) }
}

fn plane_json(plane: &PlaneSpec) -> PlaneJson {
    PlaneJson {
        kind: plane.kind.number(),
        attribute: if let PlaneKind::Attribute(a) = plane.kind { Some(a) } else { None },
        hot: plane.hot,
        value_bytes: plane.value_bytes,
    }
}

/// Spec of a plane. Planes of kinds that were added to version 1 and are not as this version writes
/// them count as unknown; so does a compact plane without a palette.
fn plane_spec(p: &PlaneJson, has_palette: bool) -> PlaneSpec {
    let kind = PlaneKind::from_number(p.kind, p.attribute.unwrap_or(NO_ATTRIBUTE));
    let plane = PlaneSpec { kind, hot: p.hot, value_bytes: p.value_bytes };
    let is_other = match kind {
        PlaneKind::ClipLines => plane != CLIP_LINES,
        PlaneKind::Tangents => plane != TANGENTS,
        PlaneKind::Compact => plane != COMPACT || !has_palette,
        _ => false,
    };
    if is_other { PlaneSpec { kind: PlaneKind::Unknown(p.kind), ..plane } } else { plane }
}

fn tree_json(tree: &TreeRef) -> TreeJson {
    TreeJson { path: tree.path.clone(), footer_hash: format!("{:032x}", tree.footer_hash) }
}

fn tree_ref(tree: TreeJson) -> Result<TreeRef, Fault> {
    let digits = &tree.footer_hash;
    let is_hash = digits.len() == 32 && digits.bytes().all(|b| b.is_ascii_hexdigit());
    let footer_hash = u128::from_str_radix(digits, 16).ok().filter(|_| is_hash);
    let footer_hash = footer_hash
        .ok_or_else(|| Fault::new("metadata", "a footer hash of the forest is not 32 digits"))?;
    Ok(TreeRef { path: tree.path, footer_hash })
}

fn class_json(class: &PointClass) -> ClassJson {
    ClassJson { present: class.present.clone(), colour_depth: class.colour_depth }
}

fn point_class(class: ClassJson) -> PointClass {
    PointClass { present: class.present, colour_depth: class.colour_depth }
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
