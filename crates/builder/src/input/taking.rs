//! Taking points in: batches become rows in a partition, on all cores; and whenever memory is full,
//! all rows go to scratch, and the journal is told how far the inputs are taken in.

use crate::error::BuildError;
use crate::input::intake::{Intake, Plan, Taken};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Reading, Record};
use crate::rows::partition::{Block, Partition, Spilled};
use crate::rows::row::{Incoming, RowLayout};
use crate::rows::scratch::Scratch;
use esker_format::Ranges;
use esker_points::attribute::names;
use esker_points::{AttrType, Batch, Lattice, MultisetHash, quant};
use esker_scan::ahead::Ahead;
use esker_scan::source::BATCH_POINTS;
use esker_scan::{ReadReport, SourceInfo};
use rayon::ScopeFifo;
use std::collections::VecDeque;

/// Batches under way, for each thread.
const BATCHES_A_THREAD: usize = 4;
/// Rows made of batches under way, in bytes at most.
const UNDER_WAY_BYTES: usize = 32 << 20;

/// How batches become rows.
pub struct Parting<'a> {
    intake: &'a Intake,
    /// What was chosen for the inputs.
    pub plan: &'a Plan,
    rows: RowLayout,
}

/// A batch as rows sorted into cells, and what was counted of it.
struct Parted {
    source: usize,
    points: u64,
    block: Block,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanner: bool,
}

/// Points on their way into a partition.
pub struct Taking<'a> {
    parting: &'a Parting<'a>,
    partition: Partition,
    scratch: &'a mut Scratch,
    journal: &'a mut Journal,
    hash: MultisetHash,
    ranges: Ranges,
    knows_scanners: bool,
    /// What became of the sources that were read to their end.
    pub reports: Vec<ReadReport>,
    /// The partition has all points of so many sources, and so many of the next one.
    pub added: (usize, u64),
    /// Reports that the journal has, or will have with `untold`.
    told: usize,
    /// What the journal is told once the rows that it speaks of are in scratch.
    untold: Option<Record>,
    /// Batches that become rows on all cores, in order, and how many points each has.
    under_way: VecDeque<(usize, Ahead<Parted>)>,
    points_under_way: usize,
}

impl<'a> Parting<'a> {
    /// Of inputs for which this was chosen.
    pub fn new(intake: &'a Intake, plan: &'a Plan) -> Self {
        Self { intake, plan, rows: plan.rows() }
    }

    /// Makes rows of a batch and sorts them into cells.
    fn part(&self, log2: u8, source: usize, batch: &Batch) -> Parted {
        let plan = self.plan;
        let to_file = plan.to_file(source);
        let towards = if plan.estimates_normals {
            towards_scanner(batch, self.intake.sources[source].info(), &plan.lattice)
        } else {
            None
        };
        let knows_scanner = towards.is_some();
        let towards = &towards.unwrap_or_default();
        let incoming = Incoming { batch, class: plan.class_of[source], to_file, towards };
        let mut hash = MultisetHash::default();
        let positions = batch.positions.iter().copied();
        let block = Block::new(self.rows.bytes(), log2, positions, |take| {
            hash = self.rows.for_each_rows(&incoming, take);
        });
        let mut ranges = Ranges::new(&plan.schema);
        for (column, &attribute) in batch.columns.iter().zip(to_file) {
            ranges.add_column(attribute, plan.schema.attributes[attribute].ty, column);
        }
        Parted { source, points: batch.len() as u64, block, hash, ranges, knows_scanner }
    }
}

impl<'a> Taking<'a> {
    /// Nothing yet.
    pub fn new(
        parting: &'a Parting<'a>,
        (scratch, journal): (&'a mut Scratch, &'a mut Journal),
        buffer_bytes_max: usize,
    ) -> Self {
        let Parting { intake, plan, rows } = parting;
        let log2 = intake.partition_log2(plan);
        let bytes = intake.points_likely().saturating_mul(rows.bytes() as u64);
        let is_spilling = bytes > buffer_bytes_max as u64;
        Self {
            parting,
            partition: Partition::new(rows.bytes(), log2, buffer_bytes_max, is_spilling),
            ranges: Ranges::new(&plan.schema),
            scratch,
            journal,
            hash: MultisetHash::default(),
            knows_scanners: true,
            reports: Vec::new(),
            added: (0, 0),
            told: 0,
            untold: None,
            under_way: VecDeque::new(),
            points_under_way: 0,
        }
    }

