//! Scans written by Esker equal what was read: LAS records bit by bit, with header and VLRs;
//! attributes without a field in LAS as extra bytes. Damaged blocks of a source cause no panic.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

#[allow(dead_code, reason = "each test file uses a part of it")]
mod las_writer;

use esker_points::lattice::{GridKind, Lattice, ORIGIN};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Batch, Schema};
use esker_scan::write::{self, Origin, Outline, Target};
use esker_scan::{OpenOptions, Source};
use las_writer::{File, Point, Variant};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn open(path: &Path) -> Box<dyn Source> {
    esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap()
}

/// The lattice of a scan, and its batches on it.
fn read(source: &dyn Source) -> (Lattice, Vec<Batch>) {
    let grid = &source.info().grid;
    let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let mut batches = Vec::new();
    let mut sink = |batch| {
        batches.push(batch);
        Ok(())
    };
    source.read(&lattice.placement(grid), &Silent, &mut sink).unwrap();
    (lattice, batches)
}

/// Every point as one row, sorted.
fn rows(batches: &[Batch]) -> Vec<Vec<u8>> {
    let row = |batch: &Batch, i| {
        let mut row = Vec::new();
        batch.record_into(i, &mut row);
        row
    };
    let mut rows: Vec<_> =
        batches.iter().flat_map(|b| (0..b.len()).map(move |i| row(b, i))).collect();
    rows.sort();
    rows
}

/// Writes batches of one schema; returns the notes.
fn write(
    path: &Path,
    lattice: Lattice,
    origins: &[Origin],
    batches: &[Batch],
    points_max: u64,
) -> Vec<String> {
    write_classes(path, lattice, origins, batches, points_max, Vec::new())
}

