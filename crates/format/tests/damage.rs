//! Damaged, truncated and hostile files: every changed byte is found, nothing panics, and no claim
//! is trusted.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::{EskerFile, Footer, FormatError, VerifyReport, verify};
use esker_points::Node;
use esker_points::task::Silent;
use proptest::prelude::*;
use std::path::Path;

fn small_file() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 40, 20, 3);
    tree::write(&path, &tree::metadata(schema, classes), &points, 15);
    std::fs::read_to_string(&path).unwrap_err();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(&path).unwrap(), &mut bytes).unwrap();
    bytes
}

fn sample(name: &str) -> Vec<u8> {
    let folder = "../../data-format/samples";
    let mut bytes = Vec::new();
    let mut file = std::fs::File::open(format!("{folder}/{name}.esker")).unwrap();
    std::io::Read::read_to_end(&mut file, &mut bytes).unwrap();
    bytes
}

fn check(bytes: Vec<u8>) -> Result<VerifyReport, FormatError> {
    let file = EskerFile::from_source(Path::new("a.esker"), Box::new(bytes))?;
    verify(&file, &Silent)
}

#[test]
fn every_changed_byte_is_found() {
    let good = small_file();
    check(good.clone()).unwrap();
    for at in 0..good.len() {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        let Err(error) = check(bad) else { panic!("byte {at} of {} was missed", good.len()) };
        assert!(error.to_string().starts_with("a.esker: "), "{error}");
    }
}

#[test]
fn every_cut_is_found() {
    let good = small_file();
    for length in 0..good.len() {
        let error = check(good[..length].to_vec()).unwrap_err().to_string();
        assert!(error.contains("cut short, or not an .esker file"), "{error}");
    }
    let mut longer = good.clone();
    longer.push(0);
    check(longer).unwrap_err();
}

#[test]
fn a_scan_is_distinguished_from_a_damaged_file() {
    let error = check([b"LASF".as_slice(), &[0; 4000]].concat()).unwrap_err().to_string();
    assert!(error.contains("is not an .esker file; if it is a scan, build one first"), "{error}");
}

/// The file with another node table and correct checksums.
fn with_table(good: &[u8], change: impl FnOnce(&mut [Node])) -> Vec<u8> {
    rewrite(good, |bytes, footer| {
        let place =
            footer.table.offset as usize..(footer.table.offset + footer.table.bytes) as usize;
        let records = bytes[place.clone()].chunks_exact(size_of::<Node>());
        let mut nodes: Vec<Node> = records.map(bytemuck::pod_read_unaligned).collect();
        change(&mut nodes);
        bytes[place].copy_from_slice(bytemuck::cast_slice(&nodes));
    })
}

/// The file with changed sections or footer and correct checksums.
fn rewrite(good: &[u8], change: impl FnOnce(&mut [u8], &mut Footer)) -> Vec<u8> {
    let mut bytes = good.to_vec();
    let at = bytes.len() - esker_format::footer::FOOTER_BYTES;
    let mut footer = Footer::decode(bytes[at..].try_into().unwrap()).unwrap();
    change(&mut bytes, &mut footer);
    let crc = |s: &esker_format::footer::Section| {
        let end = s.offset.saturating_add(s.bytes) as usize;
        bytes.get(s.offset as usize..end).map_or(s.crc, crc32fast::hash)
    };
    footer.table.crc = crc(&footer.table);
    footer.statistics.crc = crc(&footer.statistics);
    footer.metadata.crc = crc(&footer.metadata);
    bytes[at..].copy_from_slice(&footer.encode());
    bytes
}

#[test]
fn tables_that_break_a_rule_are_refused_when_opened() {
    let good = small_file();
    type Change = fn(&mut [Node]);
    let changes: [(&str, Change); 22] = [
        ("cell", |n| n[0].cell_log2 = 33),
        ("cell", |n| n[0].corner[1] |= 1),
        ("levels", |n| n[0].level_count = 17),
        ("levels", |n| n[0].level_count = 0),
        ("levels", |n| n[0].level_counts[15] = [1, 0, 0]),
        ("points", |n| n[0].level_counts[0] = [255; 3]),
        ("points", |n| n[0].level_counts[0][0] += 1),
        ("reserved", |n| n[0].shape |= 16),
        ("reserved", |n| n[0].reserved[2] = 1),
        ("integer box", |n| n[0].hot_shift = 17),
        ("integer box", |n| n[1].box_min[0] ^= 1 << 31),
        ("contour", |n| n[0].contour_centre[2] = f32::NAN),
        ("contour", |n| n[0].contour_half[2] = -1.0),
        ("contour", |n| n[0].spacing = f32::INFINITY),
        ("parent", |n| n[0].parent = 0),
        ("parent", |n| n[1].parent = 5),
        ("children", |n| n[0].first_child = u32::MAX),
        ("children", |n| n[0].child_count = 200),
        ("children", |n| n[0].first_child = 0),
        ("continuation", |n| n[1].shape |= 8),
        ("page", |n| n[0].page_offset = u64::MAX - 63),
        ("page", |n| n[0].page_bytes = 64),
    ];
    for (index, (_, change)) in changes.into_iter().enumerate() {
        let error = check(with_table(&good, change)).unwrap_err().to_string();
        assert!(error.contains("node table"), "change {index}: {error}");
    }
}

