//! Every format that is written is read again with equal values: LAS of all point formats by way of
//! text and PLY, and clouds of any attributes, with values that are extreme or no numbers.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod cloud;
#[allow(dead_code, reason = "each test file uses a part of it")]
mod las_writer;

use cloud::{Cloud, read_path};
use esker_points::attribute::names;
use esker_points::lattice::{Lattice, ORIGIN};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Batch, Schema};
use esker_scan::OpenOptions;
use esker_scan::write::{self, Origin, Outline, Target};
use las_writer::{File, Point, Variant};
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;

const COLOURS: [&str; 3] = [names::RED, names::GREEN, names::BLUE];

/// Writes a batch with the blocks of its source; returns the notes.
fn write(path: &Path, lattice: Lattice, origins: Vec<Origin>, batch: &Batch) -> Vec<String> {
    let schema = batch.schema.clone();
    let points_max = batch.len() as u64;
    // As a file knows them: without numbers of returns, text names the byte of returns otherwise;
    // colours of 16 bits that look like 8 have a note.
    let range = |(a, column): (&Attribute, &Vec<u8>)| {
        let is_known = a.name == names::RETURNS || COLOURS.contains(&&*a.name);
        let values = column.chunks_exact(a.ty.size()).map(|v| a.ty.to_f64(v));
        values.reduce(f64::max).filter(|_| is_known).map(|most| (0.0, most))
    };
    let ranges = schema.attributes.iter().zip(&batch.columns).map(range).collect();
    let outline = Outline { lattice, schema, points_max, ranges, classes: Vec::new() };
    let target = Target::of(path).unwrap();
    let mut origins = origins.into_iter().map(Ok);
    let mut export = write::create(path, target, &outline, &mut origins).unwrap();
    export.output.put(export.encode.encode(batch)).unwrap();
    let mut notes = export.notes;
    notes.extend(export.output.remarks());
    export.output.finish().unwrap();
    notes
}

/// Writes the scan at `from` as `to`, with all that is known of it; returns the notes.
fn convert(from: &Path, to: &Path) -> Vec<String> {
    let source = esker_scan::open(from, &OpenOptions::default(), &Silent).unwrap();
    let grid = &source.info().grid;
    let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let mut all: Option<Batch> = None;
    let mut sink = |batch: Batch| {
        assert!(all.replace(batch).is_none(), "a small scan is one batch");
        Ok(())
    };
    source.read(&lattice.placement(grid), &Silent, &mut sink).unwrap();
    write(to, lattice, vec![source.info().into()], &all.unwrap())
}

/// A value as a whole number if it is one, else as the bits of a double; all NaN are alike. Values
/// that are compared with those of singles are rounded to singles.
fn number(attribute: &Attribute, stored: &[u8], is_single: bool) -> Result<i128, u64> {
    let ty = attribute.ty;
    let mut wide = [0; 8];
    wide[..stored.len()].copy_from_slice(stored);
    let is_plain = attribute.scale == 1.0 && attribute.offset == 0.0;
    match ty {
        AttrType::U64 if is_plain => return Ok(u64::from_le_bytes(wide).into()),
        AttrType::I64 if is_plain => return Ok(i64::from_le_bytes(wide).into()),
        _ => {}
    }
    let v = ty.to_f64(stored) * attribute.scale + attribute.offset;
    let v = if is_single { f64::from(v as f32) } else { v };
    match v.fract() == 0.0 && v.abs() < 1e30 && !(v == 0.0 && v.is_sign_negative()) {
        true => Ok(v as i128),
        false if v.is_nan() => Err(u64::MAX),
        false => Err(v.to_bits()),
    }
}

