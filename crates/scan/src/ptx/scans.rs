//! Splits a PTX file into scans: the head of each, and the lines of its points in blocks. A head
//! has ten lines: columns, rows, position of the scanner, its three axes, and four rows of a matrix
//! that transforms points to the file's coordinates. A line for each direction of the scanner
//! follows.

use crate::error::ScanError;
use crate::text::blocks::{LineBlock, LineBlocks};
use crate::text::layout::{count, excerpt};
use crate::text::number::{decimals, fields, number};
use esker_points::Task;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Lines before the points of a scan.
const HEAD_LINES: usize = 10;

/// Head of a scan.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scan {
    /// Number in the file, from 1.
    pub number: u64,
    /// Claimed number of lines that follow.
    pub lines: u64,
    /// Rows of the matrix: a point is `x * rows[0] + y * rows[1] + z * rows[2] + rows[3]`.
    pub rows: [[f64; 3]; 4],
    /// Digits after the point that the last row needs.
    pub decimals: [u32; 3],
}

/// Successive lines of points of one scan.
pub(crate) struct Piece {
    /// The lines.
    pub block: LineBlock,
    /// Their scan.
    pub scan: Arc<Scan>,
}

/// Reads a file scan by scan.
pub(crate) struct Scans<'a> {
    path: PathBuf,
    lines: LineBlocks<Box<dyn Read>>,
    /// The current block, and the offset of its next line.
    rest: Option<(LineBlock, usize)>,
    scan: Option<Arc<Scan>>,
    /// Number of its lines that are not read yet.
    left: u64,
    task: &'a dyn Task,
}

impl Scan {
    /// Transforms a position to the file's coordinates.
    pub fn placed(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c, d] = self.rows;
        [0, 1, 2].map(|i| x * a[i] + y * b[i] + z * c[i] + d[i])
    }

    /// Whether the matrix only translates: decimals then stay decimals.
    pub fn is_only_moved(&self) -> bool {
        self.rows[..3] == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    }

    fn parse(number: u64, head: &[(u64, Vec<u8>)], path: &Path) -> Result<Self, ScanError> {
        let size = |i: usize| {
            let (n, line) = &head[i];
            count(line)
                .ok_or_else(|| malformed(path, *n, line, "how many columns or rows a scan has"))
        };
        let lines = size(0)?.checked_mul(size(1)?);
        let lines = lines.ok_or_else(|| {
            malformed(path, head[1].0, &head[1].1, "a number of rows that a file has room for")
        })?;
        for (n, line) in &head[2..6] {
            let numbers = numbers::<3>(line);
            numbers.ok_or_else(|| malformed(path, *n, line, "three numbers of a scan's head"))?;
        }
        let mut scan = Self { number, lines, rows: [[0.0; 3]; 4], decimals: [0; 3] };
        for (row, (n, line)) in scan.rows.iter_mut().zip(&head[6..]) {
            let [x, y, z, _] = numbers::<4>(line)
                .ok_or_else(|| malformed(path, *n, line, "four numbers of a scan's matrix"))?;
            *row = [x, y, z];
        }
        for (digits, field) in scan.decimals.iter_mut().zip(fields(&head[HEAD_LINES - 1].1)) {
            *digits = decimals(field);
        }
        Ok(scan)
    }
}

/// Exactly `N` finite numbers in a line.
fn numbers<const N: usize>(line: &[u8]) -> Option<[f64; N]> {
    let all = fields(line).map(|field| number(field).filter(|v| v.is_finite()));
    let all: Vec<f64> = all.collect::<Option<_>>()?;
    all.try_into().ok()
}

fn malformed(path: &Path, n: u64, line: &[u8], what: &str) -> ScanError {
    ScanError::damaged(path, format!("line {n} is not {what}: `{}`", excerpt(line)))
}

impl<'a> Scans<'a> {
    /// Begins with the first line of a file.
    pub fn new(path: &Path, lines: LineBlocks<Box<dyn Read>>, task: &'a dyn Task) -> Self {
        Self { path: path.to_owned(), lines, rest: None, scan: None, left: 0, task }
    }

    /// The next lines of points; `None` at the end.
    ///
    /// # Errors
    /// If a head is malformed, a scan has fewer lines than its head claims, or the file cannot be
    /// read.
    pub fn next(&mut self) -> Result<Option<Piece>, ScanError> {
        loop {
            while self.left == 0 {
                self.task.check()?;
                let Some(scan) = self.next_head()? else { return Ok(None) };
                self.left = scan.lines;
                self.scan = Some(Arc::new(scan));
            }
            let Some(scan) = self.scan.clone() else { return Ok(None) };
            let Some(block) = self.take(self.left)? else {
                let (number, lines) = (scan.number, scan.lines);
                let there = lines - self.left;
                let what = format!(
                    "scan {number} says that {lines} lines follow, {there} do; the file is cut"
                );
                return Err(ScanError::damaged(&self.path, what));
            };
            self.left -= block.rows;
            if block.rows > 0 {
                return Ok(Some(Piece { block, scan }));
            }
        }
    }

