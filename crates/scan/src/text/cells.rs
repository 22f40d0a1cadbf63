//! Cuts the lines of a table into cells, by the separator and the decimal mark of the file, and
//! reads the values of cells: a number, no value, or a word. A separator inside quotes separates
//! nothing, and a comment may follow the last cell.

use super::number::{decimals, has_decimal_commas, number};
use std::borrow::Cow;

/// Cells of this many bytes at most are numbers with a decimal comma.
const COMMA_NUMBER_BYTES_MAX: usize = 64;

/// Contents of cells that stand for no value, in lower case; blank cells do, too.
const NO_VALUE: [&[u8]; 13] = [
    b"-", b"--", b".", b"?", b"*", b"na", b"n/a", b"#n/a", b"null", b"nil", b"none", b"nodata",
    b"\\n",
];

/// What separates the cells of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Separator {
    /// Blanks and tabs, with at most one comma or semicolon among them.
    Any,
    /// A comma, a semicolon or a tab; blanks around it are ignored.
    Mark(u8),
}

/// How cells and numbers are written in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Style {
    /// What separates cells.
    pub separator: Separator,
    /// Whether numbers have a decimal comma, or a decimal point as well; commas separate nothing.
    pub has_decimal_commas: bool,
}

impl Style {
    /// Any separator, and decimal points.
    pub const ANY: Self = Self { separator: Separator::Any, has_decimal_commas: false };

    /// The cells of a line.
    pub fn cells<'a>(self, line: &'a [u8]) -> Cells<'a> {
        let rest = match self.separator {
            Separator::Mark(b'\t') => Some(line),
            Separator::Mark(_) => Some(line.trim_ascii()),
            Separator::Any => Some(line.trim_ascii()).filter(|line| !line.is_empty()),
        };
        Cells { rest, style: self }
    }

    /// Digits after the decimal mark that the number in `cell` needs.
    pub fn decimals(self, cell: &[u8]) -> u32 {
        decimals(&self.with_point(cell))
    }

    /// The value of a cell.
    pub fn value(self, cell: &[u8]) -> Value {
        match number(cell).or_else(|| number(&self.with_point(cell))) {
            Some(value) => Value::Number(value),
            None if is_no_value(cell) => Value::Missing,
            None => Value::Word,
        }
    }

    /// A cell with a decimal point in place of its decimal comma.
    fn with_point<'a>(self, cell: &'a [u8]) -> Cow<'a, [u8]> {
        if !self.has_decimal_commas {
            return Cow::Borrowed(cell);
        }
        let comma = cell
            .iter()
            .position(|&b| b == b',')
            .filter(|_| cell.len() <= COMMA_NUMBER_BYTES_MAX && !cell.contains(&b'.'));
        let Some(comma) = comma else { return Cow::Borrowed(cell) };
        let mut cell = cell.to_vec();
        cell[comma] = b'.';
        Cow::Owned(cell)
    }

    /// The style in which `lines`, a sample of a file's lines, have most numbers. `is_named` states
    /// of a column of tab-separated cells whether it has a name.
    pub fn of_lines(lines: &[&[u8]], is_named: impl Fn(usize) -> bool) -> Self {
        let most_have =
            |mark: u8| 2 * lines.iter().filter(|line| line.contains(&mark)).count() > lines.len();
        let mut has_both_marks = false;
        let is_comma_decimal = |line: &&[u8]| has_decimal_commas(line) || !line.contains(&b',');
        let mut styles = Vec::new();
        for mark in [b';', b'\t'].into_iter().filter(|&mark| most_have(mark)) {
            let style =
                |has_decimal_commas| Self { separator: Separator::Mark(mark), has_decimal_commas };
            let (points, commas) = style(true).decimal_marks(lines);
            // Both marks in one file would be marks of thousands as well.
            has_both_marks |= points > 0 && commas > 0;
            styles.push(style(points == 0 || commas == 0));
        }
        let has_commas = lines.iter().any(|line| line.contains(&b','));
        if has_commas && lines.iter().all(is_comma_decimal) {
            styles.push(Self { has_decimal_commas: true, ..Self::ANY });
        }
        if most_have(b',') {
            let separator = Separator::Mark(b',');
            styles.push(Self { separator, has_decimal_commas: false });
        }
        if !has_both_marks {
            styles.push(Self::ANY);
        }
        let mut best = (0, styles[0]);
        for style in styles {
            let score = style.score(lines, &is_named);
            if score > best.0 {
                best = (score, style);
            }
        }
        best.1
    }

    /// Number of cells with a decimal point, and of those with a decimal comma.
    fn decimal_marks(self, lines: &[&[u8]]) -> (usize, usize) {
        let is_number = |cell: &&[u8]| matches!(self.value(cell), Value::Number(_));
        let cells = || lines.iter().flat_map(|line| self.cells(line)).filter(is_number);
        let with = |mark: u8| cells().filter(|cell| cell.contains(&mark)).count();
        (with(b'.'), with(b','))
    }

    /// How well this style fits: two for each line of the most frequent number of cells that has
    /// three or more numbers and no word, one for each that has words, too.
    fn score(self, lines: &[&[u8]], is_named: &impl Fn(usize) -> bool) -> usize {
        let mut row = Row::default();
        let mut rated = Vec::with_capacity(lines.len());
        let mut filled = Vec::new();
        for line in lines {
            row.read(line, self);
            let rating = match (row.numbers(), row.has_words()) {
                (3.., false) => 2,
                (3.., true) => 1,
                _ => 0,
            };
            rated.push((row.cells, rating));
            filled.resize(filled.len().max(row.filled), false);
            for (column, filled) in filled.iter_mut().enumerate().take(row.filled) {
                *filled |= !row.is_missing(column);
            }
        }
        // Where tabs only align columns, there are empty columns between them.
        let is_aligned = self.separator == Separator::Mark(b'\t')
            && (0..filled.len()).any(|column| !filled[column] && !is_named(column));
        if is_aligned {
            return 0;
        }
        let cells = most_frequent(rated.iter().filter(|(_, rate)| *rate > 0).map(|(n, _)| *n));
        rated.iter().filter(|(n, _)| Some(*n) == cells).map(|(_, rate)| rate).sum()
    }
}

