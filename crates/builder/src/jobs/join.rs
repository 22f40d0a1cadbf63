//! The last step of a divided build: joins the parts to one file. It copies their pages, builds the
//! cells above them, proves that the file holds all points that were taken, and only then gives the
//! file its name.

use crate::budget::disk::free_bytes;
use crate::budget::memory::{self, Peak};
use crate::budget::shares::Shares;
use crate::calls::build::{check_not_replaced, context, page_layout};
use crate::calls::closing::Build;
use crate::calls::metadata::metadata_of;
use crate::error::BuildError;
use crate::jobs::Resources;
use crate::jobs::built::{BuiltPart, unsealed_parts};
use crate::jobs::cut_file::Cut;
use crate::jobs::joined::Joined;
use crate::jobs::place::Place;
use crate::jobs::planned::Planned;
use crate::jobs::status::{remove_leftovers, status};
use crate::jobs::step::{Record, Step, failed, refused};
use crate::options::{Options, Report};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, unsealed};
use crate::rows::row::RowLayout;
use crate::rows::scratch::Scratch;
use crate::rows::store::Store;
use crate::tree::levels::TreeBuilder;
use crate::tree::waiting::RecordedChunk;
use esker_format::{FileWriter, FormatError};
use esker_points::objects;
use esker_points::read_at::{ReadAt, is_remote};
use esker_points::{Lattice, Task};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Bytes of pages that are copied at a time: whole multiples of what pages are aligned to.
const COPY_BYTES: u64 = 1 << 22;

/// Joins the parts of the plan of a place to the file `out`, which may be an address in object
/// storage, and removes what killed jobs have left.
///
/// # Errors
/// If a step is missing, or what it made is damaged; if the points are not those that were taken;
/// if the disk is full, or on request. There is no file of the name `out` then.
pub fn join(
    place: &dyn Place,
    out: &Path,
    resources: &Resources,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    let planned = Planned::read(place)?;
    planned.sources.iter().try_for_each(|source| check_not_replaced(&source.at, out))?;
    let cut = Cut::read(place, &planned)?;
    let jobs = Jobs::find(place, &planned, &cut)?;
    let options = planned.options(place, resources)?;
    let report = resources.run(task, || {
        let join = Join { place, planned: &planned, cut: &cut, options: &options, task };
        join.run(jobs, out, resources)
    })?;
    Joined::create(place, &planned.hash, out, &report)?;
    remove_leftovers(place, &status(place)?)?;
    Ok(report)
}

/// Begins the file `out`, on this machine or at an address.
fn writer_of(out: &Path, lattice: &Lattice) -> Result<FileWriter, BuildError> {
    if !is_remote(out) {
        return Ok(FileWriter::create(out)?);
    }
    let unnamed = || io::Error::new(io::ErrorKind::InvalidInput, "the address names no file");
    let upload = objects::split(out)
        .ok_or_else(unnamed)
        .and_then(|(place, name)| objects::at(place)?.begin(name))
        .map_err(|source| FormatError::Io { path: out.into(), what: "write it", source })?;
    Ok(FileWriter::send(out, upload, lattice)?)
}

/// The objects of the jobs that have built parts.
struct Jobs {
    /// Records of the jobs.
    records: Vec<Record>,
    /// Places of the parts, with the job of each.
    parts: Vec<(u32, BuiltPart)>,
    /// The object that was read last, and its job.
    open: Option<(u32, Arc<dyn ReadAt>)>,
}

impl Jobs {
    /// Finds all jobs, and where their parts are.
    fn find(place: &dyn Place, planned: &Planned, cut: &Cut) -> Result<Self, BuildError> {
        let mut missing = Vec::new();
        let (mut records, mut parts) = (Vec::new(), Vec::new());
        for (index, of_job) in (0u32..).zip(&cut.builds) {
            let step = Step::Build(index);
            let Some(record) = Record::find(place, &planned.hash, step)? else {
                missing.push(index);
                continue;
            };
            let tail = record.tail(place, step)?;
            let built = unsealed_parts(&tail, record.tail);
            let built = built.filter(|built| built.len() == of_job.len());
            let built = built.ok_or_else(|| record.damaged(place, step))?;
            parts.extend(built.into_iter().map(|part| (index, part)));
            records.push(record);
        }
        let Some(&first) = missing.first() else { return Ok(Self { records, parts, open: None }) };
        let step = Step::Build(first);
        let why = match missing.len() {
            1 => format!("is missing; run `{}` first", step.command()),
            n => format!("and {} more builds are missing; `esker job status` lists them", n - 1),
        };
        Err(refused(place, &step.record(), why))
    }

    /// Bytes of the pages of all parts.
    fn page_bytes(&self) -> u64 {
        self.parts.iter().map(|(_, part)| part.pages.end - part.pages.start).sum()
    }

