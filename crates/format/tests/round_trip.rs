//! Everything that is written is read again to the bit: points of any schema and classes,
//! statistics, metadata.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::{EskerFile, Metadata, PageLayout, PagePoints, PlaneKind, verify};
use esker_points::palette::{COLOURS_MAX, Palette};
use esker_points::task::Silent;
use esker_points::{ColourDepth, PointClass, Schema};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn points_come_back_to_the_bit(
        (schema, classes) in tree::schemas(), count in 0usize..300, spread in 0u32..=32,
        seed: u64, capacity in 20usize..100, codec in tree::codecs(), normals in tree::normals(),
        clipped in prop::option::of(0usize..50), has_tangents: bool,
        colours in prop::collection::vec(any::<[u8; 3]>(), 0..=COLOURS_MAX),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.esker");
        let mut points = tree::points_of(&schema, &classes, count, spread, seed);
        let metadata = tree::metadata(schema, classes);
        let metadata = Metadata { codec, normals: normals.unwrap_or(metadata.normals), ..metadata };
        if metadata.normals.is_estimated() {
            points.normals = (0..count).map(|i| [i as i16, seed as i16]).collect();
        }
        // Most points have no clip lines, and most nodes have no point with any.
        let has_clip_lines = clipped.is_some();
        let palette = Palette::new(colours);
        let metadata = Metadata { has_clip_lines, has_tangents, palette, ..metadata };
        if has_tangents {
            points.tangents = (0..count).map(|i| [i as u8, 7, seed as u8, 255]).collect();
        }
        if let Some(clipped) = clipped {
            let words = |i: usize| if i % 50 < clipped / 2 { [i as u32, 7, seed as u32, 0] } else { [0; 4] };
            points.clip_lines = (0..count).map(words).collect();
        }
        let table = tree::write(&path, &metadata, &points, capacity);
        let file = EskerFile::open(&path).unwrap();
        prop_assert_eq!(file.table(), &table);
        prop_assert_eq!(file.layout().has(PlaneKind::ClipLines), has_clip_lines);
        prop_assert_eq!(file.layout().has(PlaneKind::Tangents), has_tangents);
        let compact = metadata.palette.as_ref().filter(|_| file.layout().has(PlaneKind::Colour));
        prop_assert_eq!(file.metadata().palette.as_ref(), compact);
        prop_assert_eq!(file.layout().has(PlaneKind::Compact), compact.is_some());
        let (_, own) = tree::build_tree(&points, &metadata.lattice, capacity);
        for (index, own) in own.iter().enumerate() {
            let page = file.read_page(index as u32).unwrap();
            let part = tree::take(&points, file.layout(), own);
            prop_assert_eq!(page.points().unwrap(), part);
            for plane in file.layout().planes() {
                let planes = file.read_planes(index as u32, &[plane.kind]).unwrap();
                prop_assert_eq!(planes.get(plane.kind).unwrap(), page.plane(plane.kind).unwrap().unwrap());
                if plane.hot {
                    let node = &table.nodes[index];
                    let range = file.layout().plane_range(plane.kind, own.len(), node.hot_shift);
                    let range = range.unwrap();
                    let bytes = &page.bytes()[range.start as usize..range.end as usize];
                    prop_assert_eq!(planes.get(plane.kind).unwrap(), bytes);
                }
            }
        }
        let report = verify(&file, &Silent).unwrap();
        prop_assert_eq!((report.points, report.nodes), (count as u64, table.nodes.len() as u64));
        prop_assert_eq!(report.hash, points.hash(file.layout()));
    }
}

#[test]
fn metadata_come_back_exactly_and_verbatim_blocks_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 50, 20, 7);
    let mut written = tree::metadata(schema, classes);
    written.set_aside = tree::set_aside(&written);
    tree::write(&path, &written, &points, 20);
    let file = EskerFile::open(&path).unwrap();
    assert_eq!(file.verbatim(0).unwrap(), written.sources[0].verbatim);
    assert_eq!(file.verbatim(1).unwrap(), []);
    written.sources.iter_mut().for_each(|s| s.verbatim.clear());
    let bits = |m: &Metadata| m.sources[0].grid.bounds.unwrap().map(|b| b.map(f64::to_bits));
    let mut read = file.metadata().clone();
    assert_eq!(bits(&read), bits(&written));
    for m in [&mut read, &mut written] {
        m.sources.iter_mut().for_each(|s| s.grid.bounds = None);
    }
    // The writer of the tests sets the bounds to those of the points.
    let axis = |i: usize| points.positions.iter().map(move |p| p[i]);
    let low = [0, 1, 2].map(|i| axis(i).min().unwrap());
    let high = [0, 1, 2].map(|i| axis(i).max().unwrap());
    assert_eq!(read.bounds, Some([low, high]));
    written.bounds = read.bounds;
    assert_eq!(read, written);
    assert_eq!(file.footer().rounding_error_max, 0.1 + 0.2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn statistics_hold_for_nodes_subtrees_and_the_file(
        (schema, classes) in tree::schemas(), count in 1usize..300, seed: u64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.esker");
        let points = tree::points_of(&schema, &classes, count, 20, seed);
        let metadata = tree::metadata(schema, classes);
        let table = tree::write(&path, &metadata, &points, 30);
        let file = EskerFile::open(&path).unwrap();
        let (_, own) = tree::build_tree(&points, &metadata.lattice, 30);
        let mut below = own.clone();
        for index in (1..below.len()).rev() {
            let moved = below[index].clone();
            below[table.nodes[index].parent as usize].extend(moved);
        }
        hold(&file, &points, &own, &below);
    }
}

