//! Meshes: every encoding gives the same triangles; damaged files end in an error of one line or in
//! a sound mesh; generated meshes are closed, face outwards and are the same on every machine.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

use esker_points::task::Silent;
use esker_scan::ScanError;
use esker_scan::mesh::generated::{MODELS, parse};
use esker_scan::mesh::{self, TriangleMesh};
use proptest::prelude::*;
use std::collections::HashMap;
use std::path::Path;

fn read(bytes: &[u8]) -> Result<TriangleMesh, ScanError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.bin");
    std::fs::write(&path, bytes).unwrap();
    mesh::read(&path, &Silent)
}

fn error(bytes: &[u8]) -> String {
    let error = read(bytes).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// A unit square, a pentagon's worth of polygons, and a vertex that nothing uses.
fn ply(format: &str) -> Vec<u8> {
    let mut out = format!(
        "ply\nformat {format} 1.0\nelement camera 2\nproperty list uchar short tags\n\
        element vertex 5\nproperty double x\nproperty float y\nproperty float z\n\
        property list uchar int more\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 3\nproperty uchar flags\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let is_ascii = format == "ascii";
    let is_big = format.ends_with("big_endian");
    macro_rules! put {
        ($($v:expr),*) => {{ $(if is_ascii {
            out.extend(format!("{} ", $v).bytes());
        } else if is_big {
            out.extend($v.to_be_bytes());
        } else {
            out.extend($v.to_le_bytes());
        })* }};
    }
    macro_rules! end {
        () => {
            if is_ascii {
                out.push(b'\n');
            }
        };
    }
    put!(2u8, 7i16, 8i16);
    end!();
    put!(0u8);
    end!();
    for (i, [x, y]) in [[0, 0], [1, 0], [9, 9], [1, 1], [0, 1]].into_iter().enumerate() {
        put!(f64::from(x), y as f32, 0.5f32, 1u8, 77i32, i as u8, 2u8, 3u8);
        end!();
    }
    put!(1u8, 4u8, 0i32, 1i32, 3i32, 4i32);
    end!();
    put!(1u8, 3u8, 0i32, 0i32, 3i32);
    end!();
    put!(1u8, 2u8, 0i32, 3i32);
    end!();
    out
}

#[test]
fn every_encoding_of_ply_gives_the_same_mesh() {
    let ascii = read(&ply("ascii")).unwrap();
    assert_eq!(ascii.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(ascii.positions[2], [1.0, 1.0, 0.5]);
    assert_eq!(ascii.colours, [[0, 2, 3], [1, 2, 3], [3, 2, 3], [4, 2, 3]]);
    assert_eq!(ascii.normals, [[0.0, 0.0, 1.0]; 4]);
    let notes = ascii.notes.join("\n");
    assert!(notes.contains("1 triangles without area") && notes.contains("1 vertices"), "{notes}");
    for format in ["binary_little_endian", "binary_big_endian"] {
        assert_eq!(read(&ply(format)).unwrap(), ascii, "{format}");
    }
    let packed = zstd::encode_all(&ply("binary_little_endian")[..], 1).unwrap();
    assert_eq!(read(&packed).unwrap(), ascii);
}

#[test]
fn every_cut_of_a_ply_file_is_refused() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let whole = ply(format);
        let bytes = whole.len() - if format == "ascii" { 3 } else { 0 };
        (0..bytes).for_each(|cut| drop(error(&whole[..cut])));
    }
}

#[test]
fn unsound_ply_meshes_are_refused_with_the_reason() {
    let file = |vertices: &str, faces: &str, body: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
            property float z\nelement face {faces}\nproperty list uchar int vertex_indices\n\
            end_header\n{body}"
        )
    };
    let corners = "0 0 0\n1 0 0\n0 1 0\n";
    for (text, want) in [
        (file("3", "1", &format!("{corners}3 0 1 3\n")), "face 0 refers to vertex 3 of 3"),
        (file("3", "1", &format!("{corners}3 0 1 -1\n")), "refers to vertex -1"),
        (file("3", "1", &format!("{corners}3 0 1 0.5\n")), "refers to vertex 0.5"),
        (file("3", "1", &format!("{corners}3 0 1 nan\n")), "refers to vertex NaN"),
        (file("3", "1", &format!("{corners}-3 0 1 2\n")), "line 13 has a list"),
        (file("3", "1", &format!("{corners}4000000000 0\n")), "of 4000000000 items"),
        (file("3", "1", &format!("{corners}3 0 1\n")), "fewer numbers"),
        (file("3", "1", &format!("{corners}3 0 1 2 2\n")), "more numbers"),
        (file("3", "2", &format!("{corners}3 0 1 2\n")), "claims 2 faces, the file holds 1"),
        (file("9", "1", corners), "claims 9 vertices, the file holds 3"),
        (file("18446744073709551615", "1", corners), "67108864 can be read"),
        (file("3", "99999999999", corners), "67108864 can be read"),
        (file("3", "0", corners), "has no faces"),
        (file("0", "1", "3 0 1 2\n"), "faces but no vertices"),
        (file("3", "1", &format!("{corners}3 0 0 1\n")), "none of its 1 triangles has an area"),
        (file("3", "1", "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n"), "has an area"),
        (file("3", "1", "0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n"), "line 11 has `x`"),
        ("ply\nformat ascii 1.0\n".to_owned(), "no `end_header`"),
    ] {
        let error = error(text.as_bytes());
        assert!(error.contains(want), "{error} / {want}");
    }
}

