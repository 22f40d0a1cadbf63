//! PCD: lines, records and compressed fields give the same points and attributes, exactly; wrong
//! headers and damaged bytes end in an error.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;

use cloud::{error, read, read_path, read_with};
use esker_points::AttrType;
use esker_points::lattice::GridKind;
use esker_points::task::Silent;
use esker_scan::{BESIDE_HELD_BYTES, OpenOptions, Scanner};
use proptest::prelude::*;

const FIELDS: &str = "VERSION 0.7\nFIELDS x y z rgb _ label normal_x normal_y normal_z\nSIZE 4 4 4 4 1 2 4 4 4\n\
    TYPE F F F F U I F F F\nCOUNT 1 1 1 1 3 1 1 1 1\n";
/// Size of each field, in bytes.
const BYTES: [usize; 9] = [4, 4, 4, 4, 3, 2, 4, 4, 4];

fn header(points: usize, data: &str) -> String {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n{FIELDS}WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
}

#[derive(Clone, Debug)]
struct Point {
    place: [f32; 3],
    colour: [u8; 3],
    label: i16,
}

impl Point {
    fn fields(&self) -> Vec<Vec<u8>> {
        let [r, g, b] = self.colour;
        let mut fields: Vec<Vec<u8>> = self.place.map(|c| c.to_le_bytes().to_vec()).to_vec();
        fields.push(vec![b, g, r, 0]);
        fields.push(vec![0xee; 3]);
        fields.push(self.label.to_le_bytes().to_vec());
        fields.extend([0.0f32, 0.6, -0.8].map(|c| c.to_le_bytes().to_vec()));
        fields
    }

    fn line(&self) -> String {
        let ([x, y, z], [r, g, b]) = (self.place, self.colour);
        let rgb = f32::from_le_bytes([b, g, r, 0]);
        format!("{x} {y} {z} {rgb:e} 0 0 0 {} 0 0.6 -0.8\n", self.label)
    }
}

/// A file of these points as lines, as records, or compressed (literal runs only).
fn file(points: &[Point], data: &str) -> Vec<u8> {
    let mut out = header(points.len(), data).into_bytes();
    match data {
        "ascii" => points.iter().for_each(|p| out.extend(p.line().bytes())),
        "binary" => points.iter().for_each(|p| out.extend(p.fields().concat())),
        _ => {
            let fields: Vec<_> = points.iter().map(Point::fields).collect();
            let all: Vec<u8> = (0..BYTES.len())
                .flat_map(|f| fields.iter().flat_map(move |p| p[f].clone()))
                .collect();
            let packed: Vec<u8> = all
                .chunks(32)
                .flat_map(|run| std::iter::once(run.len() as u8 - 1).chain(run.iter().copied()))
                .collect();
            out.extend((packed.len() as u32).to_le_bytes());
            out.extend((all.len() as u32).to_le_bytes());
            out.extend(packed);
        }
    }
    out
}

fn some() -> Vec<Point> {
    (0..5000)
        .map(|i| Point {
            place: [i as f32 * 0.25, -(i as f32), 7.5],
            colour: [i as u8, 255 - i as u8, 3],
            label: i as i16 - 2500,
        })
        .collect()
}

proptest! {
    #[test]
    fn every_form_gives_the_same_points(points in prop::collection::vec((prop::array::uniform3(-1000i16..1000), any::<[u8; 3]>(), any::<i16>()), 1..60)) {
        let points: Vec<Point> = points
            .into_iter()
            .map(|(p, colour, label)| Point { place: p.map(|c| f32::from(c) / 8.0), colour, label })
            .collect();
        let clouds = ["ascii", "binary", "binary_compressed"].map(|data| read(file(&points, data)).unwrap());
        let places: Vec<[f64; 3]> = points.iter().map(|p| p.place.map(f64::from)).collect();
        for cloud in &clouds {
            prop_assert_eq!(&cloud.world, &places);
            prop_assert_eq!(cloud.report.rounding_error_max, 0.0);
            prop_assert_eq!(cloud.types(), "blue:u8 green:u8 label:i16 nx:f32 ny:f32 nz:f32 red:u8");
            let colours: Vec<f64> = points.iter().map(|p| p.colour[0].into()).collect();
            prop_assert_eq!(cloud.column("red"), (AttrType::U8, colours));
            let labels: Vec<f64> = points.iter().map(|p| p.label.into()).collect();
            prop_assert_eq!(cloud.column("label").1, labels);
            prop_assert!(cloud.column("nz").1.iter().all(|&z| z == f64::from(-0.8f32)));
        }
    }

    #[test]
    fn damaged_bytes_are_an_error_or_points(at in 0usize..2000, byte: u8, form in 0usize..3) {
        let mut bytes = file(&some()[..30], ["ascii", "binary", "binary_compressed"][form]);
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(bytes);
    }
}