/// Compares statistics with a plain computation in `f64`.
fn hold(file: &EskerFile, points: &PagePoints, own: &[Vec<usize>], below: &[Vec<usize>]) {
    let statistics = file.statistics().unwrap();
    let schema = file.layout().schema();
    let values = |a: usize, of: &[usize]| -> Vec<f64> {
        let ty = schema.attributes[a].ty;
        of.iter()
            .filter(|&&i| file.layout().has_attribute(points.class(i), a))
            .map(|&i| ty.to_f64(&points.columns[a][i * ty.size()..]))
            .filter(|v| !v.is_nan())
            .collect()
    };
    let range = |values: &[f64]| {
        let least = values.iter().copied().reduce(f64::min)?;
        Some((least, values.iter().copied().reduce(f64::max)?))
    };
    let class = schema.find("classification");
    for node in 0..own.len() {
        for a in 0..schema.attributes.len() {
            assert_eq!(statistics.own(node as u32, a), range(&values(a, &own[node])));
            assert_eq!(statistics.subtree(node as u32, a), range(&values(a, &below[node])));
        }
        let bits = |of: &[usize]| {
            let mut bits = [0u64; 4];
            let set = |c: &f64| bits[*c as usize / 64] |= 1 << (*c as u32 % 64);
            values(class?, of).iter().for_each(set);
            Some(bits)
        };
        assert_eq!(statistics.own_classes(node as u32), bits(&own[node]));
        assert_eq!(statistics.subtree_classes(node as u32), bits(&below[node]));
    }
    for a in 0..schema.attributes.len() {
        let finite = values(a, &below[0]).iter().filter(|v| v.is_finite()).count();
        let counted: u64 = statistics.histograms().counts(a).iter().sum();
        assert_eq!(counted as usize, finite);
    }
}

#[test]
fn attributes_without_points_take_no_plane() {
    let (schema, classes) = tree::mixed_schema();
    let plain = PageLayout::new(
        &Schema::default(),
        &[PointClass { present: vec![], colour_depth: ColourDepth::Sixteen }],
    );
    let kinds: Vec<_> = plain.planes().iter().map(|p| p.kind).collect();
    assert_eq!(kinds, [PlaneKind::Position, PlaneKind::Residual]);
    let eight = PageLayout::new(&schema, &classes[1..2]);
    assert!(eight.has(PlaneKind::Colour) && !eight.has(PlaneKind::ColourRemainder));
    let red = schema.find_typed("red", esker_points::AttrType::U8).unwrap() as u16;
    assert!(!eight.has(PlaneKind::Attribute(red)), "8-bit colour stands in the hot plane only");
    assert!(!eight.has(PlaneKind::Class));
}

#[test]
fn a_writer_that_does_not_finish_leaves_nothing_and_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    std::fs::write(&path, "old").unwrap();
    let mut writer = esker_format::FileWriter::create(&path).unwrap();
    writer.write_page(&[0; 128]).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
}

#[test]
fn invalid_data_are_refused_before_a_file_exists() {
    let folder = tempfile::tempdir().unwrap();
    let error =
        |path: &std::path::Path| esker_format::FileWriter::create(path).unwrap_err().to_string();
    assert!(error(folder.path()).contains("other than a file has this name"));
    let missing = folder.path().join("missing/a.esker");
    assert!(error(&missing).contains("cannot write it"));
    let mut writer = esker_format::FileWriter::create(&folder.path().join("a.esker")).unwrap();
    assert!(writer.write_page(&[0; 65]).unwrap_err().to_string().contains("65 bytes"));
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