    /// What was chosen for the inputs.
    pub fn plan(&self) -> &'a Plan {
        self.parting.plan
    }

    /// Adds points of a source.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn add<'s>(
        &mut self,
        source: usize,
        batch: Batch,
        scope: &ScopeFifo<'s>,
    ) -> Result<(), BuildError>
    where
        'a: 's,
    {
        let (parting, log2) = (self.parting, self.partition.log2());
        let points = batch.len();
        let part = move || parting.part(log2, source, &batch);
        self.under_way.push_back((points, Ahead::begin(scope, part)));
        self.points_under_way += points;
        let batches_max = BATCHES_A_THREAD * rayon::current_num_threads();
        let points_max = UNDER_WAY_BYTES / parting.rows.bytes();
        while self.points_under_way >= points_max.min(batches_max * BATCH_POINTS) {
            self.hold_first()?;
        }
        Ok(())
    }

    /// Moves what is longest under way into the partition.
    fn hold_first(&mut self) -> Result<(), BuildError> {
        let Some((points, parted)) = self.under_way.pop_front() else { return Ok(()) };
        self.points_under_way -= points;
        // Where it has panicked, the scope does, too; nothing behind it is taken in.
        let parted = parted.wait().ok_or_else(|| BuildError::Proof("a batch was lost".into()))?;
        let Parted { source, points, block, hash, ranges, knows_scanner } = parted;
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

    /// All that was taken in. Once anything has gone to scratch, everything does, so that memory is
    /// free for building.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn finish(mut self) -> Result<Taken, BuildError> {
        while !self.under_way.is_empty() {
            self.hold_first()?;
        }
        let is_new = self.added != (self.reports.len(), 0);
        self.added = (self.reports.len(), 0);
        if !self.scratch.is_empty() && is_new {
            self.spill()?;
        }
        self.tell()?;
        let Taking { partition, reports, hash, ranges, knows_scanners, .. } = self;
        Ok(Taken { partition, reports, hash, ranges, knows_scanners })
    }

    /// Tells the journal of rows that went to scratch, once they are there.
    ///
    /// # Errors
    /// Where scratch space fails.
    pub fn tell(&mut self) -> Result<(), BuildError> {
        let Some(record) = self.untold.take() else { return Ok(()) };
        self.scratch.flush()?;
        self.journal.tell(record)
    }

    /// Moves all rows to scratch, of which the journal is told, which begins with the first ones.
    fn spill(&mut self) -> Result<(), BuildError> {
        if self.journal.may_begin()
            && self.scratch.is_empty()
            && let Some(path) = self.scratch.name()?
        {
            self.journal.begin(Some(path))?;
            self.journal.tell(self.parting.intake.known())?;
        }
        self.tell()?;
        let spilled = self.partition.spill(self.scratch)?;
        if !self.journal.keeps_rows() {
            return Ok(());
        }
        let mut record = Record::new(Kind::Taken);
        record.put([self.added.0 as u64, self.added.1]);
        record.put(self.hash.0);
        record.put(u8::from(self.knows_scanners));
        let attributes = 0..self.plan().schema.attributes.len();
        let ranges: Vec<[f64; 2]> = attributes.map(|a| self.ranges.of(a).into()).collect();
        record.put_all(&ranges);
        let reports = &self.reports[self.told..self.added.0];
        record.put(reports.len() as u64);
        reports.iter().for_each(|report| put_report(report, &mut record));
        self.told = self.added.0;
        spilled.put(&mut record);
        self.untold = Some(record);
        Ok(())
    }

    /// Takes over what an earlier build has taken in.
    ///
    /// # Errors
    /// Where its records or its rows are damaged.
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
        let mut from = Reading(record);
        let [source, points] = from.get()?;
        self.added = (usize::try_from(source).ok()?, points);
        self.hash = MultisetHash(from.get()?);
        self.knows_scanners = from.get::<u8>()? > 0;
        let ranges: Vec<[f64; 2]> = from.get_all()?;
        self.ranges = Ranges::from_pairs(ranges.into_iter().map(Into::into).collect());
        for _ in 0..from.get::<u64>()? {
            self.reports.push(report(&mut from)?);
        }
        self.told = self.reports.len();
        let spilled = Spilled::get(&mut from)?;
        self.partition.restore(&spilled);
        (self.told == self.added.0).then_some(spilled)
    }
}

/// Octahedral codes of the directions from points to where they were scanned from, if that is known
/// of all.
fn towards_scanner(batch: &Batch, info: &SourceInfo, lattice: &Lattice) -> Option<Vec<[i16; 2]>> {
    let scanner = info.scanner.as_ref()?;
    let ids = batch.schema.find_typed(names::POINT_SOURCE_ID, AttrType::U16);
    let ids = ids.map(|column| batch.columns[column].as_chunks::<2>().0);
    let towards = |(i, &p): (usize, &[u32; 3])| {
        let from = scanner.of(ids.map(|ids| u16::from_le_bytes(ids[i])))?;
        let at = lattice.world(p);
        let direction = [0, 1, 2].map(|axis| (from[axis] - at[axis]) as f32);
        Some(quant::oct_encode(direction))
    };
    batch.positions.iter().enumerate().map(towards).collect()
}

fn put_report(report: &ReadReport, record: &mut Record) {
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

fn report(from: &mut Reading<'_>) -> Option<ReadReport> {
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
