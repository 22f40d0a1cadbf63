//! E57: points have the pose of their scan, exactly if they are integers; values keep their types;
//! damaged files end in an error.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;

use cloud::{error, read};
use e57::{
    E57Writer, Quaternion, Record, RecordDataType as Kind, RecordName as Name,
    RecordValue as Value, Transform, Translation,
};
use esker_points::AttrType;
use esker_points::lattice::GridKind;
use esker_scan::Scanner;
use proptest::prelude::*;
use std::io::Cursor;

struct Scan {
    prototype: Vec<Record>,
    pose: Option<Transform>,
    points: Vec<Vec<Value>>,
}

/// A file of these scans.
fn file(scans: &[Scan]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    for scan in scans {
        let mut points = writer.add_pointcloud("a scan", scan.prototype.clone()).unwrap();
        points.set_transform(scan.pose.clone());
        scan.points.iter().for_each(|point| points.add_point(point.clone()).unwrap());
        points.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn record(name: Name, data_type: Kind) -> Record {
    Record { name, data_type }
}

fn cartesian(kind: &Kind) -> Vec<Record> {
    [Name::CartesianX, Name::CartesianY, Name::CartesianZ].map(|n| record(n, kind.clone())).to_vec()
}

const DOUBLE: Kind = Kind::Double { min: None, max: None };
const SINGLE: Kind = Kind::Single { min: None, max: None };

fn pose([w, x, y, z]: [f64; 4], at: [f64; 3]) -> Option<Transform> {
    let translation = Translation { x: at[0], y: at[1], z: at[2] };
    Some(Transform { rotation: Quaternion { w, x, y, z }, translation })
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A vector rotated by a quaternion of unit length: `v + 2 u x (u x v + w v)`.
fn turned([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let u = [x, y, z];
    let inner = cross(u, v);
    let outer = cross(u, [0, 1, 2].map(|i| inner[i] + w * v[i]));
    [0, 1, 2].map(|i| v[i] + 2.0 * outer[i])
}

proptest! {
    #[test]
    fn scans_have_their_poses(scans in prop::collection::vec((prop::array::uniform4(-1.0f64..1.0), prop::array::uniform3(-1e3f64..1e3), prop::collection::vec(prop::array::uniform3(-50.0f64..50.0), 1..40)), 1..4)) {
        let (mut written, mut places, mut number, mut of) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (i, (q, at, points)) in scans.iter().enumerate() {
            let length = q.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-9);
            let q = q.map(|c| c / length);
            let length = q.iter().map(|c| c * c).sum::<f64>();
            prop_assume!((length - 1.0).abs() < 1e-9);
            let values = |p: &[f64; 3]| p.map(Value::Double).to_vec();
            written.push(Scan { prototype: cartesian(&DOUBLE), pose: pose(q, *at), points: points.iter().map(values).collect() });
            for p in points {
                let p = turned(q, *p);
                places.push([0, 1, 2].map(|i| p[i] + at[i]));
                number.push(i as f64 + 1.0);
            }
            of.push((i as u16 + 1, *at));
        }
        let cloud = read(file(&written)).unwrap();
        // Half of the largest power of ten below 2^-24 of the extent.
        prop_assert!(cloud.report.rounding_error_max < 0.5001e-4);
        let near = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).all(|i| (a[i] - b[i]).abs() < cloud.report.rounding_error_max + 1e-9);
        prop_assert!(cloud.world.len() == places.len() && cloud.world.iter().zip(&places).all(near));
        if scans.len() > 1 {
            prop_assert_eq!(cloud.column("point_source_id"), (AttrType::U16, number));
            prop_assert_eq!(cloud.info.scanner, Some(Scanner::BySource(of.into_iter().collect())));
        } else {
            prop_assert_eq!(cloud.types(), "");
            prop_assert_eq!(cloud.info.scanner, Some(Scanner::At(of[0].1)));
        }
    }

    #[test]
    fn integers_on_a_grid_are_exact(points in prop::collection::vec(prop::array::uniform3(-200_000i64..200_000), 1..60), at in prop::array::uniform3(-1000i32..1000)) {
        let kind = Kind::ScaledInteger { min: -200_000, max: 200_000, scale: 0.001, offset: 0.5 };
        let values = |p: &[i64; 3]| p.map(Value::ScaledInteger).to_vec();
        let points: Vec<_> = points.iter().map(values).collect();
        let at = at.map(f64::from);
        let cloud = read(file(&[Scan { prototype: cartesian(&kind), pose: pose([1.0, 0.0, 0.0, 0.0], at), points: points.clone() }])).unwrap();
        prop_assert_eq!((cloud.info.grid.kind, cloud.report.rounding_error_max), (GridKind::Integer, 0.0));
        for (world, point) in cloud.world.iter().zip(&points) {
            for i in 0..3 {
                let Value::ScaledInteger(n) = point[i] else { continue };
                prop_assert!((world[i] - (n as f64 * 0.001 + 0.5 + at[i])).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn damaged_bytes_are_refused(at in 0usize..4000, byte: u8) {
        let points = (0..200).map(|i| [i as f64, 1.0, -2.0].map(Value::Double).to_vec()).collect();
        let mut bytes = file(&[Scan { prototype: cartesian(&DOUBLE), pose: None, points }]);
        let at = at % bytes.len();
        let same = bytes[at] == byte;
        bytes[at] = byte;
        // Every page has a checksum. The head of the first page is read before it and says where
        // the rest is.
        let is_sound = read(&bytes).is_ok();
        prop_assert!(is_sound == same || at < 48, "{at}");
    }
}

#[test]
fn values_keep_their_types_and_invalid_points_are_refused() {
    let mut prototype = cartesian(&SINGLE);
    prototype.extend([
        record(Name::CartesianInvalidState, Kind::Integer { min: 0, max: 2 }),
        record(Name::Intensity, Kind::Integer { min: 0, max: 4095 }),
        record(Name::ColorRed, Kind::Integer { min: 0, max: 255 }),
        record(Name::ColorGreen, Kind::Integer { min: 0, max: 255 }),
        record(Name::ColorBlue, Kind::Integer { min: 0, max: 255 }),
        record(Name::RowIndex, Kind::Integer { min: -5, max: 100 }),
        record(Name::TimeStamp, DOUBLE),
        record(Name::IsColorInvalid, Kind::Integer { min: 0, max: 1 }),
    ]);
    let point = |x: f32, state: i64, colour: i64| {
        let mut values = [x, 0.25, 4.0].map(Value::Single).to_vec();
        values.extend([state, colour * 10, colour, colour + 1, colour + 2, -5].map(Value::Integer));
        values.extend([Value::Double(0.125), Value::Integer(0)]);
        values
    };
    let points = vec![point(1.5, 0, 7), point(2.5, 1, 8), point(3.5, 2, 9), point(f32::NAN, 0, 1)];
    let cloud = read(file(&[Scan { prototype, pose: None, points }])).unwrap();
    assert_eq!(
        (cloud.world.as_slice(), cloud.report.rounding_error_max),
        (&[[1.5, 0.25, 4.0]][..], 0.0)
    );
    assert_eq!(
        cloud.types(),
        "blue:u8 green:u8 intensity:u16 is_color_invalid:u8 red:u8 row_index:i8 time_stamp:f64"
    );
    let of = |name: &str| cloud.column(name).1[0];
    assert_eq!([of("intensity"), of("red"), of("green"), of("blue")], [70.0, 7.0, 8.0, 9.0]);
    assert_eq!([of("row_index"), of("time_stamp")], [-5.0, 0.125]);
    assert_eq!(
        [cloud.refused("no return"), cloud.refused("coordinate is not a finite number")],
        [2, 1]
    );
    assert_eq!(cloud.info.scanner, None);
}

#[test]
fn colours_of_a_range_become_sixteen_bits() {
    let mut prototype = cartesian(&DOUBLE);
    let share = Kind::Single { min: Some(0.0), max: Some(2.0) };
    prototype.extend(
        [Name::ColorRed, Name::ColorGreen, Name::ColorBlue].map(|n| record(n, share.clone())),
    );
    let mut point = [1.0, 2.0, 3.0].map(Value::Double).to_vec();
    point.extend([0.0, 1.0, 2.0].map(Value::Single));
    let cloud = read(file(&[Scan { prototype, pose: None, points: vec![point] }])).unwrap();
    let of = |name: &str| cloud.column(name).1[0];
    assert_eq!([of("red"), of("green"), of("blue")], [0.0, 32768.0, 65535.0]);
    assert!(cloud.info.notes[0].contains("steps of 1/65,535"), "{:?}", cloud.info.notes);
}

#[test]
fn fractions_without_a_range_get_one_by_their_values() {
    for (greatest, want) in [(1.0, 32_768.0), (255.0, 32_768.0), (65_535.0, 32_768.0)] {
        let mut prototype = cartesian(&DOUBLE);
        let names = [Name::ColorRed, Name::ColorGreen, Name::ColorBlue];
        prototype.extend(names.map(|n| record(n, SINGLE)));
        let mut point = [1.0, 2.0, 3.0].map(Value::Double).to_vec();
        point.extend([0.0, greatest / 2.0, greatest].map(Value::Single));
        let cloud = read(file(&[Scan { prototype, pose: None, points: vec![point] }])).unwrap();
        assert_eq!(cloud.column("green").1, [want]);
        assert_eq!(cloud.column("blue").1, [65_535.0]);
        let noted = cloud.info.notes.iter().any(|n| n.contains("is taken for white"));
        assert_eq!(noted, greatest > 1.0, "{:?}", cloud.info.notes);
    }
}

#[test]
fn returns_that_fit_four_bits_are_those_of_las() {
    let whole = |max| Kind::Integer { min: 0, max };
    for (max, want) in [(7, "return_count:u8 returns:u8"), (255, "return_count:u8 return_index:u8")]
    {
        let mut prototype = cartesian(&DOUBLE);
        prototype.push(record(Name::ReturnIndex, whole(max)));
        prototype.push(record(Name::ReturnCount, whole(7)));
        let mut point = [1.0, 2.0, 3.0].map(Value::Double).to_vec();
        point.extend([1, 3].map(Value::Integer));
        let cloud = read(file(&[Scan { prototype, pose: None, points: vec![point] }])).unwrap();
        assert_eq!(cloud.types(), want);
        if max == 7 {
            assert_eq!(cloud.bytes("returns"), [0x32]);
        }
    }
}

#[test]
fn directions_and_ranges_become_positions() {
    let names = [Name::SphericalRange, Name::SphericalAzimuth, Name::SphericalElevation];
    let prototype = names.map(|n| record(n, DOUBLE)).to_vec();
    let right = std::f64::consts::FRAC_PI_2;
    let values =
        [[2.0, 0.0, 0.0], [2.0, right, 0.0], [3.0, 1.0, right], [2.0, right, -right / 3.0]];
    let points = values.map(|p| p.map(Value::Double).to_vec()).to_vec();
    let cloud = read(file(&[Scan {
        prototype,
        pose: pose([1.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0]),
        points,
    }]));
    let cloud = cloud.unwrap();
    let want = [[7.0, 0.0, 0.0], [5.0, 2.0, 0.0], [5.0, 0.0, 3.0], [5.0, 3f64.sqrt(), -1.0]];
    for (is, want) in cloud.world.iter().zip(&want) {
        assert!((0..3).all(|i| (is[i] - want[i]).abs() < 1e-8), "{is:?} {want:?}");
    }
    assert_eq!(cloud.info.scanner, Some(Scanner::At([5.0, 0.0, 0.0])));
}

#[test]
fn attributes_that_a_scan_lacks_are_noted() {
    let plain = Scan {
        prototype: cartesian(&DOUBLE),
        pose: None,
        points: vec![[1.0, 2.0, 3.0].map(Value::Double).to_vec()],
    };
    let mut prototype = cartesian(&DOUBLE);
    prototype.push(record(Name::Intensity, SINGLE));
    let mut point = [4.0, 5.0, 6.0].map(Value::Double).to_vec();
    point.push(Value::Single(0.5));
    let cloud = read(file(&[plain, Scan { prototype, pose: None, points: vec![point] }])).unwrap();
    assert_eq!(cloud.types(), "intensity:f32 point_source_id:u16");
    assert_eq!(cloud.column("intensity").1, [0.0, 0.5]);
    assert_eq!(cloud.info.notes[..1], ["1 of 2 scans have no intensity: it is 0 there"]);
    assert!(cloud.info.notes[1].starts_with("point_source_id is the number of the scan"));
}

#[test]
fn scans_that_are_moved_by_whole_steps_share_a_grid() {
    let kind = Kind::ScaledInteger { min: -1000, max: 1000, scale: 0.001, offset: 0.0 };
    let scan = |at: f64, n: i64| Scan {
        prototype: cartesian(&kind),
        pose: pose([1.0, 0.0, 0.0, 0.0], [at, 0.0, 0.0]),
        points: vec![[n, 0, -n].map(Value::ScaledInteger).to_vec()],
    };
    let cloud = read(file(&[scan(0.25, 7), scan(1000.1, -3)])).unwrap();
    assert_eq!((cloud.info.grid.kind, cloud.report.rounding_error_max), (GridKind::Integer, 0.0));
    for (is, want) in cloud.world.iter().zip([[0.257, 0.0, -0.007], [1000.097, 0.0, 0.003]]) {
        assert!((0..3).all(|i| (is[i] - want[i]).abs() < 1e-9), "{is:?} {want:?}");
    }
    let cloud = read(file(&[scan(0.25, 7), scan(0.0001, -3)])).unwrap();
    assert_eq!(cloud.info.grid.kind, GridKind::Float);
}

#[test]
fn wrong_bounds_are_surveyed() {
    let kind = Kind::ScaledInteger { min: -1000, max: 1000, scale: 0.5, offset: 0.0 };
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    let mut points = writer.add_pointcloud("a scan", cartesian(&kind)).unwrap();
    points.add_point([2, 4, 6].map(Value::ScaledInteger).to_vec()).unwrap();
    let near = |at: f64| (Some(at), Some(at + 0.25));
    let [(x_min, x_max), (y_min, y_max), (z_min, z_max)] = [near(0.0), near(7.0), near(9.0)];
    let lie = e57::CartesianBounds { x_min, x_max, y_min, y_max, z_min, z_max };
    points.set_cartesian_bounds(Some(lie));
    points.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    let cloud = read(bytes.into_inner()).unwrap();
    assert_eq!(cloud.info.grid.bounds, Some([[0.0, 7.0, 9.0], [0.25, 7.25, 9.25]]));
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0]]);
}

#[test]
fn values_of_different_scans_get_types_that_hold_them() {
    let scan = |extra: Vec<Record>, values: Vec<Value>| {
        let mut prototype = cartesian(&DOUBLE);
        prototype.extend(extra);
        let mut point = [1.0, 2.0, 3.0].map(Value::Double).to_vec();
        point.extend(values);
        Scan { prototype, pose: pose([0.0, 0.0, 0.0, 1.0], [0.0; 3]), points: vec![point] }
    };
    let integer = |name: Name, min: i64, max: i64| record(name, Kind::Integer { min, max });
    let own = |name: &str| Name::Unknown { namespace: "e".into(), name: name.into() };
    let colours = |max: i64| {
        [Name::ColorRed, Name::ColorGreen, Name::ColorBlue].map(|n| integer(n, 0, max)).to_vec()
    };
    let write = |scans: &[Scan]| {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
        writer.register_extension(e57::Extension::new("e", "https://example.org/e")).unwrap();
        for scan in scans {
            let mut points = writer.add_pointcloud("a scan", scan.prototype.clone()).unwrap();
            points.set_transform(scan.pose.clone());
            scan.points.iter().for_each(|point| points.add_point(point.clone()).unwrap());
            points.finalize().unwrap();
        }
        writer.finalize().unwrap();
        drop(writer);
        read(bytes.into_inner()).unwrap()
    };
    // White is white, whatever the number of bits.
    let white = |max: i64| scan(colours(max), vec![Value::Integer(max); 3]);
    let cloud = write(&[white(255), white(1023), white(65_535)]);
    assert_eq!(cloud.column("red"), (AttrType::U16, vec![65_535.0; 3]));
    assert_eq!(cloud.info.colour_depth, Some(esker_points::ColourDepth::Sixteen));
    assert_eq!(cloud.report.colour_max, 65_535);
    // Integers get a type that holds both, and 64-bit ones are exact to the last digit.
    let row = |min: i64, max: i64, n: i64| {
        scan(vec![integer(Name::RowIndex, min, max)], vec![Value::Integer(n)])
    };
    let cloud = write(&[row(0, 200, 9), row(-300, 5, -7)]);
    assert_eq!(cloud.column("row_index"), (AttrType::I16, vec![9.0, -7.0]));
    let long = (1 << 53) + 1;
    let cloud = write(&[row(i64::MIN, i64::MAX, long)]);
    assert_eq!(cloud.types(), "row_index:i64");
    assert_eq!(cloud.bytes("row_index"), long.to_le_bytes());
    // Attributes of equal names are both kept; the scan's number has its own name.
    let meeting = |n: i64| {
        let fields = vec![
            integer(Name::Intensity, 0, 9),
            integer(own("intensity"), 0, 9),
            integer(own("point_source_id"), 0, 65_535),
        ];
        scan(fields, [n, n + 1, 70 + n].map(Value::Integer).to_vec())
    };
    let cloud = write(&[meeting(1), meeting(3)]);
    assert_eq!(
        cloud.types(),
        "intensity:u8 intensity#2:u8 point_source_id:u16 point_source_id#2:u16"
    );
    assert_eq!(cloud.column("intensity#2").1, [2.0, 4.0]);
    assert_eq!(cloud.column("point_source_id").1, [1.0, 2.0]);
    assert_eq!(cloud.column("point_source_id#2").1, [71.0, 73.0]);
    // Half a turn about z.
    let normals = ["normalX", "normalY", "normalZ"].map(|n| record(own(n), SINGLE)).to_vec();
    let cloud = write(&[scan(normals, [0.6, 0.0, 0.8].map(Value::Single).to_vec())]);
    assert_eq!(cloud.types(), "nx:f32 ny:f32 nz:f32");
    assert_eq!(cloud.column("nx").1, [f64::from(-0.6f32)]);
    assert_eq!(cloud.column("nz").1, [f64::from(0.8f32)]);
    assert!(cloud.lies_at(&[[-1.0, -2.0, 3.0]]));
}

#[test]
fn too_many_values_are_refused() {
    let mut prototype = cartesian(&DOUBLE);
    let own = |i: usize| Name::Unknown { namespace: "e".into(), name: format!("value{i}") };
    prototype.extend((0..1024).map(|i| record(own(i), Kind::Integer { min: 0, max: 1 })));
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    writer.register_extension(e57::Extension::new("e", "https://example.org/e")).unwrap();
    writer.add_pointcloud("a scan", prototype.clone()).unwrap().finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    let error = error(bytes.into_inner());
    assert!(error.contains("scan 1 has more than 1024 values"), "{error}");
    // Another scan is kept.
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    writer.register_extension(e57::Extension::new("e", "https://example.org/e")).unwrap();
    let mut many = writer.add_pointcloud("a scan", prototype).unwrap();
    let mut point = [1.0, 2.0, 3.0].map(Value::Double).to_vec();
    point.resize(3 + 1024, Value::Integer(0));
    (0..10).for_each(|_| many.add_point(point.clone()).unwrap());
    many.finalize().unwrap();
    let mut few = writer.add_pointcloud("a scan", cartesian(&DOUBLE)).unwrap();
    few.add_point([4.0, 5.0, 6.0].map(Value::Double).to_vec()).unwrap();
    few.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    let cloud = read(bytes.into_inner()).unwrap();
    assert_eq!(
        (cloud.world.as_slice(), cloud.types()),
        (&[[4.0, 5.0, 6.0]][..], "point_source_id:u16".into())
    );
    assert_eq!(cloud.column("point_source_id").1, [2.0]);
    assert_eq!(cloud.refused("point of a damaged scan"), 10);
    let note = "scan 1 has more than 1024 values a point: its 10 points are refused";
    assert_eq!(cloud.info.notes[..1], [note]);
}

#[test]
fn damaged_files_are_refused_and_poses_that_are_none_are_noted() {
    let points = vec![[1.0, 2.0, 3.0].map(Value::Double).to_vec(); 500];
    let bytes = file(&[Scan { prototype: cartesian(&DOUBLE), pose: None, points: points.clone() }]);
    for cut in [9, 40, 1000, bytes.len() - 1024] {
        error(&bytes[..cut]);
    }
    assert!(error("ASTM-E57 and nothing else").contains("cloud.las"));
    let turn = pose([0.0; 4], [0.0; 3]);
    let scan = |pose| Scan { prototype: cartesian(&DOUBLE), pose, points: points.clone() };
    let cloud = read(file(&[scan(turn)])).unwrap();
    assert!(cloud.lies_at(&[[1.0, 2.0, 3.0]; 500]));
    let turn = pose([0.0; 4], [10.0, 20.0, 30.0]);
    let cloud = read(file(&[scan(turn), scan(None)])).unwrap();
    let places = [[[11.0, 22.0, 33.0]; 500], [[1.0, 2.0, 3.0]; 500]].concat();
    assert!(cloud.lies_at(&places));
    let note = "scan 1 has a pose whose rotation is none: it is kept as not turned";
    assert_eq!(cloud.info.notes[..1], [note]);
    let long = read(file(&[scan(pose([0.0, 0.0, 0.0, 2.0], [10.0, 20.0, 30.0]))])).unwrap();
    assert!(long.lies_at(&[[9.0, 18.0, 33.0]; 500]), "{:?}", long.world[0]);
    let note = "scan 1: its rotation is a quaternion of length 2.0000, which is scaled to 1";
    assert_eq!(long.info.notes, [note]);
    let nothing = read(file(&[])).unwrap();
    assert!(nothing.world.is_empty() && nothing.info.notes == ["has no points"]);
}

#[test]
fn one_damaged_scan_does_not_cost_the_others() {
    let scan = |kind: &Kind, from: i64, points: i64| Scan {
        prototype: cartesian(kind),
        pose: None,
        points: (from..from + points)
            .map(|i| {
                [i, 1, -2]
                    .map(|n| match kind {
                        Kind::Double { .. } => Value::Double(n as f64),
                        _ => Value::ScaledInteger(n),
                    })
                    .to_vec()
            })
            .collect(),
    };
    let grid = Kind::ScaledInteger { min: -9_000_000, max: 9_000_000, scale: 1.0, offset: 0.0 };
    for kind in [DOUBLE, grid] {
        let whole =
            file(&[scan(&kind, 0, 4000), scan(&kind, 100_000, 4000), scan(&kind, 50_000, 4000)]);
        // Damages a page in the midst of the second scan, which no other scan is in.
        let mut bytes = whole.clone();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x55;
        let cloud = read(&bytes).unwrap();
        let lost = cloud.refused("point of a damaged scan");
        let of = |from: i64| {
            let range = from as f64..(from + 4000) as f64;
            cloud.world.iter().filter(|p| range.contains(&p[0])).count() as u64
        };
        assert_eq!([of(0), of(50_000), of(100_000) + lost], [4000; 3]);
        assert!(lost > 0 && cloud.report.refused.len() == 1, "{lost}");
        let note = &cloud.report.notes[0];
        assert!(note.starts_with("scan 2: ") && note.contains("4000 points are kept"), "{note}");
    }
}
