//! The cut of a divided build: sums up what all takes have found, corrects what headers had wrong,
//! and divides the cells into parts. Its object has the records of the sources, for the metadata of
//! the file, then a record of each part, then the sums.

use crate::attributes::blocks::Blocks;
use crate::attributes::density::{Densities, Distances};
use crate::attributes::normals::Bounds;
use crate::attributes::palette::{Trained, trained};
use crate::calls::build::{NAMES_MAX, reasons};
use crate::error::BuildError;
use crate::input::intake::{correct_classes, depth_of};
use crate::jobs::Resources;
use crate::jobs::cut_file::{Cut, PartPlace, SourceTaken, TakenObjects};
use crate::jobs::parts::{Division, TakenCells};
use crate::jobs::place::Place;
use crate::jobs::planned::{NAME, Planned};
use crate::jobs::refine::Refinement;
use crate::jobs::step::{Output, Record, Step, refused};
use crate::jobs::summary::Summary;
use crate::options::Options;
use esker_format::{Ranges, SET_ASIDE_MAX, SetAside};
use esker_points::palette::Histogram;
use esker_points::{Cell, ColourDepth, MultisetHash, Task};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Takes whose summaries are read at the same time.
const GROUP_TAKES: usize = 16;

/// Share of the memory that has rows of cells that are refined: they are sorted, and held again for
/// cells within.
const REFINED_SHARE: u64 = 8;

/// What the cut did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CutReport {
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Points of all takes.
    pub points: u64,
    /// Refused points, by reason.
    pub points_refused: BTreeMap<String, u64>,
    /// Strays.
    pub points_set_aside: u64,
    /// Hash of all points.
    pub hash: MultisetHash,
    /// Number of parts.
    pub parts: u32,
    /// Number of jobs that build them.
    pub builds: u32,
    /// Rows of the largest job.
    pub build_rows_max: u64,
}

/// Sums up all takes of the plan of a place, unless that is done.
///
/// # Errors
/// If a take is missing or damaged; if points were refused and may not be, or sources have colours
/// of several depths; if the place is full, or on request.
pub fn cut(
    place: &dyn Place,
    resources: &Resources,
    task: &dyn Task,
) -> Result<CutReport, BuildError> {
    let planned = Planned::read(place)?;
    if Record::find(place, &planned.hash, Step::Cut)?.is_some() {
        return Ok(report(&Cut::read(place, &planned)?, true));
    }
    let options = planned.options(place, resources)?;
    resources.run(task, || {
        let mut sums = Sums::new(&planned);
        sums.read(place, task)?;
        sums.check(&options)?;
        sums.write(place, &options, task)
    })
}

fn report(cut: &Cut, was_done: bool) -> CutReport {
    CutReport {
        was_done,
        points: cut.points,
        points_refused: cut.points_refused.clone(),
        points_set_aside: cut.aside.len() as u64,
        hash: cut.hash,
        parts: cut.parts.len() as u32,
        builds: cut.builds.len() as u32,
        build_rows_max: (0..cut.builds.len()).map(|job| cut.rows_of(job)).max().unwrap_or(0),
    }
}

/// What takes have found together.
struct Sums<'a> {
    planned: &'a Planned,
    takes: Vec<Record>,
    cells: TakenCells,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanners: bool,
    sources: Vec<SourceTaken>,
    aside: Vec<SetAside>,
    densities: Densities,
    colours: Option<Histogram>,
}

impl<'a> Sums<'a> {
    fn new(planned: &'a Planned) -> Self {
        Self {
            planned,
            takes: Vec::new(),
            cells: TakenCells::default(),
            hash: MultisetHash::default(),
            ranges: Ranges::new(&planned.schema),
            knows_scanners: true,
            sources: vec![SourceTaken::default(); planned.sources.len()],
            aside: Vec::new(),
            densities: Densities::default(),
            colours: None,
        }
    }

