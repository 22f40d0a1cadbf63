//! Reads points as text: XYZ, TXT, CSV, PTS. Lines have numbers separated by blanks, tabs, commas
//! or semicolons, optionally after a line of names; `#`, `//` and `%` begin comments. PTS has lines
//! with only a count before the points that they count. Lines end with LF or CR LF, or all with CR.
//! A first pass finds bounds, digits and types ([`survey`]), a second one decodes the points;
//! neither keeps more than a few blocks.
//!
//! Lines with another number of values than the first one are refused and counted, as long as they
//! are fewer than 1,000 and at most one in a hundred (one is always allowed: a truncated last
//! line). Otherwise the file is refused.

pub(crate) mod blocks;
pub(crate) mod layout;
pub(crate) mod naming;
pub(crate) mod number;
pub(crate) mod start;
mod survey;

use crate::error::ScanError;
use crate::fields::recipe::Recipe;
use crate::fields::{LEGACY, LEGACY_BLOCK};
use crate::packed::head_of;
use crate::source::{Format, OpenOptions, ReadReport, Sink, Source, SourceInfo};
use blocks::{LineBlock, in_order};
use esker_points::lattice::{GridKind, Placement, decimal_grid};
use esker_points::{AttrType, Batch, ColourDepth, InputGrid, Task};
use layout::{Kind, Layout, classify};
use naming::{NOT_FINITE, colour_max, wide_colours};
use start::{first_lines, lines_of};
use std::path::Path;
use survey::{ColumnPlan, Survey, axes_of, parse_row};

/// XYZ, TXT, CSV and PTS, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "text (XYZ, TXT, CSV, PTS)",
    endings: &["xyz", "txt", "csv", "pts", "asc", "xyzi", "xyzrgb", "xyzn", "neu", "tsv", "dat"],
    is_streamed: true,
    recognises: |head| classify(&first_lines(head)).is_some(),
    open,
};

/// A file with this many malformed lines is refused ...
const MALFORMED_MAX: u64 = 1000;
/// ... and so is one with more than one malformed line in this many.
const LINES_PER_MALFORMED: u64 = 100;

struct TextSource {
    info: SourceInfo,
    layout: Layout,
    plan: ColumnPlan,
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let layout = read_layout(path)?;
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let survey = survey_file(path, &layout, task)?;
    check_malformed(path, &layout, &survey, true)?;
    let plan = ColumnPlan::new(&layout, &survey);
    let (name, named) = match (layout.has_counts, layout.names.is_some()) {
        (true, _) => ("PTS", ""),
        (false, true) => ("text", ", named"),
        (false, false) => ("text", ""),
    };
    let mut notes = plan.notes.clone();
    let lines = survey.points + survey.not_finite + survey.malformed;
    if layout.has_counts && survey.claimed != lines {
        notes.push(format!("its counts say {} points, {lines} are there", survey.claimed));
    }
    if survey.points == 0 {
        notes.push("has no points".into());
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
            bounds: survey.bounds(plan.axes),
        },
        schema: plan.schema.clone(),
        points_hint: survey.points,
        bytes,
        colour_depth: None,
        crs: None,
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
    if wide_colours(&info.schema).is_some() {
        // Colours are 16 bits wide only if a value needs more than 8.
        info.colour_depth = options.colour_depth.or(Some(ColourDepth::Sixteen));
    }
    Ok(Box::new(TextSource { info, layout, plan }))
}

fn read_layout(path: &Path) -> Result<Layout, ScanError> {
    let (head, _) = head_of(path)?;
    match classify(&first_lines(&head)) {
        Some(Kind::Columns(layout)) => Ok(layout),
        Some(Kind::DecimalCommas(line)) => Err(decimal_commas(path, line)),
        Some(Kind::NoPoints(why)) => Err(ScanError::damaged(path, why)),
        None => Err(ScanError::damaged(path, "its lines are not three or more numbers each")),
    }
}

fn decimal_commas(path: &Path, line: u64) -> ScanError {
    ScanError::unsupported(
        path,
        format!("line {line} writes decimals with a comma; write them with a point"),
    )
}

