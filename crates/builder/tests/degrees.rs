//! Scans in degrees: their coordinates stay exact, and spacing, contours and normals are in metres,
//! as those of the same ground in a projected system. The latitude is that of nearly all points.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{NormalsMode, Options, Resume, Shares};
use esker_builder::{append_sources, build_shared, build_sources, merge};
use esker_format::{EskerFile, Forest, verify};
use esker_points::quant::oct_decode;
use esker_points::task::Silent;
use esker_points::{AttrType, Node, Task};
use esker_scan::source::Crs;
use given::{Given, boxed, given, whole, whole_by};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Steps of the scans in degrees: about a centimetre, and a millimetre of height.
const STEPS: [f64; 3] = [1e-7, 1e-7, 1e-3];
/// Sides of the ground, metres.
const SIDES_M: [f64; 2] = [600.0, 450.0];
const POINTS: u64 = 6000;

/// Place on the ellipsoid WGS 84, metres from the centre of the earth, by its parametric form.
fn place([longitude, latitude, height]: [f64; 3]) -> [f64; 3] {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2: f64 = f * (2.0 - f);
    let (sin, cos) = latitude.to_radians().sin_cos();
    let (east, north) = longitude.to_radians().sin_cos();
    let n = a / (1.0 - e2 * sin * sin).sqrt();
    [(n + height) * cos * north, (n + height) * cos * east, (n * (1.0 - e2) + height) * sin]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// Metres of a degree of longitude and of latitude, measured on the ellipsoid.
fn degree_m(latitude: f64) -> [f64; 2] {
    let step = 1e-3;
    let at = |x: f64, y: f64| place([x, latitude + y, 0.0]);
    [
        distance(at(-step, 0.0), at(step, 0.0)) / (2.0 * step),
        distance(at(0.0, -step), at(0.0, step)) / (2.0 * step),
    ]
}

/// Height of the ground and its normal at a place in metres.
fn ground([x, y]: [f64; 2]) -> (f64, [f64; 3]) {
    let (u, v) = (x / 90.0, y / 70.0);
    let height = 60.0 + 20.0 * u.sin() * v.cos();
    (height, [-20.0 / 90.0 * u.cos() * v.cos(), 20.0 / 70.0 * u.sin() * v.sin(), 1.0])
}

/// The ground in degrees around a latitude, and a copy of the same points in metres, in steps of a
/// tenth of a millimetre; each point has its number.
fn both(latitude: f64) -> [Given; 2] {
    let [x_m, y_m] = degree_m(latitude);
    let (mut degrees, mut metres) = (Vec::new(), Vec::new());
    for i in 0..POINTS {
        let at = [0, 1].map(|k| f64::from(below(2 * i + k as u64, 1 << 24)) / f64::from(1 << 24));
        let [x, y] = [0, 1].map(|k| (at[k] - 0.5) * SIDES_M[k]);
        let raw = [x / x_m / STEPS[0], y / y_m / STEPS[1], ground([x, y]).0 / STEPS[2]];
        let raw = raw.map(|c| c.round() as i32);
        degrees.push(raw);
        let step = [STEPS[0] * x_m, STEPS[1] * y_m, STEPS[2]];
        metres.push([0, 1, 2].map(|k| (f64::from(raw[k]) * step[k] / 1e-4).round() as i32));
    }
    let number = |given: Given| given.with("number", AttrType::U32, |i| i);
    let degrees = number(given("degrees.las", STEPS, degrees)).at([8.5, latitude, 0.0]);
    [located(degrees, "EPSG:4326"), number(given("metres.las", [1e-4; 3], metres))]
}

/// The scan with a coordinate reference system.
fn located(mut scan: Given, crs: &str) -> Given {
    scan.info.crs = Some(crs.parse::<Crs>().unwrap());
    scan
}

fn options() -> Options {
    Options { node_capacity: 1024, normals: NormalsMode::Estimate, ..Options::default() }
}

/// Mean spacing of the points in leaves.
fn spacing(file: &EskerFile) -> f64 {
    let leaves = || file.table().nodes.iter().filter(|node| node.child_count == 0);
    let points: f64 = leaves().map(|node| node.points() as f64).sum();
    leaves().map(|node| f64::from(node.spacing) * node.points() as f64).sum::<f64>() / points
}

/// Normals by the number of the point.
fn normals(file: &EskerFile) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0; 3]; POINTS as usize];
    for node in 0..file.table().nodes.len() as u32 {
        let points = file.read_page(node).unwrap().points().unwrap();
        let numbers = points.columns[0].as_chunks::<4>().0;
        for (number, &code) in numbers.iter().zip(&points.normals) {
            normals[u32::from_le_bytes(*number) as usize] = oct_decode(code).map(f64::from);
        }
    }
    normals
}

