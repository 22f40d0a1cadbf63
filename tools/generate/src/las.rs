//! LAS 1.4 of point format 7, plain or compressed: the header with its WKT and, for LAZ, the LASzip
//! record, points in the order in which they come; bounds and counts are filled in at the end (LAS
//! specification 1.4 R15, tables 3 to 5 and 13).

use anyhow::{Context, Result};
use esker_points::attribute::names;
use esker_points::{Batch, Grid};
use esker_scan::SourceInfo;
use laz::{LazVlr, LazVlrBuilder, ParLasZipCompressor};
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

const HEADER_BYTES: u16 = 375;
const POINT_FORMAT: u8 = 7;
const RECORD_BYTES: u16 = 36;
/// GPS times are adjusted standard time; the CRS is WKT.
const GLOBAL_ENCODING: u16 = 1 | 1 << 4;
/// Half the lattice: raw 0 of a coordinate.
const ORIGIN: i64 = 1 << 31;

/// The fields behind the coordinates, in the order of the record, and the bytes of each.
const FIELDS: [(&str, usize); 11] = [
    (names::INTENSITY, 2),
    (names::RETURNS, 1),
    (names::FLAGS, 1),
    (names::CLASSIFICATION, 1),
    (names::USER_DATA, 1),
    (names::SCAN_ANGLE, 2),
    (names::POINT_SOURCE_ID, 2),
    (names::GPS_TIME, 8),
    (names::RED, 2),
    (names::GREEN, 2),
    (names::BLUE, 2),
];

/// Records gathered before they are written: eight chunks of LAZ, which are compressed side by side.
const GATHERED_BYTES: usize = 8 * 50_000 * RECORD_BYTES as usize;

enum Points {
    Plain(BufWriter<File>),
    Compressed(Box<ParLasZipCompressor<BufWriter<File>>>),
}

/// A file that is being written.
pub struct Writer {
    points: Points,
    grid: Grid,
    count: u64,
    by_return: [u64; 15],
    bounds: [[i32; 3]; 2],
    vlrs: Vec<(&'static str, u16, Vec<u8>)>,
    gathered: Vec<u8>,
}

impl Writer {
    /// Begins a file.
    pub fn new(mut file: BufWriter<File>, info: &SourceInfo, is_compressed: bool) -> Result<Self> {
        let mut vlrs = Vec::new();
        if let Some(crs) = &info.crs {
            vlrs.push(("LASF_Projection", 2112, [crs.text.as_bytes(), &[0]].concat()));
        }
        let laszip = LazVlrBuilder::default().with_point_format(POINT_FORMAT, 0)?.build();
        if is_compressed {
            let mut data = Vec::new();
            laszip.write_to(&mut data)?;
            vlrs.push((LazVlr::USER_ID, LazVlr::RECORD_ID, data));
        }
        let vlr_bytes: usize = vlrs.iter().map(|(_, _, data)| 54 + data.len()).sum();
        file.seek(SeekFrom::Start(u64::from(HEADER_BYTES) + vlr_bytes as u64))?;
        let points = if is_compressed {
            Points::Compressed(Box::new(ParLasZipCompressor::new(file, laszip)?))
        } else {
            Points::Plain(file)
        };
        let bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        let (grid, gathered) = (info.grid.grid, Vec::new());
        Ok(Self { points, grid, count: 0, by_return: [0; 15], bounds, vlrs, gathered })
    }

    /// Appends points that lie on the lattice of the file's own grid.
    pub fn add(&mut self, batch: &Batch) -> Result<()> {
        let start = self.gathered.len();
        self.gathered.resize(start + batch.len() * usize::from(RECORD_BYTES), 0);
        let records = &mut self.gathered[start..];
        let [low, high] = &mut self.bounds;
        for (position, record) in batch.positions.iter().zip(records.chunks_exact_mut(36)) {
            for axis in 0..3 {
                let raw = (i64::from(position[axis]) - ORIGIN) as i32;
                record[4 * axis..][..4].copy_from_slice(&raw.to_le_bytes());
                low[axis] = low[axis].min(raw);
                high[axis] = high[axis].max(raw);
            }
        }
        let mut at = 12;
        for (name, bytes) in FIELDS {
            let column = batch.schema.find(name).with_context(|| format!("no {name}"))?;
            let values = batch.columns[column].chunks_exact(bytes);
            for (value, record) in values.zip(records.chunks_exact_mut(36)) {
                record[at..at + bytes].copy_from_slice(value);
            }
            at += bytes;
        }
        for record in records.chunks_exact(36) {
            let number = usize::from(record[14] & 15).clamp(1, 15);
            self.by_return[number - 1] += 1;
        }
        self.count += batch.len() as u64;
        if self.gathered.len() >= GATHERED_BYTES { self.put() } else { Ok(()) }
    }

    fn put(&mut self) -> Result<()> {
        match &mut self.points {
            Points::Plain(file) => file.write_all(&self.gathered)?,
            Points::Compressed(compressor) => compressor.compress_many(&self.gathered)?,
        }
        self.gathered.clear();
        Ok(())
    }

    /// Writes what is still held back, then the header.
    pub fn finish(mut self) -> Result<()> {
        self.put()?;
        let header = self.header();
        let mut file = match self.points {
            Points::Plain(file) => file,
            Points::Compressed(mut compressor) => {
                compressor.done()?;
                compressor.into_inner()
            }
        };
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&header)?;
        for (user, number, data) in &mut self.vlrs {
            let mut vlr = [0; 54];
            vlr[2..2 + user.len()].copy_from_slice(user.as_bytes());
            vlr[18..20].copy_from_slice(&number.to_le_bytes());
            vlr[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
            file.write_all(&vlr)?;
            file.write_all(data)?;
        }
        file.flush()?;
        file.get_ref().sync_all()?;
        Ok(())
    }

    fn header(&self) -> Vec<u8> {
        let vlr_bytes: usize = self.vlrs.iter().map(|(_, _, data)| 54 + data.len()).sum();
        let compressed = if matches!(self.points, Points::Compressed(_)) { 0x80 } else { 0 };
        let mut header = vec![0; usize::from(HEADER_BYTES)];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"LASF");
        put(6, &GLOBAL_ENCODING.to_le_bytes());
        put(24, &[1, 4]);
        put(26, b"synthetic");
        put(58, concat!("esker-generate ", env!("CARGO_PKG_VERSION")).as_bytes());
        // Day and year of creation: fixed, so that the same scan is the same file.
        put(90, &1u16.to_le_bytes());
        put(92, &2000u16.to_le_bytes());
        put(94, &HEADER_BYTES.to_le_bytes());
        put(96, &(u32::from(HEADER_BYTES) + vlr_bytes as u32).to_le_bytes());
        put(100, &(self.vlrs.len() as u32).to_le_bytes());
        put(104, &[POINT_FORMAT | compressed]);
        put(105, &RECORD_BYTES.to_le_bytes());
        for axis in 0..3 {
            let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
            put(131 + 8 * axis, &scale.to_le_bytes());
            put(155 + 8 * axis, &offset.to_le_bytes());
            let bound = |end: usize| match self.count {
                0 => offset,
                _ => f64::from(self.bounds[end][axis]) * scale + offset,
            };
            put(179 + 16 * axis, &bound(1).to_le_bytes());
            put(187 + 16 * axis, &bound(0).to_le_bytes());
        }
        put(247, &self.count.to_le_bytes());
        for (i, count) in self.by_return.iter().enumerate() {
            put(255 + 8 * i, &count.to_le_bytes());
        }
        header
    }
}
