//! Reads PTX (Leica Cyclone): scans as text, each with the pose of its scanner. Points are returned
//! in the file's coordinates. Directions without a return (`0 0 0`) are counted but are no points.
//! A first pass finds bounds, digits and types, a second one decodes the points; neither keeps more
//! than a few blocks. Lines may have colours or not; other lines are refused and counted, and so
//! are those of a scan whose head is malformed.
//!
//! If there are several scans, the `point_source_id` of a point is the number of its scan, from 1.

mod pose;
mod scans;

use crate::error::ScanError;
use crate::source::{
    Format, OpenOptions, ReadReport, SCAN_NUMBERS, Scanner, Sink, Source, SourceInfo,
};
use crate::text::blocks::in_order;
use crate::text::layout::{count, excerpt};
use crate::text::naming::{NO_RETURN, NOT_FINITE, schema_of};
use crate::text::number::{decimals, fields, number};
use crate::text::start::{first_lines, lines_of};
use esker_points::attribute::names;
use esker_points::lattice::{Grid, GridKind, Placement, decimal_grid, float_grid};
use esker_points::spread::Corners;
use esker_points::{AttrType, Batch, Column, InputGrid, Rounding, Schema, Spread, Task};
use scans::{Faults, Piece, Scans};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// PTX, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "PTX",
    endings: &["ptx"],
    is_streamed: true,
    can_sample: false,
    recognises,
    open,
};

/// Number of significant digits up to which an `f32` holds every decimal.
const F32_DIGITS: usize = 6;
/// Greatest number of digits after the point for which decimal text gets a decimal grid.
const DECIMALS_MAX: u32 = 15;
/// Numbers in a line: position and intensity, and in some scans colours.
const COLUMNS: [usize; 2] = [4, 7];
/// Reasons for which lines are refused.
const MALFORMED: &str = "line is not four numbers, or seven with colours of 0 to 255";
const LOST: &str = "line behind a malformed head of a scan";
const CUT: &str = "line that the end of the file cuts";

struct PtxSource {
    info: SourceInfo,
    /// Type of the intensity.
    intensity: AttrType,
    has_colours: bool,
    has_scans: bool,
    /// The columns of the schema: intensity, red, green, blue, and the scan.
    attributes: Vec<usize>,
}

/// What the first pass finds.
#[derive(Clone, Debug)]
struct Survey {
    points: u64,
    /// Number of points without colours.
    colourless: u64,
    /// Lines without a point.
    others: u64,
    malformed: u64,
    /// Number and beginning of the first malformed line.
    first_malformed: Option<(u64, String)>,
    scans: BTreeMap<u64, [f64; 3]>,
    spread: Spread,
    decimals: [u32; 3],
    is_only_moved: bool,
    /// Greatest number of significant digits of an intensity.
    digits: usize,
}

/// A line of a piece.
enum Line {
    Point {
        world: [f64; 3],
        intensity: f64,
        colours: Option<[u8; 3]>,
    },
    NoReturn,
    NotFinite,
    Malformed,
    /// Its scan has no head.
    Lost,
}

