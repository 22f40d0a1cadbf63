//! Takes decoded points in: batches become rows in a partition, on all cores. Whenever memory is
//! full, all rows go to scratch, and the journal records how far the inputs have been read.

use crate::error::BuildError;
use crate::input::known::KnownInputs;
use crate::input::outside::Outside;
use crate::input::plan::{DecodedInputs, Plan};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Record, RecordReader};
use crate::rows::partition::{Partition, RowBlock, Spilled};
use crate::rows::row::{Incoming, RowLayout};
use crate::rows::scratch::Scratch;
use esker_format::Ranges;
use esker_points::attribute::names;
use esker_points::{AttrType, Batch, Lattice, MultisetHash, quant};
use esker_scan::ahead::Ahead;
use esker_scan::source::BATCH_POINTS;
use esker_scan::{ReadReport, Source, SourceInfo};
use rayon::ScopeFifo;
use std::collections::VecDeque;

/// Batches in progress, for each thread.
const BATCHES_A_THREAD: usize = 4;
/// Most bytes of rows made of batches in progress.
const IN_PROGRESS_BYTES: usize = 32 << 20;

/// Makes rows of batches and sorts them into cells.
pub struct BatchPartitioner<'a> {
    sources: &'a [Box<dyn Source>],
    plan: &'a Plan,
    known: &'a KnownInputs,
    rows: RowLayout,
}

/// A batch as rows sorted into cells, with hash and ranges of its points.
struct PartitionedBatch {
    source: usize,
    points: u64,
    outside: Outside,
    block: RowBlock,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanner: bool,
}

/// Collects the rows of all inputs in a partition.
pub struct RowCollector<'a> {
    partitioner: &'a BatchPartitioner<'a>,
    known: &'a KnownInputs,
    partition: Partition,
    scratch: &'a mut Scratch,
    journal: &'a mut Journal,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanners: bool,
    outside: Outside,
    /// Points set aside that the journal has, or will have with `unrecorded`.
    recorded_aside: usize,
    /// Reports of the sources that were read to their end.
    pub reports: Vec<ReadReport>,
    /// Number of sources of which the partition has all points, and its points of the next source.
    pub added: (usize, u64),
    /// Reports that the journal has, or will have with `unrecorded`.
    recorded: usize,
    /// Journal record of rows that are on their way to scratch, appended once they are there.
    unrecorded: Option<Record>,
    /// Batches that become rows on all cores, in order, and the number of points of each.
    in_progress: VecDeque<(usize, Ahead<PartitionedBatch>)>,
    points_in_progress: usize,
}

impl<'a> BatchPartitioner<'a> {
    /// A partitioner of batches of `sources`, for which `plan` was chosen from what is `known`.
    pub fn new(sources: &'a [Box<dyn Source>], known: &'a KnownInputs, plan: &'a Plan) -> Self {
        Self { sources, plan, known, rows: plan.rows() }
    }

    /// Makes rows of a batch and sorts them into cells of `2^log2` steps.
    fn partition(&self, log2: u8, source: usize, mut batch: Batch) -> PartitionedBatch {
        let points = batch.len() as u64;
        let outside = Outside::of(&mut batch, source, self.known.grids[source].bounds);
        let (batch, plan) = (&batch, self.plan);
        let to_file = plan.to_file(source);
        let towards = if plan.computed.normals {
            towards_scanner(batch, self.sources[source].info(), &plan.lattice)
        } else {
            None
        };
        let knows_scanner = towards.is_some();
        let towards = &towards.unwrap_or_default();
        let incoming = Incoming { batch, class: plan.class_of[source], to_file, towards };
        let mut hash = MultisetHash::default();
        let positions = batch.positions.iter().copied();
        let block = RowBlock::new(self.rows.bytes(), log2, positions, |take| {
            hash = self.rows.for_each_rows(&incoming, take);
        });
        let mut ranges = Ranges::new(&plan.schema);
        for (column, &attribute) in batch.columns.iter().zip(to_file) {
            ranges.add_column(attribute, plan.schema.attributes[attribute].ty, column);
        }
        PartitionedBatch { source, points, outside, block, hash, ranges, knows_scanner }
    }
}

