//! LAS and LAZ files, written here byte by byte for every version and point format, are read bit by
//! bit; damaged ones end in an error. The writer of these tests does not use the reader's tables:
//! it places every field by the specification.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod las_writer;

use esker_points::lattice::{Lattice, ORIGIN};
use esker_points::task::Silent;
use esker_points::{Batch, ColourDepth};
use esker_scan::{BESIDE_HELD_BYTES, OpenOptions, ReadReport, ScanError, Source};
use las_writer::{File, Point, Variant};
use proptest::prelude::*;
use std::io::{Seek, Write};

fn on_disk(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    file
}

fn open(file: &tempfile::NamedTempFile) -> Result<Box<dyn Source>, ScanError> {
    esker_scan::open(file.path(), &OpenOptions::default(), &Silent)
}

fn read(source: &dyn Source) -> Result<(Vec<Batch>, ReadReport), ScanError> {
    let grid = &source.info().grid;
    let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let mut batches = Vec::new();
    let report = source.read(&lattice.placement(grid), &Silent, &mut |batch| {
        assert!(batch.is_consistent());
        batches.push(batch);
        Ok(())
    })?;
    assert_eq!(report.points, batches.iter().map(|b| b.len() as u64).sum::<u64>());
    Ok((batches, report))
}

/// All values of an attribute as raw bytes, one per point.
fn column(batches: &[Batch], name: &str) -> Vec<Vec<u8>> {
    let mut values = Vec::new();
    for batch in batches {
        let at = batch.schema.find(name).unwrap_or_else(|| panic!("no attribute {name}"));
        let size = batch.schema.attributes[at].ty.size();
        values.extend(batch.columns[at].chunks(size).map(<[u8]>::to_vec));
    }
    values
}

/// Compares every attribute and coordinate of the read batches with the written points.
fn assert_equal(batches: &[Batch], points: &[Point], variant: Variant) {
    let positions: Vec<_> = batches.iter().flat_map(|b| &b.positions).collect();
    assert_eq!(positions.len(), points.len());
    for (read, written) in positions.iter().zip(points) {
        assert_eq!(read.map(|c| i64::from(c) - ORIGIN), written.position.map(i64::from));
    }
    let expected = las_writer::expected_columns(points, variant);
    let names: Vec<_> = expected.iter().map(|(name, _)| name.clone()).collect();
    if let Some(batch) = batches.first() {
        let mut sorted = names.clone();
        sorted.sort();
        let read: Vec<_> = batch.schema.attributes.iter().map(|a| a.name.clone()).collect();
        assert_eq!(read, sorted);
    }
    for (name, values) in expected {
        if !points.is_empty() {
            assert_eq!(column(batches, &name), values, "{name}");
        }
    }
}

fn variants() -> impl Strategy<Value = Variant> {
    (0u8..=10, 0u8..=5, 0u16..9).prop_map(|(format, minor, extra)| {
        let minor_min = [0, 0, 2, 2, 3, 3, 4, 4, 4, 4, 4][usize::from(format)];
        Variant { format, minor: minor.max(minor_min), extra }
    })
}

fn points(
    extra: u16,
    number: impl Into<prop::collection::SizeRange>,
) -> impl Strategy<Value = Vec<Point>> {
    let point = (
        any::<[i32; 3]>(),
        any::<[u8; 60]>(),
        prop::collection::vec(any::<u8>(), usize::from(extra)),
    );
    let point = point.prop_map(|(position, fields, extra)| Point { position, fields, extra });
    prop::collection::vec(point, number)
}

fn file_of(variant: Variant, points: Vec<Point>) -> File {
    File { variant, points, vlrs: vec![] }
}

