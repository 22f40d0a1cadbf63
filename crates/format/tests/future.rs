//! A file of a later Esker, with planes, a statistics column and metadata of kinds that this version does not
//! know, is read: what is known comes out, the rest is skipped. Both readers are asked.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::footer::{FOOTER_BYTES, Section, header};
use esker_format::layout::PlaneSpec;
use esker_format::{EskerFile, Footer, FormatError, PageLayout, PlaneKind, encode_page, verify};
use esker_points::task::Silent;
use std::path::Path;
use std::process::Command;

/// The planes of a later version: unknown ones among the hot and among the cold.
fn later_layout(today: &PageLayout) -> PageLayout {
    let unknown =
        |number, hot| PlaneSpec { kind: PlaneKind::Unknown(number), hot, value_bytes: 12 };
    let mut planes = today.planes().to_vec();
    planes.insert(1, unknown(40, true));
    planes.push(unknown(41, false));
    today.clone().with_planes(planes).unwrap()
}

/// Adds a column of kind 99 behind all others.
fn later_statistics(today: &[u8]) -> Vec<u8> {
    let count = u32::from_le_bytes(today[4..8].try_into().unwrap()) as usize;
    let directory = 16 + 24 * count;
    let mut out = today[..directory].to_vec();
    out[4..8].copy_from_slice(&(count as u32 + 1).to_le_bytes());
    for entry in out[16..].chunks_exact_mut(24) {
        let offset = u64::from_le_bytes(entry[8..16].try_into().unwrap()) + 24;
        entry[8..16].copy_from_slice(&offset.to_le_bytes());
    }
    out.extend_from_slice(&[99, 0, 255, 255, 0, 0, 0, 0]);
    out.extend_from_slice(&(today.len() as u64 + 24).to_le_bytes());
    out.extend_from_slice(&8u64.to_le_bytes());
    out.extend_from_slice(&today[directory..]);
    out.extend_from_slice(&[7; 8]);
    out
}

fn later_metadata(today: &[u8], layout: &PageLayout) -> Vec<u8> {
    let mut json: serde_json::Value = serde_json::from_slice(today).unwrap();
    json["mood"] = "sunny".into();
    let planes = layout.planes().iter().map(|p| {
        let attribute = if let PlaneKind::Attribute(a) = p.kind { Some(a) } else { None };
        serde_json::json!({ "kind": p.kind.number(), "attribute": attribute, "hot": p.hot,
            "value_bytes": p.value_bytes, "colour": "unknown member" })
    });
    json["planes"] = planes.collect();
    serde_json::to_vec(&json).unwrap()
}

fn section(out: &mut Vec<u8>, bytes: &[u8]) -> Section {
    let offset = out.len() as u64;
    out.extend_from_slice(bytes);
    Section { offset, bytes: bytes.len() as u64, crc: crc32fast::hash(bytes) }
}

fn later_file(file: &EskerFile) -> Vec<u8> {
    let today = file.footer();
    let read = |s: Section| {
        let mut bytes = vec![0; s.bytes as usize];
        file.read_exact_at(&mut bytes, s.offset).unwrap();
        bytes
    };
    let layout = later_layout(file.layout());
    let mut out = header().to_vec();
    let mut table = file.table().clone();
    for (index, node) in (0..).zip(&mut table.nodes) {
        let points = file.read_page(index).unwrap().points().unwrap();
        let page = encode_page(&layout, node.box_min, node.hot_shift, &points);
        node.page_offset = out.len() as u64;
        node.page_bytes = page.len() as u32;
        out.extend_from_slice(&page);
    }
    let mut footer = Footer {
        table: section(&mut out, bytemuck::cast_slice(&table.nodes)),
        statistics: section(&mut out, &later_statistics(&read(today.statistics))),
        metadata: section(&mut out, &later_metadata(&read(today.metadata), &layout)),
        verbatim: section(&mut out, &read(today.verbatim)),
        ..*today
    };
    footer.file_bytes = (out.len() + FOOTER_BYTES) as u64;
    out.extend_from_slice(&footer.encode());
    out
}

/// The first entry of a page whose kind is 10 gets an encoding that nobody knows.
fn with_later_encoding(mut file: Vec<u8>, page: usize, planes: usize) -> Vec<u8> {
    let entries = page + 12..page + 12 + 20 * planes;
    let mut starts = entries.clone().step_by(20);
    let entry = starts.find(|&at| file[at..at + 2] == [10, 0]).unwrap();
    file[entry + 4] = 9;
    let crc = crc32fast::hash(&file[page..entries.end]);
    file[entries.end..entries.end + 4].copy_from_slice(&crc.to_le_bytes());
    file
}

#[test]
fn an_unknown_encoding_is_named_when_its_plane_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 50, 20, 3);
    let table = tree::write(&path, &tree::metadata(schema, classes), &points, 60);
    let today = EskerFile::open(&path).unwrap();
    let mut bytes = vec![0; today.footer().file_bytes as usize];
    today.read_exact_at(&mut bytes, 0).unwrap();
    let planes = today.layout().planes();
    let bytes = with_later_encoding(bytes, table.nodes[0].page_offset as usize, planes.len());
    let later = EskerFile::from_source(Path::new("b"), Box::new(bytes)).unwrap();
    let attributes = planes.iter().map(|p| p.kind).filter(|k| k.number() == 10);
    let attributes: Vec<PlaneKind> = attributes.collect();
    let told = later.read_planes(0, &attributes[..1]).unwrap_err();
    assert!(matches!(told, FormatError::Unsupported { .. }), "{told}");
    assert!(told.to_string().contains("encoding 9"), "{told}");
    for kind in [PlaneKind::Position, PlaneKind::Class, attributes[1]] {
        let read =
            |file: &EskerFile| file.read_planes(0, &[kind]).unwrap().get(kind).unwrap().to_vec();
        assert_eq!(read(&today), read(&later));
    }
    assert!(verify(&later, &Silent).unwrap_err().to_string().contains("encoding 9"));
}

#[test]
fn unknown_planes_columns_and_members_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 90, 20, 3);
    tree::write(&path, &tree::metadata(schema, classes), &points, 25);
    let today = EskerFile::open(&path).unwrap();
    let bytes = later_file(&today);
    let later = EskerFile::from_source(Path::new("b"), Box::new(bytes.clone())).unwrap();
    assert_eq!(verify(&later, &Silent).unwrap().hash, today.footer().hash);
    for node in 0..today.table().nodes.len() as u32 {
        let exact = |file: &EskerFile| file.read_page(node).unwrap().points().unwrap();
        assert_eq!(exact(&today), exact(&later));
        let kinds = [PlaneKind::Colour, PlaneKind::Residual, PlaneKind::Class];
        let (a, b) = (today.read_planes(node, &kinds), later.read_planes(node, &kinds));
        let (a, b) = (a.unwrap(), b.unwrap());
        assert!(kinds.iter().all(|&kind| a.get(kind).unwrap() == b.get(kind).unwrap()));
    }
    let path = folder.path().join("later.esker");
    std::fs::write(&path, bytes).unwrap();
    let python = std::env::var("ESKER_PYTHON").unwrap_or_else(|_| "python3".into());
    let reader = "../../data-format/reader.py";
    let numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if !numpy.is_ok_and(|o| o.status.success()) {
        println!("skipped: {python} with numpy is not there (ESKER_PYTHON names another)");
        return;
    }
    let output = Command::new(&python).args(["-B", reader]).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
