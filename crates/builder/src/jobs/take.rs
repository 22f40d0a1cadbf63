//! A take of a divided build: decodes its pieces of the sources once, as a build does, and writes
//! their rows, grouped by cell along the Morton curve, with what the cut sums up.

use crate::attributes::palette::colours;
use crate::budget::disk::free_bytes;
use crate::budget::memory::Peak;
use crate::budget::shares::Shares;
use crate::calls::build::page_layout;
use crate::error::BuildError;
use crate::input::attribute_types::take_types;
use crate::input::identity::time_of_change;
use crate::input::intake::{Intake, Restart};
use crate::input::known::KnownInputs;
use crate::input::plan::{DecodedInputs, Plan};
use crate::jobs::Resources;
use crate::jobs::pieces::{Piece, PieceSource};
use crate::jobs::place::Place;
use crate::jobs::planned::{NAME, Planned, PlannedSource};
use crate::jobs::splitting::Splitter;
use crate::jobs::step::{Output, Record, Step, refused};
use crate::jobs::summary::{CellRows, SourceKept, Summary, TakenPiece};
use crate::options::Options;
use crate::rows::borders::densities;
use crate::rows::partition::{Bucket, Partition};
use crate::rows::scratch::Scratch;
use esker_format::SetAside;
use esker_points::palette::Histogram;
use esker_points::{ColourDepth, Task};
use esker_scan::Source;
use rayon::prelude::*;

/// What a take did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TakeReport {
    /// Index of the take.
    pub index: u32,
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Points that were taken.
    pub points: u64,
    /// Cells that have them.
    pub cells: u64,
    /// Bytes of the object.
    pub bytes: u64,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
}

/// Does a take of the plan of a place, unless it is done.
///
/// # Errors
/// If a source is damaged or has changed since the plan was made, or does not fit it; if the place
/// or scratch is full, or on request.
pub fn take(
    place: &dyn Place,
    index: u32,
    resources: &Resources,
    task: &dyn Task,
) -> Result<TakeReport, BuildError> {
    let planned = Planned::read(place)?;
    let Some(pieces) = planned.takes.get(index as usize) else {
        let why = format!("has takes 0 to {}, and no {index}", planned.takes.len().max(1) - 1);
        return Err(refused(place, NAME, why));
    };
    let step = Step::Take(index);
    let attributes = planned.schema.attributes.len();
    if let Some(record) = Record::find(place, &planned.hash, step)? {
        let summary = Summary::read(&record, place, index, attributes)?;
        return Ok(report(index, true, &summary, record.bytes, 0));
    }
    let options = planned.options(place, resources)?;
    let work = Take { place, planned: &planned, pieces, options: &options, task };
    resources.run(task, || work.run(index, resources))
}

/// Number of takes of the plan of a place.
///
/// # Errors
/// If there is no plan.
pub fn count(place: &dyn Place) -> Result<u32, BuildError> {
    Ok(Planned::read(place)?.takes.len() as u32)
}

fn report(
    index: u32,
    was_done: bool,
    summary: &Summary,
    bytes: u64,
    scratch_bytes: u64,
) -> TakeReport {
    let cells = summary.cells.len() as u64;
    TakeReport { index, was_done, points: summary.rows(), cells, bytes, scratch_bytes }
}

/// A take in progress.
struct Take<'a> {
    place: &'a dyn Place,
    planned: &'a Planned,
    pieces: &'a [Piece],
    options: &'a Options,
    task: &'a dyn Task,
}

