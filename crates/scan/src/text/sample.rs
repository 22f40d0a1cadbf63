//! Samples the beginning of a text file line by line: the line that names the columns, lines of
//! counts, lines before them that are neither, and the first lines with points.

use super::axes::has_axes;
use super::cells::{Row, Style, Value, is_comment};
use super::columns::Columns;
use super::header::{names_of, uncommented};
use super::line::{count, excerpt};

/// Lines with points that are sampled, and their bytes.
const LINES_MAX: usize = 500;
const BYTES_MAX: usize = 64 << 10;
/// Lines that may stand before the points and are neither names nor comments nor counts.
const PASSED_MAX: u64 = 200;

/// What the user says of text files.
#[derive(Clone, Debug, Default)]
pub(crate) struct Choice {
    /// Which column is which.
    pub columns: Option<Columns>,
    /// Lines at the beginning that are passed over.
    pub skip_lines: u64,
}

/// A line that may name the columns.
#[derive(Clone, Debug)]
pub(crate) struct Header {
    /// Number of the line.
    pub number: u64,
    /// The line, without the marks of a comment.
    pub line: Vec<u8>,
    /// Whether x, y and z are among its names.
    pub has_axes: bool,
}

/// The beginning of a text file.
#[derive(Clone, Debug)]
pub(crate) struct Sample<'a> {
    /// What the user says.
    pub choice: &'a Choice,
    /// The last comment before the points that names x, y and z.
    pub commented: Option<Header>,
    /// The line that names columns: the first that names x, y and z, else the first with names.
    pub named: Option<Header>,
    /// Number and beginning of the first line that is no point, name, comment or count, and the
    /// number of such lines.
    pub passed: Option<(u64, String, u64)>,
    /// Whether a line has only a count.
    pub has_counts: bool,
    /// Numbers and bytes of the first lines that may be points.
    pub lines: Vec<(u64, Vec<u8>)>,
    bytes: usize,
    row: Row,
}

impl<'a> Sample<'a> {
    /// The sample of no lines.
    pub fn new(choice: &'a Choice) -> Self {
        Self {
            choice,
            commented: None,
            named: None,
            passed: None,
            has_counts: false,
            lines: Vec::new(),
            bytes: 0,
            row: Row::default(),
        }
    }

    /// Whether no more lines are needed.
    pub fn is_full(&self) -> bool {
        self.lines.len() == LINES_MAX
            || self.bytes >= BYTES_MAX
            || self.passed.as_ref().is_some_and(|passed| passed.2 > PASSED_MAX)
    }

    /// Whether there were only comments, and blank lines.
    pub fn is_comments(&self) -> bool {
        self.named.is_none() && self.passed.is_none() && self.lines.is_empty() && !self.has_counts
    }

    /// Takes a line with its tabs, and its number.
    pub fn take(&mut self, number: u64, line: &[u8]) {
        let trimmed = line.trim_ascii();
        if number <= self.choice.skip_lines || trimmed.is_empty() {
            return;
        }
        if is_comment(trimmed) {
            if self.lines.is_empty() {
                self.commented = header(number, uncommented(trimmed))
                    .filter(|header| header.has_axes)
                    .or(self.commented.take());
            }
            return;
        }
        if count(trimmed).is_some() && (self.lines.is_empty() || self.has_counts) {
            self.has_counts = true;
            return;
        }
        if !self.lines.is_empty() || self.is_data(trimmed) {
            self.bytes += line.len();
            self.lines.push((number, line.to_vec()));
            return;
        }
        let header = header(number, trimmed);
        let is_better = |header: &Header| match &self.named {
            Some(named) => header.has_axes && !named.has_axes,
            None => true,
        };
        match header.filter(is_better) {
            Some(header) => {
                if let Some(worse) = self.named.replace(header) {
                    self.pass(worse.number, &worse.line);
                }
            }
            None if self.has_axes() => {
                self.bytes += line.len();
                self.lines.push((number, line.to_vec()));
            }
            None => self.pass(number, trimmed),
        }
    }

    fn pass(&mut self, number: u64, line: &[u8]) {
        let first = self.passed.take();
        let (first, text, lines) = first.unwrap_or_else(|| (number, excerpt(line), 0));
        self.passed = Some((first, text, lines + 1));
    }

    /// Whether x, y and z are named.
    pub fn has_axes(&self) -> bool {
        let has = |header: &Option<Header>| header.as_ref().is_some_and(|header| header.has_axes);
        has(&self.named) || has(&self.commented)
    }

    /// Whether the first point may stand in this line.
    fn is_data(&mut self, line: &[u8]) -> bool {
        let first = Style::ANY.cells(line).next().map(|cell| Style::ANY.value(cell));
        if matches!(first, Some(Value::Number(_))) {
            return true;
        }
        if self.choice.columns.is_none() {
            return false;
        }
        self.row.read(line, Style::ANY);
        self.row.numbers() >= 3
    }
}

fn header(number: u64, line: &[u8]) -> Option<Header> {
    let names = names_of(line, None)?;
    Some(Header { number, line: line.to_vec(), has_axes: has_axes(&names.names) })
}
