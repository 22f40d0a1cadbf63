//! Splits a PTX file into scans: the head of each, and the lines of its points in blocks. A head
//! has ten lines: columns, rows, position of the scanner, its three axes, and four rows of a matrix
//! that transforms points to the file's coordinates. A line for each direction of the scanner
//! follows. A line of one whole number begins the next head, whatever the head before it claims.
//! Only a first head that is malformed is an error; other faults become notes.

use super::pose::{Given, Place, pose};
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
/// Line of the head with the position of the scanner, and the first of its matrix, from 0.
const STATION_LINE: usize = 2;
const MATRIX_LINE: usize = 6;
/// Greatest number of faults that are noted one by one.
const FAULTS_NOTED: usize = 8;

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
    /// Whether the head is malformed. Lines behind it cannot be placed.
    pub is_lost: bool,
}

/// Successive lines of points of one scan.
pub(crate) struct Piece {
    /// The lines.
    pub block: LineBlock,
    /// Their scan.
    pub scan: Arc<Scan>,
    /// Whether the line behind them, the last one of the file, is truncated and left out.
    pub is_cut: bool,
}

/// What is wrong with a file of which parts can be read.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faults {
    /// The first ones, a line each.
    notes: Vec<String>,
    count: usize,
    /// The first that costs points.
    first: Option<String>,
}

/// Reads a file scan by scan.
pub(crate) struct Scans<'a> {
    path: PathBuf,
    lines: LineBlocks<Box<dyn Read>>,
    /// The current block, and the offset of its next line.
    rest: Option<(LineBlock, usize)>,
    scan: Option<Arc<Scan>>,
    /// Number of its lines that were read.
    there: u64,
    faults: Faults,
    task: &'a dyn Task,
}

impl Faults {
    /// Adds a fault that costs points.
    fn add(&mut self, what: String) {
        self.first.get_or_insert_with(|| what.clone());
        self.remark(what);
    }

    /// Adds what is noted but costs no points.
    fn remark(&mut self, what: String) {
        self.count += 1;
        if self.notes.len() < FAULTS_NOTED {
            self.notes.push(what);
        }
    }

    /// The first fault that costs points.
    pub fn first(&self) -> Option<&str> {
        self.first.as_deref()
    }

    /// Notes on all faults.
    pub fn into_notes(mut self) -> Vec<String> {
        let more = self.count - self.notes.len();
        if more > 0 {
            self.notes.push(format!("{more} more faults of this kind are not listed"));
        }
        self.notes
    }
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

    /// A scan whose head is malformed.
    fn lost(number: u64) -> Self {
        Self { number, lines: 0, rows: [[0.0; 3]; 4], decimals: [0; 3], is_lost: true }
    }

    /// Parses a head; adds to `faults` where its pose is not sound. The error says which line is
    /// malformed.
    fn parse(number: u64, head: &[(u64, Vec<u8>)], faults: &mut Faults) -> Result<Self, String> {
        let size = |i: usize| {
            let (n, line) = &head[i];
            count(line).ok_or_else(|| malformed(*n, line, "how many columns or rows a scan has"))
        };
        let lines = size(0)?.saturating_mul(size(1)?);
        let mut station = [[0.0; 3]; 4];
        for (row, (n, line)) in station.iter_mut().zip(&head[STATION_LINE..MATRIX_LINE]) {
            let numbers = numbers::<3>(line);
            *row = numbers.ok_or_else(|| malformed(*n, line, "three numbers of a scan's head"))?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for (row, (n, line)) in matrix.iter_mut().zip(&head[MATRIX_LINE..]) {
            *row = numbers::<4>(line)
                .ok_or_else(|| malformed(*n, line, "four numbers of a scan's matrix"))?;
        }
        let [station, axes @ ..] = station;
        let sound = pose(&Given { matrix, station, axes });
        for remark in sound.remarks {
            faults.remark(format!("scan {number} {remark}"));
        }
        let rows = sound.rows;
        let mut scan = Self { number, lines, rows, decimals: [0; 3], is_lost: false };
        for (axis, digits) in scan.decimals.iter_mut().enumerate() {
            let (line, field) = match sound.place {
                Place::Row => (HEAD_LINES - 1, axis),
                Place::Column => (MATRIX_LINE + axis, 3),
                Place::Station => (STATION_LINE, axis),
            };
            *digits = fields(&head[line].1).nth(field).map_or(0, decimals);
        }
        Ok(scan)
    }
}

/// Exactly `N` numbers in a line.
fn numbers<const N: usize>(line: &[u8]) -> Option<[f64; N]> {
    let all: Vec<f64> = fields(line).map(number).collect::<Option<_>>()?;
    all.try_into().ok()
}

fn malformed(n: u64, line: &[u8], what: &str) -> String {
    format!("line {n} is not {what}: `{}`", excerpt(line))
}

impl<'a> Scans<'a> {
    /// Begins with the first line of a file.
    pub fn new(path: &Path, lines: LineBlocks<Box<dyn Read>>, task: &'a dyn Task) -> Self {
        let path = path.to_owned();
        Self { path, lines, rest: None, scan: None, there: 0, faults: Faults::default(), task }
    }

    /// The faults that were found so far.
    pub fn into_faults(self) -> Faults {
        self.faults
    }

