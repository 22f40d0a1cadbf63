//! Reads points as text: XYZ, TXT, CSV, PTS. Lines have numbers separated by blanks, tabs, commas
//! or semicolons, optionally after a line of names; `#`, `//` and `%` begin comments. PTS has lines
//! with only a count before the points that they count; its scans may have different columns.
//! Lines end with LF or CR LF, or all with CR; text is UTF-8, UTF-16, or one byte a character.
//!
//! The first lines decide the layout ([`layout`]). A first pass finds bounds, digits and types
//! ([`survey`]), a second one decodes the points; neither keeps more than a few blocks.
//!
//! Lines with another number of values than most, or with words for coordinates, are refused and
//! counted, as long as they are fewer than 1,000 and at most one in a hundred (one is always
//! allowed: a truncated last line). Otherwise the file is refused.

mod axes;
pub(crate) mod blocks;
mod cells;
mod columns;
mod encoding;
mod guess;
mod header;
pub(crate) mod layout;
mod line;
pub(crate) mod naming;
pub(crate) mod number;
mod plan;
mod ranges;
mod sample;
mod scans;
pub(crate) mod start;
mod survey;

pub use columns::{Column, Columns};

use crate::error::ScanError;
use crate::fields::recipe::Recipe;
use crate::fields::values::Values;
use crate::fields::{LEGACY, LEGACY_BLOCK};
use crate::las::geodetic::in_degrees;
use crate::las::times_block;
use crate::source::{
    Format, Guess, HEAD_BYTES, OpenOptions, ReadReport, Sink, Source, SourceInfo, share_note,
};
use blocks::in_order;
use cells::Row;
use esker_points::lattice::{GridKind, Placement, decimal_grid};
use esker_points::{AttrType, Batch, ColourDepth, InputGrid, Rounding, Spread, Task};
use layout::{Kind, Layout, classify, layout_of};
use line::is_text;
use naming::{colour_max, wide_colours};
use plan::{ColumnPlan, fill_of};
use sample::{Choice, Sample};
use scans::{Piece, Pieces};
use start::{first_lines, lines_of};
use std::path::Path;
use std::sync::Arc;
use survey::{Fault, Survey, WIDTHS_MAX, read_point};

/// XYZ, TXT, CSV and PTS, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "text (XYZ, TXT, CSV, PTS)",
    endings: &["xyz", "txt", "csv", "pts", "asc", "xyzi", "xyzrgb", "xyzn", "neu", "tsv", "dat"],
    is_streamed: true,
    can_sample: true,
    recognises,
    open,
};

/// A file with this many malformed lines is refused ...
const MALFORMED_MAX: u64 = 1000;
/// ... and so is one with more than one malformed line in this many.
const LINES_PER_MALFORMED: u64 = 100;

/// Greatest number of attributes of scans with different columns: short lines take the memory of
/// all attributes.
const MIXED_ATTRIBUTES_MAX: usize = 32;

struct TextSource {
    info: SourceInfo,
    layout: Layout,
    plan: ColumnPlan,
    guess: Option<Guess>,
    one_in: u32,
}

