//! Decides how the lines of a text file are laid out, from a sample of its beginning: separator and
//! decimal mark, the number of columns, their names, and which are x, y and z. The most frequent
//! number of cells decides, so that a damaged first line does not.

use super::axes::{axes_of, single};
use super::cells::{Row, Separator, Style, Value, is_comment, most_frequent};
use super::columns::{Column, Columns};
use super::header::{Names, names_of};
pub(crate) use super::line::{count, excerpt};
use super::line::{excerpt_of, is_text};
use super::naming::COLUMNS_MAX;
use super::sample::{Choice, Header, Sample};

/// Rows that a note shows, and the length of each.
const SHOWN_ROWS: usize = 3;
const SHOWN_BYTES: usize = 72;
/// Empty cells at the end of a line that may be left out.
const EMPTY_MAX: usize = 32;
/// Names that a message lists.
const LISTED_NAMES: usize = 12;

/// Class of a text file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Columns of numbers.
    Columns(Box<Layout>),
    /// A table, but not of points; the message names the line and the reason.
    NoPoints(String),
}

/// How the lines of a file are laid out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    /// Names of the columns, if a line has them.
    pub names: Option<Vec<String>>,
    /// Number of the first line that may be a point.
    pub first_line: u64,
    /// Greatest number of cells of a line; of a file of counts, that of most lines.
    pub columns: usize,
    /// Least number of cells of a line.
    pub least: usize,
    /// Whether lines with only a count precede the lines that they count.
    pub has_counts: bool,
    /// How cells are separated and numbers written.
    pub style: Style,
    /// Columns of x, y and z.
    pub axes: [usize; 3],
    /// Names that the user gives to other columns.
    pub chosen: Vec<(String, usize)>,
    /// Why the choice of x, y and z is a guess, if it is one.
    pub guess: Option<String>,
    /// Whether x and y are longitudes and latitudes by their names.
    pub is_geographic: bool,
    /// The first points.
    pub shown: Vec<String>,
    /// Assumptions, a line each.
    pub notes: Vec<String>,
}

impl Layout {
    /// Whether a line of this number is not meant as a point.
    pub fn is_beside(&self, number: u64, line: &[u8]) -> bool {
        number < self.first_line
            || is_comment(line.trim_ascii_start())
            || self.has_counts && count(line.trim_ascii()).is_some()
    }
}

impl Layout {
    /// Whether the names in a line are those of the columns; without names, or where scans have
    /// different columns, whether x, y and z are the same columns.
    pub fn is_named_by(&self, line: &[u8]) -> bool {
        let Some(found) = names_of(line, Some(self.columns)) else { return false };
        match self.names.as_ref().filter(|_| !self.has_counts) {
            Some(names) => {
                let same = |(a, b): (&String, &String)| a.to_lowercase() == b.to_lowercase();
                let found = padded(found.names, names.len());
                found.len() == names.len() && names.iter().zip(&found).all(same)
            }
            None => axes_of(&found.names).is_ok_and(|axes| axes.columns == self.axes),
        }
    }
}

/// Whether only empty fields or a comment follow the numbers of a line: `field` is the first that
/// is no number, `behind` the fields after it.
fn is_end<'a>(field: &'a [u8], behind: impl Iterator<Item = &'a [u8]>) -> bool {
    std::iter::once(field).chain(behind).find(|f| !f.is_empty()).is_none_or(is_comment)
}

/// Classifies a file by its first lines; `None` if it is not text that could hold points. A file
/// without any point is recognised only by its names.
pub(crate) fn classify(head: &[u8], choice: &Choice) -> Option<Kind> {
    if !is_text(head) {
        return None;
    }
    let mut sample = Sample::new(choice);
    for (n, line) in (1..).zip(head.split(|&b| b == b'\n')) {
        sample.take(n, line);
        if sample.is_full() {
            break;
        }
    }
    layout_of(&sample)
}