#[test]
fn obj_faces_have_normals_colours_and_negative_indices() {
    let text = "# made by hand\r\nmtllib x.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\n\
        v 0 1 0\nvt 0 0\nvn 0 0 2\nvn 0 3 0\no part\ns 1\nf 1//1 2//1 3//1 4//1\n\
        f -4/1/-1 -3/1/-1 -1/1/-1\nf 1 2 3\nl 1 2\n";
    let mesh = read(text.as_bytes()).unwrap();
    assert_eq!(mesh.triangles[..2], [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.positions.len(), 10, "split by another and by no normal: {mesh:?}");
    assert_eq!(mesh.normals[..4], [[0.0, 0.0, 1.0]; 4]);
    let [a, b, c] = mesh.triangles[2].map(|v| mesh.normals[v as usize]);
    assert_eq!([a, b, c], [[0.0, 1.0, 0.0]; 3]);
    assert_eq!(mesh.normals[mesh.triangles[3][0] as usize], [0.0, 0.0, 1.0], "computed");
    assert_eq!(mesh.colours[..4], [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255; 3]]);
    assert!(mesh.notes.join("\n").contains("1 lines, points and curves"), "{:?}", mesh.notes);
    let plain = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4").unwrap();
    assert!(plain.colours.is_empty());
    assert_eq!(plain.positions.len(), 6, "the right angle stays sharp");
}

#[test]
fn unsound_obj_meshes_are_refused_with_the_line() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (more, want) in [
        ("f 1 2 4", "line 4 refers to vertex 4, and 3 precede it"),
        ("f 1 2 0", "refers to vertex 0"),
        ("f 1 2 -4", "refers to vertex -4"),
        ("f 1//1 2//1 3//1", "refers to normal 1, and 0 precede it"),
        ("f 1 2", "fewer than three"),
        ("f 1 2 x", "`x` for a vertex"),
        ("f 1 2 99999999999999999999", "no whole number"),
        ("v 1 2", "has 2 numbers and needs 3"),
        ("v 1 2 zwei", "has `zwei`"),
        ("", "is no mesh"),
        ("f 1 1 2", "none of its 1 triangles"),
    ] {
        let error = error(format!("{corners}{more}\n").as_bytes());
        assert!(error.contains(want), "{error} / {want}");
    }
    assert!(error(b"").contains("is no mesh"));
    assert!(error(&[0; 5000]).contains("is no mesh"));
}

#[test]
fn a_written_mesh_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hall.ply");
    let hall = MODELS[2].make(20_000);
    let bytes = mesh::write(&hall, &path).unwrap();
    assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
    let back = mesh::read(&path, &Silent).unwrap();
    assert_eq!((&back.positions, &back.colours), (&hall.positions, &hall.colours));
    assert_eq!((&back.triangles, &back.notes), (&hall.triangles, &hall.notes));
    let apart = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|i| (a[i] - b[i]).abs() > 1e-6);
    assert!(!back.normals.iter().zip(&hall.normals).any(apart));
}

