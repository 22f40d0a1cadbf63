//! Previews read one in so many points: each is a point of the whole file with all its values, and
//! they are spread over all of it, whatever its format. Damaged files end in an error.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;
mod data;

use cloud::{Cloud, is_error_one_line, read, read_with};
use e57::{
    E57Writer, Quaternion, Record, RecordDataType as Kind, RecordName as Name,
    RecordValue as Value, Transform, Translation,
};
use esker_scan::OpenOptions;
use std::collections::BTreeMap;
use std::io::Cursor;

/// Points of the files.
const POINTS: u32 = 40_000;

fn one_in(one_in: u32) -> OpenOptions {
    OpenOptions { one_in, ..OpenOptions::default() }
}

fn place(i: u32) -> [f64; 3] {
    let across = f64::from(i % 200) / 4.0;
    [f64::from(i / 200) / 2.0, across, f64::from(i.wrapping_mul(2_654_435_761) % 4096) / 32.0]
}

fn class(i: u32) -> u32 {
    i / 7 % 20
}

/// The values of a point by their names, and its position.
type Point = (Vec<(String, f64)>, [f64; 3]);

/// The points by their numbers.
fn points(cloud: &Cloud) -> BTreeMap<u64, Point> {
    let (_, numbers) = cloud.column("number");
    let columns = cloud.names().into_iter().map(|name| (name, cloud.column(name).1));
    let columns: Vec<(&str, Vec<f64>)> = columns.collect();
    let rows = cloud.world.iter().enumerate().map(|(row, &at)| {
        let values = columns.iter().map(|(name, column)| (name.to_string(), column[row]));
        (numbers[row] as u64, (values.collect(), at))
    });
    rows.collect()
}

/// Checks that the share of a file are points of the whole, as many as wanted, and from all of it.
fn assert_share(file: &[u8], share: u32, gap: u64) {
    let (whole, part) = (read(file).unwrap(), read_with(file, &one_in(share)).unwrap());
    let (all, some) = (points(&whole), points(&part));
    assert_eq!(some.len(), part.world.len(), "each at most once");
    assert_eq!(part.info.points_hint, part.world.len() as u64);
    let wanted = f64::from(POINTS) / f64::from(share);
    let found = some.len() as f64;
    assert!((0.9 * wanted..=1.1 * wanted).contains(&found), "{found} of {wanted}");
    let slack = whole.report.rounding_error_max + part.report.rounding_error_max + 1e-9;
    for (number, (values, at)) in &some {
        let (same, place) = &all[number];
        assert_eq!(values, same);
        assert!((0..3).all(|i| (at[i] - place[i]).abs() <= slack), "{at:?} {place:?}");
    }
    let numbers: Vec<u64> = some.into_keys().chain([u64::from(POINTS)]).collect();
    let widest = numbers.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    assert!(numbers[0] < gap && widest < gap, "{} {widest}", numbers[0]);
    let note = format!("one in {share} of its points");
    assert!(part.info.notes.iter().any(|other| other.contains(&note)));
}

/// A PLY file with an element before the vertices and, if it is binary, one behind them.
fn ply(format: &str) -> Vec<u8> {
    let is_ascii = format == "ascii";
    let beside = |name: &str| match is_ascii {
        true => String::new(),
        false => format!("element {name} 3\nproperty short a\nproperty uchar b\n"),
    };
    let header = format!(
        "ply\nformat {format} 1.0\ncomment x\n{}element vertex {POINTS}\nproperty float x\n\
         property float y\nproperty double z\nproperty uint number\nproperty uchar red\nproperty \
         uchar green\nproperty uchar blue\nproperty uchar classification\n{}end_header\n",
        beside("before"),
        beside("behind"),
    );
    let mut bytes = header.into_bytes();
    let is_big = format == "binary_big_endian";
    let mut put = |value: &[u8]| match is_big {
        true => bytes.extend(value.iter().rev()),
        false => bytes.extend(value),
    };
    let beside = if is_ascii { 0 } else { 9 };
    (0..beside).for_each(|i| put(&[i]));
    let mut lines = String::new();
    for i in 0..POINTS {
        let ([x, y, z], [red, green, blue]) = (place(i), [i, i / 256, 7].map(|c| c as u8));
        if is_ascii {
            lines += &format!("{x} {y} {z} {i} {red} {green} {blue} {}\n", class(i));
            continue;
        }
        put(&(x as f32).to_le_bytes());
        put(&(y as f32).to_le_bytes());
        put(&z.to_le_bytes());
        put(&i.to_le_bytes());
        [red, green, blue, class(i) as u8].into_iter().for_each(|value| put(&[value]));
    }
    (0..beside).for_each(|i| put(&[i]));
    bytes.extend(lines.bytes());
    bytes
}