    /// The object of a job.
    fn object(&mut self, place: &dyn Place, job: u32) -> Result<Arc<dyn ReadAt>, BuildError> {
        match &self.open {
            Some((open, object)) if *open == job => Ok(Arc::clone(object)),
            _ => {
                let object = self.records[job as usize].open(place, Step::Build(job))?;
                self.open = Some((job, Arc::clone(&object)));
                Ok(object)
            }
        }
    }
}

/// A join in progress.
struct Join<'a> {
    place: &'a dyn Place,
    planned: &'a Planned,
    cut: &'a Cut,
    options: &'a Options,
    task: &'a dyn Task,
}

impl Join<'_> {
    fn run(&self, mut jobs: Jobs, out: &Path, resources: &Resources) -> Result<Report, BuildError> {
        let Self { place, planned, cut, options, task } = *self;
        self.check_space(&jobs, out)?;
        let plan = cut.plan(planned);
        let pages = page_layout(&plan, options, cut.knows_scanners);
        let (palette, misfit) = cut.palette.clone().unzip();
        let pages = pages.with_palette(palette);
        let context = context(&plan, pages, cut.ranges.clone(), cut.points, options);
        let shares = Shares::of(options.memory_bytes);
        let mut store = Store {
            writer: writer_of(out, &plan.lattice)?,
            scratch: Scratch::new(&resources.folder())?,
            journal: Journal::none(),
            borders: None,
        };
        let build = Build {
            store: &mut store,
            options,
            task,
            peak: Peak::default(),
            anon_bytes_before: memory::usage().anon_bytes,
            scratch_bytes_estimated: Some(0),
        };
        task.phase("joining", Some(cut.points), "points");
        let root = TreeBuilder {
            context: &context,
            store: &mut *build.store,
            chunk_rows_max: shares.chunk_rows_max(options, &plan),
            buffer_bytes_max: usize::try_from(shares.buffer_bytes_max).unwrap_or(usize::MAX),
            task,
            peak: &build.peak,
        }
        .join(&cut.steps, &mut |part, store| {
            self.open_part(&mut jobs, part, &plan.rows(), store)
        })?;
        let points = (cut.points, cut.hash);
        let tree = build.prove_tree(root, context, &plan.schema, points, misfit)?;
        let sources = cut.sources(place, planned)?;
        let rounding = sources.iter().map(|source| source.rounding_error_max).fold(0.0, f64::max);
        let metadata = metadata_of(&plan, options, sources, cut.aside.clone());
        build.close(tree, metadata, (cut.points, cut.points_refused.clone(), cut.hash), rounding)
    }

    /// Checks that the disk has room for the pages.
    fn check_space(&self, jobs: &Jobs, out: &Path) -> Result<(), BuildError> {
        if is_remote(out) {
            return Ok(());
        }
        let folder = match out.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let needed_bytes = jobs.page_bytes();
        let Some(free_bytes) = free_bytes(folder).filter(|&free| free < needed_bytes) else {
            return Ok(());
        };
        Err(BuildError::Space {
            path: folder.into(),
            what: "the file needs",
            needed_bytes,
            free_bytes,
            remedy: "name another output",
        })
    }

    /// Copies the pages of a part to the file; returns its record.
    fn open_part(
        &self,
        jobs: &mut Jobs,
        part: u32,
        layout: &RowLayout,
        store: &mut Store,
    ) -> Result<RecordedChunk, BuildError> {
        let place = self.place;
        let Some((job, built)) = jobs.parts.get(part as usize).cloned() else {
            return Err(BuildError::Proof(format!("part {part} was not built")));
        };
        let object = jobs.object(place, job)?;
        let (record, step) = (&jobs.records[job as usize], Step::Build(job));
        let unreadable = || failed(place, &record.object, "cannot be read");
        let bytes = usize::try_from(built.record.end - built.record.start).unwrap_or(usize::MAX);
        let mut bytes = vec![0; bytes];
        object.read_exact_at(&mut bytes, built.record.start).map_err(unreadable())?;
        let is_own = |chunk: &RecordedChunk| {
            self.cut.parts.get(part as usize).is_some_and(|own| own.rows == chunk.rows)
                && chunk.pages.end - chunk.pages.start == built.pages.end - built.pages.start
        };
        let chunk = unsealed(&bytes, Kind::Chunk);
        let chunk = chunk.and_then(|content| RecordedChunk::get(content.0, layout));
        let chunk = chunk.filter(is_own).ok_or_else(|| record.damaged(place, step))?;
        drop(bytes);
        let mut crc = crc32fast::Hasher::new();
        let mut buffer = vec![0; COPY_BYTES.min(built.pages.end - built.pages.start) as usize];
        for offset in built.pages.clone().step_by(COPY_BYTES as usize) {
            self.task.check()?;
            let bytes = &mut buffer[..COPY_BYTES.min(built.pages.end - offset) as usize];
            object.read_exact_at(bytes, offset).map_err(unreadable())?;
            crc.update(bytes);
            store.writer.write_page(bytes)?;
        }
        if crc.finalize() == chunk.crc { Ok(chunk) } else { Err(record.damaged(place, step)) }
    }
}