/// Classifies a file by a sample of it; see [`classify`].
pub(crate) fn layout_of(sample: &Sample<'_>) -> Option<Kind> {
    match table(sample)? {
        Ok(layout) => Some(Kind::Columns(Box::new(layout))),
        Err(why) => Some(Kind::NoPoints(why)),
    }
}

fn table(sample: &Sample<'_>) -> Option<Result<Layout, String>> {
    let Some((first_line, first)) = sample.lines.first() else {
        return Some(without_points(sample)).filter(|_| sample.has_axes());
    };
    let is_named = sample.has_axes() || sample.choice.columns.is_some();
    let lines: Vec<&[u8]> = sample.lines.iter().map(|(_, line)| line.as_slice()).collect();
    let style = Style::of_lines(&lines, |column| is_column_named(sample, column));
    let rows = rows_of(&lines, style, is_named);
    let has_row = |n: u64| rows.iter().any(|row| sample.lines[row.line].0 == n);
    if rows.is_empty() || !is_named && !has_row(*first_line) && 2 * rows.len() < lines.len() {
        let (numbers, stray) = numbers_of(first, style);
        let is_table = numbers > 0 || is_named;
        return is_table.then(|| Err(why_no_point(*first_line, numbers, stray)));
    }
    // Lines that are neither names nor points belong to some other format.
    let names = sample.named.as_ref().filter(|header| header.has_axes);
    if !is_named && sample.passed.is_some() {
        return None;
    }
    let cells = most_frequent(rows.iter().map(|row| row.cells))?;
    let of_most = || rows.iter().filter(|row| row.cells == cells);
    let filled = of_most().map(|row| row.filled).max()?;
    let first_row = of_most().next().map_or(*first_line, |row| sample.lines[row.line].0);
    let found = match names.or(sample.named.as_ref()) {
        Some(header) => match names_in(header, (cells, filled), first_row, sample.choice) {
            Ok(names) => names,
            Err(why) => return Some(Err(why)),
        },
        None => sample
            .commented
            .as_ref()
            .and_then(|header| names_of(&header.line, Some(cells)))
            .filter(|names| (names.names.len()..=names.cells).contains(&filled)),
    };
    let (columns, least) = match &found {
        Some(Names { names, cells: named }) => {
            (names.len().max(cells.min(*named)), names.len().min(cells))
        }
        None => (cells, filled),
    };
    // Short lines take the memory of all columns.
    let least = if columns - least > EMPTY_MAX { columns } else { least };
    let shown = of_most().take(SHOWN_ROWS);
    let layout = Layout {
        names: found.map(|found| padded(found.names, columns)),
        first_line: *first_line,
        columns,
        least,
        has_counts: sample.has_counts,
        style,
        axes: [0, 1, 2],
        chosen: Vec::new(),
        guess: None,
        is_geographic: false,
        shown: shown.map(|row| excerpt_of(lines[row.line], SHOWN_BYTES)).collect(),
        notes: notes(sample, style),
    };
    Some(with_axes(layout, sample.choice))
}

/// The layout of a file that has names of x, y and z, but no point.
fn without_points(sample: &Sample<'_>) -> Result<Layout, String> {
    let named = [&sample.named, &sample.commented].into_iter().flatten();
    let header = named.clone().find(|header| header.has_axes);
    let names = header.and_then(|header| names_of(&header.line, None));
    let names = names.map(|found| found.names).unwrap_or_default();
    let layout = Layout {
        first_line: header.map_or(1, |header| header.number + 1),
        columns: names.len(),
        least: names.len(),
        names: Some(names),
        has_counts: sample.has_counts,
        style: Style::ANY,
        axes: [0, 1, 2],
        chosen: Vec::new(),
        guess: None,
        is_geographic: false,
        shown: Vec::new(),
        notes: Vec::new(),
    };
    with_axes(layout, sample.choice)
}

/// A line of the sample that is a point.
struct Point {
    line: usize,
    cells: usize,
    filled: usize,
}

