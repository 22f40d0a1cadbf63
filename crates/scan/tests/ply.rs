//! PLY: every encoding gives the same points and attributes, exactly; wrong headers and damaged
//! bytes end in an error or in the sound points, never in a panic.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

use esker_points::lattice::{GridKind, Lattice};
use esker_points::{AttrType, ColourDepth};
use proptest::prelude::*;

mod cloud;
mod data;

use cloud::{error, is_error_one_line, read, read_path};
use data::Entry;

#[test]
fn attributes_get_their_usual_names_and_keep_their_types() {
    let cloud = read(
        b"ply \r\nformat ascii 1.0\r\ncomment hand made\r\nobj_info none\r\nelement vertex 2\r\n\
        property uchar diffuse_red\r\nproperty uchar g\r\nproperty uchar BLUE\r\nproperty uchar alpha\r\n\
        property float X\r\nproperty double Y\r\nproperty int Z\r\nproperty float normal_x\r\n\
        property float scalar_Intensity\r\nproperty short label\r\nend_header\r\n\
        1 2 3 4 0.5 -0.25 7 0.6 0.1 -5\r\n\r\n255.0 0 0 0 1e-3 2 8 nan 0.2 6\r\n",
    )
    .unwrap();
    assert_eq!(cloud.names(), ["alpha", "blue", "green", "intensity", "label", "nx", "red"]);
    assert_eq!(cloud.column("red"), (AttrType::U8, vec![1.0, 255.0]));
    assert_eq!(cloud.column("label"), (AttrType::I16, vec![-5.0, 6.0]));
    assert_eq!(cloud.column("intensity").1, [f64::from(0.1f32), f64::from(0.2f32)]);
    assert!(cloud.column("nx").1[1].is_nan());
    assert_eq!(cloud.world, [[0.5, -0.25, 7.0], [0.001, 2.0, 8.0]]);
    assert_eq!(cloud.report.rounding_error_max, 0.0);
    assert_eq!(cloud.info.grid.kind, GridKind::Decimal);
    assert_eq!(cloud.info.grid.grid.scale, [0.001, 0.01, 1.0]);
}

#[test]
fn other_elements_and_lists_are_skipped_with_a_note() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement camera 1\nproperty double f\nproperty list uchar ushort tags\n\
            element nothing 1000000000000\nelement vertex 2\nproperty float x\nproperty list int double h\n\
            property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let ascii = header("ascii") + "0.5 2 7 8\n1 0 2 3\n4 2 9 9 5 6\n3 0 1 0\n";
    let mut clouds = vec![read(ascii.as_bytes()).unwrap()];
    for big in [false, true] {
        let mut bytes =
            header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
        macro_rules! put {
            ($($v:expr),*) => {{ $(bytes.extend(if big { $v.to_be_bytes() } else { $v.to_le_bytes() });)* }};
        }
        put!(0.5f64);
        put!(2u8);
        put!(7u16, 8u16);
        put!(1f32);
        put!(0i32);
        put!(2f32, 3f32, 4f32);
        put!(2i32);
        put!(9f64, 9f64);
        put!(5f32, 6f32);
        put!(3u8);
        put!(0i32, 1i32, 0i32);
        clouds.push(read(&bytes).unwrap());
        let cut = bytes.len() - 13 - 4;
        assert!(error(&bytes[..cut]).contains("claims 2 vertices, the file holds 1"));
    }
    for cloud in clouds {
        assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let notes = cloud.info.notes.join("\n");
        for want in ["1 elements `camera` ignored", "1 faces ignored", "the list `h`"] {
            assert!(notes.contains(want), "{notes}");
        }
    }
}

#[test]
fn wrong_counts_are_refused_with_both_numbers() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for claimed in ["3", "4294967295", "18446744073709551615"] {
            let mut bytes = format!(
                "ply\nformat {format} 1.0\nelement vertex {claimed}\nproperty char x\nproperty char y\nproperty char z\nend_header\n"
            )
            .into_bytes();
            bytes.extend_from_slice(if format == "ascii" { b"1 2 3\n4 5 6\n" } else { b"abcdef" });
            let error = error(&bytes);
            assert!(
                error.contains(&format!("claims {claimed} vertices, the file holds 2")),
                "{error}"
            );
        }
    }
    let list = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint64 double l\n\
        property char x\nproperty char y\nproperty char z\nend_header\n\xff\xff\xff\xff\xff\xff\xff\xff123";
    assert!(error(list).contains("claims 1 vertices, the file holds 0"));
}

