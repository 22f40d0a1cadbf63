//! Reads a share of a file that is spread over all of it, for a preview: short runs of records of
//! one size, or of whole lines, at equal distances. They come as one stream, so that the reader of
//! the whole file reads them, too. What lies between the runs is not read.

use crate::text::blocks::LINE_BYTES_MAX;
use std::fs::File;
use std::io::{BufRead, Read, Result as IoResult, Seek, SeekFrom};

/// Size of a run, in bytes: a page of a disk, and about a hundred points.
const RUN_BYTES: u64 = 4 << 10;
/// Bytes in which the end of a line is looked for behind a run.
const TAIL_BYTES: u64 = 512;

/// Part of a file that is read in runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Region {
    /// So many records of `stride` bytes, from the offset `start` on.
    Records { start: u64, stride: u64, count: u64 },
    /// The lines from the offset `start`, where one begins, to the offset `end`; their last byte is
    /// `mark`. A line belongs to the run in which it begins, however long it is.
    Lines { start: u64, end: u64, mark: u8 },
}

/// Whether the lines of a share are clearly too many for so many points of the whole file: lines
/// that are no points follow them.
pub(crate) fn are_too_many(lines: u64, points: u64, one_in: u32) -> bool {
    lines > points / u64::from(one_in.max(1)) * 5 / 4 + 64
}

/// Runs of a file, one behind another.
pub(crate) struct Runs {
    file: File,
    region: Region,
    /// Units of all runs together, and the number of runs.
    units: u64,
    runs: u64,
    next_run: u64,
    run: Vec<u8>,
    /// Bytes of the run that were taken.
    taken: usize,
}

impl Region {
    /// Offset of the region, size of a unit in bytes, and the number of units: records, or bytes of
    /// lines.
    fn units(self) -> [u64; 3] {
        match self {
            Self::Records { start, stride, count } => [start, stride.max(1), count],
            Self::Lines { start, end, .. } => [start, 1, end.saturating_sub(start)],
        }
    }
}

impl Runs {
    /// Reads about one in `one_in` points of a region.
    pub fn new(file: File, region: Region, one_in: u32) -> Self {
        let [_, unit_bytes, count] = region.units();
        let units = count.div_ceil(one_in.max(1).into());
        let runs = units.div_ceil((RUN_BYTES / unit_bytes).max(1));
        Self { file, region, units, runs, next_run: 0, run: Vec::new(), taken: 0 }
    }

    /// Number of records; of lines, of bytes in which they begin.
    pub fn units(&self) -> u64 {
        self.units
    }

    /// Reads run number `i`.
    fn read_run(&mut self, i: u64) -> IoResult<()> {
        let [start, unit_bytes, count] = self.region.units();
        let share =
            |of: u64, i: u64| (u128::from(of) * u128::from(i) / u128::from(self.runs)) as u64;
        let first = share(count, i);
        let units = share(self.units, i + 1) - share(self.units, i);
        let at = start + first * unit_bytes;
        self.run.clear();
        match self.region {
            Region::Records { .. } => self.read_at(at, units * unit_bytes),
            Region::Lines { mark, .. } => self.read_lines(at, at + units, mark),
        }
    }

    /// Reads the lines that begin at offsets `from..to`.
    fn read_lines(&mut self, from: u64, to: u64, mark: u8) -> IoResult<()> {
        let [start, _, bytes] = self.region.units();
        // A line begins at `from` if the byte before is a mark.
        let before = u64::from(from > start);
        self.read_at(from - before, to - from + before)?;
        if before > 0 {
            let begin = self.run.iter().position(|&b| b == mark).map(|at| at + 1);
            self.run.drain(..begin.unwrap_or(self.run.len()));
        }
        let (mut at, end) = (to, start + bytes);
        while !self.run.is_empty()
            && self.run.last() != Some(&mark)
            && at < end
            && self.run.len() as u64 <= RUN_BYTES + LINE_BYTES_MAX as u64
        {
            let tail = self.run.len();
            self.read_at(at, TAIL_BYTES.min(end - at))?;
            at += TAIL_BYTES;
            let line_end = self.run[tail..].iter().position(|&b| b == mark);
            self.run.truncate(line_end.map_or(self.run.len(), |end| tail + end + 1));
        }
        Ok(())
    }

    /// Appends up to so many bytes at the offset `at`; fewer at the end of the file.
    fn read_at(&mut self, at: u64, bytes: u64) -> IoResult<()> {
        self.file.seek(SeekFrom::Start(at))?;
        (&self.file).take(bytes).read_to_end(&mut self.run).map(drop)
    }
}

impl BufRead for Runs {
    fn fill_buf(&mut self) -> IoResult<&[u8]> {
        while self.taken == self.run.len() && self.next_run < self.runs {
            self.taken = 0;
            self.read_run(self.next_run)?;
            self.next_run += 1;
        }
        Ok(&self.run[self.taken..])
    }

