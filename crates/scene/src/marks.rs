//! What a user adds to scans: clips, measurements, annotations, bookmarks. Coordinates are those of
//! the scans.

use crate::camera::Camera;
use crate::error::SceneError;
use crate::fields::{is_default, is_yes, yes};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// A region whose points are kept, or cut away. It has a box, an oriented box or a plane.
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
    /// A box of any orientation.
    #[serde(default, skip_serializing_if = "is_default")]
    pub oriented_box: Option<OrientedBox>,
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

/// A box of any orientation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrientedBox {
    /// Its centre.
    pub centre: [f64; 3],
    /// Lengths of its edges, 0 or more.
    pub size: [f64; 3],
    /// Degrees by which it is turned about the axes z, y and x: about x first, then about y, then
    /// about z.
    #[serde(default, skip_serializing_if = "is_default")]
    pub rotation: [f64; 3],
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

impl MeasurementKind {
    /// What points, which have to be in one unit of length along all axes, measure: the length of
    /// the line through them, the elevation of the second above the first, the angle in degrees (0
    /// to 180), or the area of the polygon, in the square of the unit; of a polygon that is not
    /// plane, that of its projection on the plane where it is greatest (Newell's normal). `None`
    /// for coordinates, for another number of points than the kind needs, and for an angle at a
    /// point that is one of the others.
    pub fn value(self, points: &[[f64; 3]]) -> Option<f64> {
        let from = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|i| b[i] - a[i]);
        let value = match (self, points) {
            (Self::Distance, [_, _, ..]) => {
                points.windows(2).map(|line| length(from(line[0], line[1]))).sum()
            }
            (Self::Height, [a, b]) => b[2] - a[2],
            (Self::Angle, &[a, at, b]) => {
                let (a, b) = (from(at, a), from(at, b));
                let dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
                let has_sides = length(a) > 0.0 && length(b) > 0.0;
                has_sides.then(|| length(cross(a, b)).atan2(dot).to_degrees())?
            }
            (Self::Area, &[first, _, _, ..]) => {
                // Differences to a corner keep their digits where coordinates are large.
                let sides =
                    points.windows(2).map(|side| cross(from(first, side[0]), from(first, side[1])));
                let twice = sides.fold([0.0; 3], |sum, of| [0, 1, 2].map(|i| sum[i] + of[i]));
                length(twice) / 2.0
            }
            _ => return None,
        };
        Some(value)
    }
}

fn length(v: [f64; 3]) -> f64 {
    v[0].hypot(v[1]).hypot(v[2])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

impl Clip {
    pub(crate) fn check(&self, field: &str) -> Result<(), SceneError> {
        let fault = match (&self.bounds, &self.oriented_box, &self.plane) {
            (Some([x0, y0, z0, x1, y1, z1]), None, None) => {
                let has_inside = x0 <= x1 && y0 <= y1 && z0 <= z1;
                (!has_inside).then_some(("box", "has no inside: the least corner comes first"))
            }
            (None, Some(OrientedBox { size, .. }), None) => {
                let has_inside = size.iter().all(|length| *length >= 0.0);
                (!has_inside).then_some(("oriented_box.size", "has a length below 0"))
            }
            (None, None, Some(plane)) => {
                (plane.normal == [0.0; 3]).then_some(("plane.normal", "is 0,0,0: no direction"))
            }
            _ => {
                return Err(SceneError::of(
                    field,
                    "needs one of `box`, `oriented_box` and `plane`",
                ));
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use MeasurementKind::{Angle, Area, Coordinates, Distance, Height};

    #[test]
    fn measurements_have_the_values_of_known_figures_wherever_they_lie() {
        for offset in [[0.0; 3], [4_512_345.0, -691_000.0, 2_048.0]] {
            let at = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] + offset[i]);
            let path = [[0.0; 3], [3.0, 4.0, 0.0], [3.0, 4.0, -12.0]].map(at);
            assert_eq!(Distance.value(&path), Some(17.0));
            assert_eq!(Height.value(&path[1..]), Some(-12.0));
            assert_eq!(Angle.value(&path), Some(90.0));
            assert_eq!(Area.value(&path), Some(30.0));
            // An L on a slope of 45 degrees: three unit squares on the ground.
            let corners = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]];
            let slope = corners.map(|[x, y]| at([f64::from(x), f64::from(y), f64::from(x)]));
            let area = Area.value(&slope).unwrap_or_default();
            assert!((area - 3.0 * 2f64.sqrt()).abs() < 1e-12, "{area}");
            let back: Vec<[f64; 3]> = slope.iter().rev().copied().collect();
            assert_eq!(Area.value(&back), Some(area), "in either direction");
        }
    }

    #[test]
    fn measurements_without_a_value_have_none() {
        let p = [1.0, 2.0, 3.0];
        assert_eq!(Coordinates.value(&[p]), None);
        assert_eq!(Distance.value(&[p]), None);
        assert_eq!(Height.value(&[p; 3]), None);
        assert_eq!(Angle.value(&[p; 3]), None, "no sides");
        assert_eq!(Angle.value(&[[0.0; 3], p, [2.0, 4.0, 6.0]]), Some(180.0));
        assert_eq!(Area.value(&[p; 2]), None);
        assert_eq!(Area.value(&[p; 3]), Some(0.0));
    }
}
