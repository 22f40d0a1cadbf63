//! What a user adds to scans: clips, measurements, annotations, bookmarks. Coordinates are those of
//! the scans.

use crate::camera::Camera;
use crate::error::SceneError;
use crate::fields::{is_default, is_yes, yes};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// A region whose points are kept, or cut away. It has a box or a plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clip {
    /// Name for people.
    #[serde(default, skip_serializing_if = "is_default")]
    pub name: Option<String>,
    /// Whether it has an effect.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub enabled: bool,
    /// Side whose points are kept.
    #[serde(default, skip_serializing_if = "is_default")]
    pub keep: Keep,
    /// A box: least and greatest corner, `x0,y0,z0,x1,y1,z1`.
    #[serde(default, rename = "box", skip_serializing_if = "is_default")]
    pub bounds: Option<[f64; 6]>,
    /// A plane.
    #[serde(default, skip_serializing_if = "is_default")]
    pub plane: Option<Plane>,
}

/// Side of a clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// Inside a box; behind a plane, away from its normal.
    #[default]
    Inside,
    /// The other side.
    Outside,
}

/// A plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// A point on it.
    pub point: [f64; 3],
    /// Its normal, of any length.
    pub normal: [f64; 3],
}

/// A measurement; its value follows from its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// Name for people.
    #[serde(default, skip_serializing_if = "is_default")]
    pub name: Option<String>,
    /// What is measured.
    pub kind: MeasurementKind,
    /// Its points.
    pub points: Vec<[f64; 3]>,
}

/// What a measurement measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MeasurementKind {
    /// The coordinates of a point.
    Coordinates,
    /// The length of a line through two points or more.
    Distance,
    /// The difference of the elevations of two points.
    Height,
    /// The angle at the second of three points.
    Angle,
    /// The area of a polygon with three corners or more.
    Area,
}

/// A text at a point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Annotation {
    /// The text.
    pub text: String,
    /// The point.
    pub at: [f64; 3],
}

/// A camera with a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bookmark {
    /// The name, which no other bookmark has.
    pub name: String,
    /// The camera.
    pub camera: Camera,
}

impl Clip {
    pub(crate) fn check(&self, field: &str) -> Result<(), SceneError> {
        let fault = match (&self.bounds, &self.plane) {
            (Some([x0, y0, z0, x1, y1, z1]), None) => {
                let has_inside = x0 <= x1 && y0 <= y1 && z0 <= z1;
                (!has_inside).then_some(("box", "has no inside: the least corner comes first"))
            }
            (None, Some(plane)) => {
                (plane.normal == [0.0; 3]).then_some(("plane.normal", "is 0,0,0: no direction"))
            }
            _ => return Err(SceneError::of(field, "needs either `box` or `plane`")),
        };
        fault.map_or(Ok(()), |(part, what)| Err(SceneError::of(format!("{field}.{part}"), what)))
    }
}

impl Measurement {
    pub(crate) fn check(&self, field: &str) -> Result<(), SceneError> {
        let points = self.points.len();
        let (fits, needs) = match self.kind {
            MeasurementKind::Coordinates => (points == 1, "one point"),
            MeasurementKind::Distance => (points >= 2, "two points or more"),
            MeasurementKind::Height => (points == 2, "two points"),
            MeasurementKind::Angle => (points == 3, "three points"),
            MeasurementKind::Area => (points >= 3, "three points or more"),
        };
        let fault = || format!("has {points} points; this kind of measurement needs {needs}");
        if fits { Ok(()) } else { Err(SceneError::of(format!("{field}.points"), fault())) }
    }
}

pub(crate) fn check_bookmarks(bookmarks: &[Bookmark]) -> Result<(), SceneError> {
    let mut names = HashSet::new();
    for (i, bookmark) in bookmarks.iter().enumerate() {
        let (name, field) = (bookmark.name.trim(), format!("bookmarks[{i}].name"));
        if name.is_empty() {
            return Err(SceneError::of(field, "is empty"));
        }
        if !names.insert(name) {
            return Err(SceneError::of(field, format!("`{name}` names two bookmarks")));
        }
    }
    Ok(())
}