#[test]
fn files_without_points_are_refused_in_a_line() {
    let no_z = "element vertex 1\nproperty float x\nproperty float y\nproperty list uchar int z\n";
    for (body, want) in [("", "no element `vertex`"), (no_z, "lack x, y or z")] {
        let error = error(format!("ply\nformat ascii 1.0\n{body}end_header\n1 2 0\n").as_bytes());
        assert!(error.contains(want), "{error}");
    }
}

#[test]
fn a_file_of_no_vertices_has_no_points() {
    for format in ["ascii", "binary_big_endian"] {
        let text = format!(
            "ply\nformat {format} 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        );
        let cloud = read(text.as_bytes()).unwrap();
        assert_eq!((cloud.report.points, cloud.info.grid.bounds), (0, None));
    }
}

#[test]
fn lines_that_break_the_header_are_named() {
    let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nend_header\n1 2 3 4\n";
    for (line, want) in [
        ("1 2 3\n", "line 10 has fewer numbers"),
        ("1 2 3 4 5\n", "line 10 has more numbers"),
        ("1 2 3 256\n", "line 10 has `256` for red, which is u8"),
        ("1 2 3 1.5\n", "line 10 has `1.5` for red"),
        ("1 two 3 4\n", "line 10 has `two` for y"),
    ] {
        let error = error(format!("{head}{line}").as_bytes());
        assert!(error.contains(want), "{error}");
    }
}

#[test]
fn lines_behind_the_last_vertex_are_noted() {
    let notes = |count: usize, faces: usize, body: &str| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty int x\nproperty int y\nproperty int z\n\
            element face {faces}\nproperty list uchar int v\nend_header\n{body}"
        );
        let cloud = read(text.as_bytes()).unwrap();
        assert_eq!(cloud.report.points, count as u64);
        cloud.info.notes
    };
    let point = "1 2 3\n";
    // In one block and in many; the last vertex may end a block.
    for count in [1, 3, 100_000, (256 << 10) / 6] {
        let body = point.repeat(count);
        let none: Vec<String> = Vec::new();
        assert_eq!(notes(count, 0, &body), none);
        assert_eq!(notes(count, 0, &(body.clone() + "\n \n")), none);
        assert_eq!(notes(count, 1, &(body.clone() + "3 0 0 0\n")), ["1 faces ignored"]);
        let behind = format!("behind the {count} vertices that the header claims");
        for more in ["4 5 6", "what is this\n"] {
            let want = format!("1 line {behind} is left out");
            assert_eq!(notes(count, 0, &(body.clone() + more)), [want]);
        }
        let many = "4 5 6\n\n".repeat(90_000);
        let want = format!("90000 lines {behind} are left out");
        assert_eq!(notes(count, 0, &(body.clone() + &many)), [want]);
    }
}

#[test]
fn records_behind_the_last_vertex_are_noted() {
    let notes = |property: &str, count: usize, more: &[u8]| {
        let text = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{property}property float x\n\
            property float y\nproperty float z\nelement face 0\nproperty list uchar int v\nend_header\n"
        );
        let lists = usize::from(!property.is_empty());
        let point = [&[0u8][..lists], &[1.0f32, 2.0, 3.0].map(f32::to_le_bytes).concat()].concat();
        let cloud = read([text.as_bytes(), &point.repeat(count), more].concat()).unwrap();
        assert_eq!(cloud.report.points, count as u64);
        cloud.info.notes
    };
    let behind = "behind the 5 vertices that the header claims";
    assert!(notes("", 5, b"").is_empty());
    let want = format!("3 further records {behind} are left out: correct the header to read them");
    assert_eq!(notes("", 5, &[0; 36]), [want]);
    let want = format!("7 bytes {behind} are left out: they are no whole records");
    assert_eq!(notes("", 5, &[0; 7]), [want]);
    assert!(notes("property list uchar int v\n", 5, &[1; 36])[0].starts_with("36 bytes behind"));
    let none = notes("", 0, &[0; 24]);
    assert!(none[0].starts_with("2 further records behind the 0 vertices"), "{none:?}");
}

#[test]
fn points_without_a_finite_position_are_refused_and_counted() {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar i\nend_header\n".to_vec();
    for (i, x) in [1.0, f32::NAN, f32::INFINITY, 4.0].into_iter().enumerate() {
        for c in [x, 0.0, 1e-3] {
            bytes.extend(c.to_le_bytes());
        }
        bytes.push(i as u8);
    }
    let ascii = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar i\nend_header\n1 0 0 0\nnan 0 0 1\n1e39 0 0 2\n4 0 0 3\n";
    for cloud in [read(&bytes).unwrap(), read(ascii).unwrap()] {
        let refused: Vec<_> = cloud.report.refused.into_iter().collect();
        assert_eq!(refused, [("coordinate is not a finite number".to_owned(), 2)]);
        let i = cloud.info.schema.find("i").unwrap();
        assert_eq!(cloud.columns[i], [0, 3]);
        assert_eq!(cloud.info.grid.bounds.unwrap()[1][0], 4.0);
    }
}