/// The lines that have three numbers or more; with words only if columns are named.
fn rows_of(lines: &[&[u8]], style: Style, is_named: bool) -> Vec<Point> {
    let mut row = Row::default();
    let mut rows = Vec::new();
    for (line, text) in lines.iter().enumerate() {
        row.read(text, style);
        let (cells, filled) = (row.cells, row.filled);
        if row.numbers() >= 3 && cells <= COLUMNS_MAX && (is_named || !row.has_words()) {
            rows.push(Point { line, cells, filled });
        }
    }
    rows
}

/// Whether the header has a name between the tabs of this column.
fn is_column_named(sample: &Sample<'_>, column: usize) -> bool {
    let tabs = Style { separator: Separator::Mark(b'\t'), has_decimal_commas: false };
    let header = sample.named.as_ref().or(sample.commented.as_ref());
    let mut cells = header.into_iter().flat_map(|header| tabs.cells(&header.line));
    cells.nth(column).is_some_and(|name| !name.is_empty())
}

/// The names in `header`, if they fit lines of so many cells, of which so many are filled.
fn names_in(
    header: &Header,
    (cells, filled): (usize, usize),
    row: u64,
    choice: &Choice,
) -> Result<Option<Names>, String> {
    let found = names_of(&header.line, Some(cells));
    let fits = |of: &Names| filled <= of.cells && of.names.len() <= cells;
    if let Some(names) = found.as_ref().filter(|found| !fits(found)) {
        // Numbers of columns need no names.
        if choice.columns.as_ref().is_some_and(are_axes_numbers) {
            return Ok(None);
        }
        return Err(format!(
            "line {row} has {filled} numbers, but line {} names {} columns; name them with \
             --columns, such as \"x=1,y=2,z=3\"",
            header.number,
            names.names.len()
        ));
    }
    Ok(found)
}

fn are_axes_numbers(columns: &Columns) -> bool {
    let is_number =
        |axis: &&str| columns.entries().any(|e| e.0 == *axis && matches!(e.1, Column::Number(_)));
    AXES.iter().all(is_number)
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn padded(mut names: Vec<String>, columns: usize) -> Vec<String> {
    names.extend((names.len() + 1..=columns).map(|n| format!("column_{n}")));
    names
}

fn notes(sample: &Sample<'_>, style: Style) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some((first, text, lines)) = &sample.passed {
        let rest = if *lines > 1 { format!(", and {} more", lines - 1) } else { String::new() };
        notes.push(format!("line {first} before the points is passed over (`{text}`){rest}"));
    }
    let has_comma = |line: &[u8]| style.cells(line).any(|cell| cell.contains(&b','));
    if style.has_decimal_commas && sample.lines.iter().any(|(_, line)| has_comma(line)) {
        notes.push("numbers have decimal commas".into());
    }
    notes
}

/// The layout with its columns of x, y and z: those that the user names, else those that the file
/// names, else the first three.
fn with_axes(mut layout: Layout, choice: &Choice) -> Result<Layout, String> {
    let mut chosen = [None; 3];
    for (name, column) in choice.columns.iter().flat_map(Columns::entries) {
        let at = resolve(column, &layout)?;
        match AXES.iter().position(|axis| *axis == name) {
            Some(axis) => chosen[axis] = Some(at),
            None => layout.chosen.push((name.to_owned(), at)),
        }
    }
    if let Some((name, at)) = layout.chosen.iter().find(|(_, at)| chosen.contains(&Some(*at))) {
        let why = "is one of x, y and z as well";
        return Err(format!("--columns: column {} ({name}) {why}", at + 1));
    }
    if let [Some(x), Some(y), Some(z)] = chosen {
        return distinct(Layout { axes: [x, y, z], ..layout });
    }
    let Some(names) = &layout.names else {
        layout.axes = [0, 1, 2].map(|axis| chosen[axis].unwrap_or(axis));
        layout.guess = Some("no line names the columns".into());
        return distinct(layout);
    };
    if chosen != [None; 3] {
        let used: Vec<usize> = chosen.into_iter().flatten().collect();
        let found = [0, 1, 2].map(|axis| chosen[axis].or_else(|| single(names, axis, &used)));
        let lacking: Vec<usize> = (0..3).filter(|&axis| found[axis].is_none()).collect();
        let [Some(x), Some(y), Some(z)] = found else { return Err(lacks(names, &lacking)) };
        return distinct(Layout { axes: [x, y, z], ..layout });
    }
    let axes = axes_of(names).map_err(|lacking| lacks(names, &lacking))?;
    layout.is_geographic = axes.is_geographic;
    if axes.is_geographic {
        layout.notes.push("x is the longitude and y the latitude, in degrees".into());
    }
    if !axes.rivals.is_empty() {
        let rivals: Vec<String> =
            axes.rivals.iter().map(|&c| format!("{} (`{}`)", c + 1, names[c])).collect();
        layout.guess =
            Some(format!("by its name, column {} could be meant, too", rivals.join(", ")));
    }
    layout.axes = axes.columns;
    distinct(layout)
}

