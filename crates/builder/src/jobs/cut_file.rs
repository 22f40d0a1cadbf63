//! The object of the cut of a divided build: what builds of parts and the joining of them read.

use crate::attributes::density::Distances;
use crate::attributes::palette::{Trained, palette_record, restored};
use crate::error::BuildError;
use crate::input::plan::Plan;
use crate::input::taking::{put_report, report};
use crate::jobs::parts::{Part, TakenRows};
use crate::jobs::place::Place;
use crate::jobs::planned::Planned;
use crate::jobs::step::{Record as StepRecord, Step, failed, refused};
use crate::jobs::summary::{SourceKept, TakenPiece, aside, put_aside, put_ranges, ranges};
use crate::rows::journal_record::{Kind, Record, RecordReader, unsealed};
use crate::tree::levels::PartStep;
use esker_format::{Ranges, SetAside, SourceRecord};
use esker_points::read_at::ReadAt;
use esker_points::{Cell, ColourDepth, MultisetHash, PointClass};
use esker_scan::ReadReport;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Objects that are open at the same time: systems allow few files, and there may be thousands.
const OPEN_MAX: usize = 64;

/// What takes have found of a source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceTaken {
    /// Report on all its points.
    pub report: ReadReport,
    /// What the metadata keep of it.
    pub kept: Option<SourceKept>,
}

/// A part, and where its record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartPlace {
    /// Smallest cell that holds its points.
    pub cell: Cell,
    /// Number of its rows.
    pub rows: u64,
    /// Offset of its record, in bytes.
    pub offset: u64,
    /// Bytes of its record.
    pub bytes: u64,
}

/// The cut.
pub struct Cut {
    /// Number of points.
    pub points: u64,
    /// Refused points, by reason.
    pub points_refused: BTreeMap<String, u64>,
    /// Hash of all points.
    pub hash: MultisetHash,
    /// Range of each attribute.
    pub ranges: Ranges,
    /// Whether the position of the scanner is known for all points.
    pub knows_scanners: bool,
    /// Strays.
    pub aside: Vec<SetAside>,
    /// Depths of 16-bit colours of the sources, corrected.
    pub depths: Vec<ColourDepth>,
    /// Classes of points, corrected.
    pub classes: Vec<PointClass>,
    /// How far points are apart, if attributes are computed.
    pub distances: Option<Distances>,
    /// Palette of the compact plane.
    pub palette: Trained,
    /// Records of the takes.
    pub takes: Vec<StepRecord>,
    /// Parts that each job builds.
    pub builds: Vec<Range<u32>>,
    /// Steps of the tree above parts, in the order in which they are done.
    pub steps: Vec<PartStep>,
    /// Parts, along the Morton curve.
    pub parts: Vec<PartPlace>,
    /// Offset and length of what was found of the sources, in bytes.
    pub sources_at: [u64; 2],
    /// The object and its record, if the cut was read.
    pub object: Option<(Arc<dyn ReadAt>, StepRecord)>,
}

impl SourceTaken {
    /// Adds a piece of the source.
    pub fn add(&mut self, piece: TakenPiece) {
        let (sum, more) = (&mut self.report, piece.report);
        sum.points += more.points;
        for (reason, points) in more.refused {
            *sum.refused.entry(reason).or_default() += points;
        }
        sum.rounding_error_max = sum.rounding_error_max.max(more.rounding_error_max);
        sum.colour_max = sum.colour_max.max(more.colour_max);
        for note in more.notes {
            if !sum.notes.contains(&note) {
                sum.notes.push(note);
            }
        }
        self.kept = self.kept.take().or(piece.kept);
    }

    /// Bytes of what was found of all sources.
    pub fn seal_all(sources: &[Self]) -> Vec<u8> {
        let mut record = Record::new(Kind::Inputs);
        for Self { report, kept } in sources {
            put_report(report, &mut record);
            record.put(u8::from(kept.is_some()));
            kept.iter().for_each(|kept| kept.put(&mut record));
        }
        record.seal()
    }

    fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let report = report(from)?;
        let kept = if from.get::<u8>()? > 0 { Some(SourceKept::get(from)?) } else { None };
        Some(Self { report, kept })
    }
}