/// Checks that `found` has the values of `want` under their names.
fn check(want: &Cloud, found: &Cloud, what: &str) -> Result<(), TestCaseError> {
    prop_assert_eq!(want.world.len(), found.world.len());
    let attributes = &want.info.schema.attributes;
    let is_dark = attributes.iter().zip(&want.columns).all(|(a, column)| {
        let is_dark = || column.chunks_exact(2).all(|v| v[1] == 0);
        !COLOURS.contains(&&*a.name) || (a.ty == AttrType::U16 && is_dark())
    });
    for (attribute, column) in attributes.iter().zip(&want.columns) {
        // A name that means something else in LAS gets its type as a suffix, with a note.
        let schema = &found.info.schema;
        let all = [AttrType::F32, AttrType::F64, AttrType::I32, AttrType::U8];
        let renamed = |ty: AttrType| schema.find(&format!("{}_{}", attribute.name, ty.name()));
        let at = schema.find_typed(&attribute.name, attribute.ty);
        let at = at.or_else(|| all.into_iter().find_map(renamed));
        let at = at.or_else(|| schema.find(&attribute.name));
        if attribute.name == names::SCAN_ANGLE_RANK
            && at.is_none()
            && schema.find(names::SCAN_ANGLE).is_some()
        {
            // Whole degrees among values that only steps of 0.006 hold; a note says so.
            continue;
        }
        let at = at.ok_or_else(|| TestCaseError::fail(format!("{what}: no {}", attribute.name)))?;
        let own = &found.info.schema.attributes[at];
        let is_single = attribute.ty == AttrType::F32;
        let values = |a: &Attribute, column: &[u8]| -> Vec<_> {
            column.chunks(a.ty.size()).map(|v| number(a, v, is_single)).collect()
        };
        let notes = &found.info.notes;
        let mut want = values(attribute, column);
        let mut found = values(own, &found.columns[at]);
        if attribute.name == names::RETURNS && what.contains("la") {
            // LAS and LAZ demand the number of a return.
            for v in want.iter_mut().flatten().filter(|v| **v & 15 == 0) {
                *v = (*v >> 4).max(1) << 4 | 1;
            }
        }
        let by_text = what.contains("csv") || what.contains("xyz");
        let is_float = matches!(own.ty, AttrType::F32 | AttrType::F64);
        if by_text && !is_float && want.iter().all(|v| *v == Err(u64::MAX)) {
            // A column of text without any value has the type that its name tells.
            let note = format!("have no value for {}: 0 stands for it", attribute.name);
            let is_noted = notes.iter().any(|n| n.contains(&note));
            prop_assert!(is_noted || what.contains(" to "), "{:?}", notes);
            want.fill(Ok(0));
        }
        let is_text_first = what.starts_with("csv to las") || what.starts_with("xyz to las");
        if is_text_first && is_dark && COLOURS.contains(&&*attribute.name) {
            // Text has them as colours of 8 bits, with a note; LAS has 16.
            want.iter_mut().flatten().for_each(|v| *v *= 256);
        }
        let near = |(a, b): (&Result<i128, u64>, &Result<i128, u64>)| match (a, b) {
            // Scaled values are written in decimals.
            (Err(a), Err(b)) if attribute.scale != 1.0 => {
                let (a, b) = (f64::from_bits(*a), f64::from_bits(*b));
                (a - b).abs() <= a.abs() * 1e-15
            }
            (a, b) => a == b,
        };
        if [names::NX, names::NY, names::NZ].contains(&attribute.name.as_str()) {
            // Text has 0 in place of a normal that is no number; a note counts them.
            let none = want.iter_mut().chain(&mut found).filter(|v| **v == Err(u64::MAX));
            none.for_each(|v| *v = Ok(0));
        }
        if what.contains("laz") {
            // LAZ reorders points.
            want.sort_unstable();
            found.sort_unstable();
        }
        prop_assert!(
            want.len() == found.len() && want.iter().zip(&found).all(near),
            "{}: {} ({:?}, {:?}): {:?} {:?}",
            what,
            attribute.name,
            attribute.ty,
            own.ty,
            want,
            found
        );
    }
    Ok(())
}

