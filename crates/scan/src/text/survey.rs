//! The first pass over a text file: bounds, digits after the point, the ranges of the columns, and
//! the lines that are no points, by reason. Lines of different numbers of columns, of the scans in
//! a PTS file, are surveyed apart.

use super::axes::has_axes;
use super::cells::{Row, is_comment};
use super::header::{Names, names_of, uncommented};
use super::layout::Layout;
use super::line::{count, excerpt};
use super::number::unquoted;
use super::ranges::{Range, Unit};
use super::scans::Piece;
use crate::fields::is_watched;
use crate::fields::values::Values;
use esker_points::Spread;

/// Greatest number of different numbers of columns that the scans of a file may have.
pub(crate) const WIDTHS_MAX: usize = 8;
/// Greatest number of columns for which unit vectors are looked for.
const UNIT_COLUMNS_MAX: usize = 10;

/// Why a line is no point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Fewer cells than columns.
    TooFew,
    /// More values than columns.
    TooMany,
    /// A word in place of a coordinate.
    Word,
    /// A coordinate is missing.
    NoCoordinate,
    /// A coordinate is infinite or NaN.
    NotFinite,
    /// A line of names, as two tables in one file have it.
    Names,
}

impl Fault {
    /// All faults, in the order of their counters.
    pub const ALL: [Self; 6] =
        [Self::TooFew, Self::TooMany, Self::Word, Self::NoCoordinate, Self::NotFinite, Self::Names];

    /// The reason for which points are refused.
    pub fn reason(self) -> &'static str {
        match self {
            Self::TooFew => "line has too few values",
            Self::TooMany => "line has too many values",
            Self::Word => "line has a word in place of a coordinate",
            Self::NoCoordinate => "coordinate is missing",
            Self::NotFinite => super::naming::NOT_FINITE,
            Self::Names => "line names the columns again",
        }
    }

    /// Whether such a line casts doubt on the layout; others are points without a place.
    fn is_malformed(self) -> bool {
        matches!(self, Self::TooFew | Self::TooMany | Self::Word)
    }
}

/// Reads a line of a scan of so many columns, and checks that it is a point. Cells behind the last
/// one become NaN.
///
/// # Errors
/// Why it is no point.
pub(crate) fn read_point(
    line: &[u8],
    columns: usize,
    layout: &Layout,
    row: &mut Row,
) -> Result<[f64; 3], Fault> {
    read_numbers(line, columns, layout, row).map_err(|fault| {
        let is_header = fault.is_malformed() && row.numbers() == 0 && header_of(line).is_some();
        if is_header { Fault::Names } else { fault }
    })
}

fn read_numbers(
    line: &[u8],
    columns: usize,
    layout: &Layout,
    row: &mut Row,
) -> Result<[f64; 3], Fault> {
    row.read(line, layout.style);
    let least = if layout.has_counts { columns } else { layout.least };
    let last_axis = layout.axes.into_iter().fold(0, usize::max);
    if row.filled > columns && columns > 0 {
        return Err(Fault::TooMany);
    }
    if row.cells < least.max(last_axis + 1) || columns == 0 {
        return Err(Fault::TooFew);
    }
    row.values.resize(columns, f64::NAN);
    let place = layout.axes.map(|axis| row.values[axis]);
    if place.iter().all(|c| c.is_finite()) {
        return Ok(place);
    }
    let any = |is: fn(&Row, usize) -> bool| layout.axes.iter().any(|&axis| is(row, axis));
    Err(if any(Row::is_word) {
        Fault::Word
    } else if any(Row::is_missing) {
        Fault::NoCoordinate
    } else {
        Fault::NotFinite
    })
}

/// Lines that are no points for one reason.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faulty {
    /// Number of lines.
    pub lines: u64,
    /// Number and beginning of the first one.
    pub first: Option<(u64, String)>,
}

/// The points of scans of one number of columns.
#[derive(Clone, Debug)]
pub(crate) struct Width {
    /// Numbers in a line.
    pub columns: usize,
    /// Number of points.
    pub points: u64,
    /// Number of scans, where lines of counts separate them.
    pub scans: u64,
    /// The ranges of the columns.
    pub ranges: Vec<Range>,
    /// The triples of columns from each column, if their lengths matter.
    pub units: Vec<Unit>,
}