#[test]
fn lines_are_decimals_beyond_the_digits_of_a_single() {
    let text = "VERSION 0.7\nFIELDS X Y Z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nWIDTH 2\nHEIGHT 1\nDATA ascii\n\
        289814.15 4320978.61 170.76 4278190337\n289814.64 4320978.84 nan 1\n";
    let cloud = read(text).unwrap();
    assert_eq!(cloud.world, [[289_814.15, 4_320_978.61, 170.76]]);
    assert_eq!((cloud.info.grid.kind, cloud.info.grid.grid.scale), (GridKind::Decimal, [0.01; 3]));
    assert_eq!(cloud.types(), "alpha:u8 blue:u8 green:u8 red:u8");
    let of = |name: &str| cloud.column(name).1[0];
    assert_eq!([of("alpha"), of("red"), of("green"), of("blue")], [255.0, 0.0, 1.0, 1.0]);
    assert_eq!(cloud.refused("coordinate is not a finite number"), 1);
    let more = read(text.replace("WIDTH 2", "WIDTH 1")).unwrap();
    let notes = more.info.notes;
    assert!(notes[0].starts_with("1 line behind the 1 points that"), "{notes:?}");
}

#[test]
fn an_image_has_the_position_of_its_sensor() {
    let place = |height: &str, viewpoint: &str| {
        let text = format!(
            "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 2\nHEIGHT {height}\n{viewpoint}DATA ascii\n"
        );
        read(text + &"1 2 3\n".repeat(2 * height.parse::<usize>().unwrap())).unwrap().info.scanner
    };
    assert_eq!(place("1", "VIEWPOINT 0 0 0 1 0 0 0\n"), None);
    assert_eq!(place("2", ""), Some(Scanner::At([0.0; 3])));
    assert_eq!(place("1", "VIEWPOINT 4 5 6 1 0 0 0\n"), Some(Scanner::At([4.0, 5.0, 6.0])));
}

#[test]
fn a_viewpoint_is_reported_and_applied_on_request() {
    let text = "FIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n\
        WIDTH 1\nHEIGHT 1\nVIEWPOINT 100.25 200 300 1 0 0 1\nDATA ascii\n1.5 2 3 1 0 0\n";
    let apply = OpenOptions { apply_viewpoint: true, ..OpenOptions::default() };
    let unit = text.replace("300 1 0 0 1", "300 0.7071068 0 0 0.7071068");
    let cloud = read(unit).unwrap();
    assert_eq!(cloud.world, [[1.5, 2.0, 3.0]]);
    let note = "its VIEWPOINT is 100.25 200 300, turned: points are kept as they are; \
        --apply-viewpoint transforms them by it";
    assert_eq!(cloud.info.notes, [note]);
    assert_eq!(cloud.info.scanner, Some(Scanner::At([100.25, 200.0, 300.0])));
    // A quarter turn to the left: x becomes y, y becomes -x.
    let cloud = read_with(text, &apply).unwrap();
    assert!(cloud.lies_at(&[[98.25, 201.5, 303.0]]), "{:?}", cloud.world);
    assert_eq!(cloud.info.grid.kind, GridKind::Float);
    assert!(cloud.info.notes[0].ends_with("points and normals are transformed by it"));
    assert!((cloud.column("nx").1[0]).abs() < 1e-7 && (cloud.column("ny").1[0] - 1.0).abs() < 1e-7);
    assert_eq!(cloud.info.scanner, Some(Scanner::At([100.25, 200.0, 300.0])));
    // Decimals stay decimals if points are only moved.
    let cloud = read_with(text.replace("300 1 0 0 1", "300 1 0 0 0"), &apply).unwrap();
    assert_eq!(cloud.world, [[101.75, 202.0, 303.0]]);
    assert_eq!((cloud.info.grid.kind, cloud.info.grid.grid.scale[0]), (GridKind::Decimal, 0.01));
    let note = "its VIEWPOINT has a quaternion of length 1.4142: it is scaled to 1";
    assert_eq!(read(text).unwrap().info.notes[1], note);
    let cloud = read_with(text.replace("300 1 0 0 1", "300 0 0 0 0"), &apply).unwrap();
    assert_eq!(cloud.world, [[1.5, 2.0, 3.0]]);
    assert_eq!(cloud.info.notes, ["its VIEWPOINT is no pose and is not used"]);
    assert!(
        read(text.replace("100.25 200 300 1 0 0 1", "0 0 0 1 0 0 0"))
            .unwrap()
            .info
            .notes
            .is_empty()
    );
}