fn las() -> impl Strategy<Value = File> {
    let point = |extra: usize| {
        let fields = prop::collection::vec(any::<u8>(), 60);
        let extra = prop::collection::vec(any::<u8>(), extra);
        let position = prop::array::uniform3(-1_000_000i32..1_000_000);
        (position, fields, extra).prop_map(|(position, fields, extra)| Point {
            position,
            fields: fields.try_into().unwrap(),
            extra,
        })
    };
    (0u8..=10, 0u16..9).prop_flat_map(move |(format, extra)| {
        let minor = [2, 2, 2, 2, 3, 3, 4, 4, 4, 4, 4][usize::from(format)];
        let variant = Variant { format, minor, extra };
        let kinds = match extra {
            8.. => vec![(7, 0, "stamp")],
            4.. => vec![(9, 0, "amplitude")],
            3 => vec![(3, 0b11000, "range"), (1, 0, "width")],
            _ => vec![],
        };
        let vlrs = vec![las_writer::extra_bytes_vlr(&kinds)];
        prop::collection::vec(point(usize::from(extra)), 1..30).prop_map(move |points| File {
            variant,
            points,
            vlrs: vlrs.clone(),
        })
    })
}

/// Attributes of a cloud, in groups that occur together.
fn groups() -> Vec<Vec<(&'static str, AttrType)>> {
    use AttrType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    vec![
        vec![("intensity", U16)],
        vec![("intensity", U8)],
        vec![("intensity", F32)],
        vec![("returns", U8), ("flags", U8)],
        vec![("returns", U8), ("flags", U8), ("scan_angle", I16)],
        vec![("returns", U8), ("flags", U8), ("scan_angle_rank", I8)],
        vec![("classification", U8), ("user_data", U8), ("point_source_id", U16)],
        vec![("gps_time", F64)],
        vec![("red", U16), ("green", U16), ("blue", U16), ("nir", U16)],
        vec![("nx", F32), ("ny", F32), ("nz", F32)],
        vec![("a_u8", U8), ("a_i8", I8), ("a_u16", U16), ("a_i16", I16), ("a_u32", U32)],
        vec![("an_i32", I32), ("a_u64", U64), ("an_i64", I64), ("an_f32", F32), ("an_f64", F64)],
    ]
}

/// Values of this type: extreme, no numbers, small whole ones, and any bytes.
fn value(ty: AttrType) -> impl Strategy<Value = Vec<u8>> {
    let floats =
        [0.0, -0.0, 1.0, 0.1, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-310];
    let special = (0..floats.len() + 3, any::<u64>()).prop_map(move |(kind, bits)| {
        let float = floats.get(kind).copied();
        match (ty, float, kind - floats.len().min(kind)) {
            (AttrType::F64, Some(v), _) => v.to_le_bytes().to_vec(),
            (AttrType::F32, Some(v), _) => (v as f32).to_le_bytes().to_vec(),
            (_, None, 0) => vec![0xff; ty.size()],
            (_, None, 1) => [vec![0; ty.size() - 1], vec![0x80]].concat(),
            _ => (bits % 200).to_le_bytes()[..ty.size()].to_vec(),
        }
    });
    prop_oneof![special, prop::collection::vec(any::<u8>(), ty.size())]
}

fn any_cloud() -> impl Strategy<Value = Batch> {
    let chosen = prop::sample::subsequence(groups(), 0..=6);
    (chosen, 1usize..20).prop_flat_map(|(groups, points)| {
        let mut attributes: Vec<Attribute> = Vec::new();
        for (name, ty) in groups.into_iter().flatten() {
            if attributes.iter().all(|a| a.name != name) {
                attributes.push(Attribute::new(name, ty));
            }
        }
        let schema = Arc::new(Schema::new(attributes));
        let columns: Vec<_> = schema
            .attributes
            .iter()
            .map(|a| prop::collection::vec(value(a.ty), points).prop_map(|v| v.concat()))
            .collect();
        let places = prop::array::uniform3(0u32..1_000_000);
        let positions = prop::collection::vec(places, points);
        (positions, columns).prop_map(move |(positions, columns)| Batch {
            schema: schema.clone(),
            positions: positions.iter().map(|p| p.map(|c| c + ORIGIN as u32)).collect(),
            columns,
            outside: Vec::new(),
        })
    })
}

