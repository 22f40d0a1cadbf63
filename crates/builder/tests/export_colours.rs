//! An export has colours of one scale, whatever the scales of its sources; what 8 bits do not hold
//! is counted.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod given;

use esker_builder::{ExportOptions, Options, build_sources, export_with};
use esker_format::Forest;
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth, Filter};
use esker_scan::OpenOptions;
use given::{Given, boxed, given};

const POINTS: u64 = 40;

/// A scan whose colours are this function of the index.
fn coloured(name: &str, ty: AttrType, value: impl Fn(u64) -> u64 + Copy) -> Given {
    let x0 = i32::from(name.as_bytes()[0]) * 1000;
    let places = (0..POINTS as i32).map(|i| [x0 + i, i, 0]).collect();
    let names = ["red", "green", "blue"];
    names.iter().fold(given(name, [0.001; 3], places), |scan, name| scan.with(name, ty, value))
}

/// Reds of the export of these scans, sorted, with their type; and the notes.
fn reds(
    scans: &[Given],
    ending: &str,
    colour_depth: Option<ColourDepth>,
) -> (AttrType, Vec<u64>, String) {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("in.esker"), folder.path().join(format!("out.{ending}")));
    build_sources(boxed(scans), &file, &Options::default(), &Silent).unwrap();
    let forest = Forest::open(&file).unwrap();
    let options = ExportOptions { colour_depth, ..Default::default() };
    let report = export_with(&forest, &out, &Filter::default(), options, &Silent).unwrap();
    let source = esker_scan::open(&out, &OpenOptions::default(), &Silent).unwrap();
    let grid = &source.info().grid;
    let lattice = esker_points::Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let schema = source.info().schema.clone();
    let all: Vec<_> = schema.attributes.iter().filter(|a| a.name == "red").collect();
    let [red] = all[..] else { panic!("{} reds", all.len()) };
    let at = schema.find("red").unwrap();
    let mut values = Vec::new();
    let mut sink = |batch: esker_points::Batch| {
        values.extend(batch.columns[at].chunks(red.ty.size()).map(|v| red.ty.to_f64(v) as u64));
        Ok(())
    };
    source.read(&lattice.placement(grid), &Silent, &mut sink).unwrap();
    values.sort_unstable();
    (red.ty, values, report.notes.join("\n"))
}

fn sorted(mut values: Vec<u64>) -> Vec<u64> {
    values.sort_unstable();
    values
}

#[test]
fn sources_of_eight_and_of_sixteen_bits_get_one_scale() {
    let low = coloured("a", AttrType::U16, |i| i).coloured(ColourDepth::Eight);
    let wide = coloured("b", AttrType::U16, |i| i * 1000).coloured(ColourDepth::Sixteen);
    let bytes = coloured("c", AttrType::U8, |i| 5 * i);
    let all = [low.clone(), wide.clone(), bytes.clone()];
    let of = |f: fn(u64) -> u64| (0..POINTS).map(f);
    let want = sorted(of(|i| 256 * i).chain(of(|i| 1000 * i)).chain(of(|i| 1280 * i)).collect());
    for ending in ["las", "laz", "ply", "csv"] {
        let (ty, found, notes) = reds(&all, ending, None);
        assert_eq!((ty, &found), (AttrType::U16, &want), "{ending}");
        assert!(notes.contains("colours of 8 and of 16 bits"), "{ending}: {notes}");
    }
    // A single scale stays as it is in LAS.
    for (scan, factor) in [(low, 1), (wide, 1000)] {
        let want: Vec<u64> = (0..POINTS).map(|i| factor * i).collect();
        let (_, found, notes) = reds(&[scan], "las", None);
        assert_eq!(found, want);
        assert!(!notes.contains("colours"), "{notes}");
    }
    // But for 8 bits, of which LAS asks for 16.
    let (_, found, notes) = reds(&[bytes], "las", None);
    assert_eq!(found, (0..POINTS).map(|i| 1280 * i).collect::<Vec<u64>>());
    assert!(notes.contains("times 256"), "{notes}");
}

#[test]
fn ply_has_bytes_where_they_hold_all_colours() {
    let byte = |i: u64| 6 * i;
    let want: Vec<u64> = (0..POINTS).map(byte).collect();
    for scan in [
        coloured("a", AttrType::U16, byte).coloured(ColourDepth::Eight),
        coloured("a", AttrType::U16, move |i| 256 * byte(i)).coloured(ColourDepth::Sixteen),
        coloured("a", AttrType::U16, move |i| 257 * byte(i)).coloured(ColourDepth::Sixteen),
        coloured("a", AttrType::U8, byte),
    ] {
        let (ty, found, _) = reds(&[scan], "ply", None);
        assert_eq!((ty, &found), (AttrType::U8, &want));
    }
    let wide = coloured("a", AttrType::U16, |i| 1000 * i).coloured(ColourDepth::Sixteen);
    let (ty, found, notes) = reds(&[wide], "ply", None);
    assert_eq!((ty, found[3]), (AttrType::U16, 3000));
    assert!(notes.contains("some programs show black"), "{notes}");
}

#[test]
fn rounding_to_eight_bits_is_counted() {
    let wide = [coloured("a", AttrType::U16, |i| 257 * i + 100).coloured(ColourDepth::Sixteen)];
    let want: Vec<u64> = (0..POINTS).collect();
    for (ending, ty) in [("ply", AttrType::U8), ("csv", AttrType::U8), ("las", AttrType::U16)] {
        let (found_ty, found, notes) = reds(&wide, ending, Some(ColourDepth::Eight));
        assert_eq!((found_ty, &found), (ty, &want), "{ending}");
        assert!(
            notes
                .contains("120 values of colours are rounded to 8 bits, times 257, by at most 100"),
            "{notes}"
        );
    }
    let bytes = [coloured("a", AttrType::U8, |i| i)];
    let (ty, found, _) = reds(&bytes, "ply", Some(ColourDepth::Sixteen));
    assert_eq!((ty, found[3]), (AttrType::U16, 768));
}

#[test]
fn one_factor_holds_for_all_colours() {
    // White, and a grey, as two programs widen bytes.
    let upper = |i: u64| [65_280, 32_768, 0][i as usize % 3];
    let both = |i: u64| [65_535, 32_896, 0][i as usize % 3];
    let of = |scans: &[Given], bits| reds(scans, "ply", bits);
    let mixed = [coloured("a", AttrType::U16, move |i| if i < 20 { upper(i) } else { both(i) })
        .coloured(ColourDepth::Sixteen)];
    let apart = [
        coloured("a", AttrType::U16, upper).coloured(ColourDepth::Sixteen),
        coloured("b", AttrType::U16, both).coloured(ColourDepth::Sixteen),
    ];
    for scans in [&mixed[..], &apart[..]] {
        let (ty, found, notes) = of(scans, None);
        assert_eq!(ty, AttrType::U16);
        assert!(found.contains(&65_280) && found.contains(&65_535), "{found:?}");
        assert!(!notes.contains("hold all of them"), "{notes}");
        let (ty, found, notes) = of(scans, Some(ColourDepth::Eight));
        assert_eq!(ty, AttrType::U8);
        assert!(found.contains(&254) && found.contains(&255), "{found:?}");
        assert!(notes.contains("values of colours are rounded to 8 bits, times 257"), "{notes}");
    }
    for (scan, number) in apart.iter().zip([256, 257]) {
        let (ty, found, notes) = of(std::slice::from_ref(scan), None);
        assert_eq!((ty, found[39]), (AttrType::U8, 255));
        assert!(notes.contains(&format!("stands for {number} times its value")), "{notes}");
    }
}