proptest! {
    #[test]
    fn every_bit_of_a_las_file_is_read((variant, points) in variants().prop_flat_map(|v| (Just(v), points(v.extra, 0..40)))) {
        let disk = on_disk(&file_of(variant, points.clone()).las());
        let source = open(&disk).unwrap();
        let (batches, report) = read(source.as_ref()).unwrap();
        assert_equal(&batches, &points, variant);
        prop_assert_eq!(report.rounding_error_max, 0.0);
        prop_assert!(source.info().format.starts_with("LAS 1."));
    }

    #[test]
    fn every_bit_of_a_laz_file_is_read((variant, points) in variants().prop_flat_map(|v| (Just(v), points(v.extra, 0..40))), chunk in 1u32..20) {
        let disk = on_disk(&file_of(variant, points.clone()).laz(chunk));
        let source = open(&disk).unwrap();
        let (batches, _) = read(source.as_ref()).unwrap();
        assert_equal(&batches, &points, variant);
        prop_assert!(source.info().format.starts_with("LAZ 1."));
    }

    #[test]
    fn damaged_files_end_and_never_panic(
        (variant, points) in variants().prop_flat_map(|v| (Just(v), points(v.extra, 1..30))),
        is_laz: bool,
        only_points: bool,
        flips in prop::collection::vec((0usize..3000, 0u8..8), 1..12),
        cut in prop_oneof![3 => Just(0usize), 1 => 1usize..200],
    ) {
        let file = file_of(variant, points);
        let mut bytes = if is_laz { file.laz(7) } else { file.las() };
        let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        let first = if only_points { start } else { 0 };
        let length = bytes.len();
        for (at, bit) in flips {
            bytes[first + at % (length - first)] ^= 1 << bit;
        }
        bytes.truncate(length.saturating_sub(cut).max(4));
        let disk = on_disk(&bytes);
        if let Ok(source) = open(&disk) {
            let _ = source.survey(&Silent);
            let grid = &source.info().grid;
            let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
            let mut points = 0u64;
            let report = source.read(&lattice.placement(grid), &Silent, &mut |b| { points += b.len() as u64; Ok(()) });
            if let Err(e) = report {
                prop_assert!(e.to_string().contains(&disk.path().display().to_string()), "{}", e);
            }
            prop_assert!(points < 1_000_000);
        }
    }
}

fn plain_points(number: usize, extra: u16) -> Vec<Point> {
    (0..number)
        .map(|i| Point {
            position: [i as i32, -(i as i32), 7],
            fields: [i as u8; 60],
            extra: vec![i as u8; usize::from(extra)],
        })
        .collect()
}

#[test]
fn more_points_than_a_batch_come_in_order_and_in_bounded_batches() {
    let variant = Variant { format: 0, minor: 2, extra: 0 };
    let file = file_of(variant, plain_points(150_000, 0));
    for bytes in [file.las(), file.laz(50_000), file.laz(1000), file.laz(140_000)] {
        let (batches, _) = read(open(&on_disk(&bytes)).unwrap().as_ref()).unwrap();
        assert!(batches.iter().all(|b| b.len() <= 1 << 16));
        assert_equal(&batches, &file.points, variant);
    }
}

#[test]
fn one_thread_and_many_give_the_same_batches() {
    let file = file_of(Variant { format: 6, minor: 4, extra: 2 }, plain_points(20_000, 2));
    let disk = on_disk(&file.laz(900));
    let records = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (batches, _) = read(open(&disk).unwrap().as_ref()).unwrap();
            let mut out = Vec::new();
            batches.iter().for_each(|b| (0..b.len()).for_each(|i| b.record_into(i, &mut out)));
            out
        })
    };
    assert_eq!(records(1), records(4));
}

/// A preview reads points from all parts of a file, and nothing but its points.
#[test]
fn one_in_seven_points_are_read_from_all_parts_of_a_file() {
    for (format, minor) in [(3, 2), (6, 4)] {
        let file = file_of(Variant { format, minor, extra: 0 }, plain_points(20_000, 0));
        for bytes in [file.las(), file.laz(500)] {
            let disk = on_disk(&bytes);
            let options = OpenOptions { one_in: 7, ..OpenOptions::default() };
            let source = esker_scan::open(disk.path(), &options, &Silent).unwrap();
            let (batches, report) = read(source.as_ref()).unwrap();
            assert_eq!(report.points, source.info().points_hint);
            assert!((2857..3000).contains(&report.points), "{}", report.points);
            let first = read(open(&disk).unwrap().as_ref()).unwrap().0[0].positions[0][0];
            let x = batches.iter().flat_map(|batch| &batch.positions).map(|p| p[0] - first);
            let mut numbers: Vec<u32> = x.collect();
            assert!(numbers.is_sorted(), "in the order of the file");
            let expected: Vec<Point> =
                numbers.iter().map(|&i| file.points[i as usize].clone()).collect();
            assert_equal(&batches, &expected, file.variant);
            numbers.push(20_000);
            let gap = numbers.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(gap <= 500, "{gap}");
            assert!(source.info().notes.iter().any(|note| note.contains("one in 7")));
        }
    }
}