impl Cut {
    /// Bytes of the sums, which are the tail of the object.
    pub fn seal(&self, planned: &Planned) -> Vec<u8> {
        let mut record = Record::new(Kind::Cut);
        record.put(self.points);
        record.put(self.sources_at);
        record.put(self.points_refused.len() as u64);
        for (reason, &points) in &self.points_refused {
            record.put_all(reason.as_bytes());
            record.put(points);
        }
        record.put(self.hash.0);
        put_ranges(&self.ranges, planned.schema.attributes.len(), &mut record);
        record.put(u8::from(self.knows_scanners));
        put_aside(&self.aside, &mut record);
        let is_eight = |depth: &ColourDepth| u8::from(*depth == ColourDepth::Eight);
        record.put_all(&self.depths.iter().map(is_eight).collect::<Vec<_>>());
        let of_classes = self.classes.iter().map(|class| is_eight(&class.colour_depth));
        record.put_all(&of_classes.collect::<Vec<_>>());
        record.put(u8::from(self.distances.is_some()));
        let distances = self.distances.unwrap_or(Distances { spacing: 0.0, steps_max: 0.0 });
        record.put([distances.spacing, distances.steps_max]);
        record.put(u8::from(self.palette.is_some()));
        record.append(&palette_record(self.palette.as_ref()));
        record.put(self.takes.len() as u64);
        for take in &self.takes {
            // The record of a step is JSON.
            record.put_all(&serde_json::to_vec(take).unwrap_or_default());
        }
        record.put_all(&self.builds.iter().map(|b| [b.start, b.end]).collect::<Vec<_>>());
        record.put(self.steps.len() as u64);
        for step in &self.steps {
            let (number, cell) = match *step {
                PartStep::Part(part) => (part, None),
                PartStep::Combine(cell, children) => (children, Some(cell)),
            };
            record.put(u8::from(cell.is_some()));
            record.put(number);
            let cell = cell.unwrap_or(Cell { corner: [0; 3], log2: 0 });
            record.put(cell.corner);
            record.put(cell.log2);
        }
        record.put(self.parts.len() as u64);
        for PartPlace { cell, rows, offset, bytes } in &self.parts {
            record.put(cell.corner);
            record.put(cell.log2);
            record.put([*rows, *offset, *bytes]);
        }
        record.seal()
    }

    /// Reads the cut of the plan of a place.
    ///
    /// # Errors
    /// If it is missing, cut short or damaged.
    pub fn read(place: &dyn Place, planned: &Planned) -> Result<Self, BuildError> {
        let record = StepRecord::of(place, &planned.hash, Step::Cut)?;
        let tail = record.tail(place, Step::Cut)?;
        let cut = Self::unsealed(&tail, planned);
        let mut cut = cut.ok_or_else(|| record.damaged(place, Step::Cut))?;
        cut.object = Some((record.open(place, Step::Cut)?, record));
        Ok(cut)
    }

    fn unsealed(tail: &[u8], planned: &Planned) -> Option<Self> {
        let mut from = unsealed(tail, Kind::Cut)?;
        let (points, sources_at) = (from.get()?, from.get()?);
        let count = from.get::<u64>()?;
        let reason = |_| Some((from.get_text()?, from.get()?));
        let points_refused = (0..count).map(reason).collect::<Option<_>>()?;
        let hash = MultisetHash(from.get()?);
        let ranges = ranges(&mut from, planned.schema.attributes.len())?;
        let knows_scanners = from.get::<u8>()? > 0;
        let aside = aside(&mut from)?;
        let depth =
            |is_eight: &u8| [ColourDepth::Sixteen, ColourDepth::Eight][usize::from(*is_eight > 0)];
        let depths: Vec<ColourDepth> = from.get_all()?.iter().map(depth).collect();
        let of_classes: Vec<ColourDepth> = from.get_all()?.iter().map(depth).collect();
        let mut classes = planned.classes.clone();
        let fits = depths.len() == planned.sources.len() && of_classes.len() == classes.len();
        classes.iter_mut().zip(of_classes).for_each(|(class, depth)| class.colour_depth = depth);
        let has_distances = from.get::<u8>()? > 0;
        let [spacing, steps_max] = from.get()?;
        let distances = has_distances.then_some(Distances { spacing, steps_max });
        let palette = if from.get::<u8>()? > 0 { restored(&mut from)? } else { None };
        let count = from.get::<u64>()?;
        let take = |_| serde_json::from_slice(&from.get_all::<u8>()?).ok();
        let takes: Vec<StepRecord> = (0..count).map(take).collect::<Option<_>>()?;
        let builds: Vec<[u32; 2]> = from.get_all()?;
        let steps = part_steps(&mut from)?;
        let parts = part_places(&mut from)?;
        let (takes_planned, part_count) = (planned.takes.len(), parts.len() as u32);
        let is_sound = fits
            && takes.len() == takes_planned
            && builds.iter().all(|[start, end]| start <= end && *end <= part_count)
            && parts.iter().map(|part| part.rows).fold(0, u64::saturating_add) == points;
        is_sound.then(|| Self {
            points,
            points_refused,
            hash,
            ranges,
            knows_scanners,
            aside,
            depths,
            classes,
            distances,
            palette,
            takes,
            builds: builds.into_iter().map(|[start, end]| start..end).collect(),
            steps,
            parts,
            sources_at,
            object: None,
        })
    }