/// As [`write`], with the attributes of each class of points.
fn write_classes(
    path: &Path,
    lattice: Lattice,
    origins: &[Origin],
    batches: &[Batch],
    points_max: u64,
    classes: Vec<Vec<usize>>,
) -> Vec<String> {
    let schema = batches.first().map_or_else(|| Arc::new(Schema::default()), |b| b.schema.clone());
    let outline = Outline { lattice, schema, points_max, ranges: Vec::new(), classes };
    let mut origins = origins.iter().cloned().map(Ok);
    let target = Target::of(path).unwrap();
    let mut export = write::create(path, target, &outline, &mut origins).unwrap();
    for batch in batches {
        export.output.put(export.encode.encode(batch)).unwrap();
    }
    let bytes = export.output.finish().unwrap();
    assert_eq!(bytes, std::fs::metadata(path).unwrap().len());
    assert_eq!(open(path).info().format.split(',').next(), export.format.split(',').next());
    export.notes
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn point(extra: usize) -> impl Strategy<Value = Point> {
    let fields = prop::collection::vec(any::<u8>(), 60);
    let extra = prop::collection::vec(any::<u8>(), extra);
    (any::<[i32; 3]>(), fields, extra).prop_map(|(position, fields, extra)| Point {
        position,
        fields: fields.try_into().unwrap(),
        extra,
    })
}

fn scan() -> impl Strategy<Value = File> {
    (0u8..=10, 0u8..=5, 0u16..5).prop_flat_map(|(format, minor, extra)| {
        let least = [0, 0, 2, 2, 3, 3, 4, 4, 4, 4, 4][usize::from(format)];
        let variant = Variant { format, minor: minor.max(least), extra };
        prop::collection::vec(point(usize::from(extra)), 0..40).prop_map(move |points| File {
            variant,
            points,
            vlrs: vec![
                ("me".into(), 7, vec![1, 2, 3]),
                ("LAStools".into(), 10, vec![9; 28]),
                las_writer::extra_bytes_vlr(
                    &[(3, 0b11000, "range"), (1, 0, "width")][..usize::from(extra.min(3)) / 3 * 2],
                ),
            ],
        })
    })
}

/// Records of a file, sorted.
fn records(bytes: &[u8]) -> Vec<&[u8]> {
    let u16_at = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let start = u16_at(96) | u16_at(98) << 16;
    let mut records: Vec<_> = bytes[start..].chunks_exact(u16_at(105)).collect();
    records.sort();
    records
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn las_of_every_format_is_written_bit_by_bit(scan in scan()) {
        let folder = tempfile::tempdir().unwrap();
        let las = scan.las();
        let source = open(&file(folder.path(), "in.las", &las));
        let (lattice, batches) = read(source.as_ref());
        let origin = Origin::from(source.info());
        let count = scan.points.len() as u64;
        let out = folder.path().join("out.las");
        let notes = write(&out, lattice, std::slice::from_ref(&origin), &batches, count);
        if count > 0 {
            prop_assert!(notes.is_empty(), "{notes:?}");
            let back = std::fs::read(&out).unwrap();
            prop_assert_eq!(records(&las), records(&back));
            // Everything except bounds and counts.
            let vlrs = usize::from(u16::from_le_bytes([las[94], las[95]]))..las.len() - records(&las).concat().len();
            for range in [0..107, 131..179, vlrs] {
                prop_assert_eq!(&las[range.clone()], &back[range]);
            }
            let laz = folder.path().join("out.laz");
            write(&laz, lattice, &[origin], &batches, count);
            prop_assert_eq!(rows(&read(open(&laz).as_ref()).1), rows(&batches));
        }
    }

    #[test]
    fn text_is_read_again_whatever_the_names_of_columns(
        names in prop::collection::vec(prop_oneof!["[ \\PC]{1,12}", " {1,3}"], 1..6),
        values in prop::collection::vec(any::<u8>(), 1..20),
    ) {
        let attributes = names.iter().map(|name| Attribute::new(name, AttrType::U8)).collect();
        let schema = Arc::new(Schema::new(attributes));
        let mut batch = Batch::with_capacity(schema, values.len());
        batch.positions = values.iter().map(|&v| [u32::from(v); 3]).collect();
        batch.columns.iter_mut().for_each(|c| c.clone_from(&values));
        let lattice = Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let folder = tempfile::tempdir().unwrap();
        for ending in ["csv", "xyz"] {
            let out = folder.path().join(format!("out.{ending}"));
            write(&out, lattice, &[], std::slice::from_ref(&batch), values.len() as u64);
            let (_, back) = read(open(&out).as_ref());
            prop_assert_eq!(&back[0].columns, &batch.columns);
        }
    }

    #[test]
    fn damaged_blocks_make_a_file_or_an_error(
        header in prop::collection::vec(any::<u8>(), 0..500),
        vlrs in prop::collection::vec(any::<u8>(), 0..300),
        evlrs in prop::collection::vec(any::<u8>(), 0..300),
        format in 0u8..12, minor in 0u8..7, claims: bool,
    ) {
        let mut header = header;
        if header.len() >= 230 {
            header[..4].copy_from_slice(b"LASF");
            let bytes = header.len() as u16;
            header[24..26].copy_from_slice(&[1, minor]);
            header[94..96].copy_from_slice(&bytes.to_le_bytes());
            header[96..100].copy_from_slice(&1000u32.to_le_bytes());
            header[104] = format;
            if claims { header[105..107].copy_from_slice(&90u16.to_le_bytes()); }
            for axis in 0..6 {
                header[131 + 8 * axis..][..8].copy_from_slice(&1f64.to_le_bytes());
            }
        }
        let verbatim = [("las header", header), ("las vlrs", vlrs), ("las evlrs", evlrs)];
        let verbatim = verbatim.map(|(name, bytes)| (name.to_owned(), bytes)).to_vec();
        let origin = Origin { kind: GridKind::Integer, crs: None, verbatim };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.las");
        write(&out, Lattice::default(), &[origin], &[normals()], 2);
        prop_assert_eq!(read(open(&out).as_ref()).1[0].len(), 2);
    }
}

/// Two points with normals, colours of 8 bits and an attribute of their own.
fn normals() -> Batch {
    let mut attributes = ["nx", "ny", "nz"].map(|n| Attribute::new(n, AttrType::F32)).to_vec();
    attributes.extend(["red", "green", "blue"].map(|n| Attribute::new(n, AttrType::U8)));
    let own = Attribute {
        description: "metres".into(),
        scale: 0.5,
        ..Attribute::new("own", AttrType::I64)
    };
    attributes.push(own);
    let mut batch = Batch::with_capacity(Arc::new(Schema::new(attributes)), 2);
    batch.positions = vec![[ORIGIN as u32, 0, u32::MAX], [1, 2, 3]];
    let schema = batch.schema.clone();
    for (column, (a, n)) in batch.columns.iter_mut().zip(schema.attributes.iter().zip(1u8..)) {
        column.resize(2 * a.ty.size(), n);
    }
    batch
}

#[test]
fn attributes_without_a_las_field_become_extra_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let batch = normals();
    let origin = Origin { kind: GridKind::Float, crs: None, verbatim: Vec::new() };
    for ending in ["las", "laz"] {
        let out = folder.path().join(format!("out.{ending}"));
        let notes = write(
            &out,
            Lattice::default(),
            std::slice::from_ref(&origin),
            std::slice::from_ref(&batch),
            2,
        );
        let colours = "colours of 8 bits are written with 16 as LAS asks, times 256";
        assert_eq!(notes, ["as extra bytes: nx, ny, nz, own", colours]);
        let source = open(&out);
        let (_, back) = read(source.as_ref());
        assert!(source.info().format.ends_with("1.4, point format 7"), "{}", source.info().format);
        for (a, values) in batch.schema.attributes.iter().zip(&batch.columns) {
            let ty = if a.ty == AttrType::U8 { AttrType::U16 } else { a.ty };
            let at = back[0].schema.find_typed(&a.name, ty).unwrap();
            let found = &back[0].schema.attributes[at];
            assert_eq!((&found.description, found.scale), (&a.description, a.scale));
            let want: Vec<u8> = match a.ty {
                // Times 256.
                AttrType::U8 => values.iter().flat_map(|&v| [0, v]).collect(),
                _ => values.clone(),
            };
            assert_eq!(back[0].columns[at], want, "{}", a.name);
        }
        // LAZ reorders points.
        let mut positions = back[0].positions.clone();
        positions.sort_by_key(|p| p[0] != ORIGIN as u32);
        assert_eq!(positions, batch.positions);
    }
}

