//! COPC files drawn as they are: the tree has every point of the file once, with all attributes and
//! the file's own integers, whatever is read first; damaged hierarchies are errors.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{Options, build_sources, copc, export};
use esker_format::{EskerFile, Forest};
use esker_points::attribute::names;
use esker_points::task::Silent;
use esker_points::{AttrType, Filter};
use esker_scan::OpenOptions;
use given::{Given, boxed, given};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

fn scan(count: u64, place: impl Fn(u64) -> [i32; 3]) -> Given {
    given("a.las", [0.001; 3], (0..count).map(place).collect())
        .at([1000.5, -20.25, 3.0])
        .with(names::INTENSITY, AttrType::U16, |i| i)
        .with(names::CLASSIFICATION, AttrType::U8, |i| i % 7)
        .with(names::RED, AttrType::U16, |i| i * 7)
        .with(names::GREEN, AttrType::U16, |i| i * 5)
        .with(names::BLUE, AttrType::U16, |i| i * 3)
        .with("gps_time", AttrType::F64, |i| (i as f64 - 100.0).to_bits())
        .with("amplitude", AttrType::F32, |i| u64::from((i as f32).to_bits()))
}

/// A COPC file of a scan in nodes of `node_capacity` points.
fn exported(scan: Given, node_capacity: u32) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let built = folder.path().join("in.esker");
    let options = Options { node_capacity, ..Default::default() };
    build_sources(boxed(&[scan]), &built, &options, &Silent).unwrap();
    let out = folder.path().join("out.copc.laz");
    export(&Forest::open(&built).unwrap(), &out, &Filter::default(), &Silent).unwrap();
    (folder, out)
}

fn open(path: &Path) -> EskerFile {
    copc::open(path, &OpenOptions::default(), 1 << 20).unwrap()
}

/// Everything that is known of a tree once all of it was read.
fn completed(mut file: EskerFile) -> EskerFile {
    loop {
        let nodes: Vec<u32> = (0..file.table().nodes.len() as u32).collect();
        file.complete(&nodes).unwrap();
        match file.newer() {
            Some(newer) => file = newer,
            None => return file,
        }
    }
}

/// Coordinates and attributes of points, one row each, sorted.
fn sorted(mut rows: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    rows.sort_unstable();
    rows
}

fn rows(positions: &[[u32; 3]], columns: &[Vec<u8>], sizes: &[usize]) -> Vec<Vec<u8>> {
    let row = |(i, p): (usize, &[u32; 3])| {
        let mut row: Vec<u8> = p.iter().flat_map(|c| c.to_le_bytes()).collect();
        columns.iter().zip(sizes).for_each(|(c, &n)| row.extend_from_slice(&c[i * n..][..n]));
        row
    };
    positions.iter().enumerate().map(row).collect()
}

/// Rows of all points as the reader of LAZ has them.
fn rows_of_scan(path: &Path) -> Vec<Vec<u8>> {
    let source = esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap();
    let info = source.info();
    let lattice = esker_points::Lattice::choose(std::slice::from_ref(&info.grid)).unwrap();
    let placement = lattice.placement(&info.grid);
    assert!(placement.is_exact());
    let sizes: Vec<usize> = info.schema.attributes.iter().map(|a| a.ty.size()).collect();
    let mut all = Vec::new();
    let mut take = |batch: esker_points::Batch| {
        all.extend(rows(&batch.positions, &batch.columns, &sizes));
        Ok(())
    };
    source.read(&placement, &Silent, &mut take).unwrap();
    sorted(all)
}

/// Rows of all points of a tree that is completed, after checks of each node.
fn rows_of_tree(file: &EskerFile) -> Vec<Vec<u8>> {
    let schema = &file.metadata().schema;
    let sizes: Vec<usize> = schema.attributes.iter().map(|a| a.ty.size()).collect();
    let (drawn, exact) = (file.metadata().lattice, file.exact_lattice());
    let mut all = Vec::new();
    for (index, node) in (0u32..).zip(&file.table().nodes) {
        let points = file.read_page(index).unwrap().points().unwrap();
        let own = file.exact_positions(index).unwrap().unwrap();
        assert_eq!((points.len(), own.len()), (node.points(), node.points()));
        let contour = node.contour();
        for (placed, own) in points.positions.iter().zip(&own) {
            let (a, b) = (drawn.world(*placed), exact.world(*own));
            for axis in 0..3 {
                // Rounded to a step, or moved by one off the upper face of the cube.
                let off = (a[axis] - b[axis]).abs();
                assert!(off <= 1.01 * drawn.scale[axis] + 1e-9, "{a:?} {b:?}");
            }
            assert!(node.cell().contains(*placed));
            let local = [0, 1, 2].map(|i| {
                f64::from(placed[i] - node.corner[i]) * drawn.metric().scale[i] - contour.centre[i]
            });
            for (axis, half) in contour.axes.iter().zip(contour.half) {
                let along: f64 = (0..3).map(|i| axis[i] * local[i]).sum();
                assert!(along.abs() <= half * (1.0 + 1e-6), "{along} of {half}");
            }
        }
        all.extend(rows(&own, &points.columns, &sizes));
        for child in node.children() {
            let child = &file.table().nodes[child as usize];
            assert_eq!(child.parent, index);
            assert!(node.cell().contains_cell(&child.cell()));
            assert_eq!(child.is_continuation(), child.cell() == node.cell());
        }
    }
    sorted(all)
}

