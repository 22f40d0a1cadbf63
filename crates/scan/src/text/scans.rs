//! Cuts a text file into blocks and finds the scans in them. A file of counts (PTS) may have
//! several scans, and their lines may have different numbers of columns: the most frequent number
//! of the first lines behind a count decides. Other files are one scan.

use super::blocks::{LineBlock, LineBlocks};
use super::cells::{Row, is_comment, most_frequent};
use super::layout::Layout;
use super::line::count;
use super::naming::COLUMNS_MAX;
use super::start::{lines_of, some_lines_of};
use crate::error::ScanError;
use std::io::Read;
use std::path::Path;

/// Lines behind a count that decide the number of columns of a scan.
const DECIDING_LINES: usize = 8;

/// A block of lines with the scans in it.
pub(crate) struct Piece {
    /// The lines.
    pub block: LineBlock,
    /// The runs of lines of one scan, in order; the first begins with the block.
    pub runs: Vec<Run>,
}

/// Lines of one scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    /// Number of its first line.
    pub line: u64,
    /// Numbers in its lines; 0 if they are no points.
    pub columns: usize,
    /// Whether the scan begins here.
    pub begins: bool,
}

/// The pieces of a file.
pub(crate) struct Pieces<'a> {
    lines: LineBlocks<Box<dyn Read>>,
    layout: &'a Layout,
    /// Numbers in the lines of the scan under way; `None` before its first line.
    columns: Option<usize>,
}

impl<'a> Pieces<'a> {
    /// The pieces of the file at `path`; if `one_in` is above 1, of a share of its lines.
    ///
    /// # Errors
    /// If the file cannot be read, or not in part.
    pub fn of(path: &Path, layout: &'a Layout, one_in: u32) -> Result<Self, ScanError> {
        let columns = (!layout.has_counts).then_some(layout.columns);
        let lines = match one_in {
            0 | 1 => lines_of(path)?,
            _ => some_lines_of(path, layout.first_line, one_in)?,
        };
        Ok(Self { lines, layout, columns })
    }

    /// The next piece; `None` at the end.
    ///
    /// # Errors
    /// As of [`LineBlocks::next`].
    pub fn next(&mut self) -> Result<Option<Piece>, ScanError> {
        let Some(block) = self.lines.next()? else { return Ok(None) };
        let line = block.first_line;
        let mut runs = Vec::new();
        if let Some(columns) = self.columns {
            runs.push(Run { line, columns, begins: false });
        }
        if self.layout.has_counts {
            self.find_scans(&block, &mut runs);
        }
        Ok(Some(Piece { block, runs }))
    }

    fn find_scans(&mut self, block: &LineBlock, runs: &mut Vec<Run>) {
        let mut row = Row::default();
        let mut begin: Option<u64> = None;
        let mut cells: Vec<usize> = Vec::new();
        let mut decide = |begin: &mut Option<u64>, cells: &mut Vec<usize>| {
            let line = begin.take()?;
            let columns = most_frequent(cells.drain(..)).unwrap_or(0);
            runs.push(Run { line, columns, begins: true });
            Some(columns)
        };
        for (n, line) in block.lines() {
            if n < self.layout.first_line && count(line).is_none() {
                continue;
            }
            if count(line).is_some() {
                decide(&mut begin, &mut cells);
                self.columns = None;
            } else if self.columns.is_none() && !is_comment(line) {
                begin.get_or_insert(n);
                row.read(line, self.layout.style);
                if row.numbers() >= 3 && row.filled <= COLUMNS_MAX {
                    cells.push(row.filled);
                }
                if cells.len() == DECIDING_LINES {
                    self.columns = decide(&mut begin, &mut cells);
                }
            }
        }
        // The rest of the block decides; lines that are no points leave that to the next block.
        if let Some(columns) = decide(&mut begin, &mut cells) {
            self.columns = Some(columns).filter(|columns| *columns > 0);
        }
    }
}

impl Piece {
    /// Its lines that are not blank, with their numbers and the numbers of columns of their scans.
    pub fn lines(&self) -> impl Iterator<Item = (u64, &[u8], usize)> {
        let mut runs = self.runs.iter().peekable();
        let mut columns = 0;
        self.block.lines_with_tabs().map(move |(n, line)| {
            while let Some(run) = runs.next_if(|run| run.line <= n) {
                columns = run.columns;
            }
            (n, line, columns)
        })
    }
}