fn lacks(names: &[String], lacking: &[usize]) -> String {
    let axes: Vec<&str> = lacking.iter().map(|&axis| AXES[axis]).collect();
    let listed = names.iter().take(LISTED_NAMES).map(|name| format!("`{name}`"));
    let listed: Vec<String> = listed.collect();
    let more = if names.len() > LISTED_NAMES { " ..." } else { "" };
    format!(
        "no column is known as {} by its name ({}{more}); name them with --columns, such as \
         \"x=1,y=2,z=3\"",
        axes.join(", "),
        listed.join(", ")
    )
}

fn distinct(layout: Layout) -> Result<Layout, String> {
    let [x, y, z] = layout.axes;
    let columns = layout.columns;
    if let Some(axis) = layout.axes.iter().position(|&column| column >= columns) {
        return Err(format!("has no column for {}: lines have {columns} numbers", AXES[axis]));
    }
    if x == y || y == z || x == z {
        return Err("--columns gives some of x, y and z only; give all three".into());
    }
    Ok(layout)
}

/// The column that the user means.
fn resolve(column: &Column, layout: &Layout) -> Result<usize, String> {
    let columns = layout.columns;
    match column {
        Column::Number(number) if *number <= columns => Ok(number - 1),
        Column::Number(number) => {
            Err(format!("has no column {number}, which --columns names: it has {columns}"))
        }
        Column::Name(name) => {
            let Some(names) = &layout.names else {
                return Err(format!(
                    "no line names the columns: give the number of `{name}` to --columns"
                ));
            };
            let lower = name.to_lowercase();
            let exact = names.iter().position(|of| of == name);
            exact.or_else(|| names.iter().position(|of| of.to_lowercase() == lower)).ok_or_else(
                || {
                    let listed: Vec<_> = names.iter().take(LISTED_NAMES).cloned().collect();
                    format!("has no column `{name}`, which --columns names ({})", listed.join(", "))
                },
            )
        }
    }
}

/// Counts the numbers that a line begins with; also returns the cell after them, unless only empty
/// cells or a comment follow.
fn numbers_of(line: &[u8], style: Style) -> (usize, Option<&[u8]>) {
    let mut cells = style.cells(line);
    let mut numbers = 0;
    while let Some(cell) = cells.next() {
        if !matches!(style.value(cell), Value::Number(_)) {
            return (numbers, (!is_end(cell, cells)).then_some(cell));
        }
        numbers += 1;
    }
    (numbers, None)
}

/// Why line `n`, which begins with `numbers` numbers, is no point.
fn why_no_point(n: u64, numbers: usize, stray: Option<&[u8]>) -> String {
    match stray {
        Some(b"") => format!("line {n} has an empty field; write a number there"),
        Some(word) => format!("line {n} has `{}`, which is no number", excerpt(word)),
        None if numbers > COLUMNS_MAX => {
            format!("line {n} has more than {COLUMNS_MAX} numbers, which are read at most")
        }
        None => format!("line {n} has fewer than three numbers"),
    }
}