    /// The next lines of points; `None` at the end.
    ///
    /// # Errors
    /// If the first head is malformed, or the file cannot be read.
    pub fn next(&mut self) -> Result<Option<Piece>, ScanError> {
        loop {
            if let Some(scan) = self.scan.clone() {
                if let Some(piece) = self.take_points(&scan)? {
                    return Ok(Some(piece));
                }
                if !scan.is_lost && self.there != scan.lines {
                    let (number, lines, there) = (scan.number, scan.lines, self.there);
                    let cut =
                        if there < lines { "; the file is cut or the head wrong" } else { "" };
                    self.faults.add(format!(
                        "scan {number} says that {lines} lines follow, {there} do{cut}"
                    ));
                }
            }
            self.task.check()?;
            let Some(scan) = self.next_head()? else { return Ok(None) };
            self.there = 0;
            self.scan = Some(Arc::new(scan));
        }
    }

    /// The current block and the offset of its next line; `None` at the end.
    fn current(&mut self) -> Result<Option<(LineBlock, usize)>, ScanError> {
        match self.rest.take() {
            Some(rest) => Ok(Some(rest)),
            None => Ok(self.lines.next()?.map(|block| (block, 0))),
        }
    }

    /// The next lines of a scan, from one block; `None` before the next head and at the end.
    fn take_points(&mut self, scan: &Arc<Scan>) -> Result<Option<Piece>, ScanError> {
        while let Some((block, at)) = self.current()? {
            let is_head = |line: &[u8]| !scan.is_lost && count(line).is_some();
            let mut taken = self.cut(block, at, u64::MAX, is_head);
            if taken.bytes.is_empty() {
                return Ok(None);
            }
            // Only the last line of a file may lack an end.
            let is_open = taken.rows > 0 && !taken.bytes.ends_with(b"\n");
            let is_cut = is_open && !scan.is_lost && self.there + taken.rows < scan.lines;
            if is_cut {
                let end = taken.bytes.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1);
                taken.bytes.truncate(end);
                taken.rows -= 1;
            }
            self.there += taken.rows;
            if taken.rows > 0 || is_cut {
                return Ok(Some(Piece { block: taken, scan: scan.clone(), is_cut }));
            }
        }
        Ok(None)
    }

    /// Cuts the lines of `block` from the offset `at` off, up to `lines` that are not blank and
    /// none from that on which `ends`; keeps the rest.
    fn cut(
        &mut self,
        block: LineBlock,
        at: usize,
        lines: u64,
        ends: impl Fn(&[u8]) -> bool,
    ) -> LineBlock {
        let (mut end, mut number, mut rows) = (at, block.first_line, 0);
        while rows < lines && end < block.bytes.len() {
            let line = &block.bytes[end..];
            let length = line.iter().position(|&b| b == b'\n').map_or(line.len(), |at| at + 1);
            let line = line[..length].trim_ascii();
            if ends(line) {
                break;
            }
            rows += u64::from(!line.is_empty());
            (end, number) = (end + length, number + 1);
        }
        if at == 0 && end == block.bytes.len() {
            return block;
        }
        let bytes = block.bytes[at..end].to_vec();
        let taken = LineBlock { bytes, first_line: block.first_line, rows };
        if end < block.bytes.len() {
            let rest = LineBlock { first_line: number, rows: block.rows - rows, ..block };
            self.rest = Some((rest, end));
        }
        taken
    }

    /// The next head; `None` at the end.
    fn next_head(&mut self) -> Result<Option<Scan>, ScanError> {
        let mut head = Vec::with_capacity(HEAD_LINES);
        while head.len() < HEAD_LINES {
            let Some((block, at)) = self.current()? else { break };
            let taken = self.cut(block, at, (HEAD_LINES - head.len()) as u64, |_| false);
            head.extend(taken.lines().map(|(n, line)| (n, line.to_vec())));
        }
        let number = self.scan.as_ref().map_or(1, |scan| scan.number + 1);
        let parsed = match head.len() {
            0 => return Ok(None),
            _ if number > u64::from(u16::MAX) => {
                let what =
                    "has more than 65,535 scans, more than Esker can distinguish; split the file";
                return Err(ScanError::unsupported(&self.path, what));
            }
            HEAD_LINES => Scan::parse(number, &head, &mut self.faults),
            n => Err(format!(
                "the head of scan {number} has {n} lines of {HEAD_LINES}; the file is cut"
            )),
        };
        match parsed {
            Ok(scan) => Ok(Some(scan)),
            Err(what) if number == 1 => Err(ScanError::damaged(&self.path, what)),
            Err(what) => {
                let behind =
                    if head.len() == HEAD_LINES { ": what follows is left out" } else { "" };
                self.faults.add(format!("{what}{behind}"));
                Ok(Some(Scan::lost(number)))
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
    fn a_first_head_that_is_malformed_is_refused_with_the_line() {
        for (text, want) in [
            (HEAD[..HEAD.len() - 11].to_owned(), "head of scan 1 has 9 lines of 10"),
            (HEAD.replace("2\n1\n", "2\n-1\n"), "line 2 is not how many columns or rows"),
            (HEAD.replace("0 0 1\n1 0 0 0", "0 0\n1 0 0 0"), "line 7 is not three numbers"),
            (HEAD.replace("7.25", "x"), "line 11 is not four numbers"),
        ] {
            let error = read(&text).err().unwrap().to_string();
            assert!(error.contains(want), "{error}");
        }
    }
}