    /// Lattice, schema and classes for a build, as takes have corrected them.
    pub fn plan(&self, planned: &Planned) -> Plan {
        let mut plan = planned.plan();
        plan.classes.clone_from(&self.classes);
        plan
    }

    /// Rows of all parts of a job.
    pub fn rows_of(&self, job: usize) -> u64 {
        let parts = self.builds.get(job).cloned().unwrap_or(0..0);
        parts.filter_map(|part| self.parts.get(part as usize)).map(|part| part.rows).sum()
    }

    /// Reads bytes of the object.
    fn bytes(&self, place: &dyn Place, offset: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        let Some((object, record)) = &self.object else { return Ok(Vec::new()) };
        if offset.checked_add(bytes).is_none_or(|end| end > record.tail) {
            return Err(record.damaged(place, Step::Cut));
        }
        let mut read = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX)];
        let done = object.read_exact_at(&mut read, offset);
        done.map_err(failed(place, &record.object, "cannot be read"))?;
        Ok(read)
    }

    fn damaged(&self, place: &dyn Place) -> BuildError {
        match &self.object {
            Some((_, record)) => record.damaged(place, Step::Cut),
            None => refused(place, &Step::Cut.record(), "was not read"),
        }
    }

    /// Reads a part.
    ///
    /// # Errors
    /// If there is no such part, or its record is damaged.
    pub fn part(&self, place: &dyn Place, part: u32) -> Result<Part, BuildError> {
        let at = self.parts.get(part as usize).ok_or_else(|| self.damaged(place))?;
        let bytes = self.bytes(place, at.offset, at.bytes)?;
        let takes = self.takes.len() as u32;
        let is_sound = |part: &Part| {
            let cells = part.cells.iter().chain(&part.halo);
            cells.flat_map(|cell| &cell.rows).all(|rows| rows.take <= takes)
        };
        Part::unsealed(&bytes).filter(is_sound).ok_or_else(|| self.damaged(place))
    }

    /// Records of all sources, as the metadata of the file have them.
    ///
    /// # Errors
    /// If they are damaged.
    pub fn sources(
        &self,
        place: &dyn Place,
        planned: &Planned,
    ) -> Result<Vec<SourceRecord>, BuildError> {
        let [offset, bytes] = self.sources_at;
        let bytes = self.bytes(place, offset, bytes)?;
        let mut from = unsealed(&bytes, Kind::Inputs).ok_or_else(|| self.damaged(place))?;
        let mut records = Vec::with_capacity(planned.sources.len());
        for (source, &depth) in planned.sources.iter().zip(&self.depths) {
            let taken = SourceTaken::get(&mut from).ok_or_else(|| self.damaged(place))?;
            let kept = taken.kept.ok_or_else(|| self.damaged(place))?;
            records.push(SourceRecord {
                path: source.path.display().to_string(),
                format: kept.format,
                grid: source.grid.clone(),
                points: taken.report.points,
                refused: taken.report.refused,
                rounding_error_max: taken.report.rounding_error_max,
                colour_depth: source.colour_depth.map(|_| depth),
                colour_depth_forced: planned.has_forced_depth() && source.colour_depth.is_some(),
                class: source.class,
                crs: kept.crs,
                notes: kept.notes.into_iter().chain(taken.report.notes).collect(),
                verbatim: kept.verbatim,
            });
        }
        Ok(records)
    }

    /// The objects that have the rows of parts: those of all takes, and that of the cut. They are
    /// opened when they are read.
    pub fn rows(&self) -> TakenObjects {
        let of_cut = self.object.iter().map(|(_, record)| (Step::Cut, record.clone()));
        let mut objects = TakenObjects::of(&self.takes);
        objects.records.extend(of_cut);
        objects
    }
}