#[test]
fn points_that_are_compressed_as_a_whole_cannot_be_read_in_part() {
    let file = file_of(Variant { format: 3, minor: 2, extra: 0 }, plain_points(1000, 0));
    let disk = on_disk(&file.laz(5000));
    let options = OpenOptions { one_in: 7, ..OpenOptions::default() };
    let error = esker_scan::open(disk.path(), &options, &Silent).err().unwrap();
    assert!(error.to_string().contains("cannot be read in part"), "{error}");
}

#[test]
fn laz_of_varying_chunks_gives_all_points() {
    for (format, minor) in [(3, 2), (7, 4)] {
        let variant = Variant { format, minor, extra: 3 };
        let file = file_of(variant, plain_points(1000, 3));
        let disk = on_disk(&file.laz_of_varying_chunks(&[400, 1, 99, 500]));
        let (batches, _) = read(open(&disk).unwrap().as_ref()).unwrap();
        assert_equal(&batches, &file.points, variant);
    }
}

#[test]
fn laz_without_chunk_table_gives_all_points_and_a_note() {
    for (format, minor) in [(3, 2), (7, 4)] {
        let variant = Variant { format, minor, extra: 3 };
        let file = file_of(variant, plain_points(1000, 3));
        let disk = on_disk(&file.laz_without_chunk_table(300));
        let source = open(&disk).unwrap();
        assert!(source.info().notes.iter().any(|n| n.contains("no chunk table")));
        let (batches, _) = read(source.as_ref()).unwrap();
        assert_equal(&batches, &file.points, variant);
    }
}