    /// Up to `lines` of the lines that follow and are not blank, from one block; `None` at the end.
    fn take(&mut self, lines: u64) -> Result<Option<LineBlock>, ScanError> {
        let (block, at) = match self.rest.take() {
            Some(rest) => rest,
            None => match self.lines.next()? {
                Some(block) => (block, 0),
                None => return Ok(None),
            },
        };
        if at == 0 && block.rows <= lines {
            return Ok(Some(block));
        }
        let (mut end, mut number, mut rows) = (at, block.first_line, 0);
        while rows < lines && end < block.bytes.len() {
            let line = &block.bytes[end..];
            let length = line.iter().position(|&b| b == b'\n').map_or(line.len(), |at| at + 1);
            rows += u64::from(!line[..length].trim_ascii().is_empty());
            (end, number) = (end + length, number + 1);
        }
        let bytes = block.bytes[at..end].to_vec();
        let taken = LineBlock { bytes, first_line: block.first_line, rows };
        if end < block.bytes.len() {
            let rest = LineBlock { first_line: number, rows: block.rows - rows, ..block };
            self.rest = Some((rest, end));
        }
        Ok(Some(taken))
    }

    /// The next head; `None` at the end.
    fn next_head(&mut self) -> Result<Option<Scan>, ScanError> {
        let mut head = Vec::with_capacity(HEAD_LINES);
        while head.len() < HEAD_LINES {
            let Some(block) = self.take((HEAD_LINES - head.len()) as u64)? else { break };
            head.extend(block.lines().map(|(n, line)| (n, line.to_vec())));
        }
        let number = self.scan.as_ref().map_or(1, |scan| scan.number + 1);
        match head.len() {
            0 => Ok(None),
            _ if number > u64::from(u16::MAX) => {
                let what =
                    "has more than 65,535 scans, more than Esker can distinguish; split the file";
                Err(ScanError::unsupported(&self.path, what))
            }
            HEAD_LINES => Scan::parse(number, &head, &self.path).map(Some),
            n => {
                let what = format!(
                    "the head of scan {number} has {n} lines of {HEAD_LINES}; the file is cut"
                );
                Err(ScanError::damaged(&self.path, what))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    const HEAD: &str =
        "2\n1\n\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n7.25 0 0 1\n";

    fn read(text: &str) -> Result<Vec<Piece>, ScanError> {
        let input: Box<dyn Read> = Box::new(std::io::Cursor::new(text.to_owned().into_bytes()));
        let path = Path::new("f.ptx");
        let lines = LineBlocks::new(input, path.to_owned(), 1);
        let mut scans = Scans::new(path, lines, &Silent);
        let mut pieces = Vec::new();
        while let Some(piece) = scans.next()? {
            pieces.push(piece);
        }
        Ok(pieces)
    }

    #[test]
    fn lines_belong_to_their_scan_and_keep_their_numbers() {
        let text = format!("{HEAD}1 2 3 0.5\n\n4 5 6 0.5\n{HEAD}7 8 9 0.5\n10 11 12 0.5");
        let pieces = read(&text).unwrap();
        let lines: Vec<(u64, u64, Vec<u8>)> = pieces
            .iter()
            .flat_map(|p| p.block.lines().map(|(n, l)| (p.scan.number, n, l.to_vec())))
            .collect();
        let want = [
            (1, 12, "1 2 3 0.5"),
            (1, 14, "4 5 6 0.5"),
            (2, 26, "7 8 9 0.5"),
            (2, 27, "10 11 12 0.5"),
        ];
        assert_eq!(lines, want.map(|(scan, n, line)| (scan, n, line.as_bytes().to_vec())));
        assert!(pieces.iter().all(|p| p.scan.is_only_moved() && p.scan.decimals == [2, 0, 0]));
        assert_eq!(pieces[0].scan.placed([1.0, 2.0, 3.0]), [8.25, 2.0, 3.0]);
    }

    #[test]
    fn scans_longer_than_a_block_are_whole() {
        let head = HEAD.replacen("2\n1", "40000\n2", 1);
        let one = format!("{head}{}", "0.125 0.25 0.5 0.75\n".repeat(80_000));
        let pieces = read(&format!("{one}{one}")).unwrap();
        for number in [1, 2] {
            let of = pieces.iter().filter(|p| p.scan.number == number);
            assert_eq!(of.map(|p| p.block.rows).sum::<u64>(), 80_000);
        }
    }

    #[test]
    fn many_scans_of_few_points_take_a_step_each() {
        let one = HEAD.replacen("2\n1", "1\n1", 1) + "1 2 3 0.5\n";
        assert_eq!(read(&one.repeat(60_000)).unwrap().len(), 60_000);
        let error = read(&HEAD.replacen("2\n1", "0\n0", 1).repeat(65_536)).err().unwrap();
        assert!(error.to_string().contains("more than 65,535 scans"), "{error}");
    }

    #[test]
    fn cut_and_malformed_heads_are_refused_with_the_line() {
        for (text, want) in [
            (format!("{HEAD}1 2 3 0.5\n"), "scan 1 says that 2 lines follow, 1 do"),
            (format!("{HEAD}1 2 3 4\n1 2 3 4\n2\n3\n"), "head of scan 2 has 2 lines of 10"),
            (HEAD.replace("2\n1\n", "2\n-1\n"), "line 2 is not how many columns or rows"),
            (HEAD.replace("2\n1\n", "9999999999\n9999999999\n"), "line 2 is not a number of rows"),
            (HEAD.replace("0 0 1\n1 0 0 0", "0 0\n1 0 0 0"), "line 7 is not three numbers"),
            (HEAD.replace("7.25", "inf"), "line 11 is not four numbers"),
        ] {
            let error = read(&text).err().unwrap().to_string();
            assert!(error.contains(want), "{error}");
        }
    }
}