    /// Reads what all takes have found, in their order.
    fn read(&mut self, place: &dyn Place, task: &dyn Task) -> Result<(), BuildError> {
        let planned = self.planned;
        let count = planned.takes.len() as u32;
        self.takes = self.records(place)?;
        task.phase("summing up", Some(count.into()), "takes");
        let attributes = planned.schema.attributes.len();
        for first in (0..count).step_by(GROUP_TAKES) {
            task.check()?;
            let group = first..count.min(first + GROUP_TAKES as u32);
            let read =
                |index: u32| Summary::read(&self.takes[index as usize], place, index, attributes);
            let read: Vec<_> = group.clone().into_par_iter().map(read).collect();
            for (index, summary) in group.zip(read) {
                let record = &self.takes[index as usize];
                let damaged = record.damaged(place, Step::Take(index));
                self.add(index, summary?).ok_or(damaged)?;
                task.advance(1);
            }
        }
        Ok(())
    }

    /// Records of all takes.
    fn records(&self, place: &dyn Place) -> Result<Vec<Record>, BuildError> {
        let plan = &self.planned.hash;
        let count = self.planned.takes.len() as u32;
        let find = |index| Record::find(place, plan, Step::Take(index));
        let found: Vec<_> = (0..count).into_par_iter().map(find).collect();
        let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
        let missing: Vec<u32> = (0..).zip(&found).filter(|f| f.1.is_none()).map(|f| f.0).collect();
        if let Some(&first) = missing.first() {
            let step = Step::Take(first);
            let why = match missing.len() {
                1 => format!("is missing; run `{}` first", step.command()),
                n => format!("and {} more takes are missing; `esker job status` lists them", n - 1),
            };
            return Err(refused(place, &step.record(), why));
        }
        Ok(found.into_iter().flatten().collect())
    }

    /// Adds what a take has found; `None` if it is not what was planned.
    fn add(&mut self, index: u32, summary: Summary) -> Option<()> {
        let planned = self.planned;
        let pieces = planned.takes.get(index as usize)?;
        let of = summary.pieces.iter().map(|piece| piece.source);
        let is_planned = of.eq(pieces.iter().map(|piece| piece.source))
            && summary.row_bytes == planned.plan().row_bytes() as u64
            && summary.densities.is_some() == planned.computed.is_any();
        if !is_planned {
            return None;
        }
        self.cells.add(index, &summary.cells);
        self.hash += summary.hash;
        self.ranges.merge(&summary.ranges);
        self.knows_scanners &= summary.knows_scanners;
        for piece in summary.pieces {
            self.sources.get_mut(piece.source as usize)?.add(piece);
        }
        self.aside.extend(summary.aside);
        if let Some(densities) = summary.densities {
            self.densities = std::mem::take(&mut self.densities).merged(densities);
        }
        if let Some(colours) = summary.colours {
            let histogram = self.colours.get_or_insert_default();
            for [number, points] in colours {
                let [_, rgb @ ..] = number.to_be_bytes();
                histogram.add_count(rgb, points);
            }
        }
        Some(())
    }

    /// Checks that the points may be built.
    fn check(&self, options: &Options) -> Result<(), BuildError> {
        let (points, refused) = self.points();
        let names = || {
            let paths = self.planned.sources.iter().map(|s| s.path.display().to_string());
            let mut names: Vec<String> = paths.take(NAMES_MAX).collect();
            if self.planned.sources.len() > NAMES_MAX {
                names.push(format!("{} more", self.planned.sources.len() - NAMES_MAX));
            }
            names.join(", ")
        };
        let (lost, why) = (refused.values().sum::<u64>(), reasons(&refused));
        if lost > 0 && points == 0 {
            let why = format!("{why}; look at what wrote them");
            return Err(BuildError::Refused { inputs: names(), points: lost, why });
        }
        if lost > 0 && options.refuse_loss {
            return Err(BuildError::Lost { inputs: names(), points: lost, why });
        }
        if self.aside.len() > SET_ASIDE_MAX {
            return Err(BuildError::Options(format!(
                "{}: over {SET_ASIDE_MAX} points lie far from nearly all others, more than a file keeps; build the parts one by one",
                names()
            )));
        }
        Ok(())
    }

    /// Number of points, and of refused ones by reason.
    fn points(&self) -> (u64, BTreeMap<String, u64>) {
        let mut refused = BTreeMap::new();
        for (reason, n) in self.sources.iter().flat_map(|source| &source.report.refused) {
            *refused.entry(reason.clone()).or_default() += n;
        }
        (self.sources.iter().map(|source| source.report.points).sum(), refused)
    }