#[test]
fn the_tree_has_every_point_once_with_all_attributes() {
    let near = |i: u64, size: u32| [0, 1, 2].map(|axis| below(3 * i + axis, size));
    let clouds = [
        ("a volume", scan(20_000, move |i| near(i, 9_000)), 256),
        ("a plane", scan(20_000, |i| [below(2 * i, 50_000), below(2 * i + 1, 50_000), 7]), 256),
        ("a line", scan(5_000, |i| [i as i32, 3, 3]), 64),
        (
            "far apart",
            scan(5_000, move |i| near(i, 900).map(|c| c + 100_000 * (i % 2) as i32)),
            256,
        ),
        ("one place", scan(3_000, |_| [5, 6, 7]), 256),
        ("one point", scan(1, |_| [-5, 6, 7]), 256),
        (
            "whole range",
            scan(999, |i| [0, 1, 2].map(|a| below(3 * i + a, u32::MAX) ^ i32::MIN)),
            256,
        ),
    ];
    for (name, cloud, capacity) in clouds {
        let points = cloud.positions.len() as u64;
        let (_folder, path) = exported(cloud, capacity);
        let file = open(&path);
        assert_eq!(file.footer().points, points, "{name}");
        let file = completed(file);
        let sum: usize = file.table().nodes.iter().map(|node| node.points()).sum();
        assert_eq!(sum as u64, points, "{name}");
        assert_eq!(rows_of_tree(&file), rows_of_scan(&path), "{name}");
    }
}

/// Whether the contour of a node holds all of its cell.
fn holds_cell(file: &EskerFile, node: &esker_points::Node) -> bool {
    let scale = file.metadata().lattice.metric().scale;
    let contour = node.contour();
    (0..8).all(|corner| {
        let local = [0, 1, 2].map(|axis| {
            let at = f64::from(corner >> axis & 1) * node.cell().edge() as f64;
            at * scale[axis] - contour.centre[axis]
        });
        contour.axes.iter().zip(contour.half).all(|(axis, half)| {
            let along: f64 = (0..3).map(|i| axis[i] * local[i]).sum();
            along.abs() <= half * (1.0 + 1e-5)
        })
    })
}

#[test]
fn contours_hold_all_points_before_and_after_chunks_are_read_also_in_degrees() {
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 40_000));
    let mut degrees = scan(20_000, place);
    degrees.info.grid.grid.scale = [1e-7; 3];
    degrees = degrees.at([8.5, 47.0, 0.0]);
    degrees.info.crs = Some(esker_scan::Crs {
        text: r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]"#.into(),
        unit: Some("degree".into()),
    });
    for (name, cloud) in [("metres", scan(20_000, place)), ("degrees", degrees)] {
        let (_folder, path) = exported(cloud, 256);
        let file = open(&path);
        assert_eq!(file.metadata().lattice.is_scaled(), name == "degrees");
        // The first chunk is read when the file is opened.
        let unknown = file.table().nodes.iter().skip(1);
        assert!(unknown.clone().count() > 20);
        assert!(unknown.clone().all(|node| holds_cell(&file, node)), "{name}");
        assert_eq!(rows_of_tree(&completed(file)), rows_of_scan(&path), "{name}");
    }
}

#[test]
fn pages_of_the_hierarchy_are_read_when_they_are_wanted() {
    let place = |i: u64| [below(2 * i, 4_000_000), below(2 * i + 1, 4_000_000), 0];
    let (_folder, path) = exported(scan(300_000, place), 64);
    let file = open(&path);
    let first = file.table().nodes.len();
    let links = |file: &EskerFile| -> Vec<u32> {
        let is_link = |index: &u32| {
            let node = &file.table().nodes[*index as usize];
            node.points() == 0 && node.child_count == 0
        };
        (0..file.table().nodes.len() as u32).filter(is_link).collect()
    };
    let before = links(&file);
    assert!(!before.is_empty() && first < 4_500, "{} of {first}", before.len());
    // One more page: nodes keep what they had, and this one gets points and children.
    file.complete(&before[..1]).unwrap();
    let one = file.newer().unwrap();
    assert_eq!(links(&one).len(), before.len() - 1);
    let (old, new) = (&file.table().nodes, &one.table().nodes);
    assert!(new.len() > old.len() && new[before[0] as usize].points() > 0);
    for (index, (old, new)) in old.iter().zip(new).enumerate() {
        if index != before[0] as usize {
            assert_eq!(
                (old.corner, old.page_offset, old.parent),
                (new.corner, new.page_offset, new.parent)
            );
        }
    }
    // The earlier state still reads what it names.
    assert!(file.read_page(before[0]).unwrap().points().unwrap().is_empty());
    let whole = completed(one);
    assert!(links(&whole).is_empty());
    assert_eq!(rows_of_tree(&whole), rows_of_scan(&path));
}