fn pcd(data: &str) -> Vec<u8> {
    let header = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z number rgb _\nSIZE 4 4 4 4 4 1\nTYPE F F F U U U\n\
         COUNT 1 1 1 1 1 3\nWIDTH {POINTS}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\n\
         DATA {data}\n"
    );
    let mut bytes = header.into_bytes();
    for i in 0..POINTS {
        let [x, y, z] = place(i);
        if data == "ascii" {
            bytes.extend(format!("{x} {y} {z} {i} {} 0 0 0\n", 77 * i).bytes());
        } else {
            [x, y, z].into_iter().for_each(|c| bytes.extend((c as f32).to_le_bytes()));
            [i, 77 * i].into_iter().for_each(|value| bytes.extend(value.to_le_bytes()));
            bytes.extend([9; 3]);
        }
    }
    bytes
}

/// Lines of points behind `head`, with `mark` between numbers and `end` behind lines. Every 1,000th
/// line is followed by `odd`.
fn text(head: &str, mark: &str, end: &str, odd: &str) -> Vec<u8> {
    let mut text = head.replace('\n', end);
    for i in 0..POINTS {
        let [x, y, z] = place(i).map(|c| c.to_string());
        let (number, class, red) = (i.to_string(), class(i).to_string(), (i % 256).to_string());
        text += &[x, y, z, number, class, red.clone(), red.clone(), red].join(mark);
        text += end;
        text += if i % 1000 == 999 { odd } else { "" };
    }
    text.into_bytes()
}

const NAMES: &str = "x y z number classification red green blue\n";

#[test]
fn shares_of_ply_files_are_spread_over_them() {
    for format in ["binary_little_endian", "binary_big_endian", "ascii"] {
        for share in [2, 7, 30] {
            assert_share(&ply(format), share, 700 * u64::from(share));
        }
    }
}

#[test]
fn shares_of_pcd_files_are_spread_over_them() {
    for data in ["binary", "ascii"] {
        for share in [2, 7, 30] {
            assert_share(&pcd(data), share, 700 * u64::from(share));
        }
    }
}

#[test]
fn shares_of_text_are_spread_over_it() {
    let comments = format!("# one\n{}{NAMES}", "# two\n".repeat(5000));
    let comma = NAMES.replace(' ', ",");
    for share in [2, 7, 30] {
        let gap = 700 * u64::from(share);
        assert_share(&text(NAMES, " ", "\n", ""), share, gap);
        assert_share(&text(NAMES, "\t", "\r\n", "\r\n\r\n"), share, gap);
        assert_share(&text(NAMES, " ", "\r", "\r"), share, gap);
        assert_share(&text(&comma, ",", "\n", "# a comment\n\n"), share, gap);
        assert_share(&text(&comments, " ", "\n", "1 2\n"), share, gap);
        let marked = [b"\xEF\xBB\xBF", text(NAMES, " ", "\n", "").as_slice()].concat();
        assert_share(&marked, share, gap);
        // The last line has no end.
        let open = text(NAMES, " ", "\n", "");
        assert_share(&open[..open.len() - 1], share, gap);
    }
    // Long lines take the place of points.
    let long = format!("# {}\n", "long ".repeat(10_000));
    assert_share(&text(NAMES, " ", "\n", &long), 2, 10_000);
}

#[test]
fn shares_of_pts_files_begin_behind_the_count() {
    let scan = |points: u32| {
        let line = |i: u32| {
            let [x, y, z] = place(i);
            format!("{x} {y} {z} {} {} 0 9\n", i % 4096 * 4, i % 256)
        };
        let lines: String = (0..points).map(line).collect();
        format!("{points}\n{lines}")
    };
    let whole = read(scan(POINTS)).unwrap();
    let part = read_with(scan(POINTS), &one_in(9)).unwrap();
    assert!(part.world.len().abs_diff(POINTS as usize / 9) < 200, "{}", part.world.len());
    assert_eq!(part.info.format, whole.info.format);
    assert_eq!(part.names(), whole.names());
    let mut rest = whole.world.iter();
    assert!(part.world.iter().all(|point| rest.any(|other| other == point)));
}