/// The value that occurs most often; of several, the one that occurs first.
pub(crate) fn most_frequent(values: impl Iterator<Item = usize>) -> Option<usize> {
    let mut counts: Vec<(usize, usize)> = Vec::new();
    for value in values {
        match counts.iter_mut().find(|(of, _)| *of == value) {
            Some((_, count)) => *count += 1,
            None => counts.push((value, 1)),
        }
    }
    counts.into_iter().rev().max_by_key(|&(_, count)| count).map(|(value, _)| value)
}

/// The cells of a line, without blanks around them. A separator at the end of the line is followed
/// by an empty cell, unless any separates.
pub(crate) struct Cells<'a> {
    rest: Option<&'a [u8]>,
    style: Style,
}

impl<'a> Iterator for Cells<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest?;
        let Separator::Mark(mark) = self.style.separator else { return self.next_of_any(rest) };
        let blanks = rest.iter().take_while(|b| **b == b' ').count();
        let from = blanks + end_of_quotes(&rest[blanks..]).unwrap_or(0);
        let end = rest[from..].iter().position(|&b| b == mark).map(|at| from + at);
        self.rest = end.map(|end| &rest[end + 1..]);
        Some(rest[..end.unwrap_or(rest.len())].trim_ascii())
    }
}

impl<'a> Cells<'a> {
    fn next_of_any(&mut self, rest: &'a [u8]) -> Option<&'a [u8]> {
        let separates_by_comma = !self.style.has_decimal_commas;
        let is_mark = |b: &u8| *b == b';' || *b == b',' && separates_by_comma;
        // Digits, points and signs are all greater than a comma: most bytes need one comparison.
        let separates = |b: &u8| match *b {
            b',' => separates_by_comma,
            other if other > b',' => other == b';',
            other => other.is_ascii_whitespace(),
        };
        let end = end_of_quotes(rest)
            .unwrap_or_else(|| rest.iter().position(separates).unwrap_or(rest.len()));
        let (cell, after) = rest.split_at(end);
        let mut rest = after.trim_ascii_start();
        if rest.first().is_some_and(is_mark) {
            rest = rest[1..].trim_ascii_start();
        }
        self.rest = Some(rest).filter(|rest| !rest.is_empty());
        Some(cell)
    }
}

/// The length of the quoted text that `bytes` begin with; doubled quotes in it stand for one.
/// `None` without a quote that closes it, before a separator or the end.
fn end_of_quotes(bytes: &[u8]) -> Option<usize> {
    if bytes.first() != Some(&b'"') {
        return None;
    }
    let mut at = 1;
    loop {
        at += bytes[at..].iter().position(|&b| b == b'"')? + 1;
        match bytes.get(at) {
            Some(b'"') => at += 1,
            None | Some(b',' | b';' | b' ' | b'\t') => return Some(at),
            Some(_) => return None,
        }
    }
}

/// What a cell holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Value {
    /// A number, or NaN.
    Number(f64),
    /// Nothing, or one of the words for it.
    Missing,
    /// Something else.
    Word,
}