impl Take<'_> {
    fn run(&self, index: u32, resources: &Resources) -> Result<TakeReport, BuildError> {
        let Self { place, planned, task, .. } = *self;
        let sources = self.open()?;
        let kept: Vec<_> = sources.iter().map(|s| SourceKept::of(s.info())).collect();
        let of = |piece: &Piece| &planned.sources[piece.source as usize];
        let class_of = self.pieces.iter().map(|piece| of(piece).class).collect();
        let plan = planned.plan().for_some(&sources, class_of);
        let intake = Intake::of_known(sources, self.known(), planned.has_forced_depth());
        let mut scratch = Scratch::new(&resources.folder())?;
        let partition = self.partition(&intake, &plan, resources)?;
        let peak = Peak::default();
        let decoded = match intake.decode_on(&plan, partition, &mut scratch, task, &peak)? {
            Ok(decoded) => decoded,
            Err(restart) => return Err(self.misplanned(&restart)),
        };
        // What was decoded may be of several versions of a file.
        self.pieces.iter().try_for_each(|piece| check_time(of(piece)))?;
        let DecodedInputs { partition, reports, aside, hash, ranges, knows_scanners } = decoded;
        let buckets = partition.finish(&mut scratch)?;
        let splitter = Splitter {
            stride: plan.row_bytes(),
            rows_max: planned.cell_rows_max(),
            buffer_bytes_max: self.buffer_bytes(&intake, resources),
            task,
        };
        let buckets = splitter.split_all(buckets, &mut scratch)?;
        task.phase("writing", Some(buckets.iter().map(|b| b.rows).sum()), "points");
        let rows = plan.rows();
        let scale = plan.lattice.metric().scale;
        let densities = if plan.computed.is_any() {
            Some(densities(&buckets, rows.bytes(), scale, &mut scratch)?)
        } else {
            None
        };
        let colours = if self.options.compact {
            let pages = page_layout(&plan, self.options, knows_scanners);
            colours(&buckets, &rows, &pages, &mut scratch)?.as_ref().map(counts)
        } else {
            None
        };
        let mut output = Output::begin(place, &planned.hash, Step::Take(index))?;
        let cells = write_rows(&buckets, rows.bytes(), &mut scratch, &mut output, task)?;
        let pieces = self.pieces.iter().zip(reports).zip(kept);
        let taken = pieces.map(|((piece, report), kept)| TakenPiece {
            source: piece.source,
            report,
            kept: piece.is_first().then_some(kept),
        });
        let global = |stray| self.of_all(stray);
        let summary = Summary {
            row_bytes: rows.bytes() as u64,
            cells,
            hash,
            ranges,
            knows_scanners,
            pieces: taken.collect(),
            aside: aside.into_iter().map(global).collect(),
            densities,
            colours,
        };
        let tail = summary.seal(planned.schema.attributes.len());
        task.check()?;
        let (record, is_own) = output.publish(&tail)?;
        Ok(report(index, !is_own, &summary, record.bytes, scratch.bytes()))
    }

    /// A stray under the index of its source among those of the plan.
    fn of_all(&self, stray: SetAside) -> SetAside {
        let piece = self.pieces.get(stray.source as usize);
        SetAside { source: piece.map_or(stray.source, |p| p.source), ..stray }
    }

    /// Opens the pieces, and checks that their sources are those of the plan.
    fn open(&self) -> Result<Vec<Box<dyn Source>>, BuildError> {
        let Self { planned, options, task, .. } = *self;
        let open = |piece: &Piece| -> Result<Box<dyn Source>, BuildError> {
            task.check()?;
            let of = &planned.sources[piece.source as usize];
            check_time(of)?;
            let mut source = esker_scan::open(&of.at, &options.open_options(), task)?;
            let present = &planned.classes[usize::from(of.class)].present;
            take_types(&mut source, &planned.schema, present);
            let mut info = source.info().clone();
            let own = info.schema.attributes.iter();
            let mut found: Vec<_> =
                own.filter_map(|a| planned.schema.find_typed(&a.name, a.ty)).collect();
            found.sort_unstable();
            let is_same = info.bytes == of.bytes
                && info.points_hint == of.points
                && info.grid.grid == of.grid.grid
                && found.iter().copied().eq(present.iter().map(|&i| usize::from(i)));
            if !is_same {
                return Err(changed(of));
            }
            info.path.clone_from(&of.path);
            info.grid.name.clone_from(&of.grid.name);
            Ok(Box::new(PieceSource::new(source, *piece, info)))
        };
        // Of several errors the first piece's is reported.
        let opened: Vec<_> = self.pieces.par_iter().map(open).collect();
        opened.into_iter().collect()
    }

    /// What the plan knows of the sources of the pieces.
    fn known(&self) -> KnownInputs {
        let of = || self.pieces.iter().map(|piece| &self.planned.sources[piece.source as usize]);
        KnownInputs {
            grids: of().map(|source| source.grid.clone()).collect(),
            measured: of().map(|source| source.is_measured).collect(),
            depths: of().map(|s| s.colour_depth.unwrap_or(ColourDepth::Sixteen)).collect(),
            core: None,
        }
    }

    /// An empty partition, once scratch has room for rows that memory does not hold.
    fn partition(
        &self,
        intake: &Intake,
        plan: &Plan,
        resources: &Resources,
    ) -> Result<Partition, BuildError> {
        let buffer_bytes = self.buffer_bytes(intake, resources);
        let rows_bytes = intake.points_likely().saturating_mul(plan.row_bytes() as u64);
        let is_spilling = rows_bytes > buffer_bytes as u64;
        let folder = resources.folder();
        if let Some(free_bytes) =
            free_bytes(&folder).filter(|&free| is_spilling && rows_bytes > free)
        {
            return Err(BuildError::Space {
                path: folder,
                what: "scratch files need",
                needed_bytes: rows_bytes,
                free_bytes,
                remedy: "name another folder with --scratch, give more --memory, or plan more jobs",
            });
        }
        let log2 = self.planned.cell_log2;
        Ok(Partition::new(plan.row_bytes(), log2, buffer_bytes, is_spilling))
    }

    /// Bytes of rows in memory.
    fn buffer_bytes(&self, intake: &Intake, resources: &Resources) -> usize {
        let memory_bytes = resources.memory_bytes;
        let held_bytes = intake.sources.iter().map(|s| s.held_bytes()).max().unwrap_or(0);
        let shares = Shares::of(memory_bytes).beside(held_bytes, memory_bytes);
        usize::try_from(shares.buffer_bytes_max).unwrap_or(usize::MAX)
    }

    /// The error for points that the plan does not fit.
    fn misplanned(&self, restart: &Restart) -> BuildError {
        let path = match restart {
            Restart::Bounds(piece) => {
                let source = self.pieces.get(*piece).map(|piece| piece.source as usize);
                source
                    .and_then(|i| self.planned.sources.get(i))
                    .map(|s| s.path.display().to_string())
            }
            Restart::Colours => None,
        };
        BuildError::Step {
            name: path.unwrap_or_else(|| self.place.shown()),
            why: "points lie outside of its header's bounds; plan anew into another folder, with \
                  --measure, which reads all points first"
                .into(),
        }
    }
}