#[test]
fn large_chunks_become_nodes_that_continue_each_other() {
    // Coincident points share a chunk.
    let (_folder, path) = exported(scan(600_000, |_| [5, 6, 7]), 1 << 16);
    let file = completed(open(&path));
    let largest = file.table().nodes.iter().map(|node| node.points()).max();
    assert!(largest <= Some(1 << 18), "{largest:?}");
    assert!(file.table().nodes.iter().filter(|node| node.is_continuation()).count() >= 2);
    assert_eq!(rows_of_tree(&file), rows_of_scan(&path));
}

#[test]
fn bytes_are_those_of_pages_however_they_are_read() {
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000));
    let (_folder, path) = exported(scan(20_000, place), 256);
    let file = completed(open(&path));
    let nodes = &file.table().nodes;
    let pages: Vec<u8> =
        (0..nodes.len() as u32).flat_map(|i| file.read_page(i).unwrap().bytes().to_vec()).collect();
    let start = nodes[0].page_offset;
    for (from, bytes) in [(0, 100), (1, 70_000), (123_457, 200_000), (777, 1)] {
        let mut read = vec![0; bytes];
        file.read_exact_at(&mut read, start + from as u64).unwrap();
        assert!(read == pages[from..from + bytes], "{bytes} at {from}");
    }
    let mut beyond = [0; 2];
    assert!(file.read_exact_at(&mut beyond, start + pages.len() as u64 - 1).is_err());
}

#[test]
fn what_is_not_known_yet_may_have_any_value() {
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000));
    let (_folder, path) = exported(scan(20_000, place), 256);
    let file = open(&path);
    let schema = &file.metadata().schema;
    let statistics = file.statistics().unwrap();
    for (a, attribute) in schema.attributes.iter().enumerate() {
        let (low, high) = statistics.own(1, a).unwrap();
        let (least, greatest) = match attribute.ty {
            AttrType::U8 => (0.0, 255.0),
            AttrType::U16 => (0.0, 65535.0),
            AttrType::I16 => (-32768.0, 32767.0),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        };
        assert!(low <= least && high >= greatest, "{}: {low} to {high}", attribute.name);
    }
    assert_eq!(statistics.own_classes(1), Some([u64::MAX; 4]));
    let known = completed(file.clone()).statistics().unwrap();
    assert_eq!(known.subtree_classes(0), Some([0b111_1111, 0, 0, 0]));
    let intensity = schema.find_typed(names::INTENSITY, AttrType::U16).unwrap();
    assert_eq!(known.subtree(0, intensity), Some((0.0, 19_999.0)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn a_damaged_file_gives_errors_or_its_points(places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4), is_in_hierarchy in any::<bool>()) {
        let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 900));
        let (folder, path) = exported(scan(600, place), 64);
        let mut bytes = std::fs::read(&path).unwrap();
        let end = bytes.len();
        for (at, value) in places {
            // The hierarchy is at the end, header and records are at the beginning.
            let at = if is_in_hierarchy { end - 1 - at.index(2_000) } else { at.index(1_500) };
            bytes[at] = value;
        }
        let damaged = folder.path().join("damaged.copc.laz");
        std::fs::write(&damaged, &bytes).unwrap();
        if let Ok(mut file) = copc::open(&damaged, &OpenOptions::default(), 1 << 20) {
            for _ in 0..20 {
                let nodes = 0..file.table().nodes.len() as u32;
                let is_sound = file.complete(&nodes.collect::<Vec<_>>()).is_ok();
                match file.newer() {
                    Some(newer) if is_sound => file = newer,
                    _ => break,
                }
            }
        }
    }
}

#[test]
fn scans_that_are_not_copc_are_not_taken_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 900));
    let (copc_folder, path) = exported(scan(600, place), 64);
    assert!(copc::is_copc(&path).unwrap());
    let built = copc_folder.path().join("in.esker");
    assert!(!copc::is_copc(&built).unwrap());
    let laz = folder.path().join("plain.laz");
    export(&Forest::open(&built).unwrap(), &laz, &Filter::default(), &Silent).unwrap();
    assert!(!copc::is_copc(&laz).unwrap());
    let error = copc::open(&laz, &OpenOptions::default(), 1 << 20).unwrap_err().to_string();
    assert!(error.contains("octree"), "{error}");
    // Cut behind its header: a clear error.
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.truncate(2_000);
    std::fs::write(&laz, &bytes).unwrap();
    let error = copc::open(&laz, &OpenOptions::default(), 1 << 20).unwrap_err().to_string();
    assert!(error.starts_with(&laz.display().to_string()), "{error}");
}
