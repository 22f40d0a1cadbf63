//! Reads a share of the points of a file that is spread over all of it, for a preview: the first
//! points of each compressed chunk, or short runs of uncompressed records at equal intervals. The
//! rest is not decoded, and of uncompressed files not read.

use super::decode::{Convert, Points};
use super::laszip::Compression;
use crate::error::ScanError;
use esker_points::Task;
use esker_points::read_at::Input;
use rayon::prelude::*;
use std::io::{Cursor, Read, Seek, SeekFrom};

/// Uncompressed records that are read together: a page of a disk holds more than a hundred.
const RUN_POINTS: u64 = 64;
/// Parts whose records are converted together.
const UNIT_PARTS: usize = 64;
/// Raw bytes of a unit, unless a single part has more.
const UNIT_BYTES: usize = 2 << 20;

/// Points that follow each other, of which the first ones are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Part {
    /// Place in the file, and size, in bytes.
    at: u64,
    bytes: usize,
    /// Points to read.
    points: usize,
    /// Number of the first one.
    first_point: u64,
}

impl Points {
    /// Whether a share of the points can be read without the others: not where one chunk holds
    /// them all, or where it is not known where chunks begin.
    pub fn can_sample(&self) -> bool {
        match &self.compression {
            None => true,
            Some(Compression { chunks: Some(chunks), .. }) => {
                chunks.len() > 1 && chunks.iter().all(|&chunk| !self.is_large(chunk))
            }
            Some(_) => false,
        }
    }

    /// Number of points of one in `one_in`.
    pub fn sampled_count(&self, one_in: u32) -> u64 {
        self.parts(one_in).map(|part| part.points as u64).sum()
    }

    /// Decodes one in `one_in` points, as [`Points::for_each_run`] decodes all of them.
    ///
    /// # Errors
    /// As for [`Points::for_each_run`].
    pub fn for_each_sampled<T: Send>(
        &self,
        one_in: u32,
        task: &dyn Task,
        convert: &Convert<'_, T>,
        sink: &mut dyn FnMut(T) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let mut units: Vec<Vec<Part>> = Vec::new();
        let mut unit_bytes = 0;
        for part in self.parts(one_in) {
            let bytes = (part.points * self.record_bytes).max(part.bytes);
            unit_bytes += bytes;
            match units.last_mut() {
                Some(unit) if unit.len() < UNIT_PARTS && unit_bytes <= UNIT_BYTES => {
                    unit.push(part);
                }
                _ => {
                    units.push(vec![part]);
                    unit_bytes = bytes;
                }
            }
        }
        for units in units.chunks(2 * rayon::current_num_threads()) {
            task.check()?;
            let decode = |unit: &Vec<Part>| self.decode_unit(unit, convert);
            let decoded: Vec<_> = units.par_iter().map(decode).collect();
            for runs in decoded {
                runs?.into_iter().try_for_each(&mut *sink)?;
            }
        }
        Ok(())
    }

    /// The parts of which one in `one_in` points are read.
    fn parts(&self, one_in: u32) -> impl Iterator<Item = Part> {
        let one_in = u64::from(one_in.max(1));
        let record_bytes = self.record_bytes as u64;
        let compressed = self.compression.as_ref().map(|c| c.chunks.as_deref().unwrap_or(&[]));
        let runs = if compressed.is_some() { 0 } else { self.count };
        let (start, count) = (self.start, self.count);
        let raw = (0..runs).step_by((RUN_POINTS * one_in) as usize).map(move |first_point| {
            let points = RUN_POINTS.min(count - first_point) as usize;
            let at = start + first_point * record_bytes;
            Part { at, bytes: points * record_bytes as usize, points, first_point }
        });
        let mut next = (start, 0);
        let chunks = compressed.unwrap_or(&[]).iter().map(move |chunk| {
            let (at, first_point) = next;
            next = (at + u64::from(chunk.bytes), first_point + u64::from(chunk.points));
            let points = u64::from(chunk.points).div_ceil(one_in) as usize;
            Part { at, bytes: chunk.bytes as usize, points, first_point }
        });
        raw.chain(chunks)
    }

    /// Reads and decodes parts.
    fn decode_unit<T>(&self, unit: &[Part], convert: &Convert<'_, T>) -> Result<Vec<T>, ScanError> {
        let mut file = Input::open(&self.path).map_err(|e| self.io(e))?;
        let mut bytes = Vec::new();
        let mut records = Vec::new();
        for part in unit {
            bytes.clear();
            file.seek(SeekFrom::Start(part.at)).map_err(|e| self.io(e))?;
            let read = file.by_ref().take(part.bytes as u64).read_to_end(&mut bytes);
            if read.map_err(|e| self.io(e))? < part.bytes {
                return Err(self.damaged("the file was cut short while it was read".into()));
            }
            let Some(compression) = &self.compression else {
                records.extend_from_slice(&bytes);
                continue;
            };
            let before = records.len();
            records.resize(before + part.points * self.record_bytes, 0);
            if let Some(layers) = compression.layers {
                self.check_layers(&bytes, bytes.len() as u64, layers, part.points as u64)?;
            }
            let input = Cursor::new(bytes.as_slice());
            let mut decoder = self.decoder(compression, input, part.first_point)?;
            let records = &mut records[before..];
            self.guarded(part.first_point, || decoder.decompress_many(records))?;
        }
        records.chunks(self.run_points() * self.record_bytes).map(convert).collect()
    }
}