/// Other programs cannot know a scale there: values counted in halves are written in metres.
#[test]
fn formats_without_scales_get_scaled_values() {
    let folder = tempfile::tempdir().unwrap();
    let mut batch = normals();
    let own = batch.schema.find("own").unwrap();
    batch.columns[own] = [-3i64, 9].iter().flat_map(|v| v.to_le_bytes()).collect();
    for ending in ["ply", "xyz", "csv"] {
        let out = folder.path().join(format!("out.{ending}"));
        let notes = write(&out, Lattice::default(), &[], std::slice::from_ref(&batch), 2);
        assert_eq!(notes, ["written as scaled values: own"]);
        let back = read(open(&out).as_ref()).1.remove(0);
        let own = back.schema.find("own").unwrap();
        let ty = back.schema.attributes[own].ty;
        let values: Vec<f64> =
            back.columns[own].chunks(ty.size()).map(|value| ty.to_f64(value)).collect();
        assert_eq!(values, [-1.5, 4.5], "{ending}");
        let red = back.schema.find("red").unwrap();
        let size = back.schema.attributes[red].ty.size();
        assert_eq!(back.columns[red].len(), 2 * size, "{ending}");
    }
}

#[test]
fn sources_of_different_formats_get_the_least_format_that_holds_all() {
    let folder = tempfile::tempdir().unwrap();
    let make = |format, minor| {
        let variant = Variant { format, minor, extra: 0 };
        let point = Point {
            position: [1, 2, 3],
            fields: std::array::from_fn(|i| 3 * i as u8 + 1),
            extra: vec![],
        };
        let vlr = |n: u16| ("me".to_owned(), n, vec![format]);
        File { variant, points: vec![point], vlrs: vec![vlr(1), vlr(u16::from(format) + 2)] }
    };
    for (a, b, format, minor) in [
        ((0, 0), (2, 2), 2, 2),
        ((1, 1), (2, 2), 3, 2),
        ((1, 2), (6, 4), 6, 4),
        ((3, 2), (8, 4), 8, 4),
        ((4, 3), (2, 2), 5, 3),
    ] {
        let sources = [a, b].map(|(format, minor)| {
            let scan = make(format, minor);
            open(&file(folder.path(), &format!("{format}.las"), &scan.las()))
        });
        let schema = Arc::new(sources[0].info().schema.union(&sources[1].info().schema));
        // As the points of a file that has both: zeros where a point lacks an attribute.
        let widened = sources.each_ref().map(|source| {
            let own = read(source.as_ref()).1.remove(0);
            let column = |attribute: &Attribute| {
                own.schema
                    .find_typed(&attribute.name, attribute.ty)
                    .map_or_else(|| vec![0; attribute.ty.size()], |i| own.columns[i].clone())
            };
            let columns = schema.attributes.iter().map(column).collect();
            let (positions, outside) = (own.positions.clone(), Vec::new());
            Batch { schema: schema.clone(), positions, columns, outside }
        });
        let origins = sources.each_ref().map(|s| Origin::from(s.info()));
        let lattice = read(sources[0].as_ref()).0;
        let out = folder.path().join("out.las");
        let class = |source: &dyn Source| {
            let own = source.info().schema.attributes.iter();
            own.filter_map(|a| schema.find_typed(&a.name, a.ty)).collect()
        };
        let classes = sources.iter().map(|source| class(source.as_ref())).collect();
        let notes = write_classes(&out, lattice, &origins, &widened, 2, classes);
        assert!(notes[0].contains(&format!("point format {format}")), "{notes:?}");
        let back = open(&out);
        assert_eq!(back.info().format, format!("LAS 1.{minor}, point format {format}"));
        // The VLRs of both, each once, the first's before the other's.
        let vlrs = &back.info().verbatim[1].1;
        let kept: Vec<u8> = vlrs.chunks(55).map(|v| v[54]).collect();
        assert_eq!(kept, [a.0, a.0, b.0], "{notes:?}");
        assert!(notes.iter().any(|n| n.starts_with("1 VLRs of later sources differ")));
        let (_, batches) = read(back.as_ref());
        for (i, source) in widened.iter().enumerate() {
            for (attribute, values) in schema.attributes.iter().zip(&source.columns) {
                let Some(at) = batches[0].schema.find_typed(&attribute.name, attribute.ty) else {
                    assert_eq!(attribute.name, "scan_angle_rank");
                    continue;
                };
                let size = attribute.ty.size();
                let found = &batches[0].columns[at][i * size..][..size];
                if attribute.name == "scan_angle" && values == &[0, 0] {
                    let rank = schema.find("scan_angle_rank").unwrap();
                    let degrees = f64::from(source.columns[rank][0] as i8);
                    let steps = i16::from_le_bytes([found[0], found[1]]);
                    assert!((f64::from(steps) * 0.006 - degrees).abs() <= 0.003);
                } else {
                    assert_eq!(found, values, "{}", attribute.name);
                }
            }
        }
    }
}