#[test]
fn a_laszip_record_that_the_decoder_does_not_know_is_refused_by_name() {
    let file = file_of(Variant { format: 1, minor: 2, extra: 0 }, plain_points(10, 0));
    let good = file.laz(5);
    let record = 227 + 54;
    for (at, value, what) in [
        (record, 9, "compressor 9"),
        (record + 2, 3, "coder 3"),
        (record + 34, 8, "do not make point format 1"),
        (record + 36, 19, "bytes a point"),
        (record + 38, 7, "version 7"),
        (record + 32, 200, "cut short"),
    ] {
        let mut bytes = good.clone();
        bytes[at] = value;
        let error = open(&on_disk(&bytes)).err().unwrap().to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn wrong_chunk_tables_are_refused_before_allocating() {
    let file = file_of(Variant { format: 6, minor: 4, extra: 0 }, plain_points(10, 0));
    let good = file.laz(5);
    let start = u32::from_le_bytes(good[96..100].try_into().unwrap()) as usize;
    let table = u64::from_le_bytes(good[start..start + 8].try_into().unwrap()) as usize;
    let length = good.len() as u64;
    for place in [length, length - 4, length + 1000, i64::MAX as u64, start as u64 + 4] {
        let mut bytes = good.clone();
        bytes[start..start + 8].copy_from_slice(&place.to_le_bytes());
        assert!(open(&on_disk(&bytes)).is_err(), "{place}");
    }
    let mut bytes = good.clone();
    bytes[table + 4..table + 8].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = open(&on_disk(&bytes)).err().unwrap().to_string();
    assert!(error.contains("claims 4294967295 chunks"), "{error}");
}

#[test]
fn extra_bytes_get_their_names_types_and_scales() {
    let variant = Variant { format: 1, minor: 2, extra: 4 + 6 + 1 + 2 };
    let mut file = file_of(variant, plain_points(5, variant.extra));
    file.vlrs.push(las_writer::extra_bytes_vlr(&[
        (5, 0b11000, "intensity"),
        (23, 0, "Colours"),
        (0, 1, "what"),
    ]));
    let disk = on_disk(&file.las());
    let source = open(&disk).unwrap();
    let named: Vec<_> =
        source.info().schema.attributes.iter().map(|a| (a.name.as_str(), a.ty.name())).collect();
    for expected in [
        ("intensity_extra", "u32"),
        ("Colours[0]", "u16"),
        ("Colours[2]", "u16"),
        ("extra_bytes[0]", "u8"),
        ("extra_bytes[1]", "u8"),
        ("extra_bytes[2]", "u8"),
        ("intensity", "u16"),
    ] {
        assert!(named.contains(&expected), "{expected:?} in {named:?}");
    }
    let scaled = source.info().schema.find("intensity_extra").unwrap();
    let scaled = &source.info().schema.attributes[scaled];
    assert_eq!(
        (scaled.scale, scaled.offset, scaled.description.as_str()),
        (0.25, -3.0, "about intensity")
    );
    let (batches, _) = read(source.as_ref()).unwrap();
    assert_eq!(column(&batches, "Colours[1]")[3], [3, 3]);
}

#[test]
fn descriptions_of_too_many_bytes_fall_back_to_raw_bytes() {
    let mut file = file_of(Variant { format: 1, minor: 2, extra: 2 }, plain_points(5, 2));
    file.vlrs.push(las_writer::extra_bytes_vlr(&[(10, 0, "wide")]));
    let disk = on_disk(&file.las());
    let source = open(&disk).unwrap();
    assert!(
        source.info().notes.iter().any(|n| n.contains("kept raw")),
        "{:?}",
        source.info().notes
    );
    assert!(source.info().schema.find("extra_bytes[1]").is_some());
}

#[test]
fn eight_bit_colours_are_detected_and_can_be_overridden() {
    let variant = Variant { format: 2, minor: 2, extra: 0 };
    let mut file = file_of(variant, plain_points(3, 0));
    for (value, depth) in
        [(0, ColourDepth::Sixteen), (255, ColourDepth::Eight), (256, ColourDepth::Sixteen)]
    {
        file.points.iter_mut().for_each(|p| p.set_colours(variant, [value, 0, value / 2]));
        let disk = on_disk(&file.las());
        let source = open(&disk).unwrap();
        assert_eq!(source.info().colour_depth, Some(depth));
        assert_eq!(read(source.as_ref()).unwrap().1.colour_max, value);
        let options =
            OpenOptions { colour_depth: Some(ColourDepth::Eight), ..OpenOptions::default() };
        let overridden = esker_scan::open(disk.path(), &options, &Silent).unwrap();
        assert_eq!(overridden.info().colour_depth, Some(ColourDepth::Eight));
    }
}

#[test]
fn wrong_counts_are_refused_or_corrected() {
    let file = file_of(Variant { format: 0, minor: 2, extra: 0 }, plain_points(10, 0));
    let with_count = |count: u32, bytes: usize| {
        let mut bytes = file.las()[..bytes].to_vec();
        bytes[107..111].copy_from_slice(&count.to_le_bytes());
        on_disk(&bytes)
    };
    let all = file.las().len();
    for claimed in [0, 4, 9, 11, 5000, u32::MAX] {
        let disk = with_count(claimed, all);
        let source = open(&disk).unwrap();
        let [note] = &source.info().notes[..] else { panic!("{:?}", source.info().notes) };
        assert!(note.contains(&format!("claims {claimed} points")) && note.contains("10 whole"));
        assert_eq!(source.info().points_hint, 10);
        assert_equal(&read(source.as_ref()).unwrap().0, &file.points, file.variant);
    }
    // If a record is cut off, the file is truncated.
    let error = open(&with_count(11, all - 7)).err().unwrap().to_string();
    assert!(error.contains("claims 11 points") && error.contains("for 9 only"), "{error}");
    assert!(!error.contains('\n'));
    // A number of bytes that is not whole records may be anything.
    let disk = with_count(8, all - 7);
    let source = open(&disk).unwrap();
    assert!(source.info().notes[0].contains("33 bytes behind"), "{:?}", source.info().notes);
    assert_eq!(read(source.as_ref()).unwrap().1.points, 8);
}

/// Bytes that were never points may be whole records by chance.
#[test]
fn records_behind_the_points_and_far_from_their_box_are_no_points() {
    let variant = Variant { format: 0, minor: 2, extra: 0 };
    let mut points = plain_points(10, 0);
    // With the box of the first points in the header.
    let bytes_of = |points: &[Point], claimed: usize| {
        let mut bytes = file_of(variant, points.to_vec()).las();
        bytes[107..111].copy_from_slice(&(claimed as u32).to_le_bytes());
        for axis in 0..3 {
            let values = points[..claimed].iter().map(|p| f64::from(p.position[axis]) * 0.01);
            let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            bytes[179 + 16 * axis..][..8].copy_from_slice(&high.to_le_bytes());
            bytes[187 + 16 * axis..][..8].copy_from_slice(&low.to_le_bytes());
        }
        bytes
    };
    for records in [1, 60, 3000] {
        let mut bytes = bytes_of(&points, 10);
        bytes.extend(b"<Metadata>text is".iter().cycle().take(20 * records));
        let disk = on_disk(&bytes);
        let source = open(&disk).unwrap();
        let [note] = &source.info().notes[..] else { panic!("{:?}", source.info().notes) };
        assert!(note.contains(&format!("{} bytes behind the 10 points", 20 * records)), "{note}");
        assert_equal(&read(source.as_ref()).unwrap().0, &points, variant);
    }
    // Points appended without a new header lie outside of its box, and are points.
    points.iter_mut().skip(4).for_each(|p| p.position[0] += 100);
    let disk = on_disk(&bytes_of(&points, 4));
    let source = open(&disk).unwrap();
    assert!(source.info().notes[0].contains("claims 4 points"), "{:?}", source.info().notes);
    assert_equal(&read(source.as_ref()).unwrap().0, &points, variant);
}

#[test]
fn zeros_behind_the_points_that_the_header_claims_are_padding() {
    let file = file_of(Variant { format: 0, minor: 2, extra: 0 }, plain_points(10, 0));
    let padded = |claimed: u32, records: usize, last: u8| {
        let mut bytes = file.las();
        bytes[107..111].copy_from_slice(&claimed.to_le_bytes());
        bytes.resize(bytes.len() + 20 * records, 0);
        *bytes.last_mut().unwrap() = last;
        let disk = on_disk(&bytes);
        let source = open(&disk).unwrap();
        let [note] = &source.info().notes[..] else { panic!("{:?}", source.info().notes) };
        (read(source.as_ref()).unwrap().1.points, note.clone())
    };
    for records in [1, 7000] {
        let (points, note) = padded(10, records, 0);
        assert_eq!(points, 10);
        assert!(note.contains(&format!("{} bytes of zeros behind the 10 points", 20 * records)));
        // Other bytes there are a point, and so are all records if the header claims none.
        assert_eq!(padded(10, records, 1).0, 10 + records as u64);
        assert_eq!(padded(9, records, 0).0, 10 + records as u64);
        assert_eq!(padded(0, records, 0).0, 10 + records as u64);
    }
}

#[test]
fn wrong_counts_are_corrected_from_chunks_with_counts() {
    let file = file_of(Variant { format: 7, minor: 4, extra: 3 }, plain_points(1000, 3));
    for good in [file.laz(300), file.laz_of_varying_chunks(&[400, 1, 99, 500]), file.laz(5000)] {
        for claimed in [0u64, 1, 899, 901, 999, 1001, 4999, 1 << 40, u64::MAX] {
            let mut bytes = good.clone();
            bytes[247..255].copy_from_slice(&claimed.to_le_bytes());
            let disk = on_disk(&bytes);
            let source = open(&disk).unwrap();
            let [note] = &source.info().notes[..] else { panic!("{:?}", source.info().notes) };
            assert!(
                note.contains(&format!("claims {claimed} points")) && note.contains("hold 1000")
            );
            assert_equal(&read(source.as_ref()).unwrap().0, &file.points, file.variant);
        }
    }
    // Other chunks have no count: points left out make a note, missing ones an error.
    let file = file_of(Variant { format: 3, minor: 2, extra: 0 }, plain_points(1000, 0));
    let with_count = |claimed: u32| {
        let mut bytes = file.laz(300);
        bytes[107..111].copy_from_slice(&claimed.to_le_bytes());
        on_disk(&bytes)
    };
    let disk = with_count(500);
    let source = open(&disk).unwrap();
    assert!(source.info().notes[0].contains("2 of its 4 chunks"), "{:?}", source.info().notes);
    assert_equal(&read(source.as_ref()).unwrap().0, &file.points[..500], file.variant);
    let error = open(&with_count(2000)).err().unwrap().to_string();
    assert!(error.contains("claims 2000 points") && error.contains("at most 1200"), "{error}");
    let disk = with_count(1100);
    assert!(read(open(&disk).unwrap().as_ref()).is_err());
    // A file without points is read as empty.
    for (format, minor) in [(3, 2), (7, 4)] {
        let empty = file_of(Variant { format, minor, extra: 0 }, Vec::new());
        let disk = on_disk(&empty.laz(300));
        let source = open(&disk).unwrap();
        assert_eq!((source.info().points_hint, source.info().notes.len()), (0, 0));
        assert_eq!(read(source.as_ref()).unwrap().1.points, 0);
    }
}

#[test]
fn a_chunk_larger_than_memory_is_refused_with_a_remedy() {
    // Layered chunks are decoded whole; this one is larger than those decoded in parallel.
    let variant = Variant { format: 6, minor: 4, extra: 200 };
    let points: Vec<_> = (0..160_000u64)
        .map(|i| {
            let random = |j: u64| (i * 100 + j).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
            let extra = (0..200).map(|j| random(j / 8 * 8) as u8).collect();
            Point { position: [0, 1, 2].map(|a| random(a) as i32), fields: [0; 60], extra }
        })
        .collect();
    let disk = on_disk(&file_of(variant, points).laz(200_000));
    let open = |bytes| {
        let options = OpenOptions { memory_bytes: Some(bytes), ..OpenOptions::default() };
        esker_scan::open(disk.path(), &options, &Silent)
    };
    let held_bytes = open(1 << 30).unwrap().held_bytes();
    let file_bytes = disk.path().metadata().unwrap().len();
    assert!(held_bytes < file_bytes && held_bytes > file_bytes - 4000, "{held_bytes}");
    let needed_mib = (held_bytes + BESIDE_HELD_BYTES).div_ceil(1 << 20);
    let source = open(needed_mib << 20).unwrap();
    assert_eq!(read(source.as_ref()).unwrap().1.points, 160_000);
    let error = open((needed_mib - 1) << 20).err().unwrap().to_string();
    for word in [&format!("give {needed_mib} MiB of --memory"), "50000 points"] {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn header_and_records_are_kept_verbatim() {
    let mut file = file_of(Variant { format: 6, minor: 4, extra: 0 }, plain_points(2, 0));
    file.vlrs.push((
        "LASF_Projection".into(),
        2112,
        br#"PROJCS["x",UNIT["foot",0.3048]]"#.to_vec(),
    ));
    let bytes = file.las();
    let disk = on_disk(&bytes);
    let source = open(&disk).unwrap();
    let kept: Vec<u8> = source.info().verbatim.iter().flat_map(|(_, b)| b.clone()).collect();
    assert_eq!(kept, bytes[..kept.len()]);
    assert_eq!(kept.len(), bytes.len() - 2 * 30);
    assert_eq!(source.info().crs.as_ref().unwrap().unit.as_deref(), Some("foot"));
}

#[test]
fn keys_that_all_point_to_the_same_values_are_bounded() {
    let file = |keys: u16, count: u16| {
        let key = |i: u16| [2000 + i, 34736, count, 0];
        let keys: Vec<u16> = [1, 1, 0, keys].into_iter().chain((0..keys).flat_map(key)).collect();
        let mut file = file_of(Variant { format: 0, minor: 2, extra: 0 }, plain_points(2, 0));
        let bytes = |words: &[u16]| words.iter().flat_map(|w| w.to_le_bytes()).collect();
        file.vlrs.push(("LASF_Projection".into(), 34735, bytes(&keys)));
        let doubles = 1e-300f64.to_le_bytes().repeat(8191);
        file.vlrs.push(("LASF_Projection".into(), 34736, doubles));
        on_disk(&file.las())
    };
    let few = open(&file(9, 7)).unwrap();
    assert!(few.info().crs.as_ref().unwrap().text.contains("Key2000=0.000"));
    let disk = file(8000, 8191);
    let many = open(&disk).unwrap();
    assert_eq!(many.info().crs, None);
    assert!(many.info().notes[0].contains("more than 64 KiB as text"), "{:?}", many.info().notes);
    assert_eq!(read(many.as_ref()).unwrap().1.points, 2);
}

/// A LAS 1.4 of two points with EVLRs of these payload sizes; the payloads may be a hole in the
/// file.
fn with_evlrs(payloads: &[u64], claimed: u32) -> tempfile::NamedTempFile {
    let file = file_of(Variant { format: 6, minor: 4, extra: 0 }, plain_points(2, 0));
    let mut bytes = file.las();
    let start = bytes.len() as u64;
    bytes[235..243].copy_from_slice(&start.to_le_bytes());
    bytes[243..247].copy_from_slice(&claimed.to_le_bytes());
    let mut disk = on_disk(&bytes);
    let mut at = start;
    for (number, payload) in payloads.iter().enumerate() {
        let mut head = [0; 60];
        head[2..6].copy_from_slice(b"some");
        head[18..20].copy_from_slice(&(number as u16).to_le_bytes());
        head[20..28].copy_from_slice(&payload.to_le_bytes());
        disk.seek(std::io::SeekFrom::Start(at)).unwrap();
        disk.write_all(&head).unwrap();
        at += 60 + payload;
    }
    disk.as_file().set_len(at).unwrap();
    disk
}

#[test]
fn evlrs_without_number_or_end_are_bounded_and_noted_once() {
    let notes = |payloads: &[u64], claimed| {
        let disk = with_evlrs(payloads, claimed);
        let source = open(&disk).unwrap();
        assert_eq!(read(source.as_ref()).unwrap().1.points, 2);
        let verbatim = &source.info().verbatim;
        let kept = verbatim.iter().find(|(name, _)| name == "las evlrs");
        (kept.map_or(0, |(_, bytes)| bytes.len()), source.info().notes.clone())
    };
    assert_eq!(notes(&[3, 0, 4], 3), (3 * 60 + 7, vec![]));
    let large = 64 << 20;
    let (kept, what) = notes(&[1, large, 2], 3);
    assert_eq!(
        (kept, &what[..]),
        (123, &["the EVLR some 1 of 67108864 bytes is not kept".into()][..])
    );
    let (kept, what) = notes(&[large, 1, large, large], 4);
    assert!(kept == 61 && what.len() == 1, "{what:?}");
    assert!(what[0].starts_with("3 EVLRs of 201326592 bytes are not kept"), "{what:?}");
    let (kept, what) = notes(&[0; 20_000], 20_000);
    assert!(kept == 60 << 14 && what.len() == 1, "{what:?}");
    assert!(what[0].contains("claims 20000 EVLRs; 16384 are kept at most"), "{what:?}");
    assert!(notes(&[0; 3], u32::MAX).1[0].contains("number 4 runs past the end"));
}

#[test]
fn points_outside_the_lattice_are_reported_and_surveyed() {
    let variant = Variant { format: 0, minor: 2, extra: 0 };
    let mut points = plain_points(3, 0);
    points[2].position = [i32::MAX, i32::MIN, 0];
    let disk = on_disk(&file_of(variant, points).las());
    let source = open(&disk).unwrap();
    let mut other = source.info().grid.clone();
    other.grid.scale = [2.0 * 0.01 / 3.0; 3];
    let lattice =
        Lattice { scale: other.grid.scale, offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
    let placement = lattice.placement(&source.info().grid);
    let mut outside = Vec::new();
    let mut sink = |mut batch: Batch| {
        outside.extend(batch.take_outside());
        assert!(batch.len() == 2 && batch.is_consistent());
        Ok(())
    };
    source.read(&placement, &Silent, &mut sink).unwrap();
    let [(place, values)] = outside.as_slice() else { panic!("{outside:?}") };
    let far = [i32::MAX, i32::MIN, 0].map(|raw| f64::from(raw) * 0.01);
    assert_eq!((*place, values.len()), (far, source.info().schema.record_bytes()));
    let [min, max] = source.survey(&Silent).unwrap().bounds().unwrap();
    assert_eq!((max[0], min[1]), (f64::from(i32::MAX) * 0.01, f64::from(i32::MIN) * 0.01));
}