/// Objects that have rows: those of takes, and at last that of the cut.
pub struct TakenObjects {
    records: Vec<(Step, StepRecord)>,
    /// Objects that were read last, oldest first.
    open: Mutex<VecDeque<(u32, Arc<dyn ReadAt>)>>,
}

impl TakenObjects {
    /// The objects of all takes.
    pub fn of(takes: &[StepRecord]) -> Self {
        let of_take = |(index, record): (u32, &StepRecord)| (Step::Take(index), record.clone());
        Self { records: (0..).zip(takes).map(of_take).collect(), open: Mutex::default() }
    }

    /// Number of objects.
    pub fn len(&self) -> u32 {
        self.records.len() as u32
    }

    fn record(&self, place: &dyn Place, index: u32) -> Result<&(Step, StepRecord), BuildError> {
        let record = self.records.get(index as usize);
        record.ok_or_else(|| refused(place, &Step::Cut.record(), "names no object"))
    }

    /// Opens an object, unless it is one of those that were read last.
    fn object(&self, place: &dyn Place, index: u32) -> Result<Arc<dyn ReadAt>, BuildError> {
        let lock = || self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, object)) = lock().iter().find(|(open, _)| *open == index) {
            return Ok(Arc::clone(object));
        }
        let (step, record) = self.record(place, index)?;
        let object = record.open(place, *step)?;
        let mut open = lock();
        if open.len() >= OPEN_MAX {
            open.pop_front();
        }
        open.push_back((index, Arc::clone(&object)));
        Ok(object)
    }

    /// Reads rows of an object from an offset on.
    ///
    /// # Errors
    /// If they cannot be read, or there are fewer.
    pub fn read(
        &self,
        place: &dyn Place,
        index: u32,
        offset: u64,
        into: &mut [u8],
    ) -> Result<(), BuildError> {
        let (step, record) = self.record(place, index)?;
        let object = self.object(place, index)?;
        if offset.checked_add(into.len() as u64).is_none_or(|end| end > record.tail) {
            return Err(record.damaged(place, *step));
        }
        let read = object.read_exact_at(into, offset);
        read.map_err(failed(place, &record.object, "cannot be read"))
    }

    /// Compares the CRC-32 of rows that were read with theirs, and begins the next one.
    ///
    /// # Errors
    /// If the rows are damaged.
    pub fn check(
        &self,
        place: &dyn Place,
        rows: &TakenRows,
        crc: &mut crc32fast::Hasher,
    ) -> Result<(), BuildError> {
        if std::mem::take(crc).finalize() == rows.crc {
            return Ok(());
        }
        let (step, record) = self.record(place, rows.take)?;
        Err(record.damaged(place, *step))
    }

    /// Appends rows of `stride` bytes to `into`.
    ///
    /// # Errors
    /// If they cannot be read, or are damaged.
    pub fn append(
        &self,
        place: &dyn Place,
        rows: &TakenRows,
        stride: usize,
        into: &mut Vec<u8>,
    ) -> Result<(), BuildError> {
        let start = into.len();
        into.resize(start + rows.rows as usize * stride, 0);
        self.read(place, rows.take, rows.offset, &mut into[start..])?;
        let mut crc = crc32fast::Hasher::new();
        crc.update(&into[start..]);
        self.check(place, rows, &mut crc)
    }
}

fn part_steps(from: &mut RecordReader<'_>) -> Option<Vec<PartStep>> {
    let count = from.get::<u64>()?;
    let step = |_| {
        let (combines, number) = (from.get::<u8>()? > 0, from.get()?);
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        Some(if combines { PartStep::Combine(cell, number) } else { PartStep::Part(number) })
    };
    (0..count).map(step).collect()
}

fn part_places(from: &mut RecordReader<'_>) -> Option<Vec<PartPlace>> {
    let count = from.get::<u64>()?;
    let place = |_| {
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        let [rows, offset, bytes] = from.get()?;
        Some(PartPlace { cell, rows, offset, bytes }).filter(|part| part.cell.is_valid())
    };
    (0..count).map(place).collect()
}