#[test]
fn fields_without_values_are_skipped() {
    for data in ["ascii", "binary"] {
        let point = match data {
            "ascii" => b"1 2 3 9 8 7 5\n".to_vec(),
            _ => [&[1.0f32, 2.0, 3.0].map(f32::to_le_bytes).concat()[..], &[9, 8, 7, 5]].concat(),
        };
        let head = format!(
            "FIELDS x y z _ _ ring _\nSIZE 4 4 4 1 1 1 1\nTYPE F F F U U U U\nCOUNT 1 1 1 3 0 1 0\n\
            WIDTH 1\nHEIGHT 1\nDATA {data}\n"
        );
        let cloud = read([head.as_bytes(), &point].concat()).unwrap();
        assert_eq!(cloud.world, [[1.0, 2.0, 3.0]]);
        assert_eq!((cloud.types(), cloud.column("ring").1), ("ring:u8".into(), vec![5.0]));
    }
    let error = error("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 0 0 0\nWIDTH 1\nDATA binary\n");
    assert!(error.contains("no field in the header has a value"), "{error}");
}

#[test]
fn truncated_or_wrong_files_are_refused_with_the_reason() {
    let points = some();
    let cut = |data: &str, by: usize| {
        let bytes = file(&points, data);
        bytes[..bytes.len() - by].to_vec()
    };
    let lies = |from: &str, to: &str, data: &str| {
        let bytes = file(&points[..3], data);
        let head = header(3, data);
        [head.replace(from, to).as_bytes(), &bytes[head.len()..]].concat()
    };
    for (bytes, want) in [
        (cut("ascii", 300), "has fewer numbers than the header has fields"),
        (cut("binary", 1), "the header claims 5000 points, the file holds 4999; it is cut"),
        (cut("binary_compressed", 1), "the file is cut"),
        (lies("POINTS 3", "POINTS 4", "binary_compressed"), "claims 4 points of 33 bytes, but"),
        (lies("POINTS 3", "POINTS 99999999999999", "binary"), "the file holds 3; it is cut"),
        (lies("POINTS 3", "POINTS 4", "ascii"), "the header claims 4 points, the file holds 3"),
        (lies("FIELDS x", "FIELDS a", "binary"), "its fields lack x, y or z"),
        (lies("label", "l l", "binary"), "`SIZE` in the header has 9 entries for 10 fields"),
    ] {
        let error = error(bytes);
        assert!(error.contains(want), "{error} / {want}");
    }
    let text = String::from_utf8(file(&points[..3], "ascii")).unwrap();
    let last = text.trim_end().rsplit_once('\n').unwrap().1;
    for (line, want) in [
        (last.replacen("0.6", "", 1), "line 14 has fewer numbers than the header has fields"),
        (format!("{last} 9"), "line 14 has more numbers"),
        (last.replacen("-2498", "40000", 1), "line 14 has `40000` for label, which is i16"),
    ] {
        let error = error(text.replace(last, &line));
        assert!(error.contains(want), "{error} / {want}");
    }
}

