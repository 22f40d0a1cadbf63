//! Reads PTX (Leica Cyclone): scans as text, each with the pose of its scanner. Points are returned
//! in the file's coordinates. Directions without a return (`0 0 0`) are counted but are no points.
//! A first pass finds bounds, digits and types, a second one decodes the points; neither keeps more
//! than a few blocks.
//!
//! If there are several scans, the `point_source_id` of a point is the number of its scan, from 1.

mod scans;

use crate::error::ScanError;
use crate::source::{Format, OpenOptions, ReadReport, Scanner, Sink, Source, SourceInfo};
use crate::text::blocks::in_order;
use crate::text::layout::{count, excerpt};
use crate::text::naming::{NO_RETURN, NOT_FINITE, schema_of};
use crate::text::number::{decimals, fields, number};
use crate::text::start::{first_lines, lines_of};
use esker_points::attribute::names;
use esker_points::lattice::{Grid, GridKind, Placement, decimal_grid, float_grid};
use esker_points::spread::Corners;
use esker_points::{AttrType, Batch, InputGrid, Rounding, Schema, Spread, Task};
use scans::{Piece, Scans};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// PTX, an entry of the registry.
pub const FORMAT: Format = Format { name: "PTX", endings: &["ptx"], recognises, open };

/// Number of significant digits up to which an `f32` holds every decimal.
const F32_DIGITS: usize = 6;
/// Greatest number of digits after the point for which decimal text gets a decimal grid.
const DECIMALS_MAX: u32 = 15;
/// Numbers in a line: position and intensity, and in some files colours.
const COLUMNS: [usize; 2] = [4, 7];

struct PtxSource {
    info: SourceInfo,
    columns: usize,
    /// Type of the intensity.
    intensity: AttrType,
    has_scans: bool,
    /// The columns of the schema: intensity, red, green, blue, and the scan.
    attributes: Vec<usize>,
}

/// What the first pass finds.
#[derive(Clone, Debug)]
struct Survey {
    points: u64,
    /// Lines without a point.
    others: u64,
    scans: BTreeMap<u64, [f64; 3]>,
    spread: Spread,
    decimals: [u32; 3],
    is_only_moved: bool,
    /// Greatest number of significant digits of an intensity.
    digits: usize,
}

/// A line of a piece.
enum Line {
    Point { world: [f64; 3], rest: [f64; 4] },
    NoReturn,
    NotFinite,
}

/// The points decoded from a piece, and the number of refused ones.
struct Decoded {
    batch: Batch,
    no_return: u64,
    not_finite: u64,
    rounding: Rounding,
}

fn recognises(head: &[u8]) -> bool {
    let lines = first_lines(head);
    let mut lines =
        lines.split(|&b| b == b'\n').map(|l| l.trim_ascii()).filter(|line| !line.is_empty());
    let is_count = |line: Option<&[u8]>| line.and_then(count).is_some();
    let first = lines.next();
    let is_head = is_count(first)
        && is_count(lines.next())
        && lines.next().is_some_and(|line| fields(line).count() == 3);
    // A PTS file may begin with two counts, the first of no points. The seventh line of PTX is the
    // first row of a matrix, unless the file is cut there.
    let is_matrix = lines.nth(3).is_some_and(|line| fields(line).count() == 4);
    let is_cut = lines.next().is_none() && first.and_then(count) != Some(0);
    is_head && (is_matrix || is_cut)
}

/// Numbers in the line of a point, from the first one; the least number if there is no point.
fn columns_of(path: &Path, task: &dyn Task) -> Result<usize, ScanError> {
    let mut scans = Scans::new(path, lines_of(path)?, task);
    let piece = scans.next()?;
    let first = piece.as_ref().and_then(|piece| piece.block.lines().next());
    let columns = first.map_or(COLUMNS[0], |(_, line)| fields(line).count());
    match (first, COLUMNS.contains(&columns)) {
        (Some((n, line)), false) => Err(ScanError::damaged(
            path,
            format!("line {n} is not four or seven numbers (`{}`)", excerpt(line)),
        )),
        _ => Ok(columns),
    }
}

