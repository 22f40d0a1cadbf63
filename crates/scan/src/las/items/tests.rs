//! Records come back as they were given to `laz`'s compressor, whatever their fields do, and
//! damaged data end with an error.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use super::{Decoder, layered, sequential};
use laz::las::{Point0, Point1, Point3, Point5, Point6, Point7, Point8, Point9, Point10};
use laz::record::{
    LayeredPointRecordCompressor, RecordCompressor, SequentialPointRecordCompressor,
};
use laz::{LazItem, LazItemRecordBuilder as Items};
use proptest::prelude::*;
use std::io::{Cursor, ErrorKind};

const POINT14_BYTES: usize = 30;

/// Records of `items`: what each does is drawn from a few kinds, so that every branch of the
/// decoder is taken: steady fields, changes by one, jumps, times that interleave.
fn records(items: &[LazItem], seeds: &[u64]) -> Vec<Vec<u8>> {
    let bytes: usize = items.iter().map(|item| usize::from(item.size())).sum();
    let is_layered = items[0].version() >= 3;
    let time_at = if is_layered { 22 } else { 20 };
    let mut record = vec![0; bytes];
    let mut times = [1.0e8_f64, 1.0e8 + 40.0, 3.0, -7.0e300, 1.0e-300, 5.0e5];
    let mut out = Vec::new();
    for &seed in seeds {
        let mut part = {
            let mut left = seed;
            move |below: u64| {
                let value = left % below;
                left = (left / below).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 7;
                value
            }
        };
        for axis in 0..3 {
            let size = [1, 30, 1 << 12, 1 << 32][part(4) as usize];
            let step = part(size) as i32;
            let place = 4 * axis..4 * axis + 4;
            let before = i32::from_le_bytes(record[place.clone()].try_into().unwrap());
            record[place].copy_from_slice(&before.wrapping_add(step).to_le_bytes());
        }
        for byte in &mut record[12..] {
            match part(8) {
                0 => *byte = part(256) as u8,
                1 => *byte = byte.wrapping_add(1),
                _ => {}
            }
        }
        if bytes >= time_at + 8 && (is_layered || items.len() > 1) {
            let time = &mut times[part(6) as usize];
            let bits = time.to_bits() as i64;
            let step = [0, 1000, 1000, 1000 * part(600) as i64, -9000, -11_000, -990, 1 << 40];
            *time = f64::from_bits(bits.wrapping_add(step[part(8) as usize]) as u64);
            record[time_at..time_at + 8].copy_from_slice(&time.to_le_bytes());
        }
        out.push(record.clone());
    }
    out
}

fn compress(mut compressor: impl RecordCompressor<Cursor<Vec<u8>>>, of: &[Vec<u8>]) -> Vec<u8> {
    for record in of {
        compressor.compress_next(record).unwrap();
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

fn encoded(items: &Vec<LazItem>, records: &[Vec<u8>]) -> Vec<u8> {
    let output = Cursor::new(Vec::new());
    if items[0].version() >= 3 {
        let mut compressor = LayeredPointRecordCompressor::new(output);
        compressor.set_fields_from(items).unwrap();
        compress(compressor, records)
    } else {
        let mut compressor = SequentialPointRecordCompressor::new(output);
        compressor.set_fields_from(items).unwrap();
        compress(compressor, records)
    }
}

fn decoder<'a>(items: &[LazItem], bytes: &'a [u8]) -> Decoder<'a, Cursor<&'a [u8]>> {
    let input = Cursor::new(bytes);
    if items[0].version() >= 3 { layered(items, input) } else { sequential(items, input) }.unwrap()
}

/// Items of all kinds and versions.
fn all_items() -> Vec<Vec<LazItem>> {
    vec![
        Items::version_1_of::<Point1>(0),
        Items::version_2_of::<Point0>(2),
        Items::version_2_of::<Point1>(0),
        Items::version_2_of::<Point3>(3),
        Items::version_2_of::<Point5>(0),
        Items::version_3_of::<Point6>(0),
        Items::version_3_of::<Point7>(2),
        Items::version_3_of::<Point8>(0),
        Items::version_3_of::<Point9>(1),
        Items::version_3_of::<Point10>(0),
        Items::version_4_of::<Point6>(0),
        Items::version_4_of::<Point8>(1),
        Items::version_4_of::<Point10>(0),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn records_come_back(seeds in proptest::collection::vec(any::<u64>(), 1..900)) {
        for items in all_items() {
            let records = records(&items, &seeds);
            let bytes = encoded(&items, &records);
            let mut decoder = decoder(&items, &bytes);
            let mut record = vec![0; records[0].len()];
            for (i, expected) in records.iter().enumerate() {
                decoder.decompress_next(&mut record).unwrap();
                prop_assert_eq!(&record, expected, "record {} of {:?}", i, &items);
            }
        }
    }
}

/// Bytes of 255 decode to the last code each time: go on to another sequence of times.
#[test]
fn times_without_an_end_are_an_error() {
    for items in [Items::version_2_of::<Point1>(0), Items::version_3_of::<Point6>(0)] {
        let is_layered = items[0].version() >= 3;
        let seeds: Vec<u64> = (1..200u64).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
        let records = records(&items, &seeds);
        let mut bytes = encoded(&items, &records);
        let behind_head = if is_layered {
            let size = bytes[POINT14_BYTES + 4 + 4 * 8..][..4].try_into().unwrap();
            bytes.len() - u32::from_le_bytes(size) as usize
        } else {
            records[0].len()
        };
        bytes[behind_head..].fill(255);
        bytes.extend([255; 4000]);
        let mut decoder = decoder(&items, &bytes);
        let mut record = vec![0; records[0].len()];
        let error = (0..100_000).find_map(|_| decoder.decompress_next(&mut record).err());
        assert_eq!(error.map(|e| e.kind()), Some(ErrorKind::InvalidData), "{items:?}");
    }
}