/// `laz` writes wrong times behind a GPS time of -0.
#[test]
fn times_behind_a_negative_zero_come_back_from_laz() {
    let attributes = [("flags", AttrType::U8), (names::GPS_TIME, AttrType::F64)];
    let attributes = attributes.map(|(name, ty)| Attribute::new(name, ty)).to_vec();
    // Scanner channels 0, 1 and 2: each begins with the last record of another.
    let points = [(0u8, 0.0_f64), (0, -0.0), (0x20, -0.0), (0x10, 1.0), (0, 1.0), (0x20, 2.0)];
    let batch = Batch {
        schema: Arc::new(Schema::new(attributes)),
        positions: vec![[ORIGIN as u32; 3]; points.len()],
        columns: vec![
            points.iter().map(|p| p.0).collect(),
            points.iter().flat_map(|p| p.1.to_le_bytes()).collect(),
        ],
        outside: Vec::new(),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.laz");
    let lattice =
        Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
    let notes = write(&path, lattice, vec![], &batch);
    assert!(notes.contains(&"2 GPS times of -0 are written as 0".to_owned()), "{notes:?}");
    let found = read_path(&path).unwrap();
    let column = |name: &str, ty| &found.columns[found.info.schema.find_typed(name, ty).unwrap()];
    let times = column(names::GPS_TIME, AttrType::F64).chunks(8).map(|t| AttrType::F64.to_f64(t));
    let mut rows: Vec<_> = column("flags", AttrType::U8).iter().copied().zip(times).collect();
    rows.sort_by(|a, b| a.partial_cmp(b).unwrap());
    let mut want = points;
    want.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(rows, want);
}

#[test]
fn text_says_that_dark_colours_of_16_bits_look_like_8() {
    let folder = tempfile::tempdir().unwrap();
    let lattice =
        Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
    for (brightest, is_noted) in [(255u16, true), (256, false)] {
        let batch = Batch {
            schema: Arc::new(Schema::new(COLOURS.map(|n| Attribute::new(n, AttrType::U16)).into())),
            positions: vec![[ORIGIN as u32; 3]],
            columns: [7, brightest, 0].map(|v| v.to_le_bytes().to_vec()).into(),
            outside: Vec::new(),
        };
        let notes = write(&folder.path().join("out.csv"), lattice, vec![], &batch);
        let note =
            "colours of 16 bits are all below 256: text with them is read as colours of 8 bits";
        assert_eq!(notes.iter().any(|n| n == note), is_noted, "{notes:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn las_of_every_format_comes_back_from_text_and_ply(scan in las()) {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("in.las"), scan.las()).unwrap();
        let want = read_path(&path("in.las")).unwrap();
        for ending in ["csv", "xyz", "ply"] {
            let (between, out) = (path(&format!("between.{ending}")), path("out.las"));
            convert(&path("in.las"), &between);
            check(&want, &read_path(&between).unwrap(), ending)?;
            let notes = convert(&between, &out);
            let found = read_path(&out).unwrap();
            check(&want, &found, &format!("las by way of {ending}, {notes:?}"))?;
        }
    }

    #[test]
    fn clouds_of_any_attributes_come_back_from_every_format(batch in any_cloud()) {
        let folder = tempfile::tempdir().unwrap();
        let lattice = Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let path = |name: String| folder.path().join(name);
        write(&path("want.las".into()), lattice, vec![], &batch);
        let info = read_path(&path("want.las".into())).unwrap().info;
        let report = Default::default();
        let world = batch.positions.iter().map(|&p| lattice.world(p)).collect();
        let schema = batch.schema.clone();
        let info = esker_scan::SourceInfo { schema, ..info };
        let want = Cloud { info, report, world, columns: batch.columns.clone() };
        for ending in ["csv", "xyz", "ply", "las", "laz"] {
            let first = path(format!("first.{ending}"));
            write(&first, lattice, vec![], &batch);
            let what = |way: &str| format!("{way} {:?}", batch.schema.attributes.len());
            check(&want, &read_path(&first).unwrap(), &what(ending))?;
            for then in ["csv", "ply", "las"] {
                let second = path(format!("second.{then}"));
                convert(&first, &second);
                let way = format!("{ending} to {then}");
                check(&want, &read_path(&second).unwrap(), &what(&way))?;
            }
        }
    }
}