fn open(path: &Path, _: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let columns = columns_of(path, task)?;
    let survey = survey_file(path, columns, task)?;
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let intensity = if survey.digits <= F32_DIGITS { AttrType::F32 } else { AttrType::F64 };
    let mut attributes = vec![(names::INTENSITY.to_owned(), intensity)];
    if columns == COLUMNS[1] {
        let colours = [names::RED, names::GREEN, names::BLUE];
        attributes.extend(colours.map(|name| (name.to_owned(), AttrType::U8)));
    }
    let has_scans = survey.scans.len() > 1;
    if has_scans {
        attributes.push((names::POINT_SOURCE_ID.to_owned(), AttrType::U16));
    }
    let (schema, attributes) = schema_of(attributes);
    let (kind, grid, bounds) = survey.grid();
    let mut notes = Vec::new();
    if survey.points == 0 {
        notes.push("has no points".into());
    }
    let scanner = match survey.scans.len() {
        0 => None,
        1 => survey.scans.values().next().copied().map(Scanner::At),
        _ => Some(Scanner::BySource(survey.scans.iter().map(|(&n, &at)| (n as u16, at)).collect())),
    };
    let scans = match survey.scans.len() {
        1 => "one scan".to_owned(),
        n => format!("{n} scans"),
    };
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("PTX, {scans}"),
        grid: InputGrid { name: path.display().to_string(), kind, grid, bounds },
        schema,
        points_hint: survey.points + survey.others,
        bytes,
        colour_depth: None,
        crs: None,
        scanner,
        verbatim: Vec::new(),
        notes,
    };
    Ok(Box::new(PtxSource { info, columns, intensity, has_scans, attributes }))
}

fn survey_file(path: &Path, columns: usize, task: &dyn Task) -> Result<Survey, ScanError> {
    let mut scans = Scans::new(path, lines_of(path)?, task);
    let mut found = Survey::empty();
    in_order(
        task,
        || scans.next(),
        |piece| Survey::of_piece(path, &piece, columns),
        |part| {
            found.merge(part);
            Ok(())
        },
    )?;
    Ok(found)
}

/// Parses a line of a piece.
fn read_line(
    path: &Path,
    (n, line): (u64, &[u8]),
    piece: &Piece,
    columns: usize,
) -> Result<Line, ScanError> {
    let mut row = [0.0; COLUMNS[1]];
    let mut count = 0;
    for field in fields(line) {
        match (number(field), row.get_mut(count)) {
            (Some(value), Some(at)) => *at = value,
            _ => count = columns,
        }
        count += 1;
    }
    let [x, y, z, rest @ ..] = row;
    let is_byte = |v: &f64| v.fract() == 0.0 && (0.0..=255.0).contains(v);
    if count != columns || columns == COLUMNS[1] && !rest[1..].iter().all(is_byte) {
        let colours = if columns == COLUMNS[1] { ", the last three of 0 to 255" } else { "" };
        let what = format!("line {n} is not {columns} numbers{colours} (`{}`)", excerpt(line));
        return Err(ScanError::damaged(path, what));
    }
    if [x, y, z] == [0.0; 3] {
        return Ok(Line::NoReturn);
    }
    let world = piece.scan.placed([x, y, z]);
    Ok(if world.iter().all(|c| c.is_finite()) {
        Line::Point { world, rest }
    } else {
        Line::NotFinite
    })
}

impl Survey {
    fn empty() -> Self {
        Self {
            points: 0,
            others: 0,
            scans: BTreeMap::new(),
            spread: Spread::default(),
            decimals: [0; 3],
            is_only_moved: true,
            digits: 0,
        }
    }

    fn of_piece(path: &Path, piece: &Piece, columns: usize) -> Result<Self, ScanError> {
        let mut found = Self::empty();
        found.scans.insert(piece.scan.number, piece.scan.placed([0.0; 3]));
        found.is_only_moved = piece.scan.is_only_moved();
        found.decimals = piece.scan.decimals;
        for (n, line) in piece.block.lines() {
            let Line::Point { world, rest } = read_line(path, (n, line), piece, columns)? else {
                found.others += 1;
                continue;
            };
            found.points += 1;
            found.spread.add(world);
            let mut words = fields(line);
            for (digits, word) in found.decimals.iter_mut().zip(&mut words) {
                *digits = (*digits).max(decimals(word));
            }
            // A value outside the range of normal singles does not fit a single, whatever its
            // digits.
            let is_single = rest[0] == 0.0 || (rest[0] as f32).is_normal();
            let digits = words.next().filter(|_| is_single).map_or(usize::MAX, significant);
            found.digits = found.digits.max(digits);
        }
        Ok(found)
    }