fn cartesian(kind: &Kind) -> Vec<Record> {
    let axes = [Name::CartesianX, Name::CartesianY, Name::CartesianZ];
    axes.map(|name| Record { name, data_type: kind.clone() }).to_vec()
}

/// A file of scans with so many points each, that are numbered by their intensities. Numbers and
/// classes have bits that are no whole bytes.
fn e57(scans: &[u32], is_scaled: bool) -> Vec<u8> {
    let scaled = Kind::ScaledInteger { min: -7, max: 30_000_000, scale: 1.0 / 4096.0, offset: 3.0 };
    let double = Kind::Double { min: None, max: None };
    let mut prototype = cartesian(if is_scaled { &scaled } else { &double });
    let record = |name, min, max| Record { name, data_type: Kind::Integer { min, max } };
    prototype.push(record(Name::Intensity, 0, i64::from(POINTS)));
    prototype.push(record(Name::ReturnIndex, 0, 4));
    prototype.push(record(Name::ReturnCount, 4, 4));
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "a file").unwrap();
    let mut first = 0;
    for &count in scans {
        let mut points = writer.add_pointcloud("a scan", prototype.clone()).unwrap();
        let translation = Translation { x: f64::from(count), y: 0.0, z: -2.0 };
        let rotation = Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
        points.set_transform(Some(Transform { rotation, translation }));
        for i in first..first + count {
            let at = place(i).map(|c| match is_scaled {
                true => Value::ScaledInteger(((c - 3.0).max(0.0) * 4096.0) as i64),
                false => Value::Double(c),
            });
            let others = [i64::from(i), i64::from(i % 5), 4].map(Value::Integer);
            points.add_point([&at[..], &others].concat()).unwrap();
        }
        points.finalize().unwrap();
        first += count;
    }
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn shares_of_e57_files_have_points_of_all_scans() {
    for (scans, is_scaled) in
        [(vec![POINTS], false), (vec![POINTS], true), (vec![10_000, 7, 20_000, 1, 9_992], true)]
    {
        for share in [2, 7, 30] {
            let file = e57(&scans, is_scaled);
            let (whole, part) = (read(&file).unwrap(), read_with(&file, &one_in(share)).unwrap());
            assert_eq!(part.info.points_hint, part.world.len() as u64);
            let wanted = f64::from(POINTS) / f64::from(share);
            let found = part.world.len() as f64;
            assert!((0.9 * wanted..=1.1 * wanted).contains(&found), "{found} of {wanted}");
            assert_eq!(part.types(), whole.types());
            let (_, numbers) = part.column("intensity");
            assert!(numbers.is_sorted_by(|a, b| a < b));
            let slack = whole.report.rounding_error_max + part.report.rounding_error_max + 1e-9;
            for (row, &number) in numbers.iter().enumerate() {
                let same = number as usize;
                for name in part.names() {
                    assert_eq!(part.column_at(name, row), whole.column_at(name, same), "{name}");
                }
                let (at, place) = (part.world[row], whole.world[same]);
                assert!((0..3).all(|i| (at[i] - place[i]).abs() <= slack));
            }
            let mut first = 0.0;
            for &points in &scans {
                let end = first + f64::from(points);
                let of = numbers.iter().filter(|n| (first..end).contains(*n)).count() as u32;
                assert!(of.abs_diff(points.div_ceil(share)) <= 1, "{of} of {points}");
                first = end;
            }
            let ends = [vec![0.0], numbers, vec![f64::from(POINTS)]].concat();
            let gap = ends.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
            assert!(gap <= 12_000.0, "{gap}");
        }
    }
}

