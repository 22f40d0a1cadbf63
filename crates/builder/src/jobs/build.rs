//! Builds the parts of one job of a divided build: loads their rows, and those beside them, from
//! the objects of the takes, builds each part as a build in one process does, and writes its pages,
//! as if they stood at the beginning of a file, with the record from which they are joined.

use crate::budget::memory::Peak;
use crate::budget::shares::Shares;
use crate::calls::build::{borders_of, context, note_reach, page_layout};
use crate::error::BuildError;
use crate::input::plan::Plan;
use crate::jobs::Resources;
use crate::jobs::built::{BuiltPart, seal_parts};
use crate::jobs::cut_file::{Cut, TakenObjects};
use crate::jobs::loading::Loading;
use crate::jobs::parts::Part;
use crate::jobs::place::{Place, unique};
use crate::jobs::planned::Planned;
use crate::jobs::step::{Output, Record, Step, refused};
use crate::options::Options;
use crate::rows::journal::Journal;
use crate::rows::partition::{Bucket, Partition};
use crate::rows::scratch::Scratch;
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::tree::levels::TreeBuilder;
use crate::tree::waiting::record_of;
use esker_format::{FileWriter, FormatError};
use esker_points::Task;
use esker_points::read_at::ReadAt;

/// Bytes of pages that are copied at a time.
const COPY_BYTES: u64 = 1 << 20;

/// What a build of parts did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartsReport {
    /// Index of the job.
    pub index: u32,
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Number of its parts.
    pub parts: u32,
    /// Points of the parts.
    pub points: u64,
    /// Bytes of the object.
    pub bytes: u64,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
}

/// Builds the parts of job `index` of the plan of a place, unless that is done.
///
/// # Errors
/// If there is no such job, or the cut is missing; if rows are damaged; if disk or place are full,
/// or on request.
pub fn build_parts(
    place: &dyn Place,
    index: u32,
    resources: &Resources,
    task: &dyn Task,
) -> Result<PartsReport, BuildError> {
    let planned = Planned::read(place)?;
    let cut = Cut::read(place, &planned)?;
    let step = Step::Build(index);
    let Some(parts) = cut.builds.get(index as usize).cloned() else {
        let (name, count) = (Step::Cut.record(), cut.builds.len());
        let why = format!("has {count} jobs, 0 to {}, no job {index}", count.saturating_sub(1));
        return Err(refused(place, &name, why));
    };
    let mut report = PartsReport {
        index,
        was_done: true,
        parts: parts.len() as u32,
        points: cut.rows_of(index as usize),
        bytes: 0,
        scratch_bytes: 0,
    };
    if let Some(record) = Record::find(place, &planned.hash, step)? {
        return Ok(PartsReport { bytes: record.bytes, ..report });
    }
    let options = planned.options(place, resources)?;
    resources.run(task, || {
        let plan = cut.plan(&planned);
        let takes = cut.rows();
        let (planned, options) = (&planned, &options);
        let job = Job { place, cut: &cut, takes, plan, options, resources, task };
        task.phase("building", Some(report.points), "points");
        let mut output = Output::begin(place, &planned.hash, step)?;
        let mut built = Vec::with_capacity(parts.len());
        for part in parts {
            let (part, scratch_bytes) = job.build(part, &mut output)?;
            report.scratch_bytes += scratch_bytes;
            built.push(part);
        }
        task.check()?;
        let (record, is_own) = output.publish(&seal_parts(&built))?;
        Ok(PartsReport { was_done: !is_own, bytes: record.bytes, ..report })
    })
}

/// Number of jobs that build the parts of the plan of a place.
///
/// # Errors
/// If there is no plan, or it is not cut.
pub fn count(place: &dyn Place) -> Result<u32, BuildError> {
    Ok(Cut::read(place, &Planned::read(place)?)?.builds.len() as u32)
}

/// A job that builds parts.
struct Job<'a> {
    place: &'a dyn Place,
    cut: &'a Cut,
    takes: TakenObjects,
    plan: Plan,
    options: &'a Options,
    resources: &'a Resources,
    task: &'a dyn Task,
}

