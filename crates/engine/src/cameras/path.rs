//! The camera path of a benchmark: named views, and the time from each to the next (`kanzok2015`,
//! figure 4: overview, close view, detail). Read from a JSON file, which `bench/README.md`
//! explains, or derived from the bounds and density of the scan.

use crate::calls::info;
use crate::cameras::camera::{Camera, check_fovy};
use anyhow::{Context, Result, ensure};
use esker_format::Forest;
use esker_lod::View;
use esker_points::Lattice;
use glam::DVec3;
use serde::Deserialize;
use std::collections::HashSet;

/// Most bytes of a file.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Most views of a path.
const VIEWS_MAX: usize = 64;
/// Longest time at a view or between two views, seconds.
const SECONDS_MAX: f64 = 3600.0;

/// A path in a file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PathRecord {
    #[serde(default)]
    coordinates: Coordinates,
    views: Vec<ViewRecord>,
}

/// Coordinates of a path.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Coordinates {
    /// Coordinates of the scan.
    #[default]
    World,
    /// Fractions of the scan's bounding box: 0 is its lowest corner, 1 its highest.
    Bounds,
}

/// A view in a file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewRecord {
    name: String,
    eye: [f64; 3],
    target: [f64; 3],
    #[serde(default = "z")]
    up: [f64; 3],
    #[serde(default = "fovy_deg")]
    fovy: f64,
    #[serde(default = "travel_s")]
    travel_s: f64,
    #[serde(default = "stay_s")]
    stay_s: f64,
}

fn z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn fovy_deg() -> f64 {
    60.0
}

fn travel_s() -> f64 {
    4.0
}

fn stay_s() -> f64 {
    2.0
}

/// A camera path.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Views, at least one, in the order in which they are visited.
    pub views: Vec<Stop>,
}

/// A view at which the camera stops.
#[derive(Clone, Debug, PartialEq)]
pub struct Stop {
    /// Name of the view.
    pub name: String,
    /// Camera of the view.
    pub view: View,
    /// Point that it looks at, on the metric lattice.
    pub target: DVec3,
    /// Seconds from the previous view to this one.
    pub travel_s: f64,
    /// Seconds for which frames are timed once the view is complete.
    pub stay_s: f64,
}

impl Path {
    /// Reads a path for a scan and pictures of `size` pixels.
    ///
    /// # Errors
    /// If the file cannot be read, is not JSON of a path, or has an invalid camera.
    pub fn read(path: &std::path::Path, scan: &Forest, size: [u32; 2]) -> Result<Self> {
        use std::io::Read;
        let shown = path.display();
        let mut text = String::new();
        std::fs::File::open(path)
            .and_then(|f| f.take(FILE_BYTES_MAX).read_to_string(&mut text))
            .with_context(|| format!("{shown}: cannot read the camera path"))?;
        Self::parse(&text, (info::bounds(scan), scan.lattice()), size)
            .with_context(|| format!("{shown}: no camera path"))
    }

    /// Parses a path for pictures of `size` pixels of a scan that has a lattice, and bounds on its
    /// metric lattice.
    ///
    /// # Errors
    /// If `text` is not JSON of a path, or has an invalid camera.
    pub fn parse(
        text: &str,
        (bounds, lattice): ([[f64; 3]; 2], &Lattice),
        size: [u32; 2],
    ) -> Result<Self> {
        let record: PathRecord = serde_json::from_str(text).context("see bench/README.md")?;
        let count = record.views.len();
        ensure!((1..=VIEWS_MAX).contains(&count), "{count} views; name 1 to {VIEWS_MAX}");
        let mut names = HashSet::new();
        let stop = |v: ViewRecord| {
            v.check()?;
            ensure!(names.insert(v.name.clone()), "two views are named `{}`", v.name);
            let places = [v.eye, v.target];
            let [eye, target] = places.map(|p| record.coordinates.place(p, bounds, lattice));
            ensure!(eye != target, "in view `{}`, the target is the eye itself", v.name);
            let up = DVec3::from_array(v.up);
            let view = View::look_at(eye, target, up, v.fovy.to_radians(), size[0], size[1]);
            Ok(Stop { name: v.name, view, target, travel_s: v.travel_s, stay_s: v.stay_s })
        };
        Ok(Self { views: record.views.into_iter().map(stop).collect::<Result<_>>()? })
    }

    /// Derives the path of a scan: all of it, then nearer, then so near to a dense place that its
    /// points are a pixel apart.
    pub fn of(file: &Forest, size: [u32; 2]) -> Self {
        let overview = Camera::of_benchmarks(info::bounds(file), size);
        let [low, high] = info::bounds(file).map(DVec3::from_array);
        let middle = low.midpoint(high);
        let (dense, spacing) = dense_place(file).unwrap_or((middle, 0.0));
        // In the middle of the overview, which need not be the scan's.
        let far = overview.depth(middle);
        let ahead = overview.eye + overview.forward() * far;
        let near = (overview.focal_px() * spacing).clamp(far * 1e-4, far * 0.25);
        let stop = |name: &str, target: DVec3, distance: f64| {
            let eye = target - overview.forward() * distance;
            let view = View::look_at(eye, target, DVec3::Z, overview.fovy_rad, size[0], size[1]);
            Stop { name: name.into(), view, target, travel_s: travel_s(), stay_s: stay_s() }
        };
        Self {
            views: vec![
                Stop { view: overview, ..stop("overview", ahead, far) },
                stop("close", dense, (far * near).sqrt()),
                stop("detail", dense, near),
            ],
        }
    }