/// What a pass over some lines finds.
#[derive(Clone, Debug)]
pub(crate) struct Survey {
    /// Points with a position.
    pub points: u64,
    /// Number of points according to lines with counts.
    pub claimed: u64,
    /// Lines that are no points, in the order of [`Fault::ALL`].
    pub faulty: [Faulty; 6],
    /// Number and beginning of the first line of names behind points that differs from the first
    /// names.
    pub renamed: Option<(u64, String)>,
    /// Number and beginning of the first comment behind points that may name other columns.
    pub commented: Option<(u64, String)>,
    /// Digits after the point that x, y and z need.
    pub decimals: [u32; 3],
    /// Distribution of the points with a position.
    pub spread: Spread,
    /// The points by the number of columns of their scans; that of the layout first.
    pub widths: Vec<Width>,
}

impl Width {
    fn empty(columns: usize, layout: &Layout) -> Self {
        let has_units = layout.names.is_none() && (6..=UNIT_COLUMNS_MAX).contains(&columns);
        let units = if has_units { columns - 2 } else { 0 };
        let named = layout.names.iter().filter(|names| names.len() == columns).flatten();
        let mut ranges = vec![Range::EMPTY; columns];
        let chosen = layout.chosen.iter().map(|(name, at)| (*at, name));
        for (column, name) in named.enumerate().chain(chosen) {
            if let Some(range) = ranges.get_mut(column).filter(|_| is_watched(name)) {
                *range = Range::empty(true);
            }
        }
        Self { columns, points: 0, scans: 0, ranges, units: vec![Unit::default(); units] }
    }

    fn add(&mut self, row: &Row, line: &[u8], layout: &Layout) {
        self.points += 1;
        for (range, &v) in self.ranges.iter_mut().zip(&row.values) {
            range.add(v);
        }
        if row.values.iter().any(|&v| Values::is_large(v)) {
            let values = self.ranges.iter_mut().zip(&row.values);
            for ((range, &v), cell) in values.zip(layout.style.cells(line)) {
                if Values::is_large(v) {
                    range.values.add_large(unquoted(cell));
                }
            }
        }
        for column in row.words().filter(|&column| column < self.columns) {
            self.ranges[column].words += 1;
            self.ranges[column].missing -= 1;
        }
        for (at, unit) in self.units.iter_mut().enumerate() {
            unit.add(&row.values[at..at + 3]);
        }
    }

    fn merge(&mut self, later: &Self) {
        self.points += later.points;
        self.scans += later.scans;
        for (a, b) in self.ranges.iter_mut().zip(&later.ranges) {
            *a = a.merge(*b);
        }
        for (a, b) in self.units.iter_mut().zip(&later.units) {
            a.merge(*b);
        }
    }
}

impl Survey {
    /// The survey of no lines.
    pub fn empty(layout: &Layout) -> Self {
        Self {
            points: 0,
            claimed: 0,
            faulty: Default::default(),
            renamed: None,
            commented: None,
            decimals: [0; 3],
            spread: Spread::default(),
            widths: vec![Width::empty(layout.columns, layout)],
        }
    }

    /// Surveys the lines of a piece.
    pub fn of_piece(piece: &Piece, layout: &Layout) -> Self {
        let mut found = Self::empty(layout);
        let mut row = Row::default();
        let mut at = 0;
        for run in piece.runs.iter().filter(|run| run.begins && run.columns > 0) {
            at = found.width(run.columns, layout);
            found.widths[at].scans += 1;
        }
        for (n, line, columns) in piece.lines() {
            if layout.is_beside(n, line) {
                let counted = if layout.has_counts { count(line.trim_ascii()) } else { None };
                found.claimed = found.claimed.saturating_add(counted.unwrap_or(0));
                if n >= layout.first_line && found.commented.is_none() && is_renaming(line, layout)
                {
                    found.commented = Some((n, excerpt(line)));
                }
                continue;
            }
            let place = match read_point(line, columns, layout, &mut row) {
                Ok(place) => place,
                Err(fault) => {
                    if fault == Fault::Names && !layout.is_named_by(line) {
                        found.renamed.get_or_insert_with(|| (n, excerpt(line)));
                    }
                    let faulty = &mut found.faulty[fault as usize];
                    faulty.lines += 1;
                    faulty.first.get_or_insert_with(|| (n, excerpt(line)));
                    continue;
                }
            };
            if found.widths[at].columns != columns {
                at = found.width(columns, layout);
            }
            found.points += 1;
            found.spread.add(place);
            found.widths[at].add(&row, line, layout);
            found.add_decimals(line, &row, layout);
        }
        found
    }