/// Number of times that each directed edge is used, by place.
fn edges(mesh: &TriangleMesh) -> HashMap<[[u64; 3]; 2], i32> {
    let place = |v: u32| mesh.positions[v as usize].map(|c| (c + 0.0).to_bits());
    let mut edges = HashMap::new();
    for t in &mesh.triangles {
        for i in 0..3 {
            *edges.entry([place(t[i]), place(t[(i + 1) % 3])]).or_default() += 1;
        }
    }
    edges
}

fn volume(mesh: &TriangleMesh) -> f64 {
    let one = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    (0..mesh.triangles.len()).map(one).sum::<f64>() / 6.0
}

#[test]
fn generated_meshes_are_closed_and_face_outwards() {
    for model in &MODELS {
        for triangles in [20_000, 50_000] {
            let mesh = model.make(triangles);
            let share = mesh.triangles.len() as f64 / triangles as f64;
            assert!((0.95..1.05).contains(&share), "{}: {}", model.name, mesh.triangles.len());
            let edges = edges(&mesh);
            for ([a, b], n) in &edges {
                let back = edges.get(&[*b, *a]).copied().unwrap_or(0);
                assert_eq!(*n, back, "{}: an edge has one side", model.name);
            }
            assert!(volume(&mesh) > 0.0, "{}", model.name);
            let (mut against, mut flat) = (0, 0);
            for t in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.corners(t);
                let [u, v] = [b, c].map(|p| [0, 1, 2].map(|i| p[i] - a[i]));
                let n = [0, 1, 2].map(|i| {
                    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                    u[j] * v[k] - u[k] * v[j]
                });
                flat += usize::from(n == [0.0; 3]);
                for v in mesh.triangles[t] {
                    let own = mesh.normals[v as usize];
                    let dot: f64 = (0..3).map(|i| n[i] * f64::from(own[i])).sum();
                    against += usize::from(dot < 0.0);
                }
            }
            assert_eq!((against, flat), (0, 0), "{}", model.name);
            assert_eq!(mesh.colours.len(), mesh.positions.len());
        }
    }
}

#[test]
fn a_generated_mesh_is_always_the_same() {
    let hashes = MODELS.map(|model| {
        let mesh = model.make(20_000);
        let values = mesh.positions.as_flattened().iter().map(|c| c.to_bits());
        let corners = mesh.triangles.as_flattened().iter().map(|&v| u64::from(v));
        // FNV-1a over 64-bit words.
        values
            .chain(corners)
            .fold(0xcbf2_9ce4_8422_2325u64, |h, w| (h ^ w).wrapping_mul(0x100_0000_01b3))
    });
    let known = [6785066661698461313, 10277538990203489519, 14644422096706365864];
    assert_eq!(hashes, known);
}

#[test]
fn names_of_generated_meshes_are_parsed() {
    let parsed = |name: &str| parse(Path::new(name)).map(|(m, n)| (m.name, n));
    assert_eq!(parsed("mesh:bust").unwrap(), ("bust", 545_000));
    assert_eq!(parsed("mesh:knot:20k").unwrap(), ("knot", 20_000));
    for (name, want) in [
        ("mesh:teapot", "there is no mesh `teapot`"),
        ("mesh:hall:3", "`3` is no number of triangles"),
        ("mesh:hall:9G", "`9G` is no number"),
        ("mesh:hall:x:y", "`x:y` is no number"),
    ] {
        let error = parsed(name).unwrap_err().to_string();
        assert!(error.contains(want) && error.contains("bust, knot, hall"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn damaged_files_give_an_error_or_a_sound_mesh(
        format in 0usize..4, at in any::<prop::sample::Index>(), byte in any::<u8>(),
    ) {
        let obj = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -1 -2 -3\n".to_vec();
        let mut bytes = match format {
            0 => ply("ascii"),
            1 => ply("binary_little_endian"),
            2 => ply("binary_big_endian"),
            _ => obj,
        };
        let at = at.index(bytes.len());
        bytes[at] = byte;
        if let Ok(mesh) = read(&bytes) {
            prop_assert!(!mesh.triangles.is_empty());
            prop_assert_eq!(mesh.normals.len(), mesh.positions.len());
            prop_assert!(mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < mesh.positions.len()));
            prop_assert!(mesh.normals.as_flattened().iter().all(|c| c.is_finite()));
        }
    }
}