/// Refuses a source that has changed since the plan was made.
fn check_time(of: &PlannedSource) -> Result<(), BuildError> {
    if time_of_change(&of.at) == of.changed { Ok(()) } else { Err(changed(of)) }
}

fn changed(of: &PlannedSource) -> BuildError {
    BuildError::Step {
        name: of.path.display().to_string(),
        why: "has changed since the build was planned; plan anew into another folder".into(),
    }
}

/// Colours that occur, with the number of their points.
fn counts(histogram: &Histogram) -> Vec<[u32; 2]> {
    let number = |[red, green, blue]: [u8; 3]| u32::from_be_bytes([0, red, green, blue]);
    // Counts are at most 2^31.
    histogram.colours().map(|(rgb, points)| [number(rgb), points as u32]).collect()
}

/// Writes the rows of buckets one after another.
fn write_rows(
    buckets: &[Bucket],
    stride: usize,
    scratch: &mut Scratch,
    output: &mut Output<'_>,
    task: &dyn Task,
) -> Result<Vec<CellRows>, BuildError> {
    let is_stored = buckets.iter().any(|bucket| !bucket.extents.is_empty());
    let map = if is_stored { Some(scratch.map()?) } else { None };
    let mut cells = Vec::with_capacity(buckets.len());
    for bucket in buckets {
        task.check()?;
        let offset = output.bytes();
        let mut crc = crc32fast::Hasher::new();
        for run in bucket.runs(map.as_ref(), stride) {
            crc.update(run);
            output.write(run)?;
        }
        cells.push(CellRows { cell: bucket.cell, offset, rows: bucket.rows, crc: crc.finalize() });
        task.advance(bucket.rows);
    }
    Ok(cells)
}