#[test]
fn a_point_with_both_scan_angles_keeps_both_in_las() {
    let folder = tempfile::tempdir().unwrap();
    let text = "x,y,z,scan_angle,scan_angle_rank\n1,2,3,-6.36,-54\n2,3,4,12.6,7\n3,3,4,0.0,9\n";
    let source = open(&file(folder.path(), "angles.csv", text.as_bytes()));
    let (lattice, batches) = read(source.as_ref());
    let out = folder.path().join("out.las");
    let notes = write(&out, lattice, &[Origin::from(source.info())], &batches, 3);
    assert!(notes.iter().any(|n| n == "as extra bytes: scan_angle_rank_i8"), "{notes:?}");
    let back = &read(open(&out).as_ref()).1[0];
    let column = |name: &str| {
        let at = back.schema.find(name).unwrap();
        let ty = back.schema.attributes[at].ty;
        back.columns[at].chunks(ty.size()).map(|v| ty.to_f64(v)).collect::<Vec<_>>()
    };
    assert_eq!(column("scan_angle"), [-1060.0, 2100.0, 0.0]);
    assert_eq!(column("scan_angle_rank_i8"), [-54.0, 7.0, 9.0]);
}

/// A gap must not become a height because another source has no heights.
#[test]
fn the_no_data_value_is_kept_if_another_source_lacks_the_attribute() {
    let folder = tempfile::tempdir().unwrap();
    let mut description = vec![0u8; 192];
    // Unsigned 16 bits; no data, scale.
    description[2..4].copy_from_slice(&[3, 0b1001]);
    description[4..7].copy_from_slice(b"hgt");
    description[40..48].copy_from_slice(&65535u64.to_le_bytes());
    description[112..120].copy_from_slice(&0.01f64.to_le_bytes());
    let scans = [(2, vec![("LASF_Spec".to_owned(), 4, description)]), (0, vec![])];
    let sources = scans.map(|(extra, vlrs)| {
        let variant = Variant { format: 0, minor: 2, extra };
        let point = Point { position: [1, 2, 3], fields: [1; 60], extra: vec![255; extra.into()] };
        let scan = File { variant, points: vec![point], vlrs };
        open(&file(folder.path(), &format!("{extra}.las"), &scan.las()))
    });
    let schema = Arc::new(sources[0].info().schema.union(&sources[1].info().schema));
    let batch = read(sources[0].as_ref()).1.remove(0);
    assert_eq!(batch.schema, schema);
    let origins = sources.each_ref().map(|s| Origin::from(s.info()));
    let out = folder.path().join("out.las");
    write(&out, read(sources[0].as_ref()).0, &origins, &[batch], 1);
    let back = open(&out);
    let vlrs = &back.info().verbatim[1].1;
    let at = vlrs.windows(4).position(|w| w == b"hgt\0").unwrap() - 4;
    assert_eq!(vlrs[at + 2..at + 4], [3, 0b1001]);
    assert_eq!(vlrs[at + 40..at + 48], 65535u64.to_le_bytes());
}