/// Whether a line (without blanks before it) is a comment.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    matches!(line, [b'#' | b'%', ..] | [b'/', b'/', ..])
}

/// The part of a cell before a comment in it.
fn before_comment(cell: &[u8]) -> Option<&[u8]> {
    let begins =
        |&at: &usize| (at == 0 || cell[at - 1].is_ascii_whitespace()) && is_comment(&cell[at..]);
    (0..cell.len()).find(begins).map(|at| cell[..at].trim_ascii())
}

fn is_no_value(cell: &[u8]) -> bool {
    let cell = super::number::unquoted(cell).trim_ascii();
    cell.is_empty() || NO_VALUE.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

/// The values of a line.
#[derive(Clone, Debug, Default)]
pub(crate) struct Row {
    /// The values of its cells; NaN where a cell is missing or a word.
    pub values: Vec<f64>,
    /// Number of cells, at most [`Row::CELLS_MAX`].
    pub cells: usize,
    /// Number of cells up to the last that is not empty.
    pub filled: usize,
    /// Columns of the cells without a number, in order, and whether they are words.
    others: Vec<(usize, bool)>,
    /// Where the cells begin and end in the line.
    spans: Vec<(u32, u32)>,
}

impl Row {
    /// Greatest number of cells that are read; no file may have so many.
    pub const CELLS_MAX: usize = super::naming::COLUMNS_MAX + 1;

    /// Reads a line.
    pub fn read(&mut self, line: &[u8], style: Style) {
        self.values.clear();
        self.others.clear();
        self.spans.clear();
        self.filled = 0;
        for cell in style.cells(line) {
            let mut value = style.value(cell);
            let mut before = None;
            if value == Value::Word {
                before = before_comment(cell);
                match before {
                    Some(b"") => break,
                    Some(before) => value = style.value(before),
                    None => {}
                }
            }
            let from = cell.as_ptr() as usize - line.as_ptr() as usize;
            let to = from + before.unwrap_or(cell).len();
            self.spans.push((from as u32, to as u32));
            let column = self.values.len();
            self.values.push(match value {
                Value::Number(value) => value,
                _ => f64::NAN,
            });
            if !matches!(value, Value::Number(_)) {
                self.others.push((column, value == Value::Word));
            }
            if !cell.is_empty() {
                self.filled = column + 1;
            }
            if before.is_some() || self.values.len() == Self::CELLS_MAX {
                break;
            }
        }
        self.cells = self.values.len();
    }

    /// The cell of a column in `line`, the line that was read.
    pub fn cell<'a>(&self, column: usize, line: &'a [u8]) -> &'a [u8] {
        let span = self.spans.get(column);
        let cell = span.and_then(|&(from, to)| line.get(from as usize..to as usize));
        cell.unwrap_or_default()
    }

    /// Number of cells with a number, NaN included.
    pub fn numbers(&self) -> usize {
        self.cells - self.others.len()
    }

    /// Whether a cell is a word.
    pub fn has_words(&self) -> bool {
        self.others.iter().any(|(_, is_word)| *is_word)
    }

    /// Columns of the cells that are words.
    pub fn words(&self) -> impl Iterator<Item = usize> {
        self.others.iter().filter(|(_, is_word)| *is_word).map(|(column, _)| *column)
    }

    /// Whether a cell has no value.
    pub fn is_missing(&self, column: usize) -> bool {
        self.others.contains(&(column, false))
    }

    /// Whether a cell is a word.
    pub fn is_word(&self, column: usize) -> bool {
        self.others.contains(&(column, true))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn style(mark: u8, has_decimal_commas: bool) -> Style {
        Style { separator: Separator::Mark(mark), has_decimal_commas }
    }

    fn split(line: &str, style: Style) -> Vec<String> {
        style.cells(line.as_bytes()).map(|f| String::from_utf8_lossy(f).into_owned()).collect()
    }

    #[test]
    fn separators_inside_quotes_separate_nothing() {
        let comma = style(b',', false);
        assert_eq!(split("x, \"a, b\" ,\"say \"\"a, b\"\"\",z", comma).len(), 4);
        assert_eq!(split("x \"a b\" z", Style::ANY), ["x", "\"a b\"", "z"]);
        assert_eq!(split("\"1,2,3", comma), ["\"1", "2", "3"]);
        assert_eq!(split("1,2,", comma), ["1", "2", ""]);
        assert_eq!(split("\t1\t\t2", style(b'\t', false)), ["", "1", "", "2"]);
        for line in ["1 2 3", "1,2,3", " 1 , 2 ,3", "1;2;3;", "1\t2 \t 3", "1, 2;3"] {
            assert_eq!(split(line, Style::ANY), ["1", "2", "3"], "{line}");
        }
    }

    #[test]
    fn the_style_is_that_with_most_numbers() {
        let comma = Style { has_decimal_commas: true, ..Style::ANY };
        for (text, want) in [
            ("1 2 3\n4 5 6", Style::ANY),
            ("1, 2;3", Style::ANY),
            ("1,2,3\n4,,6,\n4,5,6", style(b',', false)),
            ("1,2,3,tall tree\n4,5,6,", style(b',', false)),
            ("1;2;3", style(b';', true)),
            ("0;0;0\n1,5;2,5;3", style(b';', true)),
            ("1.5;2,5;3", style(b';', false)),
            ("1,5\t2\t3", style(b'\t', true)),
            ("1\t\t3\t4\n1\t2\t3\t4", style(b'\t', true)),
            ("1\t\t3\t\t4\n1\t\t3\t\t4", Style::ANY),
            ("1\t2\t3 4\n1 2\t3\t4", Style::ANY),
            ("1,5 2,5 3,5", comma),
            ("1,2 3 4", comma),
            ("1, 2 3 4", Style::ANY),
        ] {
            let lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
            assert_eq!(Style::of_lines(&lines, |_| false), want, "{text}");
        }
    }

    #[test]
    fn cells_are_numbers_or_missing_or_words() {
        let comma = style(b';', true);
        assert_eq!(comma.value(b"-1,5e3"), Value::Number(-1500.0));
        assert_eq!(comma.value(b"\"1,25\""), Value::Number(1.25));
        assert_eq!((comma.decimals(b"1,250"), comma.decimals(b"1.5")), (2, 1));
        assert_eq!(comma.value(b"1,5,2"), Value::Word);
        assert_eq!(comma.value(b"1.000,5"), Value::Word);
        assert_eq!(Style::ANY.value(b"1,5"), Value::Word);
        for cell in ["", "-", "NA", "null", "\"\"", "N/A"] {
            assert_eq!(comma.value(cell.as_bytes()), Value::Missing, "{cell}");
        }
        assert_eq!(comma.value(b"tree"), Value::Word);
    }

    #[test]
    fn comments_end_a_row() {
        let mut row = Row::default();
        for (line, of) in [
            ("1 2 3 # seen, twice", Style::ANY),
            ("1,2,3 # seen, twice", style(b',', false)),
            ("1,2,3,// seen", style(b',', false)),
        ] {
            row.read(line.as_bytes(), of);
            assert_eq!((row.cells, row.filled, row.has_words()), (3, 3, false), "{line}");
        }
    }
}
