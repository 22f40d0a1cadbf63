//! Nodes whose attributes take more memory than is decoded at a time: a value that all points share
//! is stored once, so short pages may hold them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::{Codec, EskerFile, Metadata, runs, verify};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, ColourDepth, PointClass, Schema};

const ATTRIBUTES: u16 = 600;
const POINTS: usize = 6_000;

/// A schema of many attributes, of which one class has all and one has the first.
fn wide() -> (Schema, Vec<PointClass>) {
    let attribute = |i: u16| Attribute {
        name: format!("a{i:04}"),
        ty: AttrType::U64,
        description: String::new(),
        scale: 1.0,
        offset: 0.0,
    };
    let class = |present: Vec<u16>| PointClass { present, colour_depth: ColourDepth::Sixteen };
    let schema = Schema { attributes: (0..ATTRIBUTES).map(attribute).collect() };
    (schema, vec![class((0..ATTRIBUTES).collect()), class(vec![0])])
}

#[test]
fn wide_nodes_are_read_and_verified_in_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wide.esker");
    let (schema, classes) = wide();
    let row_bytes = schema.record_bytes();
    let mut points = tree::points_of(&schema, &classes, POINTS, 20, 7);
    for (a, column) in points.columns.iter_mut().enumerate().skip(3) {
        // All constant but where the value is absent, as in small files that hold much.
        let has = points.classes.iter().map(|&class| class == 0);
        *column = has.flat_map(|has| if has { a as u64 } else { 0 }.to_le_bytes()).collect();
    }
    for codec in [Codec::None, Codec::Fast, Codec::Small] {
        let metadata = Metadata { codec, ..tree::metadata(schema.clone(), classes.clone()) };
        tree::write(&path, &metadata, &points, POINTS);
        let file = EskerFile::open(&path).unwrap();
        let page = file.read_page(0).unwrap();
        let whole = page.points().unwrap();
        let mut ends = Vec::new();
        for run in runs(whole.len(), row_bytes) {
            let part = page.points_in(run.clone()).unwrap();
            assert_eq!(part, tree::take(&whole, file.layout(), &run.clone().collect::<Vec<_>>()));
            ends.push(run.end);
        }
        assert!(ends.len() > 1 && ends.last() == Some(&POINTS), "{ends:?}");
        assert_eq!(verify(&file, &Silent).unwrap().points, POINTS as u64);
    }
}