#[test]
fn a_file_has_one_coordinate_reference_system() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, vlrs: Vec<(String, u16, Vec<u8>)>| {
        let variant = Variant { format: 1, minor: 2, extra: 0 };
        let point = Point { position: [1, 2, 3], fields: [1; 60], extra: vec![] };
        let scan = File { variant, points: vec![point], vlrs };
        open(&file(folder.path(), name, &scan.las()))
    };
    let projection = |number, data: &[u8]| ("LASF_Projection".to_owned(), number, data.to_vec());
    let wkt = |name: &str| projection(2112, format!("PROJCS[\"{name}\"]").as_bytes());
    let keys: Vec<u8> =
        [1u16, 1, 0, 1, 3072, 0, 1, 2154].into_iter().flat_map(u16::to_le_bytes).collect();
    let none = of("0.las", vec![]);
    let by_wkt = of("a.las", vec![wkt("Lambert")]);
    let by_keys = of("b.las", vec![projection(34735, &keys), ("me".into(), 7, vec![7])]);
    let again = of("c.las", vec![wkt("Lambert")]);
    for (sources, kept, others) in [
        (vec![&none, &by_wkt, &by_keys, &again], vec![2112, 7], "1 sources have"),
        (vec![&by_keys, &by_wkt, &again], vec![34735, 7], "2 sources have"),
        (vec![&by_wkt, &again], vec![2112], ""),
    ] {
        let (lattice, batches) = read(sources[0].as_ref());
        let origins: Vec<_> = sources.iter().map(|s| Origin::from(s.info())).collect();
        let out = folder.path().join("out.las");
        let notes = write(&out, lattice, &origins, &batches, 1).join("\n");
        assert_eq!(notes.contains("coordinate reference system"), !others.is_empty(), "{notes}");
        assert!(notes.contains(others) && !notes.contains("later sources differ"), "{notes}");
        let back = open(&out);
        let mut vlrs = &back.info().verbatim[1].1[..];
        let mut numbers = Vec::new();
        while !vlrs.is_empty() {
            numbers.push(u16::from_le_bytes([vlrs[18], vlrs[19]]));
            vlrs = &vlrs[54 + usize::from(u16::from_le_bytes([vlrs[20], vlrs[21]]))..];
        }
        assert_eq!(numbers, kept);
    }
}

#[test]
fn too_many_points_for_old_headers_raise_the_version() {
    let folder = tempfile::tempdir().unwrap();
    let variant = Variant { format: 1, minor: 2, extra: 0 };
    let point = Point { position: [7; 3], fields: [9; 60], extra: vec![] };
    let scan = File { variant, points: vec![point], vlrs: vec![] };
    let source = open(&file(folder.path(), "in.las", &scan.las()));
    let (lattice, batches) = read(source.as_ref());
    let out = folder.path().join("out.las");
    let notes = write(&out, lattice, &[source.info().into()], &batches, 5_000_000_000);
    assert_eq!(notes, ["written as LAS 1.4, which its records need"]);
    assert_eq!(open(&out).info().format, "LAS 1.4, point format 1");
    assert_eq!(rows(&read(open(&out).as_ref()).1), rows(&batches));
}

#[test]
fn extensions_select_the_format() {
    for (name, target) in [
        ("a.LAS", Target::Las),
        ("a.b.laz", Target::Laz),
        ("x.ply", Target::Ply),
        ("x.txt", Target::Text),
        ("x.csv", Target::Csv),
    ] {
        assert_eq!(Target::of(Path::new(name)).unwrap(), target);
    }
    for name in ["las", "a.e57", "a."] {
        assert!(
            Target::of(Path::new(name)).unwrap_err().to_string().contains("name it .las"),
            "{name}"
        );
    }
}