impl<'a> RowCollector<'a> {
    /// Collects rows in `partition`, which is empty.
    pub fn new(
        partitioner: &'a BatchPartitioner<'a>,
        (scratch, journal): (&'a mut Scratch, &'a mut Journal),
        partition: Partition,
    ) -> Self {
        Self {
            partitioner,
            known: partitioner.known,
            partition,
            ranges: Ranges::new(&partitioner.plan.schema),
            scratch,
            journal,
            hash: MultisetHash::default(),
            knows_scanners: true,
            outside: Outside::default(),
            recorded_aside: 0,
            reports: Vec::new(),
            added: (0, 0),
            recorded: 0,
            unrecorded: None,
            in_progress: VecDeque::new(),
            points_in_progress: 0,
        }
    }

    /// The plan of the build.
    pub fn plan(&self) -> &'a Plan {
        self.partitioner.plan
    }

    /// Adds points of `source`.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn add<'s>(
        &mut self,
        source: usize,
        batch: Batch,
        scope: &ScopeFifo<'s>,
    ) -> Result<(), BuildError>
    where
        'a: 's,
    {
        let (partitioner, log2) = (self.partitioner, self.partition.log2());
        let points = batch.len();
        let partition = move || partitioner.partition(log2, source, batch);
        self.in_progress.push_back((points, Ahead::begin(scope, partition)));
        self.points_in_progress += points;
        let batches_max = BATCHES_A_THREAD * rayon::current_num_threads();
        let points_max = IN_PROGRESS_BYTES / partitioner.rows.bytes();
        while self.points_in_progress >= points_max.min(batches_max * BATCH_POINTS) {
            self.collect_first()?;
        }
        Ok(())
    }

    /// Moves the oldest batch in progress into the partition.
    fn collect_first(&mut self) -> Result<(), BuildError> {
        let Some((points, batch)) = self.in_progress.pop_front() else { return Ok(()) };
        self.points_in_progress -= points;
        // If the task has panicked, the scope does too; no later batch is collected.
        let batch = batch.wait().ok_or_else(|| BuildError::Proof("a batch was lost".into()))?;
        let PartitionedBatch { source, points, outside, block, hash, ranges, knows_scanner } =
            batch;
        self.outside.merge(outside);
        if self.partition.is_full_for(&block) {
            self.spill()?;
        }
        self.partition.hold(block);
        self.knows_scanners &= knows_scanner;
        self.hash += hash;
        self.ranges.merge(&ranges);
        let before = if source == self.added.0 { self.added.1 } else { 0 };
        self.added = (source, before + points);
        if self.partition.is_full() { self.spill() } else { Ok(()) }
    }

    /// Collects the remaining batches and returns all rows. If any rows are in scratch, all go
    /// there, so that memory is free for building.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn finish(mut self) -> Result<DecodedInputs, BuildError> {
        while !self.in_progress.is_empty() {
            self.collect_first()?;
        }
        let is_new = self.added != (self.reports.len(), 0);
        self.added = (self.reports.len(), 0);
        if !self.scratch.is_empty() && is_new {
            self.spill()?;
        }
        self.record_spilled()?;
        let Self { partition, mut reports, outside, hash, ranges, knows_scanners, .. } = self;
        outside.correct(&mut reports);
        let aside = outside.aside;
        Ok(DecodedInputs { partition, reports, aside, hash, ranges, knows_scanners })
    }

    /// Waits until spilled rows are in scratch and records them in the journal.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn record_spilled(&mut self) -> Result<(), BuildError> {
        let Some(record) = self.unrecorded.take() else { return Ok(()) };
        self.scratch.flush()?;
        self.journal.append(record)
    }

    /// Moves all rows to scratch and prepares their journal record. The
    /// first rows begin the journal.
    fn spill(&mut self) -> Result<(), BuildError> {
        if self.journal.may_begin()
            && self.scratch.is_empty()
            && let Some(path) = self.scratch.make_named()?
        {
            self.journal.begin(Some(path))?;
            self.journal.append(self.known.record())?;
        }
        self.record_spilled()?;
        let spilled = self.partition.spill(self.scratch)?;
        if !self.journal.keeps_rows() {
            return Ok(());
        }
        let mut record = Record::new(Kind::Rows);
        record.put([self.added.0 as u64, self.added.1]);
        record.put(self.hash.0);
        record.put(u8::from(self.knows_scanners));
        let attributes = 0..self.plan().schema.attributes.len();
        let ranges: Vec<[f64; 2]> = attributes.map(|a| self.ranges.of(a).into()).collect();
        record.put_all(&ranges);
        let reports = &self.reports[self.recorded..self.added.0];
        record.put(reports.len() as u64);
        reports.iter().for_each(|report| put_report(report, &mut record));
        self.recorded = self.added.0;
        self.outside.put(self.recorded_aside, &mut record);
        self.recorded_aside = self.outside.aside.len();
        spilled.put(&mut record);
        self.unrecorded = Some(record);
        Ok(())
    }

    /// Restores the rows that an earlier build has decoded.
    ///
    /// # Errors
    /// If its records or its rows are damaged.
    pub fn resume(&mut self, records: Vec<Vec<u8>>) -> Result<(), BuildError> {
        if let (Some(path), true) = (self.journal.rows(), self.journal.is_resumed()) {
            self.scratch.reopen(path).map_err(|e| {
                let path = path.display();
                self.journal.refused(&format!("its scratch file {path} cannot be opened: {e}"))
            })?;
        }
        for record in records {
            match self.restore(&record) {
                Some(spilled) if self.scratch.restore(&spilled.extents())? => {}
                _ => return Err(self.journal.damaged("what it has of the inputs")),
            }
        }
        Ok(())
    }

    fn restore(&mut self, record: &[u8]) -> Option<Spilled> {
        let mut from = RecordReader(record);
        let [source, points] = from.get()?;
        self.added = (usize::try_from(source).ok()?, points);
        self.hash = MultisetHash(from.get()?);
        self.knows_scanners = from.get::<u8>()? > 0;
        let ranges: Vec<[f64; 2]> = from.get_all()?;
        self.ranges = Ranges::from_pairs(ranges.into_iter().map(Into::into).collect());
        for _ in 0..from.get::<u64>()? {
            self.reports.push(report(&mut from)?);
        }
        self.recorded = self.reports.len();
        self.outside.restore(&mut from)?;
        self.recorded_aside = self.outside.aside.len();
        let spilled = Spilled::get(&mut from)?;
        self.partition.restore(&spilled);
        (self.recorded == self.added.0).then_some(spilled)
    }
}