#[test]
fn tables_that_only_the_points_contradict_are_found_by_verify() {
    let good = small_file();
    let changes: [fn(&mut [Node]); 6] = [
        |n| n[0].occupancy = 0,
        |n| n[0].occupancy = u64::MAX,
        |n| n[0].box_min[0] += 1,
        |n| n[0].contour_half[0] /= 2.0,
        |n| n[0].hot_shift += 1,
        |n| {
            let (offset, bytes) = (n[2].page_offset, n[2].page_bytes);
            (n[1].page_offset, n[1].page_bytes) = (offset, bytes);
        },
    ];
    for change in changes {
        let bytes = with_table(&good, change);
        check(bytes).unwrap_err();
    }
}

#[test]
fn claims_of_the_footer_are_not_trusted() {
    let good = small_file();
    let changes: [fn(&mut Footer); 8] = [
        |f| f.nodes = u64::MAX,
        |f| f.nodes += 1,
        |f| f.table.bytes = u64::MAX,
        |f| f.metadata.bytes = u64::MAX,
        |f| f.statistics.offset = u64::MAX,
        |f| f.file_bytes += 1,
        |f| f.points = u64::MAX,
        |f| f.hash.0 ^= 1,
    ];
    for change in changes {
        check(rewrite(&good, |_, footer| change(footer))).unwrap_err();
    }
}

#[test]
fn other_versions_are_refused_by_name() {
    for (version, remedy) in [(0, "build it again"), (9, "use a newer Esker")] {
        let mut bytes = small_file();
        let at = bytes.len() - esker_format::footer::FOOTER_BYTES;
        bytes[at + 8] = version;
        let crc = crc32fast::hash(&bytes[at..bytes.len() - 4]);
        let end = bytes.len();
        bytes[end - 4..].copy_from_slice(&crc.to_le_bytes());
        let error = check(bytes).unwrap_err().to_string();
        assert!(error.contains(&format!("version {version}")) && error.contains(remedy), "{error}");
    }
}

/// Recomputes the checksums of a page's planes, if these are within the page, and of its directory.
fn seal_page(page: &mut [u8]) {
    let u32_at = |page: &[u8], at: usize| u32::from_le_bytes(page[at..at + 4].try_into().unwrap());
    let count = usize::from(u16::from_le_bytes([page[8], page[9]]));
    let Some(end) = Some(12 + 20 * count).filter(|end| end + 4 <= page.len()) else { return };
    for entry in (12..end).step_by(20) {
        let start = u32_at(page, entry + 8) as usize;
        let stored = page.get(start..start + u32_at(page, entry + 12) as usize);
        if let Some(crc) = stored.map(crc32fast::hash) {
            page[entry + 16..entry + 20].copy_from_slice(&crc.to_le_bytes());
        }
    }
    let crc = crc32fast::hash(&page[..end]);
    page[end..end + 4].copy_from_slice(&crc.to_le_bytes());
}

proptest! {
    #[test]
    fn random_tables_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        thread_local! { static GOOD: Vec<u8> = small_file(); }
        let bytes = GOOD.with(|good| with_table(good, |nodes| {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(nodes);
            for (at, value) in &edits { bytes[at.index(bytes.len())] = *value; }
        }));
        let _ = check(bytes);
    }

    #[test]
    fn random_pages_never_panic(
        which in 0usize..3,
        node in any::<prop::sample::Index>(),
        edits in prop::collection::vec((0usize..2, any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        // The samples have planes of every encoding.
        thread_local! {
            static GOOD: [Vec<u8>; 3] = [small_file(), sample("all-kinds"), sample("small")];
        }
        let mut bytes = GOOD.with(|good| good[which].clone());
        let file = EskerFile::from_source(Path::new("a.esker"), Box::new(bytes.clone())).unwrap();
        let node = node.get(&file.table().nodes);
        let start = node.page_offset as usize;
        let page = &mut bytes[start..start + node.page_bytes as usize];
        for (part, at, value) in edits {
            // Half of the edits in the directory, which is small.
            let length = [page.len(), file.layout().directory_bytes()][part];
            page[at.index(length)] = value;
        }
        seal_page(page);
        let _ = check(bytes);
    }

    #[test]
    fn random_metadata_and_statistics_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        thread_local! { static GOOD: Vec<u8> = small_file(); }
        let bytes = GOOD.with(|good| rewrite(good, |bytes, footer| {
            let place = footer.statistics.offset as usize..footer.verbatim.offset as usize;
            let length = place.len();
            for (at, value) in &edits { bytes[place.start + at.index(length)] = *value; }
        }));
        let _ = check(bytes);
    }
}
