//! Guesses which axis is vertical in files whose coordinates are those of a scanner or a model: the
//! axis around which the scans of an E57 file are turned, or y where the points of a PLY or PCD
//! file are thin along it. z, which surveys have, stays where neither is clear.

use crate::calls::info::sources;
use crate::cameras::camera::Camera;
use crate::cameras::places::central_range;
use crate::cameras::vertical::Vertical;
use esker_format::{Forest, ForestFilter, SourceRecord};
use esker_scan::{Turn, turns};
use glam::DVec3;

/// Formats of models, whose y axis is often vertical. A scan of a wall in E57 is thin along y too,
/// but comes from a scanner whose z axis is vertical.
const OF_MODELS: [&str; 2] = ["PLY", "PCD"];
/// The format with rotations of scans.
const OF_SCANNERS: &str = "E57";
/// Fraction of the points at either end of an axis that do not count for its extent.
const STRAYS: f64 = 0.0005;
/// y is vertical if the extent along it is at most this part of that along x and z. The range scan
/// of an object is thin along its view, but rarely by so much.
const THIN: f64 = 0.2;
/// Most points lie below: the median is below this part of the extent, or else up is down.
const LOW_HALF: f64 = 0.6;
/// Least angle of a turned scan, radians: smaller ones are those of registration.
const TURNED_RAD: f64 = 0.087;
/// Cosine of the greatest angle, 5 degrees, between an axis and the turns around it.
const AROUND_COS: f64 = 0.996_2;
/// Turned scans from which an axis is found.
const TURNED_MIN: usize = 3;

/// What is taken as vertical, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GuessedUp {
    /// The direction that is taken as upwards; never z.
    pub vertical: Vertical,
    /// Whether scans are turned around it; else points are thin along it.
    pub by_turns: bool,
}

impl GuessedUp {
    /// What is taken as vertical and why, for a window, which has controls to change it.
    pub fn reason(&self) -> &'static str {
        self.note().split(": ").next().unwrap_or_default()
    }

    /// What the user should know: the reason, and how to overrule the guess.
    pub fn note(&self) -> &'static str {
        match (self.by_turns, self.vertical.axis(), self.vertical.is_down()) {
            (true, 0, _) => {
                "x is taken as up, because the scans are turned around it: --up z and the like overrule this guess"
            }
            (true, ..) => {
                "y is taken as up, because the scans are turned around it: --up z and the like overrule this guess"
            }
            (_, _, false) => {
                "y is taken as up, because the scan is thin along it: --up z and the like overrule this guess"
            }
            (_, _, true) => {
                "-y is taken as up, because the scan is thin along y: --up z and the like overrule this guess"
            }
        }
    }
}

/// Guesses the vertical axis of a file. `None` if it is z, as in files with a coordinate reference
/// system and in formats of surveys.
pub fn guessed(forest: &Forest) -> Option<GuessedUp> {
    let all_are = |formats: &[&str]| {
        let is_one = |source: &SourceRecord| {
            let has_system = source.crs.as_ref().is_some_and(|crs| !crs.text.is_empty());
            !has_system && formats.iter().any(|format| source.format.starts_with(format))
        };
        sources(forest).next().is_some() && sources(forest).all(is_one)
    };
    if all_are(&[OF_SCANNERS]) {
        let axis = turned_around(&turns_of(forest)).filter(|axis| *axis != 2)?;
        return Some(GuessedUp { vertical: Vertical::of(axis, false), by_turns: true });
    }
    if !all_are(&OF_MODELS) {
        return None;
    }
    thin_along_y(forest).map(|vertical| GuessedUp { vertical, by_turns: false })
}

/// The camera with the up direction that is guessed where it has none; the axis along which
/// elevations of a scan within `bounds` are measured; and the guess. All are on the metric lattice.
pub fn upright(
    forest: &Forest,
    camera: Camera,
    bounds: [[f64; 3]; 2],
) -> (Camera, Vertical, Option<GuessedUp>) {
    match camera.up.map_or_else(|| guessed(forest), |_| None) {
        None => (camera, camera.vertical(bounds), None),
        Some(guess) => {
            let up = Some(guess.vertical.direction());
            (Camera { up, ..camera }, guess.vertical, Some(guess))
        }
    }
}