/// Angles between two lists of lines, degrees, in ascending order.
fn angles(a: &[[f64; 3]], b: &[[f64; 3]]) -> Vec<f64> {
    let cosine = |(a, b): (&[f64; 3], &[f64; 3])| {
        let dot = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    };
    let angle = |pair| cosine(pair).abs().min(1.0).acos().to_degrees();
    let mut angles: Vec<f64> = a.iter().zip(b).map(angle).collect();
    angles.sort_by(f64::total_cmp);
    angles
}

#[test]
fn a_scan_in_degrees_is_built_as_its_projected_copy() {
    for latitude in [0.0, 47.0, -80.0] {
        let [degrees, metres] = both(latitude);
        let build = |out: &Path| {
            build_sources(boxed(std::slice::from_ref(&degrees)), out, &options(), &Silent).unwrap()
        };
        // All points are there with their exact coordinates.
        let (report, file) = whole_by(std::slice::from_ref(&degrees), build);
        let (_, copy) = whole(std::slice::from_ref(&metres), &options());
        assert_eq!((file.metadata().version(), copy.metadata().version()), (2, 1));
        let lattice = file.metadata().lattice;
        assert_eq!((lattice.scale, lattice.offset), (STEPS, [8.5, latitude, 0.0]));
        assert_eq!(report.rounding_error_max, 0.0);

        let [x_m, y_m] = degree_m(latitude);
        for (factor, wanted) in lattice.factor.into_iter().zip([x_m, y_m, 1.0]) {
            assert!((factor / wanted - 1.0).abs() < 1e-4, "{latitude}: {factor} {wanted}");
        }
        let (ours, theirs) = (spacing(&file), spacing(&copy));
        assert!((ours / theirs - 1.0).abs() < 0.1, "{latitude}: spacing {ours}, {theirs}");
        let root = |file: &EskerFile| file.table().nodes[0];
        let volume = |node: &Node| node.contour_half.map(f64::from).iter().product::<f64>();
        let (ours, theirs) = (volume(&root(&file)), volume(&root(&copy)));
        assert!((ours / theirs - 1.0).abs() < 0.1, "{latitude}: volume {ours}, {theirs}");

        let truth = degrees.positions.iter().map(|p| {
            ground([f64::from(p[0]) * STEPS[0] * x_m, f64::from(p[1]) * STEPS[1] * y_m]).1
        });
        let truth: Vec<[f64; 3]> = truth.collect();
        let [own, theirs] = [&file, &copy].map(|file| angles(&normals(file), &truth));
        let at = |angles: &[f64], share: f64| angles[(angles.len() as f64 * share) as usize];
        for share in [0.5, 0.95] {
            let (own, theirs) = (at(&own, share), at(&theirs, share));
            assert!(own < 3.0 && own < theirs * 1.2 + 0.1, "{latitude}: {share} {own} {theirs}");
        }
    }
}

#[test]
fn lengths_of_the_metric_lattice_are_those_on_the_ellipsoid() {
    for latitude in [-80.0, 12.0, 47.0] {
        let (_, file) = whole(&both(latitude)[..1], &options());
        let (lattice, metric) = (file.metadata().lattice, file.metadata().lattice.metric());
        let mut points = Vec::new();
        for node in 0..file.table().nodes.len() as u32 {
            points.extend(file.read_page(node).unwrap().points().unwrap().positions);
        }
        for pair in points.chunks_exact(2).take(200) {
            let ours = distance(metric.world(pair[0]), metric.world(pair[1]));
            let wanted = distance(place(lattice.world(pair[0])), place(lattice.world(pair[1])));
            assert!((ours / wanted - 1.0).abs() < 1e-3, "{latitude}: {ours} {wanted}");
        }
    }
}

/// A scan with points at 0, 0, as programs write them that have no place for a point.
#[test]
fn strays_do_not_move_the_latitude() {
    let [clean, _] = both(47.0);
    let wanted = whole(std::slice::from_ref(&clean), &options()).1.metadata().lattice.factor;
    let mut strayed = clean.clone();
    strayed.positions[7] = [-85_000_000, -470_000_000, 0];
    let strayed = strayed.at([8.5, 47.0, 0.0]);
    let claiming = clean.clone().claiming(Some([[0.0; 3], [8.5, 47.0, 90.0]]));
    let claiming_nothing = clean.claiming(Some([[0.0; 3]; 2]));
    for scan in [strayed, claiming, claiming_nothing] {
        let found = whole(&[scan], &options()).1.metadata().lattice.factor;
        for (found, wanted) in found.into_iter().zip(wanted) {
            assert!((found / wanted - 1.0).abs() < 1e-5, "{found} {wanted}");
        }
    }
}

#[test]
fn heights_in_feet_are_scaled_too() {
    let wkt = r#"COMPD_CS["both",GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]],VERT_CS["v",UNIT["foot",0.3048]]]"#;
    let [scan, _] = both(47.0);
    let (_, file) = whole(&[located(scan, wkt)], &options());
    assert_eq!(file.metadata().lattice.factor[2], 0.3048);
}

