//! Walks the heads of the packets of an E57 scan (ASTM E2807, 9.3) to compare how many values of
//! each field they hold. The crate that unpacks them buffers, without limit, what one field is
//! ahead of another. So a file in which a field is far ahead, as in no sound file, is refused
//! before unpacking.

use super::buffered::BufferedFile;
use e57::{PointCloud, RecordDataType as Kind};
use esker_points::Task;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};

/// Greatest number of values by which a field may be ahead of another: a few packets of 1-bit
/// values.
const LEAD_MAX: u64 = 1 << 21;
/// Size of a page's checksum, in bytes.
const CHECKSUM_BYTES: u64 = 4;
/// Packets between two checks for cancellation.
const PACKETS_A_LOOK: u64 = 1 << 12;

/// A file as a stream without the checksums of its pages.
pub(super) struct Pages {
    file: BufferedFile,
    page_bytes: u64,
    /// Position, which does not count checksums.
    pub at: u64,
}

impl Pages {
    /// The stream of a file with pages of this size, checksums included.
    pub fn of(file: BufferedFile, page_bytes: u64) -> Self {
        Self { file, page_bytes: page_bytes.max(CHECKSUM_BYTES + 1), at: 0 }
    }

    /// Reads the head of the section of a scan: its kind, its length, and where its packets begin.
    /// Returns the position of the first one.
    pub fn first_packet(&mut self, cloud: &PointCloud) -> Result<u64> {
        self.seek(cloud.file_offset);
        self.read(&mut [0; 16])?;
        let data = self.number::<8>()?;
        self.seek(data);
        Ok(self.at)
    }

    /// Seeks to a physical position, which counts checksums.
    fn seek(&mut self, physical: u64) {
        self.at = physical - physical / self.page_bytes * CHECKSUM_BYTES;
    }

    pub fn read(&mut self, mut buffer: &mut [u8]) -> Result<()> {
        let page_data = self.page_bytes - CHECKSUM_BYTES;
        while !buffer.is_empty() {
            let (page, within) = (self.at / page_data, self.at % page_data);
            let here = (page_data - within).min(buffer.len() as u64) as usize;
            let (first, rest) = buffer.split_at_mut(here);
            let physical = page.checked_mul(self.page_bytes).and_then(|at| at.checked_add(within));
            let physical = physical.ok_or(ErrorKind::UnexpectedEof)?;
            self.file.seek(SeekFrom::Start(physical))?;
            self.file.read_exact(first)?;
            self.at += here as u64;
            buffer = rest;
        }
        Ok(())
    }

    pub fn number<const N: usize>(&mut self) -> Result<u64> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes.iter().rev().fold(0, |n, &byte| n << 8 | u64::from(byte)))
    }
}

/// Bits of a value.
pub(crate) fn bits(kind: &Kind) -> u64 {
    match *kind {
        Kind::Single { .. } => 32,
        Kind::Double { .. } => 64,
        Kind::Integer { min, max } | Kind::ScaledInteger { min, max, .. } => {
            let range = i128::from(max) - i128::from(min);
            if range > 0 { u64::from(range.ilog2()) + 1 } else { 0 }
        }
    }
}

/// Whether no field of a scan is ever far ahead of another, up to its last point. A truncated file
/// passes here; its reader reports that.
///
/// # Errors
/// If the file cannot be read; if cancelled, of kind [`ErrorKind::Interrupted`].
pub(crate) fn are_even(
    file: BufferedFile,
    page_bytes: u64,
    cloud: &PointCloud,
    task: &dyn Task,
) -> Result<bool> {
    if page_bytes <= CHECKSUM_BYTES {
        return Ok(true);
    }
    let mut pages = Pages::of(file, page_bytes);
    match walk(&mut pages, cloud, task) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(true),
        other => other,
    }
}