/// Rotations of the scans of all sources. Sources whose blocks cannot be read have none.
fn turns_of(forest: &Forest) -> Vec<Turn> {
    let files = forest.files();
    let blocks =
        files.flat_map(|file| (0..file.metadata().sources.len()).map(|i| file.verbatim(i)));
    blocks.flatten().flat_map(|blocks| turns(&blocks)).collect()
}

/// The axis around which at least half of the turned scans are turned: scanners on tripods and
/// turntables turn around the vertical.
fn turned_around(turns: &[Turn]) -> Option<usize> {
    let turned: Vec<&Turn> = turns.iter().filter(|turn| turn.angle >= TURNED_RAD).collect();
    let around =
        |axis: usize| turned.iter().filter(|turn| turn.axis[axis].abs() >= AROUND_COS).count();
    let axis = (0..3).max_by_key(|&axis| around(axis)).unwrap_or(2);
    let is_clear = turned.len() >= TURNED_MIN && around(axis) * 2 >= turned.len();
    is_clear.then_some(axis)
}

/// y, or the direction against it, if the points are thin along it: a landscape or a floor. Most of
/// its points are low.
fn thin_along_y(forest: &Forest) -> Option<Vertical> {
    let bounds = forest.bounds()?.map(|corner| forest.metric().world(corner));
    let shown = ForestFilter::of(forest, None, None).ok()?;
    let range = |axis, strays| central_range(forest, bounds, &shown, axis, strays).ok();
    let ranges = [range(0, STRAYS)?, range(1, STRAYS)?, range(2, STRAYS)?];
    if !is_thin_along_y(DVec3::from_array(ranges.map(|(low, high)| high - low))) {
        return None;
    }
    let (low, high) = ranges[1];
    let (below, above) = range(1, 0.5)?;
    let is_down = below.midpoint(above) - low > LOW_HALF * (high - low);
    Some(Vertical::of(1, is_down))
}

/// Whether the extent along y is at most [`THIN`] times each other one, which must not be zero.
fn is_thin_along_y(extents: DVec3) -> bool {
    [extents.x, extents.z].into_iter().all(|other| other > 0.0 && extents.y <= THIN * other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(axis: [f64; 3], degrees: f64) -> Turn {
        let axis = DVec3::from_array(axis).normalize_or_zero().to_array();
        Turn { axis, angle: degrees.to_radians() }
    }

    #[test]
    fn the_axis_of_most_turns_is_vertical() {
        let y = |degrees| turn([0.01, -1.0, 0.02], degrees);
        let other = turn([1.0, 1.0, 0.3], 140.0);
        let unturned = turn([1.0, 0.0, 0.0], 0.5);
        assert_eq!(turned_around(&[y(90.0), y(180.0), other, y(30.0), other, other]), Some(1));
        assert_eq!(turned_around(&[y(90.0), other, y(30.0), other, other]), None, "not half");
        assert_eq!(turned_around(&[y(90.0), unturned, y(30.0), unturned]), None, "too few");
        assert_eq!(turned_around(&[turn([0.0, 0.0, 1.0], 77.0); 3]), Some(2));
        assert_eq!(turned_around(&[]), None);
    }

    #[test]
    fn only_scans_that_are_clearly_thin_along_y_have_y_upwards() {
        for (extents, is_thin) in [
            ([100.0, 15.0, 80.0], true),
            ([100.0, 30.0, 80.0], false),
            ([100.0, 20.0, 30.0], false),
            ([3.0, 20.0, 18.0], false),
            ([100.0, 80.0, 10.0], false),
            ([0.156, 0.154, 0.121], false),
            ([10.0, 0.0, 9.0], true),
            ([10.0, 0.0, 0.0], false),
            ([0.0; 3], false),
        ] {
            assert_eq!(is_thin_along_y(DVec3::from_array(extents)), is_thin, "{extents:?}");
        }
    }
}