impl Job<'_> {
    /// Builds a part into the object of the job. Also returns the bytes written to scratch.
    fn build(&self, index: u32, output: &mut Output<'_>) -> Result<(BuiltPart, u64), BuildError> {
        let Self { place, cut, options, task, .. } = *self;
        let part = cut.part(place, index)?;
        let (cell, rows) = (cut.parts[index as usize].cell, cut.parts[index as usize].rows);
        let context = self.context();
        let folder = self.resources.folder();
        let mut store = Store {
            // Its name is that of no other file.
            writer: FileWriter::create(&folder.join(format!("esker-part-{}", unique())))?,
            scratch: Scratch::new(&folder)?,
            journal: Journal::none(),
            borders: None,
        };
        let shares = Shares::of(options.memory_bytes);
        let buffer_bytes_max = usize::try_from(shares.buffer_bytes_max).unwrap_or(usize::MAX);
        let buckets = self.load(&part, rows, buffer_bytes_max, &mut store.scratch)?;
        if let Some(distances) = &cut.distances {
            note_reach(distances, context.scale, task);
            let mut borders = borders_of(&context, distances, options);
            for beside in &part.halo {
                let loading = self.loading();
                loading.each_block(std::slice::from_ref(beside), &mut |rows| {
                    borders.add_beside(&cell, beside.cell, &[&rows], &mut store.scratch)
                })?;
            }
            store.borders = Some(borders);
        }
        let start = store.writer.offset();
        let built = TreeBuilder {
            context: &context,
            store: &mut store,
            chunk_rows_max: shares.chunk_rows_max(options, &self.plan),
            buffer_bytes_max,
            task,
            peak: &Peak::default(),
        }
        .build_part(buckets)?;
        let pages = start..store.writer.offset();
        let first = output.bytes();
        let crc = self.copy(&mut store.writer, (pages.start, pages.end), output)?;
        let chunk = (rows, pages.clone(), crc);
        let record = record_of(&context, chunk, &context.counts, &built.record(), built.below());
        let at = output.bytes();
        output.write(&record.seal())?;
        let part = BuiltPart { pages: first..at, record: at..output.bytes() };
        Ok((part, store.scratch.bytes() + pages.end))
    }

    /// Context of the whole tree, without counts.
    fn context(&self) -> Context {
        let Self { cut, plan, options, .. } = self;
        let pages = page_layout(plan, options, cut.knows_scanners);
        let pages = pages.with_palette(cut.palette.as_ref().map(|(palette, _)| palette.clone()));
        context(plan, pages, cut.ranges.clone(), cut.points, options)
    }

    fn loading(&self) -> Loading<'_> {
        Loading {
            place: self.place,
            takes: &self.takes,
            stride: self.plan.row_bytes(),
            task: self.task,
        }
    }

    /// Loads the rows of a part, sorted into cells.
    fn load(
        &self,
        part: &Part,
        rows: u64,
        buffer_bytes_max: usize,
        scratch: &mut Scratch,
    ) -> Result<Vec<Bucket>, BuildError> {
        let stride = self.plan.row_bytes();
        let log2 = part.cells.iter().map(|own| own.cell.log2).max().unwrap_or(0);
        let is_spilling = rows.saturating_mul(stride as u64) > buffer_bytes_max as u64;
        let mut partition = Partition::new(stride, log2, buffer_bytes_max, is_spilling);
        self.loading().each_sorted(&part.cells, log2, &mut |block| {
            if partition.is_full_for(&block) {
                partition.spill(scratch)?;
            }
            partition.hold(block);
            if partition.is_full() {
                partition.spill(scratch)?;
            }
            Ok(())
        })?;
        let buckets = partition.finish(scratch)?;
        let loaded: u64 = buckets.iter().map(|bucket| bucket.rows).sum();
        if loaded == rows {
            return Ok(buckets);
        }
        Err(BuildError::Proof(format!("a part of {rows} points, of which {loaded} were loaded")))
    }

    /// Copies pages to the object of the job; returns their CRC-32.
    fn copy(
        &self,
        writer: &mut FileWriter,
        (start, end): (u64, u64),
        output: &mut Output<'_>,
    ) -> Result<u32, BuildError> {
        let written = writer.written()?;
        let mut crc = crc32fast::Hasher::new();
        let mut buffer = vec![0; COPY_BYTES as usize];
        for offset in (start..end).step_by(COPY_BYTES as usize) {
            self.task.check()?;
            let bytes = &mut buffer[..COPY_BYTES.min(end - offset) as usize];
            written.read_exact_at(bytes, offset).map_err(|source| FormatError::Io {
                path: self.resources.folder(),
                what: "read pages in it",
                source,
            })?;
            crc.update(bytes);
            output.write(bytes)?;
        }
        Ok(crc.finalize())
    }
}