fn recognises(head: &[u8]) -> bool {
    let lines = first_lines(head);
    // Points may follow any number of comments.
    let begins_with_comments = || {
        let choice = Choice::default();
        let mut sample = Sample::new(&choice);
        (1..).zip(lines.split(|&b| b == b'\n')).for_each(|(n, line)| sample.take(n, line));
        sample.is_comments() && head.len() as u64 == HEAD_BYTES && is_text(&lines)
    };
    classify(&lines, &Choice::default()).is_some() || begins_with_comments()
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let layout = read_layout(path, options)?;
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let one_in = options.one_in.max(1);
    let survey = survey_file(path, &layout, one_in, task)?;
    check_malformed(path, &layout, &survey, true)?;
    if let (Some((line, text)), None) = (&survey.renamed, &options.columns) {
        let what = format!(
            "line {line} names other columns (`{text}`) than those before it: split the file \
             there, or say with --columns how all lines are read"
        );
        return Err(ScanError::unsupported(path, what));
    }
    let plan = ColumnPlan::new(&layout, &survey);
    if plan.sources.len() > 1 && plan.fills.len() > MIXED_ATTRIBUTES_MAX {
        return Err(ScanError::unsupported(
            path,
            format!("its scans of different columns have more than {MIXED_ATTRIBUTES_MAX} columns"),
        ));
    }
    let (name, named) = match (layout.has_counts, layout.names.is_some()) {
        (true, _) => ("PTS", ""),
        (false, true) => ("text", ", named"),
        (false, false) => ("text", ""),
    };
    let guess = layout.guess.as_ref().map(|why| Guess {
        what: format!("{why}; they are taken for {}", plan.columns.join(", ")),
        rows: layout.shown.clone(),
        remedy: "name them with --columns, such as \"x=1,y=2,z=3\", if that is wrong".into(),
    });
    let mut notes: Vec<String> = guess.iter().map(|guess| guess.what.clone()).collect();
    notes.extend(layout.notes.iter().chain(&plan.notes).cloned());
    let lines = survey.lines();
    if one_in > 1 {
        notes.push(share_note(one_in));
    } else if layout.has_counts && survey.claimed != lines {
        notes.push(format!("its counts say {} points, {lines} are there", survey.claimed));
    }
    if survey.points == 0 {
        notes.push("has no points".into());
    }
    if one_in == 1 {
        // Lines of a share have other numbers.
        notes.extend(survey.notes());
    }
    if survey.decimals.iter().any(|&d| d > 15) {
        notes.push("coordinates have more than 15 digits after the point; 15 are kept".into());
    }
    let mut info = SourceInfo {
        path: path.to_owned(),
        format: format!("{name}, {} columns{named}", layout.columns),
        grid: InputGrid {
            name: path.display().to_string(),
            kind: GridKind::Decimal,
            grid: decimal_grid(survey.decimals),
            bounds: survey.spread.within_steps(decimal_grid(survey.decimals).scale),
        },
        schema: plan.schema.clone(),
        points_hint: survey.points,
        bytes,
        colour_depth: None,
        crs: if layout.is_geographic { in_degrees(survey.spread.bounds()) } else { None },
        scanner: None,
        verbatim: Vec::new(),
        notes,
    };
    if let (Some(names), false) = (&layout.names, layout.has_counts) {
        info.verbatim.push(("text column names".into(), names.join(",").into_bytes()));
    }
    if plan.is_legacy {
        info.verbatim.push((LEGACY_BLOCK.into(), LEGACY.to_vec()));
    }
    let (times, note) = times_block(None, plan.are_times_beyond_week);
    info.verbatim.extend(times);
    info.notes.extend(note);
    if wide_colours(&info.schema).is_some() {
        // Colours are 16 bits wide only if a value needs more than 8.
        info.colour_depth = options.colour_depth.or(Some(ColourDepth::Sixteen));
    }
    Ok(Box::new(TextSource { info, layout, plan, guess, one_in }))
}

/// Reads as many lines as the layout needs.
fn read_layout(path: &Path, options: &OpenOptions) -> Result<Layout, ScanError> {
    let choice = Choice { columns: options.columns.clone(), skip_lines: options.skip_lines };
    let mut lines = lines_of(path)?;
    let mut sample = Sample::new(&choice);
    while !sample.is_full() {
        let block = match lines.next() {
            Ok(Some(block)) => block,
            Ok(None) => break,
            // What came before a line that is too long may decide; the survey reports the line.
            Err(error) if sample.is_comments() => return Err(error),
            Err(_) => break,
        };
        let head = &block.bytes[..block.bytes.len().min(HEAD_BYTES as usize)];
        if block.first_line == 1 && !is_text(head) {
            return Err(ScanError::damaged(path, "has control characters; it is no text"));
        }
        for (n, line) in block.lines_with_tabs() {
            sample.take(n, line);
            if sample.is_full() {
                break;
            }
        }
    }
    match layout_of(&sample) {
        Some(Kind::Columns(layout)) => Ok(*layout),
        Some(Kind::NoPoints(why)) => Err(ScanError::damaged(path, why)),
        None => Err(ScanError::damaged(path, no_table(&sample))),
    }
}

fn no_table(sample: &Sample<'_>) -> String {
    match &sample.passed {
        Some((line, text, _)) => format!(
            "line {line} (`{text}`) is neither a point nor a line of names; if points follow, pass \
             over the lines before them with --skip-lines N"
        ),
        None => "its lines are not three or more numbers each".into(),
    }
}

fn survey_file(
    path: &Path,
    layout: &Layout,
    one_in: u32,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    let mut pieces = Pieces::of(path, layout, one_in)?;
    let mut found = Survey::empty(layout);
    let work = |piece: Piece| Ok(Survey::of_piece(&piece, layout));
    in_order(
        task,
        || pieces.next(),
        work,
        |part| {
            if !found.merge(part, layout) {
                return Err(ScanError::unsupported(
                    path,
                    format!("its scans have more than {WIDTHS_MAX} different numbers of columns"),
                ));
            }
            check_malformed(path, layout, &found, false)
        },
    )?;
    Ok(found)
}

/// Refuses a file with too many malformed lines (see the module's head).
fn check_malformed(
    path: &Path,
    layout: &Layout,
    found: &Survey,
    ended: bool,
) -> Result<(), ScanError> {
    let (malformed, Some((line, excerpt))) = found.malformed() else { return Ok(()) };
    let good = found.lines() - malformed;
    let few = malformed < MALFORMED_MAX
        && (!ended || good > 0 && malformed <= (good / LINES_PER_MALFORMED).max(1));
    if few {
        return Ok(());
    }
    let more = match malformed {
        1 => String::new(),
        n => format!(", and so are {} more", n - 1),
    };
    let n = layout.columns;
    Err(ScanError::damaged(path, format!("line {line} is not {n} numbers (`{excerpt}`){more}")))
}