#[test]
fn sixteen_bit_colours_of_eight_bit_values_are_detected() {
    for (greatest, want) in [(255u16, ColourDepth::Eight), (256, ColourDepth::Sixteen)] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int y\nproperty int z\nproperty ushort red\nproperty ushort green\nproperty ushort blue\nend_header\n1 2 3 0 {greatest} 7\n"
        );
        let cloud = read(text.as_bytes()).unwrap();
        assert_eq!((cloud.info.colour_depth, cloud.report.colour_max), (Some(want), greatest));
    }
}

#[test]
fn digits_beyond_any_lattice_are_read_as_declared() {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1.00000000012345678 2 3\n1.9 3.1 3.7\n";
    let cloud = read(text.as_bytes()).unwrap();
    assert_eq!(cloud.info.grid.kind, GridKind::Float);
    let (step, declared) = (1e-7, [1.9f32, 3.1, 3.7].map(f64::from));
    assert_eq!(cloud.info.grid.grid.scale, [step; 3]);
    for (read, declared) in cloud.world[1].into_iter().zip(declared) {
        assert!((read - declared).abs() <= 0.5001 * step, "{read} {declared}");
    }
}

#[test]
fn a_ply_compressed_with_zstd_is_read_as_if_plain() {
    let mut plain = b"ply\nformat binary_little_endian 1.0\nelement vertex 100000\nproperty float x\nproperty float y\nproperty float z\nend_header\n".to_vec();
    for i in 0..300_000u32 {
        plain.extend((i as f32).to_le_bytes());
    }
    let packed = zstd::encode_all(&plain[..], 3).unwrap();
    let (a, b) = (read(&plain).unwrap(), read(&packed).unwrap());
    assert_eq!(a.world, b.world);
    assert!(b.info.format.ends_with("zstd"));
    let plain_cut = zstd::encode_all(&plain[..plain.len() - 5], 3).unwrap();
    assert!(error(&plain_cut).contains("claims 100000 vertices, the file holds 99999"));
    error(&packed[..packed.len() / 2]);
    let text = read(zstd::encode_all(&b"1 2 3\n"[..], 3).unwrap()).unwrap();
    assert_eq!(text.world, [[1.0, 2.0, 3.0]]);
    let other = error(zstd::encode_all(&b"\0\0"[..], 3).unwrap());
    assert!(other.contains("not a scan file that Esker knows (it reads PLY, PCD, PTX"), "{other}");
}

const TYPES: [(&str, AttrType); 8] = [
    ("char", AttrType::I8),
    ("uint8", AttrType::U8),
    ("short", AttrType::I16),
    ("ushort", AttrType::U16),
    ("int32", AttrType::I32),
    ("uint", AttrType::U32),
    ("float", AttrType::F32),
    ("double", AttrType::F64),
];

/// A value as in a PLY of any encoding, from random bits; finite.
fn value(ty: AttrType, bits: u64) -> Vec<u8> {
    let bytes = bits.to_le_bytes();
    match ty {
        AttrType::F32 => ((bits as i32 as f32) * 1e-3).to_le_bytes().to_vec(),
        AttrType::F64 => ((bits as i64 as f64) * 1e-9).to_le_bytes().to_vec(),
        _ => bytes[..ty.size()].to_vec(),
    }
}

fn text_of(ty: AttrType, bytes: &[u8]) -> String {
    match ty {
        AttrType::F32 => f32::from_le_bytes(bytes.try_into().unwrap()).to_string(),
        AttrType::F64 => f64::from_le_bytes(bytes.try_into().unwrap()).to_string(),
        _ => ty.to_f64(bytes).to_string(),
    }
}

/// A random cloud: property types (the first three are x, y, z), rows of little-endian values.
fn clouds() -> impl Strategy<Value = (Vec<usize>, Vec<Vec<Vec<u8>>>)> {
    prop::collection::vec(0..TYPES.len(), 3..9).prop_flat_map(|types| {
        let n = types.len();
        let row = prop::collection::vec(any::<u64>(), n);
        let rows = prop::collection::vec(row, 0..40);
        (Just(types), rows).prop_map(|(types, rows)| {
            let values = |row: Vec<u64>| {
                types.iter().zip(row).map(|(&t, bits)| value(TYPES[t].1, bits)).collect()
            };
            let rows = rows.into_iter().map(values).collect();
            (types, rows)
        })
    })
}