/// Octahedral codes of the directions from points to their scanner; `None` unless its position is
/// known for all of them.
fn towards_scanner(batch: &Batch, info: &SourceInfo, lattice: &Lattice) -> Option<Vec<[i16; 2]>> {
    let scanner = info.scanner.as_ref()?;
    let ids = batch.schema.find_typed(names::POINT_SOURCE_ID, AttrType::U16);
    let ids = ids.map(|column| batch.columns[column].as_chunks::<2>().0);
    let towards = |(i, &p): (usize, &[u32; 3])| {
        let from = scanner.of(ids.map(|ids| u16::from_le_bytes(ids[i])))?;
        let at = lattice.world(p);
        let direction = lattice.measure([0, 1, 2].map(|axis| from[axis] - at[axis]));
        let direction = direction.map(|along| along as f32);
        Some(quant::oct_encode(direction))
    };
    batch.positions.iter().enumerate().map(towards).collect()
}

/// Adds the report on a source to a record.
pub fn put_report(report: &ReadReport, record: &mut Record) {
    record.put(report.points);
    record.put(report.rounding_error_max);
    record.put(report.colour_max);
    record.put(report.refused.len() as u64);
    for (reason, &points) in &report.refused {
        record.put_all(reason.as_bytes());
        record.put(points);
    }
    record.put(report.notes.len() as u64);
    report.notes.iter().for_each(|note| record.put_all(note.as_bytes()));
}

/// Reads the report on a source from a record; `None` if it is damaged.
pub fn report(from: &mut RecordReader<'_>) -> Option<ReadReport> {
    let mut report = ReadReport {
        points: from.get()?,
        rounding_error_max: from.get()?,
        colour_max: from.get()?,
        ..Default::default()
    };
    for _ in 0..from.get::<u64>()? {
        report.refused.insert(from.get_text()?, from.get()?);
    }
    for _ in 0..from.get::<u64>()? {
        report.notes.push(from.get_text()?);
    }
    Some(report)
}