#[test]
fn what_is_not_geographic_is_not_scaled() {
    let [degrees, metres] = both(47.0);
    let projected = located(metres, "EPSG:2154");
    // A system of degrees, but coordinates that are none.
    let wrong = located(projected.clone().at([0.0, 5e6, 0.0]), "EPSG:4326");
    // A room whose device writes its own system, in steps of a millimetre.
    let room = (0..POINTS).map(|i| [0, 1, 2].map(|k| below(3 * i + k, 4000))).collect();
    let room = located(given("room.las", [1e-3; 3], room), "EPSG:4326");
    let unstated = Given {
        info: esker_scan::SourceInfo { crs: None, ..degrees.info.clone() },
        ..degrees.clone()
    };
    for scan in [projected.clone(), wrong, room, unstated] {
        let (report, file) = whole(&[scan], &options());
        assert_eq!(file.metadata().version(), 1);
        let is_wrong =
            file.metadata().sources[0].crs.as_ref().is_some_and(|c| c.text.contains("4326"));
        let is_noted = report.notes.iter().any(|note| note.contains("pictures are distorted"));
        assert_eq!(is_noted, is_wrong);
    }
    // Coordinates of both kinds as they are.
    let options = Options { ignore_crs: true, ..options() };
    let mut projected = projected;
    projected.info.path = "z.las".into();
    let (_, file) = whole(&[degrees, projected], &options);
    assert_eq!(file.metadata().version(), 1);
}

/// Cancels the task after a number of checks; keeps its notes.
struct Stops(AtomicU64, Mutex<Vec<String>>);

impl Stops {
    fn after(checks: u64) -> Self {
        Self(checks.into(), Mutex::default())
    }
}

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.0.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1)).is_err()
    }
    fn note(&self, line: &str) {
        self.1.lock().unwrap().push(line.into());
    }
}

#[test]
fn a_resumed_build_has_the_same_factors_and_bytes() {
    // The latitude is measured, since there is a stray, and the journal keeps it.
    let [mut scan, _] = both(47.0);
    scan.positions[7] = [-85_000_000, -470_000_000, 0];
    let scan = scan.at([8.5, 47.0, 0.0]);
    let shares = Shares { buffer_bytes_max: 20_000, chunk_bytes_max: 40_000 };
    let build = |out: &Path, resume, task: &dyn Task| {
        let options = Options { node_capacity: 64, resume, ..Options::default() };
        build_shared(vec![scan.boxed()], out, &options, shares, task)
    };
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.esker");
    build(&whole, Resume::Never, &Silent).unwrap();
    let mut resumed = 0;
    for checks in [3, 10, 20, 40, 80] {
        let out = folder.path().join(format!("{checks}.esker"));
        if build(&out, Resume::Later, &Stops::after(checks)).is_ok() {
            continue;
        }
        let task = Stops::after(u64::MAX);
        build(&out, Resume::Now, &task).unwrap();
        let is_fresh = |note: &String| note.contains("nothing to resume");
        resumed += u32::from(!task.1.lock().unwrap().iter().any(is_fresh));
        assert!(std::fs::read(&out).unwrap() == std::fs::read(&whole).unwrap(), "{checks}");
    }
    assert!(resumed > 0);
}

#[test]
fn an_append_keeps_the_factors_and_a_merge_needs_them_equal() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let [first, _] = both(47.0);
    let [mut next, _] = both(47.004);
    let [mut far, _] = both(49.0);
    (next.info.path, far.info.path) = ("next.las".into(), "far.las".into());
    let build = |scan: &Given, name: &str| {
        build_sources(vec![scan.boxed()], &at(name), &options(), &Silent).unwrap();
    };
    build(&first, "first.esker");
    build(&far, "far.esker");
    let old = Forest::open(&at("first.esker")).unwrap();
    append_sources(&old, vec![next.boxed()], &at("both.esker"), &options(), &Silent).unwrap();
    let forest = Forest::open(&at("both.esker")).unwrap();
    for file in forest.files() {
        assert_eq!(file.metadata().lattice, *old.lattice());
        assert_eq!(file.metadata().version(), 2);
        verify(file, &Silent).unwrap();
    }
    let merged = |files: &[&str], out: &str| {
        let files: Vec<_> = files.iter().map(|name| at(name)).collect();
        merge(&files, &at(out), &options(), &Silent)
    };
    merged(&["both.esker"], "merged.esker").unwrap();
    let file = EskerFile::open(&at("merged.esker")).unwrap();
    assert_eq!(file.metadata().lattice, *old.lattice());
    assert_eq!(verify(&file, &Silent).unwrap().points, 2 * POINTS);
    let error = merged(&["first.esker", "far.esker"], "none.esker").unwrap_err().to_string();
    assert!(error.contains("different lattices"), "{error}");
}