    fn merge(&mut self, later: Self) {
        self.points += later.points;
        self.others += later.others;
        self.scans.extend(later.scans);
        self.spread.merge(later.spread);
        for (decimals, later) in self.decimals.iter_mut().zip(later.decimals) {
            *decimals = (*decimals).max(later);
        }
        self.is_only_moved &= later.is_only_moved;
        self.digits = self.digits.max(later.digits);
    }

    /// The decimal grid of the text if scans are only translated; else the grid for floats. With
    /// the bounds of nearly all points.
    fn grid(&self) -> (GridKind, Grid, Option<Corners>) {
        let grid = decimal_grid(self.decimals);
        let bounds = self.spread.within_steps(grid.scale);
        let [lo, hi] = bounds.unwrap_or_default();
        let fits = |i: usize| {
            self.decimals[i] <= DECIMALS_MAX
                && (hi[i] - lo[i]) / grid.scale[i] <= f64::from(u32::MAX) - 2.0
        };
        if self.is_only_moved && (0..3).all(fits) {
            (GridKind::Decimal, grid, bounds)
        } else {
            let (grid, bounds) = float_grid(&self.spread, false);
            (GridKind::Float, grid, bounds)
        }
    }
}

/// Digits of a number from its first that is not 0.
fn significant(word: &[u8]) -> usize {
    let mantissa = word.split(|b| matches!(b, b'e' | b'E')).next().unwrap_or(word);
    mantissa.iter().filter(|b| b.is_ascii_digit()).skip_while(|&&b| b == b'0').count()
}

impl PtxSource {
    fn decode(&self, piece: &Piece, placement: &Placement) -> Result<Decoded, ScanError> {
        let path = &self.info.path;
        let schema: Arc<Schema> = self.info.schema.clone();
        // A point takes at least eight bytes of text.
        let room = piece.block.rows.min(piece.block.bytes.len() as u64 / 8 + 1);
        let batch = Batch::with_capacity(schema, room as usize);
        let mut decoded =
            Decoded { batch, no_return: 0, not_finite: 0, rounding: Rounding::default() };
        for (n, line) in piece.block.lines() {
            let (world, rest) = match read_line(path, (n, line), piece, self.columns)? {
                Line::Point { world, rest } => (world, rest),
                Line::NoReturn => {
                    decoded.no_return += 1;
                    continue;
                }
                Line::NotFinite => {
                    decoded.not_finite += 1;
                    continue;
                }
            };
            let placed = placement.real(world, &mut decoded.rounding);
            decoded.batch.positions.push(placed);
            let columns = &mut decoded.batch.columns;
            let (intensity, colours) = (rest[0], &rest[1..self.columns - 3]);
            let column = &mut columns[self.attributes[0]];
            match self.intensity {
                AttrType::F32 => column.extend((intensity as f32).to_le_bytes()),
                _ => column.extend(intensity.to_le_bytes()),
            }
            for (&value, &column) in colours.iter().zip(&self.attributes[1..]) {
                columns[column].push(value as u8);
            }
            if let (true, Some(&column)) = (self.has_scans, self.attributes.last()) {
                columns[column].extend((piece.scan.number as u16).to_le_bytes());
            }
        }
        Ok(decoded)
    }
}

impl Source for PtxSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let mut scans = Scans::new(&self.info.path, lines_of(&self.info.path)?, task);
        in_order(
            task,
            || scans.next(),
            |piece| self.decode(&piece, placement),
            |decoded: Decoded| {
                let refused = [(NO_RETURN, decoded.no_return), (NOT_FINITE, decoded.not_finite)];
                report.take(decoded.batch, &refused, decoded.rounding, 0, sink)
            },
        )?;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        Ok(survey_file(&self.info.path, self.columns, task)?.spread)
    }
}