    fn consume(&mut self, bytes: usize) {
        self.taken = (self.taken + bytes).min(self.run.len());
    }
}

impl Read for Runs {
    fn read(&mut self, buffer: &mut [u8]) -> IoResult<usize> {
        let bytes = self.fill_buf()?.read(buffer)?;
        self.consume(bytes);
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn file(bytes: &[u8]) -> File {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    fn read(bytes: &[u8], region: Region, one_in: u32) -> Vec<u8> {
        let mut all = Vec::new();
        Runs::new(file(bytes), region, one_in).read_to_end(&mut all).unwrap();
        all
    }

    /// Numbers in increasing order, each at most once, with no gap above `gap`.
    fn assert_spread(numbers: &[u64], count: u64, gap: u64) {
        assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]), "{numbers:?}");
        let ends = [numbers.to_vec(), vec![count]].concat();
        assert!(ends.windows(2).all(|pair| pair[1] - pair[0] <= gap), "{numbers:?}");
    }

    #[test]
    fn whole_records_are_read_from_all_of_a_file() {
        for (count, stride, one_in) in
            [(100_000u64, 12, 7), (5, 20_000, 2), (70_000, 8, 2), (1, 8, 9), (9, 8, 100), (0, 8, 3)]
        {
            let mut bytes = vec![0xEE; 11];
            for n in 0..count {
                bytes.extend(n.to_le_bytes());
                bytes.resize(bytes.len() + stride as usize - 8, 0);
            }
            bytes.extend([0xEE; 99]);
            let region = Region::Records { start: 11, stride, count };
            let got = read(&bytes, region, one_in);
            let records = got.as_slice().chunks(stride as usize);
            let numbers: Vec<u64> =
                records.map(|r| u64::from_le_bytes(*r.first_chunk().unwrap())).collect();
            assert_eq!(numbers.len() as u64, count.div_ceil(one_in.into()));
            assert_spread(&numbers, count, (2 * RUN_BYTES / stride).max(2) * u64::from(one_in));
        }
    }

    #[test]
    fn whole_lines_are_read_from_all_of_a_file() {
        for (mark, end) in [(b'\n', "\n"), (b'\n', "\r\n"), (b'\r', "\r")] {
            for (count, one_in) in [(60_000u64, 7), (60_000, 2), (3, 2), (1, 50), (0, 3)] {
                for is_open in [false, true] {
                    let line = |n| format!("{n} {}{end}", "7".repeat(n as usize % 30));
                    let lines: String = (0..count).map(line).collect();
                    let mut bytes = format!("head{end}{lines}").into_bytes();
                    bytes.truncate(bytes.len() - if is_open { end.len() } else { 0 });
                    let (start, bytes_end) = (4 + end.len() as u64, bytes.len() as u64);
                    let region = Region::Lines { start, end: bytes_end, mark };
                    let got = String::from_utf8(read(&bytes, region, one_in)).unwrap();
                    let got: Vec<&str> = got.split_inclusive(end).collect();
                    let number = |line: &&str| line.split(' ').next().unwrap().parse().unwrap();
                    let numbers: Vec<u64> = got.iter().map(number).collect();
                    for (n, got) in numbers.iter().zip(&got) {
                        assert_eq!(line(*n).trim_end(), got.trim_end());
                    }
                    let expected = count / u64::from(one_in);
                    let about = expected * 9 / 10..=expected * 11 / 10 + 2;
                    assert!(about.contains(&(numbers.len() as u64)), "{} {count}", numbers.len());
                    assert_spread(&numbers, count, 2000 * u64::from(one_in));
                }
            }
        }
    }

    #[test]
    fn lines_longer_than_a_run_are_whole_and_read_once() {
        let line = |n: usize| format!("{n} {}\n", "8".repeat(30_000 + n));
        let lines: Vec<String> = (0..40).map(line).collect();
        let bytes = lines.concat();
        let region = Region::Lines { start: 0, end: bytes.len() as u64, mark: b'\n' };
        let got = String::from_utf8(read(bytes.as_bytes(), region, 3)).unwrap();
        let got: Vec<&str> = got.split_inclusive('\n').collect();
        assert!((10..=17).contains(&got.len()), "{}", got.len());
        assert!(got.iter().all(|line| lines.iter().any(|other| other == line)));
        assert!(got.windows(2).all(|pair| pair[0].len() < pair[1].len()));
    }

    #[test]
    fn files_that_end_early_and_lines_without_end_do_not_take_memory() {
        let bytes = vec![b'3'; 1 << 20];
        let region = Region::Lines { start: 0, end: 1 << 20, mark: b'\n' };
        // The first run is taken for a line, of which a reader reports that it is too long.
        let got = read(&bytes, region, 4).len();
        assert!((LINE_BYTES_MAX + 1..100 << 10).contains(&got), "{got}");
        let region = Region::Records { start: 1 << 19, stride: 16, count: 1 << 16 };
        assert_eq!(read(&bytes, region, 4).len(), 1 << 17);
    }
}
