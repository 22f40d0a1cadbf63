//! Reads a share of the points of an E57 scan, for a preview, without the others (ASTM E2807, 9.3).
//! The values of a field are a stream of bits that goes on from packet to packet, whose heads give
//! the bytes of each stream. They tell which points a packet has whole, and where their values are.
//! Only heads and values of the share are read; checksums of pages are not compared.

use super::buffered::sparse_file_of;
use super::packets::{Pages, bits};
use crate::error::ScanError;
use e57::{PointCloud, RecordDataType as Kind, RecordValue as Value};
use std::io::{Error, ErrorKind, Result as IoResult};
use std::path::Path;

/// Points that are read together, unless a packet has fewer or a scan ends: a part of a packet,
/// which has some thousand; fewer in scans that would have less than so many runs.
const RUN_POINTS_MAX: u64 = 512;
const RUN_POINTS_MIN: u64 = 64;
const RUNS: u64 = 64;

/// A share of the points of a scan.
pub(super) struct Share {
    pages: Pages,
    /// Where the next packet begins, without checksums.
    next: u64,
    records: u64,
    one_in: u64,
    run_points: u64,
    points_max: u64,
    fields: Vec<Field>,
    /// Points in packets so far, and those that were chosen.
    there: u64,
    chosen: u64,
}

/// A field of a scan.
struct Field {
    kind: Kind,
    /// Bits of a value; 0 where all values are equal.
    bits: u64,
    /// Bytes of its stream in earlier packets, and in the current one.
    before: u64,
    bytes: u64,
}

/// Points whose values are all in the current packet.
#[derive(Clone, Copy)]
struct Run {
    first: u64,
    points: u64,
    /// Where the streams of the packet begin.
    streams: u64,
}

impl Share {
    /// A share of one in `one_in` points of a scan of a file with pages of this size, of at most
    /// `points_max` in a block.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn new(
        path: &Path,
        page_bytes: u64,
        cloud: &PointCloud,
        one_in: u32,
        points_max: usize,
    ) -> Result<Self, ScanError> {
        let mut pages = Pages::of(sparse_file_of(path)?, page_bytes);
        let field =
            |kind: &Kind| Field { kind: kind.clone(), bits: bits(kind), before: 0, bytes: 0 };
        let one_in = u64::from(one_in.max(1));
        let run_points = cloud.records / one_in / RUNS;
        Ok(Self {
            next: pages.first_packet(cloud).map_err(|e| fault(path, e))?,
            pages,
            records: cloud.records,
            one_in,
            run_points: run_points.clamp(RUN_POINTS_MIN, RUN_POINTS_MAX),
            points_max: points_max as u64,
            fields: cloud.prototype.iter().map(|record| field(&record.data_type)).collect(),
            there: 0,
            chosen: 0,
        })
    }

    /// Number of points that are read.
    ///
    /// # Errors
    /// If the scan is damaged.
    pub fn count(mut self, path: &Path) -> Result<u64, ScanError> {
        while self.next_run().map_err(|e| fault(path, e))?.is_some() {}
        Ok(self.chosen)
    }

    /// The values of the next points, point by point; none at the end.
    ///
    /// # Errors
    /// If the scan is damaged.
    pub fn next(&mut self, path: &Path) -> Result<Vec<Value>, ScanError> {
        let run = self.next_run().map_err(|e| fault(path, e))?;
        let values = run.map(|run| self.values(run)).transpose();
        Ok(values.map_err(|e| fault(path, e))?.unwrap_or_default())
    }

    /// Goes on to the next packet of which points are read.
    fn next_run(&mut self) -> IoResult<Option<Run>> {
        while self.there < self.records {
            let Some(streams) = self.next_packet()? else { continue };
            let varying = || self.fields.iter().filter(|field| field.bits > 0);
            let whole = |field: &Field| (field.before + field.bytes) * 8 / field.bits;
            let first = varying().map(|field| (field.before * 8).div_ceil(field.bits)).max();
            let end = varying().map(whole).min().unwrap_or(self.records).min(self.records);
            self.there = self.there.max(end);
            let first = first.unwrap_or(0);
            let here = end.saturating_sub(first);
            let lacking = self.there.div_ceil(self.one_in).saturating_sub(self.chosen);
            // Bits of the last points may lie in a packet of their own.
            let is_last = self.records - end < RUN_POINTS_MIN;
            let points = lacking.min(here).min(self.points_max);
            if points > 0 && (is_last || lacking >= here.min(self.run_points)) {
                self.chosen += points;
                return Ok(Some(Run { first, points, streams }));
            }
        }
        Ok(None)
    }

    /// Reads the head of the next packet. Returns where the streams of values begin; `None` if the
    /// packet has none.
    fn next_packet(&mut self) -> IoResult<Option<u64>> {
        let start = self.next;
        self.pages.at = start;
        let kind = self.pages.number::<1>()?;
        self.pages.number::<1>()?;
        let length = self.pages.number::<2>()? + 1;
        self.next = (start + length).next_multiple_of(4);
        match kind {
            1 => {}
            0 | 2 => return Ok(None),
            _ => return Err(Error::new(ErrorKind::InvalidData, "a packet is of no known kind")),
        }
        if self.pages.number::<2>()? != self.fields.len() as u64 {
            let what = "a packet has another number of fields than its scan";
            return Err(Error::new(ErrorKind::InvalidData, what));
        }
        for field in &mut self.fields {
            field.before += field.bytes;
            field.bytes = self.pages.number::<2>()?;
        }
        if self.fields.iter().map(|field| field.bytes).sum::<u64>() > length {
            return Err(Error::new(ErrorKind::InvalidData, "a packet is shorter than its streams"));
        }
        Ok(Some(self.pages.at))
    }

    /// The values of a run in the current packet.
    fn values(&mut self, run: Run) -> IoResult<Vec<Value>> {
        let (points, width) = (run.points as usize, self.fields.len());
        let mut values = vec![Value::Integer(0); points * width];
        // Most of a packet is read, since the values of a run are in all parts of it.
        let mut streams = vec![0; self.fields.iter().map(|field| field.bytes as usize).sum()];
        self.pages.at = run.streams;
        self.pages.read(&mut streams)?;
        let mut rest = streams.as_slice();
        for (column, field) in self.fields.iter().enumerate() {
            // The run is in the stream of each field, so nothing is below 0.
            let first_bit = (run.first * field.bits).saturating_sub(field.before * 8);
            let (stream, behind) = rest.split_at(field.bytes as usize);
            rest = behind;
            for (i, point) in values.chunks_exact_mut(width).enumerate() {
                let bit = first_bit + i as u64 * field.bits;
                point[column] = value(&field.kind, number(stream, bit, field.bits));
            }
        }
        Ok(values)
    }
}

