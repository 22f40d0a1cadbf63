//! A file of a later Esker, with planes, a statistics column and metadata of unknown kinds, can be
//! read: known parts come out, the rest is skipped. Tests both readers.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::footer::{FOOTER_BYTES, Section, header};
use esker_format::{
    EskerFile, Footer, FormatError, Metadata, PageLayout, PlaneKind, PlaneSpec, encode_page, verify,
};
use esker_points::palette::{NO_COLOUR, Palette};
use esker_points::quant::{HOT_POSITION_BYTES, INDEX_AT};
use esker_points::task::Silent;
use std::path::Path;
use std::process::Command;

/// Planes of a later version: unknown ones among the hot and among the cold.
fn later_layout(today: &PageLayout) -> PageLayout {
    let unknown =
        |number, hot| PlaneSpec { kind: PlaneKind::Unknown(number), hot, value_bytes: 12 };
    let mut planes = today.planes().to_vec();
    planes.insert(1, unknown(40, true));
    planes.push(unknown(41, false));
    today.clone().with_planes(planes).unwrap()
}

/// Adds a column of kind 99 at the end.
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

fn read(file: &EskerFile, s: Section) -> Vec<u8> {
    let mut bytes = vec![0; s.bytes as usize];
    file.read_exact_at(&mut bytes, s.offset).unwrap();
    bytes
}

fn later_file(file: &EskerFile) -> Vec<u8> {
    let layout = later_layout(file.layout());
    let statistics = later_statistics(&read(file, file.footer().statistics));
    let metadata = later_metadata(&read(file, file.footer().metadata), &layout);
    rewritten(file, &layout, &statistics, &metadata)
}

/// The file with pages of another layout, other statistics and metadata.
fn rewritten(file: &EskerFile, layout: &PageLayout, statistics: &[u8], metadata: &[u8]) -> Vec<u8> {
    let today = file.footer();
    let mut out = header(file.footer().version).to_vec();
    let mut table = file.table().clone();
    for (index, node) in (0..).zip(&mut table.nodes) {
        let points = file.read_page(index).unwrap().points().unwrap();
        let page = encode_page(layout, node.box_min, node.hot_shift, &points);
        node.page_offset = out.len() as u64;
        node.page_bytes = page.len() as u32;
        out.extend_from_slice(&page);
    }
    let mut footer = Footer {
        table: section(&mut out, bytemuck::cast_slice(&table.nodes)),
        statistics: section(&mut out, statistics),
        metadata: section(&mut out, metadata),
        verbatim: section(&mut out, &read(file, today.verbatim)),
        ..*today
    };
    footer.file_bytes = (out.len() + FOOTER_BYTES) as u64;
    out.extend_from_slice(&footer.encode());
    out
}

/// Gives the first entry of a page whose kind is 10 an unknown encoding.
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
fn an_unknown_encoding_is_named_when_its_plane_is_read() {
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
    let error = later.read_planes(0, &attributes[..1]).unwrap_err();
    assert!(matches!(error, FormatError::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("encoding 9"), "{error}");
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

/// A file with a compact plane, some of whose points have no colour.
fn compact_file(folder: &Path, palette: Palette) -> EskerFile {
    let path = folder.join("compact.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 90, 20, 3);
    let metadata = Metadata { palette: Some(palette), ..tree::metadata(schema, classes) };
    tree::write(&path, &metadata, &points, 25);
    EskerFile::open(&path).unwrap()
}

#[test]
fn a_compact_plane_has_positions_with_the_indices_of_their_colours() {
    let folder = tempfile::tempdir().unwrap();
    let palette = Palette::new(vec![[0; 3], [200, 10, 30], [90, 100, 110], [255; 3]]).unwrap();
    let file = compact_file(folder.path(), palette.clone());
    verify(&file, &Silent).unwrap();
    let mut numbers = [0; 256];
    for node in 0..file.table().nodes.len() as u32 {
        let kinds = [PlaneKind::Position, PlaneKind::Colour, PlaneKind::Compact];
        let planes = file.read_planes(node, &kinds).unwrap();
        let [positions, colours, compact] = kinds.map(|kind| planes.get(kind).unwrap());
        for (i, point) in compact.as_chunks::<HOT_POSITION_BYTES>().0.iter().enumerate() {
            assert_eq!(point[..INDEX_AT], positions[i * HOT_POSITION_BYTES..][..INDEX_AT]);
            let number = match colours[i * 4..][..4] {
                [0, 0, 0, 0] => NO_COLOUR,
                [r, g, b, _] => palette.nearest([r, g, b]),
                _ => unreachable!(),
            };
            assert_eq!(point[INDEX_AT], number);
            numbers[usize::from(number)] += 1;
        }
    }
    assert!(numbers[0] > 0 && numbers[2] > 0 && numbers[255] > 0, "{numbers:?}");
}

#[test]
fn compact_planes_of_another_palette_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let palette = |red| Palette::new(vec![[red, 0, 0], [90, 100, 110]]).unwrap();
    let file = compact_file(folder.path(), palette(0));
    let layout = file.layout().clone().with_palette(Some(palette(255)));
    let sections = [file.footer().statistics, file.footer().metadata].map(|s| read(&file, s));
    let bytes = rewritten(&file, &layout, &sections[0], &sections[1]);
    let other = EskerFile::from_source(Path::new("b"), Box::new(bytes)).unwrap();
    let error = verify(&other, &Silent).unwrap_err().to_string();
    assert!(error.contains("compact"), "{error}");
}

/// A reader that does not know such planes skips them too.
#[test]
fn a_compact_plane_without_a_palette_or_of_another_length_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let file = compact_file(folder.path(), Palette::new(vec![[9; 3]]).unwrap());
    for value_bytes in [8, 12] {
        let unknown = PlaneSpec { kind: PlaneKind::Unknown(11), hot: true, value_bytes };
        let planes = file.layout().planes().iter();
        let planes =
            planes.map(|p| if p.kind == PlaneKind::Compact { unknown } else { *p }).collect();
        let layout = file.layout().clone().with_palette(None).with_planes(planes).unwrap();
        let mut metadata = later_metadata(&read(&file, file.footer().metadata), &layout);
        if value_bytes == 8 {
            let mut json: serde_json::Value = serde_json::from_slice(&metadata).unwrap();
            json["palette"] = vec![[1, 2, 3]; 256].into();
            metadata = serde_json::to_vec(&json).unwrap();
        }
        let statistics = read(&file, file.footer().statistics);
        let bytes = rewritten(&file, &layout, &statistics, &metadata);
        let other = EskerFile::from_source(Path::new("b"), Box::new(bytes)).unwrap();
        assert_eq!(verify(&other, &Silent).unwrap().hash, file.footer().hash);
        assert_eq!(
            (other.layout().has(PlaneKind::Compact), other.layout().palette()),
            (false, None)
        );
        for node in 0..file.table().nodes.len() as u32 {
            let exact = |file: &EskerFile| file.read_page(node).unwrap().points().unwrap();
            assert_eq!(exact(&file), exact(&other));
        }
    }
}
