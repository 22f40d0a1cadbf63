//! Groups of fields of the document: filter, light and build, with the options' names.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Whether a field need not be written.
pub(crate) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Default of what is switched on unless the document switches it off.
pub(crate) fn yes() -> bool {
    true
}

/// Whether a switch need not be written.
pub(crate) fn is_yes(value: &bool) -> bool {
    *value
}

/// A number, or a word in its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number, or a word that may stand in its place")]
pub enum Quantity {
    /// A number.
    Number(f64),
    /// A word, such as `fit` or `adaptive`.
    Word(String),
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Word(word) => word.fmt(f),
        }
    }
}

/// Which points are drawn: those that meet all conditions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Filter {
    /// Points in a box: `x0,y0,z0,x1,y1,z1`, or `x0,y0,x1,y1` for all heights.
    #[serde(rename = "box", skip_serializing_if = "is_default")]
    pub bounds: Option<Vec<f64>>,
    /// Points above or below a polygon.
    #[serde(skip_serializing_if = "is_default")]
    pub polygon: Option<PolygonForm>,
    /// Points of these classes: numbers, ranges and names.
    #[serde(skip_serializing_if = "is_default")]
    pub classes: Option<String>,
    /// Points with any of these flags.
    #[serde(skip_serializing_if = "is_default")]
    pub flags: Option<String>,
    /// No points with any of these flags.
    #[serde(skip_serializing_if = "is_default")]
    pub without_flags: Option<String>,
    /// Points with values of attributes within these ranges: `ATTRIBUTE:MIN..MAX`.
    #[serde(rename = "where", skip_serializing_if = "is_default")]
    pub values: Vec<String>,
    /// An even sample whose points are about this length apart, the scan's unit.
    #[serde(skip_serializing_if = "is_default")]
    pub max_spacing: Option<f64>,
}

/// A polygon seen from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected corners as \"x,y x,y x,y\", a file of a polygon, or polygons as \
                 [[[[x, y], ...], ...], ...]: of each its rings, of each ring its corners"
)]
pub enum PolygonForm {
    /// Corners as `x,y x,y x,y`, or a file of corners, relative to the document.
    Word(String),
    /// Polygons; of each its rings; of each ring its corners.
    Polygons(Vec<Vec<Vec<[f64; 2]>>>),
}

/// How pictures of the method `lit` are lit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightOptions {
    /// The lights.
    #[serde(skip_serializing_if = "is_default")]
    pub lights: Vec<LightItem>,
    /// Rays through a pixel.
    #[serde(skip_serializing_if = "is_default")]
    pub samples: Option<u32>,
    /// Times that light is reflected before it reaches the surface that is seen.
    #[serde(skip_serializing_if = "is_default")]
    pub bounces: Option<u32>,
    /// Rays to each light of finite size, for each ray through a pixel.
    #[serde(skip_serializing_if = "is_default")]
    pub shadow_samples: Option<u32>,
    /// Name of the filter of indirect light.
    #[serde(skip_serializing_if = "is_default")]
    pub filter: Option<String>,
    /// Whether the shadows of lights of finite size are filtered too.
    #[serde(skip_serializing_if = "is_default")]
    pub filter_shadows: bool,
    /// Reflectance of all surfaces at right angles, and perhaps their roughness.
    #[serde(skip_serializing_if = "is_default")]
    pub gloss: Option<Vec<f64>>,
    /// Seed of the random numbers.
    #[serde(skip_serializing_if = "is_default")]
    pub seed: Option<u64>,
    /// Factor from light to the picture.
    #[serde(skip_serializing_if = "is_default")]
    pub exposure: Option<f64>,
    /// Files of triangle meshes, relative to the document.
    #[serde(skip_serializing_if = "is_default")]
    pub mesh: Vec<String>,
}

/// Lights of a document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a light as behind --lights, or an object of lights as in LIGHTS.json"
)]
pub enum LightItem {
    /// As on the command line; files are relative to the document.
    Word(String),
    /// What a file of lights holds: an object with `version`, `lights` and `emissive`.
    Data(serde_json::Map<String, serde_json::Value>),
}

/// How scans are built. `.esker` files are built already.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Build {
    /// Source of the normals that are drawn.
    #[serde(skip_serializing_if = "is_default")]
    pub normals: Option<String>,
    /// Whether sharp edges are found.
    #[serde(skip_serializing_if = "is_default")]
    pub sharp_features: bool,
    /// Whether the shapes of splats are estimated.
    #[serde(skip_serializing_if = "is_default")]
    pub tangents: bool,
    /// Whether palette colours are stored beside exact ones.
    #[serde(skip_serializing_if = "is_default")]
    pub compact: bool,
    /// Points that a node holds.
    #[serde(skip_serializing_if = "is_default")]
    pub node_capacity: Option<u32>,
    /// Bits of the values in 16-bit colour fields.
    #[serde(skip_serializing_if = "is_default")]
    pub colour_bits: Option<u32>,
    /// Compression of attributes that are not drawn.
    #[serde(skip_serializing_if = "is_default")]
    pub compress: Option<String>,
    /// Whether inputs of different coordinate reference systems are accepted.
    #[serde(skip_serializing_if = "is_default")]
    pub ignore_crs: bool,
    /// Whether coordinates may be rounded by more than the typical distance of points.
    #[serde(skip_serializing_if = "is_default")]
    pub allow_rounding: bool,
    /// Which column of text files is which.
    #[serde(skip_serializing_if = "is_default")]
    pub columns: Option<String>,
    /// Lines at the beginning of text files that are passed over.
    #[serde(skip_serializing_if = "is_default")]
    pub skip_lines: u64,
    /// Whether PCD files are transformed by the poses in their headers.
    #[serde(skip_serializing_if = "is_default")]
    pub apply_viewpoint: bool,
    /// Coordinate reference system of inputs that state none: EPSG numbers or WKT.
    #[serde(skip_serializing_if = "is_default")]
    pub crs: Option<String>,
    /// Unit of the coordinates of inputs that state none.
    #[serde(skip_serializing_if = "is_default")]
    pub unit: Option<String>,
}
