//! Writes LAS 1.4 files of point format 7 and of any size for the trials: plain, or compressed as
//! one chunk.

use laz::{LasZipCompressor, LazVlr, LazVlrBuilder};
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

const HEADER_BYTES: u16 = 375;
const RECORD_BYTES: u16 = 36;

/// Writes `count` points at raw coordinates with a step of a thousandth of a unit; their GPS times
/// differ. The bounds are those of the whole lattice. A WKT must not be empty.
pub fn write(
    path: &Path,
    wkt: &str,
    is_compressed: bool,
    count: u64,
    position: impl Fn(u64) -> [i32; 3],
) {
    // A chunk must be larger than its contents.
    let builder = LazVlrBuilder::default().with_point_format(7, 0).unwrap();
    let laszip = builder.with_fixed_chunk_size(u32::MAX - 1).build();
    let mut vlrs: Vec<(&str, u16, Vec<u8>)> = Vec::new();
    if !wkt.is_empty() {
        vlrs.push(("LASF_Projection", 2112, wkt.as_bytes().to_vec()));
    }
    if is_compressed {
        let mut data = Vec::new();
        laszip.write_to(&mut data).unwrap();
        vlrs.push((LazVlr::USER_ID, LazVlr::RECORD_ID, data));
    }
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path).unwrap());
    file.write_all(&head(&vlrs, is_compressed, count)).unwrap();
    if is_compressed {
        let mut compressor = LasZipCompressor::new(file, laszip).unwrap();
        (0..count).for_each(|i| compressor.compress_one(&record(i, position(i))).unwrap());
        compressor.done().unwrap();
        compressor.into_inner().flush().unwrap();
    } else {
        (0..count).for_each(|i| file.write_all(&record(i, position(i))).unwrap());
        file.flush().unwrap();
    }
}

/// Claims another number of points in a file's header.
pub fn claim(path: &Path, count: u64) {
    let mut file = File::options().write(true).open(path).unwrap();
    file.seek(SeekFrom::Start(247)).unwrap();
    file.write_all(&count.to_le_bytes()).unwrap();
}

/// Marks a file's GPS times as seconds of a week, not adjusted standard times.
pub fn count_from_week(path: &Path) {
    let mut file = File::options().write(true).open(path).unwrap();
    file.seek(SeekFrom::Start(6)).unwrap();
    file.write_all(&(1u16 << 4).to_le_bytes()).unwrap();
}

fn record(i: u64, position: [i32; 3]) -> [u8; RECORD_BYTES as usize] {
    let mut record = [0; RECORD_BYTES as usize];
    for (axis, c) in position.into_iter().enumerate() {
        record[4 * axis..][..4].copy_from_slice(&c.to_le_bytes());
    }
    record[12..14].copy_from_slice(&((i % 1000) as u16).to_le_bytes());
    record[14] = 0x11;
    record[16] = (i % 7) as u8;
    record[22..30].copy_from_slice(&(i as f64).to_le_bytes());
    let colour = [i % 251, i % 241, i % 239].map(|c| (c as u16) << 8);
    for (channel, c) in colour.into_iter().enumerate() {
        record[30 + 2 * channel..][..2].copy_from_slice(&c.to_le_bytes());
    }
    record
}

fn head(vlrs: &[(&str, u16, Vec<u8>)], is_compressed: bool, count: u64) -> Vec<u8> {
    let vlr_bytes: usize = vlrs.iter().map(|(_, _, data)| 54 + data.len()).sum();
    let mut head = vec![0; usize::from(HEADER_BYTES)];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(6, &(1u16 | 1 << 4).to_le_bytes());
    put(24, &[1, 4]);
    put(94, &HEADER_BYTES.to_le_bytes());
    put(96, &(u32::from(HEADER_BYTES) + vlr_bytes as u32).to_le_bytes());
    put(100, &(vlrs.len() as u32).to_le_bytes());
    put(104, &[7 | if is_compressed { 0x80 } else { 0 }]);
    put(105, &RECORD_BYTES.to_le_bytes());
    for axis in 0..3 {
        put(131 + 8 * axis, &0.001f64.to_le_bytes());
        put(179 + 16 * axis, &2147483.647f64.to_le_bytes());
        put(187 + 16 * axis, &(-2147483.648f64).to_le_bytes());
    }
    put(247, &count.to_le_bytes());
    for (user, number, data) in vlrs {
        let mut vlr = [0; 54];
        vlr[2..2 + user.len()].copy_from_slice(user.as_bytes());
        vlr[18..20].copy_from_slice(&number.to_le_bytes());
        vlr[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        head.extend(vlr);
        head.extend(data);
    }
    head
}