/// The number in bits `at..at + bits`, at most 64, the lowest first.
fn number(bytes: &[u8], at: u64, bits: u64) -> u64 {
    let mut all = [0; 16];
    let bytes = bytes.get((at / 8) as usize..).unwrap_or(&[]);
    let length = bytes.len().min(9);
    all[..length].copy_from_slice(&bytes[..length]);
    let mask = (1u128 << bits) - 1;
    (u128::from_le_bytes(all) >> (at % 8) & mask) as u64
}

/// The value that a number of the stream stands for.
fn value(kind: &Kind, number: u64) -> Value {
    let from = |min: i64| min.wrapping_add(number as i64);
    match *kind {
        Kind::Single { .. } => Value::Single(f32::from_bits(number as u32)),
        Kind::Double { .. } => Value::Double(f64::from_bits(number)),
        Kind::Integer { min, .. } => Value::Integer(from(min)),
        Kind::ScaledInteger { min, .. } => Value::ScaledInteger(from(min)),
    }
}

fn fault(path: &Path, error: Error) -> ScanError {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::InvalidData => {
            ScanError::damaged(path, format!("a scan cannot be read in part: {error}"))
        }
        _ => ScanError::io(path, error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_bits_are_taken_from_a_stream() {
        for bits in [1u64, 3, 7, 8, 13, 31, 32, 33, 63, 64] {
            let numbers: Vec<u64> = (1..50)
                .map(|i: u64| i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - bits))
                .collect();
            let mut stream = vec![0u8; (bits * 49).div_ceil(8) as usize];
            for (i, number) in numbers.iter().enumerate() {
                for bit in (0..bits).filter(|bit| number >> bit & 1 == 1) {
                    let at = i as u64 * bits + bit;
                    stream[(at / 8) as usize] |= 1 << (at % 8);
                }
            }
            let got = (0..49).map(|i| number(&stream, i * bits, bits));
            assert!(got.eq(numbers.iter().copied()), "{bits} bits");
        }
        assert_eq!(
            value(&Kind::Integer { min: i64::MIN, max: i64::MAX }, u64::MAX),
            Value::Integer(i64::MAX)
        );
    }
}
