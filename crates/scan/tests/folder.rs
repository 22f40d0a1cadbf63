//! Folders: every scan directly in a folder is found, whatever the case of its ending and its
//! compression; tables beside scans are left out and listed with the reason, never mixed in.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;

use cloud::read_path;
use esker_scan::{FolderScans, ScanError, scans_in};
use tempfile::TempDir;

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
const POINTS: &str = "500001.25 4000001.5 101.5\n500002.25 4000002.5 102.5\n";

fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn names(found: &FolderScans) -> Vec<String> {
    found.scans.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

fn found(files: &[(&str, &[u8])]) -> FolderScans {
    scans_in(folder(files).path()).unwrap()
}

/// A LAS file near easting 500,000, northing 4,000,000.
fn las() -> Vec<u8> {
    let mut out = vec![0; 227];
    out[..4].copy_from_slice(b"LASF");
    (out[24], out[25]) = (1, 2);
    out[94..96].copy_from_slice(&227u16.to_le_bytes());
    out[96..100].copy_from_slice(&227u32.to_le_bytes());
    out[105..107].copy_from_slice(&20u16.to_le_bytes());
    out[107..111].copy_from_slice(&1u32.to_le_bytes());
    let bounds = [500_100.0, 500_000.0, 4_000_100.0, 4_000_000.0, 103.0, 101.0];
    let numbers = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0].into_iter().chain(bounds);
    for (i, number) in numbers.enumerate() {
        out[131 + 8 * i..][..8].copy_from_slice(&f64::to_le_bytes(number));
    }
    out.extend([50_000_100i32, 400_000_100, 10_200].map(i32::to_le_bytes).concat());
    out.extend([0; 8]);
    out
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    // Stored blocks: head, one block, checksum and size.
    let mut out = vec![0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 0, 255, 1];
    let length = u16::try_from(bytes.len()).unwrap();
    out.extend(length.to_le_bytes());
    out.extend((!length).to_le_bytes());
    out.extend(bytes);
    let mut crc = !0u32;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    out.extend((!crc).to_le_bytes());
    out.extend(u32::from(length).to_le_bytes());
    out
}

#[test]
fn scans_of_all_formats_cases_and_compressions_are_found() {
    let packed = zstd_of(PLY.as_bytes());
    let las = las();
    let text = gzip(POINTS.as_bytes());
    let files: [(&str, &[u8]); 6] = [
        ("a.LAS", &las),
        ("b.asc", POINTS.as_bytes()),
        ("c.ply.zst", &packed),
        ("d.XYZ.gz", &text),
        ("e.Ply", PLY.as_bytes()),
        (".hidden.las", b"no scan"),
    ];
    let found = found(&files);
    assert_eq!(names(&found), ["a.LAS", "b.asc", "c.ply.zst", "d.XYZ.gz", "e.Ply"]);
    assert_eq!(found.left_out_text(), None);
}

fn zstd_of(bytes: &[u8]) -> Vec<u8> {
    // One raw block of a frame without checksum (RFC 8878, section 3.1.1).
    let size = u32::try_from(bytes.len()).unwrap();
    let mut out = vec![0x28, 0xB5, 0x2F, 0xFD, 0xA0];
    out.extend(size.to_le_bytes());
    out.extend(&(size << 3 | 1).to_le_bytes()[..3]);
    out.extend(bytes);
    out
}