#[test]
fn records_behind_the_last_point_are_noted() {
    let points = some();
    let notes = |data: &str, claimed: usize, more: &[u8]| {
        let bytes = file(&points[..5], data);
        let body = &bytes[header(5, data).len()..];
        let cloud = read([header(claimed, data).as_bytes(), body, more].concat()).unwrap();
        assert_eq!(cloud.report.points, claimed as u64);
        cloud.info.notes.first().cloned().unwrap_or_default()
    };
    let behind = "behind the 3 points that the header claims are left out";
    for data in ["ascii", "binary", "binary_compressed"] {
        assert_eq!(notes(data, 5, b""), "");
    }
    assert_eq!(notes("ascii", 3, b""), format!("2 lines {behind}"));
    let want = format!("2 further records {behind}: correct the header to read them");
    assert_eq!(notes("binary", 3, b""), want);
    assert_eq!(notes("binary", 3, b"\n"), format!("67 bytes {behind}: they are no whole records"));
    assert!(notes("binary_compressed", 5, b"\n").starts_with("1 byte behind the 5 points"));
    // Zeros behind compressed points are padding.
    assert_eq!(notes("binary_compressed", 5, &[0; 3900]), "");
}

#[test]
fn packed_colours_written_as_numbers_are_read_as_such() {
    let colours = |bytes: &[u8]| {
        let cloud = read(bytes).unwrap();
        let columns = ["red", "green", "blue"].map(|name| cloud.column(name).1);
        let rgb: Vec<_> =
            (0..cloud.world.len()).map(|i| [0, 1, 2].map(|c| columns[c][i])).collect();
        (rgb, cloud.info.notes)
    };
    let head = |count: usize, data: &str| {
        format!(
            "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH {count}\nHEIGHT 1\nDATA {data}\n"
        )
    };
    let text = |words: &[&str]| {
        let lines = words.iter().map(|word| format!("1 2 3 {word}\n")).collect::<String>();
        colours((head(words.len(), "ascii") + &lines).as_bytes())
    };
    let note = "packed colours are of type F, but all are whole numbers: they are read as integers \
        (0xRRGGBB)";
    let [red, green, black] = [[255.0, 0.0, 0.0], [0.0, 255.0, 0.0], [0.0; 3]];
    let (rgb, notes) = text(&["16711680", "65280", "0", "1.671168e7"]);
    assert_eq!((rgb, notes), (vec![red, green, black, red], vec![note.to_owned()]));
    // The bits of red and green, and a value without a colour.
    let [r, g] = [0x00ff_0000u32, 0x0000_ff00].map(|bits| format!("{:e}", f32::from_bits(bits)));
    let (rgb, notes) = text(&[&r, &g, "nan", "inf"]);
    assert_eq!(rgb, [red, green, black, black]);
    assert_eq!(notes, ["2 packed colours are no numbers: they are black"]);
    // One value of another kind decides for the bits.
    assert_eq!(text(&[&r, "65280"]).0[0], red);
    assert!(text(&["0", "0"]).1.is_empty());
    let binary = |values: &[f32]| {
        let point = |&v: &f32| [1.0, 2.0, 3.0, v].map(f32::to_le_bytes).concat();
        let body: Vec<u8> = values.iter().flat_map(point).collect();
        colours(&[head(values.len(), "binary").as_bytes(), &body].concat())
    };
    let (rgb, notes) = binary(&[16_711_680.0, 65_280.0]);
    assert_eq!((rgb, notes), (vec![red, green], vec![note.to_owned()]));
    // Opaque colours are NaN or huge as singles.
    let (rgb, notes) = binary(&[f32::from_bits(0xffff_0000), f32::from_bits(0xff00_ff00)]);
    assert_eq!((rgb, notes), (vec![red, green], Vec::new()));
}

#[test]
fn compressed_points_are_held_within_memory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.pcd");
    std::fs::write(&path, file(&some(), "binary_compressed")).unwrap();
    let open = |memory_bytes| {
        let options = OpenOptions { memory_bytes: Some(memory_bytes), ..OpenOptions::default() };
        esker_scan::open(&path, &options, &Silent)
    };
    let held_bytes = open(1 << 30).unwrap().held_bytes();
    assert!(held_bytes > 2 * 5000 * 33, "{held_bytes}");
    let error = open(BESIDE_HELD_BYTES).err().unwrap().to_string();
    assert!(error.contains("give 129 MiB of --memory"), "{error}");
    assert_eq!(read_path(&path).unwrap().world.len(), 5000);
}