    /// The index of the points of scans of so many columns.
    fn width(&mut self, columns: usize, layout: &Layout) -> usize {
        let found = self.widths.iter().position(|width| width.columns == columns);
        found.unwrap_or_else(|| {
            self.widths.push(Width::empty(columns, layout));
            self.widths.len() - 1
        })
    }

    fn add_decimals(&mut self, line: &[u8], row: &Row, layout: &Layout) {
        for (decimals, &axis) in self.decimals.iter_mut().zip(&layout.axes) {
            *decimals = (*decimals).max(layout.style.decimals(row.cell(axis, line)));
        }
    }

    /// Adds the survey of a later piece; `false` if there are too many widths.
    pub fn merge(&mut self, later: Self, layout: &Layout) -> bool {
        self.points += later.points;
        self.claimed = self.claimed.saturating_add(later.claimed);
        for (a, b) in self.faulty.iter_mut().zip(later.faulty) {
            a.lines += b.lines;
            a.first = a.first.take().or(b.first);
        }
        self.renamed = self.renamed.take().or(later.renamed);
        self.commented = self.commented.take().or(later.commented);
        for (a, b) in self.decimals.iter_mut().zip(later.decimals) {
            *a = (*a).max(b);
        }
        self.spread.merge(later.spread);
        for width in &later.widths {
            let at = self.width(width.columns, layout);
            self.widths[at].merge(width);
        }
        self.widths.len() <= WIDTHS_MAX
    }

    /// Number of lines that cast doubt on the layout, and the first of them.
    pub fn malformed(&self) -> (u64, Option<&(u64, String)>) {
        let faults =
            || Fault::ALL.iter().zip(&self.faulty).filter(|(fault, _)| fault.is_malformed());
        let lines = faults().map(|(_, faulty)| faulty.lines).sum();
        (lines, faults().filter_map(|(_, faulty)| faulty.first.as_ref()).min())
    }

    /// Number of lines that are points or meant as points.
    pub fn lines(&self) -> u64 {
        let meant = Fault::ALL.iter().zip(&self.faulty).filter(|(f, _)| **f != Fault::Names);
        self.points + meant.map(|(_, faulty)| faulty.lines).sum::<u64>()
    }

    /// The refused lines, a line for each reason.
    pub fn notes(&self) -> Vec<String> {
        let all = Fault::ALL.iter().zip(&self.faulty);
        let told = all.filter_map(|(fault, faulty)| {
            let (line, text) = faulty.first.as_ref()?;
            let (lines, reason) = (faulty.lines, fault.reason());
            Some(match lines {
                1 if *fault == Fault::Names => format!(
                    "line {line} names the columns again (`{text}`): the lines behind it are read \
                     like those before it"
                ),
                _ if *fault == Fault::Names => format!(
                    "{lines} lines name the columns again, the first is line {line} (`{text}`): \
                     the lines behind them are read like those before them"
                ),
                1 => format!("{reason}: line {line} (`{text}`)"),
                _ => format!("{reason}: {lines} lines, the first is line {line} (`{text}`)"),
            })
        });
        let commented = self.commented.iter().map(|(line, text)| {
            format!(
                "the comment in line {line} may name other columns (`{text}`): the lines behind it \
                 are read like those before it"
            )
        });
        told.chain(commented).collect()
    }
}

/// The names of x, y and z among others in a line.
fn header_of(line: &[u8]) -> Option<Names> {
    names_of(line, None).filter(|found| has_axes(&found.names))
}

/// Whether a comment names as many columns as a file has, but others.
fn is_renaming(line: &[u8], layout: &Layout) -> bool {
    let trimmed = line.trim_ascii();
    if !is_comment(trimmed) {
        return false;
    }
    let names = uncommented(trimmed);
    let has_all = |found: Names| found.names.len() == layout.columns;
    header_of(names).is_some_and(has_all) && !layout.is_named_by(names)
}