    /// View on the way to stop `to`, after `share` of the time: starts and ends gently, and changes
    /// the distance from the target by equal ratios in equal times.
    pub fn between(&self, to: usize, share: f64) -> View {
        let (a, b) = (&self.views[to.saturating_sub(1)], &self.views[to]);
        let t = share.clamp(0.0, 1.0);
        let t = t * t * (3.0 - 2.0 * t);
        let [from_a, from_b] = [a, b].map(|s| s.view.eye - s.target);
        let distance = from_a.length().powf(1.0 - t) * from_b.length().powf(t);
        let target = a.target.lerp(b.target, t);
        let mixed = (from_a.normalize_or(DVec3::Z)).lerp(from_b.normalize_or(DVec3::Z), t);
        let eye = target + mixed.normalize_or(DVec3::Z) * distance;
        let up = a.view.world_from_view.y_axis.lerp(b.view.world_from_view.y_axis, t);
        let fovy = a.view.fovy_rad + (b.view.fovy_rad - a.view.fovy_rad) * t;
        View::look_at(eye, target, up, fovy, b.view.width, b.view.height)
    }
}

impl Coordinates {
    /// Place on the metric lattice.
    fn place(self, p: [f64; 3], bounds: [[f64; 3]; 2], lattice: &Lattice) -> DVec3 {
        let [low, high] = bounds.map(DVec3::from_array);
        match self {
            Self::World => DVec3::from_array(lattice.measure(p)),
            Self::Bounds => low + (high - low) * DVec3::from_array(p),
        }
    }
}

impl ViewRecord {
    fn check(&self) -> Result<()> {
        let name = &self.name;
        ensure!(!name.is_empty() && name.len() < 100, "a view's name is empty or very long");
        let numbers = self.eye.iter().chain(&self.target).chain(&self.up);
        ensure!(numbers.into_iter().all(|v| v.is_finite()), "view `{name}` has no usable numbers");
        check_fovy(self.fovy).with_context(|| format!("view `{name}`"))?;
        for seconds in [self.travel_s, self.stay_s] {
            let usable = (0.0..=SECONDS_MAX).contains(&seconds);
            ensure!(usable, "view `{name}`: {seconds} s is out of range");
        }
        Ok(())
    }
}

/// Place that is scanned densely, and the spacing there: the first node, by spacing, that completes
/// a tenth of all points.
fn dense_place(file: &Forest) -> Option<(DVec3, f64)> {
    // Without the rest of the table, of its top.
    let whole = file.whole().ok();
    let file = whole.as_ref().unwrap_or(file);
    let mut nodes: Vec<_> = file.table().nodes.iter().filter(|n| n.spacing > 0.0).collect();
    nodes.sort_by(|a, b| a.spacing.total_cmp(&b.spacing));
    let points: usize = nodes.iter().map(|n| n.points()).sum();
    let mut finer = 0;
    let node = nodes.into_iter().find(|n| {
        finer += n.points();
        finer * 10 >= points
    })?;
    let corner = DVec3::from_array(file.metric().world(node.corner));
    let centre = DVec3::from_array(node.contour().centre);
    Some((corner + centre, f64::from(node.spacing)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: [[f64; 3]; 2] = [[100.0, 200.0, 0.0], [110.0, 220.0, 5.0]];

    fn parse(text: &str) -> Result<Path> {
        Path::parse(text, (BOUNDS, &Lattice::default()), [320, 200])
    }

    #[test]
    fn fractions_of_the_bounds_become_positions_in_the_scan() {
        let path = parse(
            r#"{"coordinates": "bounds", "views": [
                {"name": "far", "eye": [0.5, -1, 2], "target": [0.5, 0.5, 0]},
                {"name": "near", "eye": [0.5, 0, 1], "target": [0.5, 0.5, 0], "fovy": 40, "travel_s": 2}
            ]}"#,
        )
        .unwrap();
        assert_eq!(path.views[0].view.eye, DVec3::new(105.0, 180.0, 10.0));
        assert_eq!(path.views[1].travel_s, 2.0);
        let [start, end] = [0.0, 1.0].map(|share| path.between(1, share));
        assert!(start.eye.distance(path.views[0].view.eye) < 1e-9);
        assert!(end.eye.distance(path.views[1].view.eye) < 1e-9);
        assert!((end.fovy_rad.to_degrees() - 40.0).abs() < 1e-9);
        let half = path.between(1, 0.5);
        let distance = half.eye.distance(DVec3::new(105.0, 210.0, 0.0));
        let [far, near] = [path.views[0].view.eye, path.views[1].view.eye]
            .map(|eye| eye.distance(DVec3::new(105.0, 210.0, 0.0)));
        assert!((distance - (far * near).sqrt()).abs() < 1e-9, "equal ratios in equal times");
    }

    #[test]
    fn invalid_paths_are_refused() {
        for text in [
            "",
            "[]",
            r#"{"views": []}"#,
            r#"{"views": [{"name": "", "eye": [0,0,1], "target": [0,0,0]}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0,0], "target": [0,0,0]}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0], "target": [0,0,0]}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0,1], "target": [0,0,0], "fovy": 0}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0,1], "target": [0,0,0], "stay_s": -1}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0,1], "target": [0,0,0], "speed": 1}]}"#,
            r#"{"views": [{"name": "a", "eye": [0,0,1], "target": [0,0,0]},
                          {"name": "a", "eye": [0,0,2], "target": [0,0,0]}]}"#,
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