/// Whether some points come in this order among those of the whole file, with the same values where
/// both have them.
fn are_in_order(part: &Cloud, whole: &Cloud) -> bool {
    let names = part.names();
    let common = names.iter().filter(|name| whole.info.schema.find(name).is_some());
    let columns: Vec<[Vec<f64>; 2]> =
        common.map(|name| [part.column(name).1, whole.column(name).1]).collect();
    let slack = whole.report.rounding_error_max + part.report.rounding_error_max;
    let is_same = |row: usize, of: usize| {
        let (at, place) = (part.world[row], whole.world[of]);
        let is_near = |i: usize| (at[i] - place[i]).abs() <= slack + 1e-12 * place[i].abs();
        let is_equal =
            |[a, b]: &[Vec<f64>; 2]| a[row] == b[of] || a[row].is_nan() && b[of].is_nan();
        (0..3).all(is_near) && columns.iter().all(is_equal)
    };
    let mut rows = 0..whole.world.len();
    (0..part.world.len()).all(|row| rows.any(|of| is_same(row, of)))
}

#[test]
fn shares_of_real_scans_are_points_of_them() {
    let Some(folder) = data::folder() else { return };
    let mut read = 0;
    for entry in data::manifest(&folder) {
        let path = folder.join(&entry.name);
        let is_large = std::fs::metadata(&path).is_ok_and(|file| file.len() > 30 << 20);
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        let is_las = ending == "las" || ending == "laz";
        let Some(points) = entry.points.filter(|_| !is_large && !is_las) else { continue };
        let part = match cloud::read_path_with(&path, &one_in(5)) {
            Ok(part) => part,
            Err(error) => {
                assert!(error.to_string().contains("in part"), "{error}");
                continue;
            }
        };
        let whole = cloud::read_path(&path).unwrap();
        assert!(are_in_order(&part, &whole), "{}", entry.name);
        if points > 50_000 {
            let found = part.world.len() as f64 / whole.world.len() as f64;
            assert!((0.17..0.23).contains(&found), "{}: {found}", entry.name);
        }
        read += 1;
    }
    assert!(read > 5, "{read}");
}

#[test]
fn shares_greater_than_a_file_and_files_without_points_are_read() {
    let few = "x y z\n1 2 3\n4 5 6\n7 8 9\n";
    let header = |n| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        )
    };
    for file in [few.to_owned(), header(3) + "1 2 3\n4 5 6\n7 8 9\n"] {
        let cloud = read_with(&file, &one_in(1000)).unwrap();
        assert_eq!(cloud.world, [[1.0, 2.0, 3.0]]);
    }
    for file in ["x y z\n".to_owned(), header(0)] {
        assert_eq!(read_with(&file, &one_in(2)).unwrap().world.len(), 0);
    }
    assert!(read_with("", &one_in(2)).is_err());
}

#[test]
fn files_that_are_cut_or_damaged_end_in_an_error_or_in_points() {
    let files = [
        ply("binary_little_endian"),
        ply("ascii"),
        pcd("binary"),
        pcd("ascii"),
        text(NAMES, " ", "\n", "1 two 3\n"),
        e57(&[3000, 2000], true),
    ];
    for file in files {
        for cut in [1, 100, 300, 5000, file.len() / 2, file.len() - 1, file.len() - 3] {
            assert!(is_error_one_line(read_with(&file[..cut], &one_in(3))));
        }
        let step = file.len() / 50;
        for at in (0..file.len()).step_by(step) {
            let mut damaged = file.clone();
            damaged[at..file.len().min(at + 16)].fill(0xFF);
            assert!(is_error_one_line(read_with(&damaged, &one_in(3))));
        }
    }
}

#[test]
fn files_that_cannot_be_read_in_part_say_so() {
    let ply = |elements: &str| format!("ply\nformat ascii 1.0\n{elements}end_header\n");
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    let list = "element face 1\nproperty list uchar int vertex_indices\n";
    let mut binary = ply(&format!("{list}{vertex}")).replace("ascii", "binary_little_endian");
    binary += "\0            ";
    let utf_16: Vec<u8> = "x y z\n1 2 3\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let lines = "1 2 3\n".repeat(1000);
    let ptx = "1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 0.5\n";
    let gzip = {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, b"x y z\n1 2 3\n").unwrap();
        packed.finish().unwrap()
    };
    for file in [
        ply(&format!("{vertex}{list}")).into_bytes(),
        (ply(vertex) + &lines).into_bytes(),
        binary.into_bytes(),
        utf_16,
        gzip,
        ptx.into(),
    ] {
        let error = read_with(&file, &one_in(2)).err().unwrap().to_string();
        assert!(error.contains("cannot be read in part"), "{error}");
    }
}