/// The points decoded from a piece, and the number of refused lines.
struct Decoded {
    batch: Batch,
    refused: [u64; Fault::ALL.len()],
    rounding: Rounding,
}

impl TextSource {
    fn decode(&self, piece: &Piece, placement: &Placement) -> Result<Decoded, ScanError> {
        let path = &self.info.path;
        // The number of lines alone is no bound: short lines in a file of many columns are no
        // points.
        let block = &piece.block;
        let least = piece.runs.iter().map(|run| run.columns).min().unwrap_or(0);
        let least = if self.layout.has_counts { least } else { self.layout.least };
        let points_max = block.bytes.len() / (2 * least.max(3)) + 1;
        let capacity = points_max.min(block.rows as usize);
        let batch = Batch::with_capacity(self.info.schema.clone(), capacity);
        let mut decoded =
            Decoded { batch, refused: [0; Fault::ALL.len()], rounding: Rounding::default() };
        let mut row = Row::default();
        let mut sources: Option<&(usize, Vec<Option<usize>>)> = None;
        for (n, line, columns) in piece.lines() {
            if self.layout.is_beside(n, line) {
                continue;
            }
            let world = match read_point(line, columns, &self.layout, &mut row) {
                Ok(world) => world,
                Err(fault) => {
                    decoded.refused[fault as usize] += 1;
                    continue;
                }
            };
            let changed = || ScanError::damaged(path, "it changed while it was read");
            if sources.is_none_or(|sources| sources.0 != columns) {
                sources = self.plan.sources.iter().find(|sources| sources.0 == columns);
            }
            let (_, sources) = sources.ok_or_else(changed)?;
            decoded.batch.positions.push(placement.real(world, &mut decoded.rounding));
            let plans = self.plan.recipes.iter().zip(&self.plan.fills);
            let attributes = self.info.schema.attributes.iter().zip(plans);
            for ((attribute, (recipe, fill)), column) in attributes.zip(&mut decoded.batch.columns)
            {
                let number = |found: usize| {
                    let value = sources[found].map_or(f64::NAN, |source| row.values[source]);
                    if value.is_nan() { *fill } else { value }
                };
                let wide = match (recipe, attribute.ty) {
                    (Recipe::Number(found), AttrType::U64 | AttrType::I64) => {
                        sources[*found].filter(|&source| Values::is_large(row.values[source]))
                    }
                    _ => None,
                };
                let is_held = match wide {
                    Some(source) => {
                        let cell = self.layout.style.cells(line).nth(source).unwrap_or_default();
                        put_digits(number::unquoted(cell), attribute.ty, column)
                    }
                    None => recipe.put(attribute.ty, number, column),
                };
                if !is_held {
                    return Err(changed());
                }
            }
        }
        Ok(decoded)
    }
}

/// Appends a whole number of which a double would round digits away; `false` if the type does not
/// hold it.
fn put_digits(digits: &[u8], ty: AttrType, out: &mut Vec<u8>) -> bool {
    let digits = std::str::from_utf8(digits).unwrap_or_default();
    match ty {
        AttrType::U64 => digits.parse::<u64>().map(|v| out.extend(v.to_le_bytes())).is_ok(),
        _ => digits.parse::<i64>().map(|v| out.extend(v.to_le_bytes())).is_ok(),
    }
}

impl Source for TextSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn typed_by_values(&self) -> Vec<usize> {
        let recipes = self.plan.recipes.iter().enumerate();
        let of_one_column = recipes.filter(|(_, recipe)| matches!(recipe, Recipe::Number(_)));
        of_one_column.map(|(attribute, _)| attribute).collect()
    }

    fn widen(&mut self, attribute: usize, ty: AttrType) {
        let attribute_of_schema = &mut Arc::make_mut(&mut self.info.schema).attributes[attribute];
        attribute_of_schema.ty = ty;
        self.plan.fills[attribute] = fill_of(&attribute_of_schema.name, ty);
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let mut pieces = Pieces::of(&self.info.path, &self.layout, self.one_in)?;
        let work = |piece: Piece| self.decode(&piece, placement);
        in_order(
            task,
            || pieces.next(),
            work,
            |decoded: Decoded| {
                let counts = Fault::ALL.iter().zip(decoded.refused);
                let refused: Vec<_> = counts.map(|(fault, n)| (fault.reason(), n)).collect();
                let colour_max = match self.plan.are_colours_full && !decoded.batch.is_empty() {
                    true => u16::MAX,
                    false => colour_max(&decoded.batch),
                };
                report.take(decoded.batch, &refused, decoded.rounding, colour_max, sink)
            },
        )?;
        Ok(report)
    }

    fn is_text(&self) -> bool {
        true
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        Ok(survey_file(&self.info.path, &self.layout, self.one_in, task)?.spread)
    }

    fn guess(&self) -> Option<&Guess> {
        self.guess.as_ref()
    }
}