fn write(format: &str, types: &[usize], rows: &[Vec<Vec<u8>>]) -> Vec<u8> {
    let mut out = format!("ply\nformat {format} 1.0\nelement vertex {}\n", rows.len());
    for (i, &t) in types.iter().enumerate() {
        let name = ["x", "y", "z"].get(i).map_or_else(|| format!("a{i}"), |n| n.to_string());
        out += &format!("property {} {name}\n", TYPES[t].0);
    }
    let mut out = (out + "end_header\n").into_bytes();
    for row in rows {
        for (&t, v) in types.iter().zip(row) {
            match format {
                "ascii" => out.extend((text_of(TYPES[t].1, v) + " ").bytes()),
                "binary_big_endian" => out.extend(v.iter().rev()),
                _ => out.extend(v),
            }
        }
        if format == "ascii" {
            out.push(b'\n');
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_encoding_keeps_all_values((types, rows) in clouds()) {
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let cloud = read(write(format, &types, &rows)).unwrap();
            prop_assert_eq!(cloud.world.len(), rows.len());
            // Tolerance of the lattice for noise of `f64` while placing points: a millionth of a
            // step.
            let lattice = Lattice::choose(std::slice::from_ref(&cloud.info.grid)).unwrap();
            let error = cloud.report.rounding_error_max + lattice.scale[0].max(lattice.scale[1]).max(lattice.scale[2]) * 1e-6;
            for (p, row) in cloud.world.iter().zip(&rows) {
                for i in 0..3 {
                    let want = TYPES[types[i]].1.to_f64(&row[i]);
                    // The last term: an f32 in decimal text differs from its binary twin by the
                    // rounding of the text.
                    let text = if format == "ascii" { want.abs() * 6e-8 } else { 0.0 };
                    prop_assert!((p[i] - want).abs() <= error + want.abs() * 1e-15 + text + 1e-12, "{} {} {}", p[i], want, error);
                }
            }
            for (i, &t) in types.iter().enumerate().skip(3) {
                let column = cloud.info.schema.find_typed(&format!("a{i}"), TYPES[t].1).unwrap();
                let want: Vec<u8> = rows.iter().flat_map(|row| row[i].clone()).collect();
                prop_assert_eq!(&cloud.columns[column], &want);
            }
        }
    }

    #[test]
    fn flipped_bytes_never_panic((types, rows) in clouds(), flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), format in 0usize..3) {
        let format = ["ascii", "binary_little_endian", "binary_big_endian"][format];
        let mut bytes = write(format, &types, &rows);
        for (at, with) in flips {
            let at = at.index(bytes.len());
            bytes[at] = with;
        }
        prop_assert!(is_error_one_line(read(&bytes)));
    }
}

#[test]
fn real_files_have_the_points_of_the_manifest() {
    let Some(data) = data::folder() else { return };
    let mut files = 0;
    for Entry { name, points, .. } in data::manifest(&data) {
        if !(name.starts_with("ply/") || name.starts_with("models/")) {
            continue;
        }
        let cloud = read_path(&data.join(&name)).unwrap();
        assert_eq!(Some(cloud.report.points), points, "{name}");
        assert!(cloud.report.refused.is_empty(), "{name}");
        files += 1;
    }
    assert!(files >= 9, "{files}");
}

#[test]
fn the_ascii_bunny_is_the_binary_bunny() {
    let Some(data) = data::folder() else { return };
    let ascii = read_path(&data.join("models/bunny-zipper-ascii.ply")).unwrap();
    let binary = read_path(&data.join("models/bunny-36k.ply")).unwrap();
    assert!(ascii.info.notes.contains(&"69451 faces ignored".to_owned()));
    // Half a step of the grid for floats: singles of 0.19 are 1.5e-8 apart.
    assert!(binary.report.rounding_error_max <= 0.5001e-8);
    for (a, b) in ascii.world.iter().zip(&binary.world) {
        for i in 0..3 {
            assert!((a[i] - b[i]).abs() < 1.5e-8, "{a:?} {b:?}");
        }
    }
}

#[test]
fn bad_files_are_refused_in_a_line() {
    let Some(data) = data::folder() else { return };
    for (name, want) in
        [("ply-no-vertex.ply", "no element `vertex`"), ("ply-no-z.ply", "lack x, y or z")]
    {
        let error = read_path(&data.join("bad").join(name)).err().unwrap().to_string();
        assert!(error.contains(want) && error.contains(name), "{error}");
    }
}