    /// Colour depths of the sources as takes have found them.
    fn depths(&self) -> Vec<ColourDepth> {
        let is_forced = self.planned.has_forced_depth();
        let depth = |(planned, taken): (&super::planned::PlannedSource, &SourceTaken)| {
            let Some(assumed) = planned.colour_depth else { return ColourDepth::Sixteen };
            let found = depth_of(taken.report.colour_max).filter(|_| !is_forced);
            found.unwrap_or(assumed)
        };
        self.planned.sources.iter().zip(&self.sources).map(depth).collect()
    }

    /// Divides the cells, and writes the cut.
    fn write(
        self,
        place: &dyn Place,
        options: &Options,
        task: &dyn Task,
    ) -> Result<CutReport, BuildError> {
        let planned = self.planned;
        let (points, points_refused) = self.points();
        let depths = self.depths();
        let mut classes = planned.classes.clone();
        let class_of: Vec<u16> = planned.sources.iter().map(|source| source.class).collect();
        let agree = correct_classes(&mut classes, &class_of, &depths);
        if !agree || options.compact && classes != planned.classes {
            let why = "the 16-bit colours of some inputs have another depth than their first points \
                       show; plan anew into another folder, with --measure, or with --colour-bits";
            return Err(refused(place, NAME, why));
        }
        let Self { cells, densities, colours, .. } = self;
        let mut output = Output::begin(place, &planned.hash, Step::Cut)?;
        let refinement = Refinement {
            place,
            objects: &TakenObjects::of(&self.takes),
            output: &mut output,
            stride: planned.plan().row_bytes(),
            rows_max: planned.part_rows_max,
            bytes_max: options.memory_bytes / REFINED_SHARE,
            task,
            refined: Vec::new(),
        };
        let division = Division::of(refinement.run(cells)?, planned.part_rows_max);
        if division.rows() != points {
            let counted = division.rows();
            return Err(BuildError::Proof(format!("{points} points were taken, {counted} rows")));
        }
        let has_distances = planned.computed.is_any() && points > 0;
        let distances = has_distances.then(|| densities.distances());
        let palette: Trained = colours.and_then(|histogram| trained(&histogram, None));
        if options.compact && palette.is_none() && points > 0 {
            task.note("--compact has no effect: the inputs have no colours");
        }
        let sources_at = output.bytes();
        let sources = SourceTaken::seal_all(&self.sources);
        output.write(&sources)?;
        let reach = distances.map(|distances| Reach::new(planned, options, &distances));
        let parts = write_parts(&division, reach.as_ref(), &mut output, task)?;
        let cut = Cut {
            points,
            points_refused,
            hash: self.hash,
            ranges: self.ranges,
            knows_scanners: self.knows_scanners,
            aside: self.aside,
            depths,
            classes,
            distances,
            palette,
            takes: self.takes,
            builds: division.jobs(planned.jobs),
            steps: division.steps,
            parts,
            sources_at: [sources_at, sources.len() as u64],
            object: None,
        };
        task.check()?;
        let (_, is_own) = output.publish(&cut.seal(planned))?;
        Ok(report(&cut, !is_own))
    }
}

/// How far attributes reach that are computed from the points around a point.
enum Reach {
    Neighbours(Bounds),
    Blocks(Blocks),
}

impl Reach {
    fn new(planned: &Planned, options: &Options, distances: &Distances) -> Self {
        let scale = planned.lattice.metric().scale;
        if options.estimates_fast() {
            Self::Blocks(Blocks::new(scale, distances))
        } else {
            Self::Neighbours(Bounds::new(scale, distances))
        }
    }

    fn around(&self, cell: &Cell) -> [[u32; 3]; 2] {
        match self {
            Self::Neighbours(bounds) => bounds.around(cell),
            Self::Blocks(blocks) => blocks.around(cell),
        }
    }
}

/// Writes the records of all parts.
fn write_parts(
    division: &Division,
    reach: Option<&Reach>,
    output: &mut Output<'_>,
    task: &dyn Task,
) -> Result<Vec<PartPlace>, BuildError> {
    let mut places = Vec::with_capacity(division.len());
    for part in 0..division.len() {
        task.check()?;
        let (cell, rows) = division.extent(part);
        let around = reach.map(|reach| reach.around(&cell));
        let bytes = division.part(part, around).seal();
        let offset = output.bytes();
        output.write(&bytes)?;
        places.push(PartPlace { cell, rows, offset, bytes: bytes.len() as u64 });
    }
    Ok(places)
}