fn walk(pages: &mut Pages, cloud: &PointCloud, task: &dyn Task) -> Result<bool> {
    pages.first_packet(cloud)?;
    let bits: Vec<u64> = cloud.prototype.iter().map(|record| bits(&record.data_type)).collect();
    let mut bytes = vec![0u64; bits.len()];
    for packet in 0u64.. {
        if packet % PACKETS_A_LOOK == 0 && task.check().is_err() {
            return Err(Error::from(ErrorKind::Interrupted));
        }
        let start = pages.at;
        let kind = pages.number::<1>()?;
        pages.number::<1>()?;
        let length = pages.number::<2>()? + 1;
        if kind == 1 {
            // A packet has one stream for each field, otherwise the reader refuses it.
            let streams = pages.number::<2>()?;
            for stream in bytes.iter_mut().take(streams as usize) {
                *stream += pages.number::<2>()?;
            }
            let values = || {
                let of = bytes.iter().zip(&bits).filter(|(_, bits)| **bits > 0);
                of.map(|(bytes, bits)| bytes * 8 / bits)
            };
            let (least, most) = (values().min().unwrap_or(0), values().max().unwrap_or(0));
            if most - least > LEAD_MAX {
                return Ok(false);
            }
            if least >= cloud.records {
                return Ok(true);
            }
        }
        // Packets are aligned to four bytes.
        pages.at = (start + length).next_multiple_of(4);
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use e57::{Record, RecordName};
    use esker_points::task::Silent;
    use std::io::Write;

    const PAGE_BYTES: usize = 1024;

    /// A section of packets in pages; each packet has the given number of bytes of every field.
    fn file(packets: &[[u16; 2]]) -> tempfile::NamedTempFile {
        let mut bytes = vec![0; 16];
        bytes.extend(32u64.to_le_bytes());
        bytes.extend([0; 8]);
        for sizes in packets {
            let length = 10 + sizes.iter().map(|&n| usize::from(n)).sum::<usize>();
            let length = length.next_multiple_of(4);
            let start = bytes.len();
            bytes.extend([1, 0]);
            bytes.extend((length as u16 - 1).to_le_bytes());
            bytes.extend(2u16.to_le_bytes());
            sizes.iter().for_each(|size| bytes.extend(size.to_le_bytes()));
            bytes.resize(start + length, 0xaa);
        }
        let mut file = tempfile::NamedTempFile::new().unwrap();
        for page in bytes.chunks(PAGE_BYTES - 4) {
            file.write_all(page).unwrap();
            file.write_all(&[0xbb; 4]).unwrap();
        }
        file
    }

    fn is_even(packets: &[[u16; 2]], records: u64) -> bool {
        let kinds = [Kind::Double { min: None, max: None }, Kind::Integer { min: 0, max: 1 }];
        let prototype = kinds.map(|data_type| Record { name: RecordName::Intensity, data_type });
        let mut cloud = PointCloud::default();
        (cloud.records, cloud.prototype) = (records, prototype.to_vec());
        let file = file(packets);
        let input = super::super::buffered::file_of(file.path()).unwrap();
        are_even(input, PAGE_BYTES as u64, &cloud, &Silent).unwrap()
    }

    #[test]
    fn fields_far_ahead_are_found_and_truncated_files_pass() {
        let even = vec![[48_000, 750]; 20];
        assert!(is_even(&even, 120_000));
        assert!(is_even(&even, 1 << 40), "its reader reports that it is truncated");
        let bits = vec![[0, 65_000]; 20];
        assert!(!is_even(&bits, 1000));
        // Packets after the last point do not count.
        assert!(is_even(&[even.as_slice(), &bits].concat(), 120_000));
        assert!(!is_even(&[even.as_slice(), &bits].concat(), 120_001));
        // One field is behind by one or two packets.
        let late: Vec<_> = (0..20).flat_map(|_| [[0, 750], [48_000, 0]]).collect();
        assert!(is_even(&late, 120_000));
    }
}