fn survey_file(path: &Path, layout: &Layout, task: &dyn Task) -> Result<Survey, ScanError> {
    let axes = axes_of(layout);
    let mut lines = lines_of(path)?;
    let mut found = Survey::empty(layout);
    let work = |block: LineBlock| Ok(Survey::of_block(&block, layout, axes));
    in_order(
        task,
        || lines.next(),
        work,
        |part| {
            found.merge(part);
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
    let Some((line, excerpt)) = &found.first_malformed else { return Ok(()) };
    let good = found.points + found.not_finite;
    let few = found.malformed < MALFORMED_MAX
        && (!ended || good > 0 && found.malformed <= (good / LINES_PER_MALFORMED).max(1));
    if few {
        return Ok(());
    }
    if number::has_decimal_commas(excerpt.as_bytes()) {
        return Err(decimal_commas(path, *line));
    }
    let more = match found.malformed {
        1 => String::new(),
        n => format!(", and so are {} more", n - 1),
    };
    let n = layout.columns;
    Err(ScanError::damaged(path, format!("line {line} is not {n} numbers (`{excerpt}`){more}")))
}

/// The points decoded from a block, and the number of refused lines.
struct Decoded {
    batch: Batch,
    not_finite: u64,
    malformed: u64,
    rounding_error_max: f64,
}

impl TextSource {
    fn decode(&self, block: &LineBlock, placement: &Placement) -> Result<Decoded, ScanError> {
        let path = &self.info.path;
        // The number of lines alone is no bound: short lines in a file of many columns are no
        // points.
        let points_max = block.bytes.len() / (2 * self.layout.columns) + 1;
        let capacity = points_max.min(block.rows as usize);
        let batch = Batch::with_capacity(self.info.schema.clone(), capacity);
        let mut decoded = Decoded { batch, not_finite: 0, malformed: 0, rounding_error_max: 0.0 };
        let mut row = Vec::with_capacity(self.layout.columns);
        for (n, line) in block.lines() {
            if self.layout.is_beside(n, line) {
                continue;
            }
            if !parse_row(line, self.layout.columns, &mut row) {
                decoded.malformed += 1;
                continue;
            }
            let world = self.plan.axes.map(|a| row[a]);
            if !world.iter().all(|c| c.is_finite()) {
                decoded.not_finite += 1;
                continue;
            }
            let placed = placement.real(world, &mut decoded.rounding_error_max);
            let off = |e: esker_points::lattice::OffLattice| ScanError::OffLattice {
                path: path.clone(),
                world: e.world,
            };
            decoded.batch.positions.push(placed.map_err(off)?);
            let attributes = self.info.schema.attributes.iter().zip(&self.plan.recipes);
            for ((attribute, recipe), column) in attributes.zip(&mut decoded.batch.columns) {
                let is_held = match (recipe, attribute.ty) {
                    (&Recipe::Number(source), ty @ (AttrType::U64 | AttrType::I64)) => {
                        put_digits(line, source, ty, column)
                    }
                    (recipe, ty) => recipe.put(ty, |source| row[source], column),
                };
                if !is_held {
                    return Err(ScanError::damaged(path, "it changed while it was read"));
                }
            }
        }
        Ok(decoded)
    }
}

/// Appends the whole number in a field of a line, all of whose digits count; `false` if the type
/// does not hold it.
fn put_digits(line: &[u8], source: usize, ty: AttrType, out: &mut Vec<u8>) -> bool {
    let field = number::fields(line).nth(source).map(number::unquoted).unwrap_or_default();
    let digits = std::str::from_utf8(field).ok().and_then(|text| text.parse::<i128>().ok());
    // Small numbers may be written with a point or an exponent.
    let whole = digits.or_else(|| number::number(field).map(|v| v as i128));
    match (whole, ty) {
        (Some(v), AttrType::U64) => u64::try_from(v).map(|v| out.extend(v.to_le_bytes())).is_ok(),
        (Some(v), _) => i64::try_from(v).map(|v| out.extend(v.to_le_bytes())).is_ok(),
        (None, _) => false,
    }
}

impl Source for TextSource {
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
        let mut lines = lines_of(&self.info.path)?;
        let not_numbers = format!("line is not {} numbers", self.layout.columns);
        let work = |block: LineBlock| self.decode(&block, placement);
        in_order(
            task,
            || lines.next(),
            work,
            |decoded: Decoded| {
                let refused =
                    [(NOT_FINITE, decoded.not_finite), (not_numbers.as_str(), decoded.malformed)];
                let colour_max = match self.plan.are_colours_full && !decoded.batch.is_empty() {
                    true => u16::MAX,
                    false => colour_max(&decoded.batch),
                };
                report.take(decoded.batch, &refused, decoded.rounding_error_max, colour_max, sink)
            },
        )?;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Option<[[f64; 3]; 2]>, ScanError> {
        Ok(survey_file(&self.info.path, &self.layout, task)?.bounds(self.plan.axes))
    }
}