#[test]
fn what_is_no_scan_is_left_out_and_listed() {
    let las = las();
    let list = "file,minx,miny,maxx,maxy\nstrip.las,500000,4000000,500100,4000100\n";
    let found = found(&[
        ("strip.las", &las),
        ("files.csv", list.as_bytes()),
        ("readme.txt", b"This scan was made on a sunny day.\n"),
        ("a.doc", b"x"),
        ("b.doc", b"x"),
        ("report.pdf", b"%PDF"),
        ("z.doc", b"x"),
        ("empty.csv", b""),
        ("trees.csv", b"x,y,z,species\n500001,4000001,101,oak\n500002,4000001,101,ash\n"),
    ]);
    assert_eq!(names(&found), ["strip.las"]);
    let text = found.left_out_text().unwrap();
    for part in [
        "empty text files: empty.csv",
        "lists of files: files.csv",
        "not named as scans: a.doc, b.doc, report.pdf and 1 more",
        "tables of words: trees.csv",
        "text without points: readme.txt",
    ] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn tables_unlike_the_rest_are_left_out() {
    let las = las();
    let far = "372000.5 500001.5 4000001.5\n372000.6 500002.5 4000002.5\n";
    let angles = "time,x,y,z,roll,pitch,heading\n1,500001,4000001,900,0.1,0.2,3\n";
    let path = "time,x,y,z\n1,500001,4000001,900\n";
    let odd = "500001 4000001 900 0.125 -0.5 3.25\n";
    let found = scans_in(
        folder(&[
            ("tile.las", &las),
            ("near.asc", POINTS.as_bytes()),
            ("path.csv", path.as_bytes()),
            ("flight.txt", angles.as_bytes()),
        ])
        .path(),
    )
    .unwrap();
    assert_eq!(names(&found), ["near.asc", "tile.las"]);
    assert_eq!(found.left_out["trajectories"], ["flight.txt", "path.csv"]);
    let one = |name: &str, text: &str| found_with(&las, name, text);
    assert_eq!(one("far.txt", far), ["tables far from the rest"]);
    assert_eq!(one("odd.txt", odd), ["tables with other columns than the rest"]);
    assert_eq!(one("named.csv", "easting,northing,height,n\n500001,4000001,900,7\n"), [""; 0]);
    // Beside larger tables, one of other columns.
    let points = POINTS.repeat(50);
    let found = scans_in(
        folder(&[
            ("a.xyz", points.as_bytes()),
            ("b.xyz", POINTS.as_bytes()),
            ("t.txt", odd.as_bytes()),
        ])
        .path(),
    )
    .unwrap();
    assert_eq!(names(&found), ["a.xyz", "b.xyz"]);
}

/// Reasons why a text beside a LAS file is left out.
fn found_with(las: &[u8], name: &str, text: &str) -> Vec<String> {
    found(&[("tile.las", las), (name, text.as_bytes())]).left_out.into_keys().collect()
}

#[test]
fn a_folder_without_a_scan_names_what_is_in_it_and_damaged_scans_stay() {
    let error = |files: &[(&str, &[u8])]| scans_in(folder(files).path()).unwrap_err().to_string();
    assert!(error(&[]).contains("a folder without a file in it (.las, .laz"));
    let text = error(&[("a.pdf", b"x"), ("readme.txt", b"Hello there\n")]);
    assert!(text.contains("not named as scans: a.pdf; text without points: readme.txt"), "{text}");
    let damaged = found(&[("a.las", b"LASF and no more"), ("b.e57", b"something else")]);
    assert_eq!(names(&damaged), ["a.las", "b.e57"]);
}

#[test]
fn compressed_scans_are_read_and_others_named() {
    let folder = folder(&[
        ("a.xyz.gz", &gzip(POINTS.as_bytes())),
        ("b.ply.gz", &gzip(PLY.as_bytes())),
        (
            "c.pcd.zst",
            &zstd_of(
                b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n",
            ),
        ),
        ("d.las.gz", &gzip(&las())),
        (
            "g.pcd.zst",
            &zstd_of(b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nDATA binary_compressed\n"),
        ),
        ("e.zip", b"PK\x03\x04 and so on"),
        ("f.txt.gz", &gzip(POINTS.as_bytes())[..40]),
    ]);
    let read = |name: &str| read_path(&folder.path().join(name));
    assert_eq!(read("a.xyz.gz").unwrap().world[0], [500_001.25, 4_000_001.5, 101.5]);
    assert_eq!(read("b.ply.gz").unwrap().info.format, "PLY 1.0, ASCII, gzip");
    assert_eq!(read("c.pcd.zst").unwrap().world, [[1.0, 2.0, 3.0]]);
    let error = |name: &str| read(name).err().unwrap().to_string();
    assert!(
        error("d.las.gz").contains("is LAS/LAZ compressed with gzip, which is not read; unpack")
    );
    assert!(error("g.pcd.zst").contains("is compressed with zstd; unpack it first"));
    assert!(error("e.zip").contains("is a ZIP archive; unpack it first"));
    assert!(matches!(read("f.txt.gz"), Err(ScanError::Io { .. })));
}