/// The points decoded from a piece, and the number of refused ones.
struct Decoded {
    batch: Batch,
    refused: [(&'static str, u64); 5],
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

fn open(path: &Path, _: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let (survey, faults) = survey_file(path, task)?;
    check_lines(path, &survey, &faults)?;
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let intensity = if survey.digits <= F32_DIGITS { AttrType::F32 } else { AttrType::F64 };
    let mut attributes = vec![(names::INTENSITY.to_owned(), intensity)];
    let has_colours = survey.colourless < survey.points;
    if has_colours {
        let colours = [names::RED, names::GREEN, names::BLUE];
        attributes.extend(colours.map(|name| (name.to_owned(), AttrType::U8)));
    }
    let has_scans = survey.scans.len() > 1;
    if has_scans {
        attributes.push((names::POINT_SOURCE_ID.to_owned(), AttrType::U16));
    }
    let (schema, attributes) = schema_of(attributes);
    let (kind, grid, bounds) = survey.grid();
    let mut notes = faults.into_notes();
    if has_colours && survey.colourless > 0 {
        let (lacking, points) = (survey.colourless, survey.points);
        notes.push(format!("{lacking} of {points} points have no colours: they are black"));
    }
    if let Some((n, line)) = &survey.first_malformed {
        notes.push(format!("line {n} is the first that is not a point (`{line}`)"));
    }
    if has_scans {
        notes.push(SCAN_NUMBERS.into());
    }
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
        points_hint: survey.points + survey.others + survey.malformed,
        bytes,
        colour_depth: None,
        crs: None,
        scanner,
        verbatim: Vec::new(),
        notes,
    };
    Ok(Box::new(PtxSource { info, intensity, has_colours, has_scans, attributes }))
}

/// Refuses a file that is not read for the most part.
fn check_lines(path: &Path, survey: &Survey, faults: &Faults) -> Result<(), ScanError> {
    if survey.points == 0
        && let Some(fault) = faults.first()
    {
        return Err(ScanError::damaged(path, fault));
    }
    match &survey.first_malformed {
        Some((n, line)) if survey.malformed > survey.points + survey.others => {
            let what = format!("line {n} is not four or seven numbers (`{line}`)");
            Err(ScanError::damaged(path, what))
        }
        _ => Ok(()),
    }
}

fn survey_file(path: &Path, task: &dyn Task) -> Result<(Survey, Faults), ScanError> {
    let mut scans = Scans::new(path, lines_of(path)?, task);
    let mut found = Survey::empty();
    in_order(
        task,
        || scans.next(),
        |piece| Ok(Survey::of_piece(&piece)),
        |part| {
            found.merge(part);
            Ok(())
        },
    )?;
    Ok((found, scans.into_faults()))
}

/// Parses a line of a piece.
fn read_line(line: &[u8], piece: &Piece) -> Line {
    if piece.scan.is_lost {
        return Line::Lost;
    }
    let mut row = [0.0; COLUMNS[1]];
    let mut count = 0;
    for field in fields(line) {
        match (number(field), row.get_mut(count)) {
            (Some(value), Some(at)) => *at = value,
            _ => return Line::Malformed,
        }
        count += 1;
    }
    let [x, y, z, intensity, red, green, blue] = row;
    let is_byte = |v: f64| v.fract() == 0.0 && (0.0..=255.0).contains(&v);
    let colours = [red, green, blue];
    let colours = match count {
        4 => None,
        7 if colours.into_iter().all(is_byte) => Some(colours.map(|c| c as u8)),
        _ => return Line::Malformed,
    };
    if [x, y, z] == [0.0; 3] {
        return Line::NoReturn;
    }
    let world = piece.scan.placed([x, y, z]);
    if world.iter().all(|c| c.is_finite()) {
        Line::Point { world, intensity, colours }
    } else {
        Line::NotFinite
    }
}

impl Survey {
    fn empty() -> Self {
        Self {
            points: 0,
            colourless: 0,
            others: 0,
            malformed: 0,
            first_malformed: None,
            scans: BTreeMap::new(),
            spread: Spread::default(),
            decimals: [0; 3],
            is_only_moved: true,
            digits: 0,
        }
    }

    fn of_piece(piece: &Piece) -> Self {
        let mut found = Self::empty();
        if !piece.scan.is_lost {
            found.scans.insert(piece.scan.number, piece.scan.placed([0.0; 3]));
            found.is_only_moved = piece.scan.is_only_moved();
            found.decimals = piece.scan.decimals;
        }
        for (n, line) in piece.block.lines() {
            let (world, intensity) = match read_line(line, piece) {
                Line::Point { world, intensity, colours } => {
                    found.colourless += u64::from(colours.is_none());
                    (world, intensity)
                }
                Line::Malformed => {
                    found.malformed += 1;
                    found.first_malformed.get_or_insert_with(|| (n, excerpt(line)));
                    continue;
                }
                _ => {
                    found.others += 1;
                    continue;
                }
            };
            found.points += 1;
            found.spread.add(world);
            let mut words = fields(line);
            for (digits, word) in found.decimals.iter_mut().zip(&mut words) {
                *digits = (*digits).max(decimals(word));
            }
            // A value outside the range of normal singles does not fit a single, whatever its
            // digits.
            let is_single = intensity == 0.0 || (intensity as f32).is_normal();
            let digits = words.next().filter(|_| is_single).map_or(usize::MAX, significant);
            found.digits = found.digits.max(digits);
        }
        found
    }

    fn merge(&mut self, later: Self) {
        self.points += later.points;
        self.colourless += later.colourless;
        self.others += later.others;
        self.malformed += later.malformed;
        self.first_malformed = self.first_malformed.take().or(later.first_malformed);
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
        let schema: Arc<Schema> = self.info.schema.clone();
        // A point takes at least eight bytes of text.
        let room = piece.block.rows.min(piece.block.bytes.len() as u64 / 8 + 1);
        let batch = Batch::with_capacity(schema, room as usize);
        let refused = [NO_RETURN, NOT_FINITE, MALFORMED, LOST, CUT].map(|reason| (reason, 0));
        let mut decoded = Decoded { batch, refused, rounding: Rounding::default() };
        decoded.refused[4].1 = u64::from(piece.is_cut);
        for (_, line) in piece.block.lines() {
            let reason = match read_line(line, piece) {
                Line::Point { world, intensity, colours } => {
                    let placed = placement.real(world, &mut decoded.rounding);
                    decoded.batch.positions.push(placed);
                    self.put(intensity, colours, piece, &mut decoded.batch.columns);
                    continue;
                }
                Line::NoReturn => 0,
                Line::NotFinite => 1,
                Line::Malformed => 2,
                Line::Lost => 3,
            };
            decoded.refused[reason].1 += 1;
        }
        Ok(decoded)
    }

    /// Appends the attributes of a point.
    fn put(&self, intensity: f64, colours: Option<[u8; 3]>, piece: &Piece, columns: &mut [Column]) {
        let column = &mut columns[self.attributes[0]];
        match self.intensity {
            AttrType::F32 => column.extend((intensity as f32).to_le_bytes()),
            _ => column.extend(intensity.to_le_bytes()),
        }
        if self.has_colours {
            for (value, &column) in
                colours.unwrap_or_default().into_iter().zip(&self.attributes[1..])
            {
                columns[column].push(value);
            }
        }
        if let (true, Some(&column)) = (self.has_scans, self.attributes.last()) {
            columns[column].extend((piece.scan.number as u16).to_le_bytes());
        }
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
                report.take(decoded.batch, &decoded.refused, decoded.rounding, 0, sink)
            },
        )?;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        Ok(survey_file(&self.info.path, task)?.0.spread)
    }
}
