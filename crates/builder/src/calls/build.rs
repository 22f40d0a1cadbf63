//! One build from first to last: checks options and budget, decodes the inputs, builds the tree,
//! proves that no point was lost, and closes the file. `Build::run` is the list of the phases.

use crate::attributes::blocks::Blocks;
use crate::attributes::clips::Clips;
use crate::attributes::density::Distances;
use crate::attributes::normals::{Bounds, NormalsMode};
use crate::budget::disk::{DiskEstimate, free_bytes};
use crate::budget::memory::{self, MEMORY_BYTES_MIN, Peak};
use crate::budget::shares::{SPILLED_BYTES_MAX, Shares};
use crate::calls::closing::{Build, ProvenTree};
use crate::calls::metadata::metadata;
use crate::error::BuildError;
use crate::input::attribute_types::join_types;
use crate::input::attribute_units::check_attribute_units;
use crate::input::crs::check_same_system;
use crate::input::guesses::note_guesses;
use crate::input::identity::Identity;
use crate::input::intake::{Intake, open_with};
use crate::input::outside::OFF_LATTICE;
use crate::input::plan::{Computed, DecodedInputs, Plan, schema_of};
use crate::options::{CAPACITY_RANGE, Options, Report, Resume};
use crate::page::histograms::Counts;
use crate::rows::borders::Borders;
use crate::rows::journal::Journal;
use crate::rows::partition::Bucket;
use crate::rows::scratch::Scratch;
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::sample::marks::{WireMarks, has_wires};
use crate::tree::levels::TreeBuilder;
use esker_format::NODE_BYTES_MAX;
use esker_format::{FileWriter, Normals, PageLayout, Ranges};
use esker_points::attribute::names;
use esker_points::{AttrType, MultisetHash, Task};
use esker_scan::{ReadReport, Source};
use rayon::ThreadBuilder;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A build has memory for the points of this many nodes: those of a chunk, and the samples of cells
/// that wait for others; or, of small inputs, for `COPIES` copies of all points.
pub(crate) const NODES_MIN: u64 = 80;
pub(crate) const COPIES: u64 = 6;
/// Memory that a build uses whatever its inputs, and that each thread uses: a node or a sample in
/// progress, and what the allocator keeps for the thread.
pub(crate) const BASE_BYTES: u64 = 128 << 20;
pub(crate) const THREAD_BYTES: u64 = 56 << 20;

/// From this many chunks on the journal records chunks even if all rows are in memory; fewer are
/// quickly built again.
const UNKEPT_CHUNKS: u64 = 16;

/// Inputs that a message names.
pub(crate) const NAMES_MAX: usize = 3;

/// Builds `out` from `inputs`, in the current rayon pool, or in one of fewer threads if memory is
/// scarce. After an error there is no file under the final name.
///
/// # Errors
/// If an input is damaged, space runs out, or on request.
pub fn build(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    build_wrapped(inputs, out, options, &|sources| sources, task)
}

/// Makes other sources of the opened ones, whose points are built in their place.
pub type Wrap<'a> = dyn Fn(Vec<Box<dyn Source>>) -> Vec<Box<dyn Source>> + Sync + 'a;

/// Builds like [`build`], from what `wrap` makes of the sources.
///
/// # Errors
/// As for [`build`].
pub fn build_wrapped(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    wrap: &Wrap<'_>,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    inputs.iter().try_for_each(|input| check_not_replaced(input, out))?;
    let sources = open_with(inputs, &options.open_options(), task)?;
    note_guesses(&sources, options, task);
    build_sources(wrap(sources), out, options, task)
}

/// Builds `out` from opened inputs; otherwise like [`build`].
///
/// # Errors
/// If an input is damaged, space runs out, or on request.
pub fn build_sources(
    sources: Vec<Box<dyn Source>>,
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    if options.memory_bytes < MEMORY_BYTES_MIN {
        return Err(too_little_memory(MEMORY_BYTES_MIN, ""));
    }
    let held_bytes = sources.iter().map(|s| s.held_bytes()).max().unwrap_or(0);
    let shares = Shares::of(options.memory_bytes).beside(held_bytes, options.memory_bytes);
    let build = || build_shared(sources, out, options, shares, task);
    let threads_max = ((options.memory_bytes - BASE_BYTES) / THREAD_BYTES) as usize;
    if rayon::current_num_threads() <= threads_max {
        return build();
    }
    task.note(&format!(
        "{threads_max} threads work: more need more --memory, {} MiB each",
        THREAD_BYTES >> 20
    ));
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads_max);
    threads
        .build_scoped(ThreadBuilder::run, |pool| pool.install(build))
        .map_err(BuildError::no_thread)?
}

/// Builds `out` from opened inputs with the given shares of memory, which may be smaller than on
/// any machine: tests build small clouds by the code paths of clouds larger than memory.
///
/// # Errors
/// If an input is damaged, space runs out, or on request.
pub fn build_shared(
    mut sources: Vec<Box<dyn Source>>,
    out: &Path,
    options: &Options,
    shares: Shares,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    join_types(&mut sources);
    check(&sources, options)?;
    let folder = options.scratch.clone().unwrap_or_else(std::env::temp_dir);
    let mut store = open_store(&sources, (out, &folder), options, &shares, task)?;
    let build = Build {
        store: &mut store,
        options,
        task,
        peak: Peak::default(),
        anon_bytes_before: memory::usage().anon_bytes,
        scratch_bytes_estimated: None,
    };
    let built = build.run(sources, (out, &folder), shares);
    let is_resumable = built.as_ref().is_err_and(BuildError::is_resumable);
    let is_kept = is_resumable && store.journal.is_begun();
    store.keep(is_kept);
    match built {
        // The earlier build's steps were correct when they were recorded,
        // so its files have changed.
        Err(BuildError::Proof(_)) if store.journal.is_resumed() => {
            Err(store.journal.damaged("what it has left"))
        }
        Err(error) if is_kept && !matches!(error, BuildError::Resume { .. }) => {
            Err(BuildError::Kept(Box::new(error)))
        }
        built => built,
    }
}

/// Opens the files of a build: the output, scratch and the journal, new ones or those of an
/// interrupted build.
fn open_store(
    sources: &[Box<dyn Source>],
    (out, folder): (&Path, &Path),
    options: &Options,
    shares: &Shares,
    task: &dyn Task,
) -> Result<Store, BuildError> {
    let scratch = Scratch::new(folder)?.for_output(out);
    // A journal without an unfinished file belongs to a finished build, which was stopped between
    // renaming the file and deleting the journal.
    let was_interrupted = FileWriter::has_left(out);
    let is_resumed = options.resume == Resume::Now && was_interrupted;
    let resume =
        if options.resume == Resume::Now && !is_resumed { Resume::Later } else { options.resume };
    let mut writer = if is_resumed { FileWriter::resume(out)? } else { FileWriter::create(out)? };
    writer.keep(is_resumed);
    let identity = Identity::of(sources, options, shares);
    let journal = Journal::open(out, resume, identity)?;
    if options.resume == Resume::Now && !journal.is_resumed() {
        task.note("there is nothing to resume; starting afresh");
    }
    if scratch.remove_stale(journal.rows()) > 0 {
        task.note(
            "removed scratch files of an earlier build of this output, whose journal is lost",
        );
    }
    if let Some(why) = journal.abandoned().filter(|_| was_interrupted) {
        let out = out.display();
        task.note(&format!("{out}: an earlier build of it was cut; it is begun afresh ({why})"));
    }
    Ok(Store { writer, scratch, journal, borders: None })
}

/// Refuses an output that is one of the inputs.
pub(crate) fn check_not_replaced(input: &Path, out: &Path) -> Result<(), BuildError> {
    let is_same = match (input.canonicalize(), out.canonicalize()) {
        (Ok(input), Ok(out)) => input == out,
        _ => input == out,
    };
    if is_same {
        let path = input.display();
        return Err(BuildError::Options(format!(
            "{path}: is input and output at once; choose another output"
        )));
    }
    Ok(())
}

pub(crate) fn too_little_memory(least: u64, why: &str) -> BuildError {
    let least = least.div_ceil(1 << 20);
    BuildError::Options(format!("--memory must be at least {least} MiB{why}"))
}

/// Refuses options that contradict themselves or the inputs.
pub(crate) fn check(sources: &[Box<dyn Source>], options: &Options) -> Result<(), BuildError> {
    let refuse = |text: String| Err(BuildError::Options(text));
    if sources.is_empty() {
        return refuse("no input: name at least one scan file".into());
    }
    if !CAPACITY_RANGE.contains(&options.node_capacity) {
        let (low, high) = (CAPACITY_RANGE.start(), CAPACITY_RANGE.end());
        return refuse(format!(
            "a node capacity of {} is outside {low} to {high}",
            options.node_capacity
        ));
    }
    for (is_chosen, option) in
        [(options.sharp_features, "--sharp-features"), (options.tangents, "--tangents")]
    {
        if is_chosen && options.normals == NormalsMode::None {
            return refuse(format!("{option} needs normals; leave out --normals none"));
        }
    }
    let infos = || sources.iter().map(|s| s.info());
    check_attribute_units(infos().map(|i| (i.path.as_path(), &*i.schema)))?;
    if options.ignore_crs {
        return Ok(());
    }
    let mut infos: Vec<_> =
        infos().filter(|i| i.crs.as_ref().is_some_and(|crs| !crs.text.is_empty())).collect();
    infos.sort_by_key(|i| i.path.as_os_str().as_encoded_bytes());
    let given = options.crs.iter().map(|crs| ("--crs".to_owned(), crs.text.as_str()));
    let of_infos = infos
        .iter()
        .map(|i| (i.path.display().to_string(), i.crs.as_ref().map_or("", |c| c.text.as_str())));
    let systems: Vec<_> = given.chain(of_infos).collect();
    check_same_system(systems.iter().map(|(path, text)| (path.as_str(), *text)))
}

impl Build<'_> {
    /// Runs the phases in their order. `folder` takes scratch files.
    fn run(
        mut self,
        sources: Vec<Box<dyn Source>>,
        (out, folder): (&Path, &Path),
        mut shares: Shares,
    ) -> Result<Report, BuildError> {
        shares.chunk_bytes_max = self.store.journal.chunk_bytes_max();
        let mut intake = new_intake(sources, self.options);
        self.scratch_bytes_estimated = self.check_budget(&intake, &mut shares, (out, folder))?;
        let buffer_bytes_max = usize::try_from(shares.buffer_bytes_max).unwrap_or(usize::MAX);
        let files = (&mut self.store.scratch, &mut self.store.journal);
        let (plan, inputs) = intake.decode(files, buffer_bytes_max, self.task, &self.peak)?;
        let (points, points_refused) = count_points(&intake, &inputs.reports)?;
        if self.options.refuse_loss && !points_refused.is_empty() {
            return Err(some_refused(&intake, &points_refused));
        }
        let chunk_rows_max = shares.chunk_rows_max(self.options, &plan);
        if points / chunk_rows_max.0 >= UNKEPT_CHUNKS && self.store.journal.may_begin() {
            self.store.journal.begin(None)?;
            self.store.journal.append(intake.known_record())?;
        }
        let DecodedInputs { partition, reports, aside, hash, ranges, knows_scanners } = inputs;
        let buckets = partition.finish(&mut self.store.scratch)?;
        let pages = page_layout(&plan, self.options, knows_scanners);
        let limits = (chunk_rows_max, buffer_bytes_max);
        let tree = self.build_tree(&plan, buckets, (pages, ranges), (points, hash), limits)?;
        let metadata = metadata(&intake, &plan, (&reports, aside), self.options);
        let rounding = reports.iter().map(|r| r.rounding_error_max).fold(0.0, f64::max);
        self.close(tree, metadata, (points, points_refused, hash), rounding)
    }

    /// Checks that nodes are not too large, and that memory and disk space suffice; returns the
    /// estimated bytes of scratch. A resumed build was checked when it began.
    fn check_budget(
        &self,
        intake: &Intake,
        shares: &mut Shares,
        (out, folder): (&Path, &Path),
    ) -> Result<Option<u64>, BuildError> {
        if self.store.journal.is_resumed() {
            return Ok(None);
        }
        let options = self.options;
        let plan = intake.plan()?;
        let node_points = intake.points_likely().min(options.node_capacity.into());
        if node_points.saturating_mul(plan.schema.record_bytes() as u64) > NODE_BYTES_MAX {
            return Err(BuildError::Options(format!(
                "attributes of {} bytes a point are too many for nodes of {node_points} points; choose a smaller --node-capacity",
                plan.schema.record_bytes(),
            )));
        }
        let rows = u64::from(options.node_capacity) * NODES_MIN;
        let rows = intake.points_likely().saturating_mul(COPIES).min(rows);
        let least = rows * plan.row_bytes() as u64;
        if options.memory_bytes < least {
            let (points, bytes) = (options.node_capacity, plan.row_bytes());
            let why = format!(" for nodes of {points} points of {bytes} bytes each");
            return Err(too_little_memory(least, &why));
        }
        let chunk_rows_max = shares.chunk_rows_max(options, &plan);
        let estimate = DiskEstimate::of(intake, &plan, shares.buffer_bytes_max, chunk_rows_max);
        estimate.check(folder, out, free_bytes)?;
        let spills = estimate.spills(free_bytes(folder));
        if spills {
            shares.buffer_bytes_max = SPILLED_BYTES_MAX;
        }
        Ok(Some(estimate.scratch_bytes(spills)))
    }

    /// Builds the tree of all rows, and proves that it holds `points` points with this hash.
    /// `chunk_rows_max` are the most rows of a chunk of several buckets and of one bucket,
    /// `buffer_bytes_max` the most bytes of rows that splitting a bucket keeps in memory.
    fn build_tree(
        &mut self,
        plan: &Plan,
        buckets: Vec<Bucket>,
        (pages, ranges): (PageLayout, Ranges),
        (points, hash): (u64, MultisetHash),
        (chunk_rows_max, buffer_bytes_max): ((u64, u64), usize),
    ) -> Result<ProvenTree, BuildError> {
        let (options, task) = (self.options, self.task);
        let palette = self.store.palette(&buckets, &plan.rows(), &pages, options, task)?;
        let (palette, palette_misfit) = palette.unzip();
        let context = context(plan, pages.with_palette(palette), ranges, points, options);
        task.phase("building", Some(points), "points");
        if plan.computed.is_any() && !buckets.is_empty() {
            self.store.borders = Some(new_borders(self.store, &context, &buckets, options, task)?);
        }
        let root = TreeBuilder {
            chunk_rows_max,
            context: &context,
            store: &mut *self.store,
            buffer_bytes_max,
            task,
            peak: &self.peak,
        }
        .build(buckets)?;
        self.prove_tree(root, context, &plan.schema, (points, hash), palette_misfit)
    }
}

/// Intake of `sources` with room for the attributes that the build computes.
pub(crate) fn new_intake(sources: Vec<Box<dyn Source>>, options: &Options) -> Intake {
    let are_given = schema_of(&sources).normals().is_some();
    let mut intake = Intake::new(sources, options.colour_depth.is_some());
    let keeps = options.normals == NormalsMode::Keep;
    intake.computed = Computed {
        normals: options.normals != NormalsMode::None && !(keeps && are_given),
        beside_given_normals: options.needs_normals() && keeps && are_given,
        clip_lines: options.sharp_features,
        tangents: options.tangents,
    };
    intake.lattice = options.inherited.lattice;
    intake.drops_outside = options.drop_outside;
    intake
}

/// Layout of pages, without the planes that depend on colours and edges.
pub(crate) fn page_layout(plan: &Plan, options: &Options, knows_scanners: bool) -> PageLayout {
    let pages = PageLayout::new(&plan.schema, &plan.classes);
    let normals = match options.normals {
        NormalsMode::None => Normals::None,
        _ if !plan.computed.normals => pages.normals(),
        _ if knows_scanners => Normals::Oriented,
        _ => Normals::Estimated,
    };
    pages.with_codec(options.compress).with_normals(normals)
}

/// Context in which all cells are sampled and all nodes are finished.
pub(crate) fn context(
    plan: &Plan,
    pages: PageLayout,
    ranges: Ranges,
    points: u64,
    options: &Options,
) -> Context {
    let clips = Clips::of(&plan.schema, &plan.lattice, options.sharp_features);
    let clips = clips.filter(|_| pages.normals() != Normals::None);
    let rows = plan.rows();
    let class = plan.schema.find_typed(names::CLASSIFICATION, AttrType::U8);
    let class = class.filter(|&attribute| has_wires(ranges.of(attribute).into()));
    let marks = WireMarks {
        class_at: class.map(|attribute| rows.attribute(attribute).start),
        normal_at: rows.normal_at(),
    };
    Context {
        wires: Some(marks).filter(|marks| marks.any()),
        rows,
        pages: pages.with_clip_lines(clips.is_some()).with_tangents(options.tangents),
        clips,
        scale: plan.lattice.metric().scale,
        capacity: options.node_capacity as usize,
        points,
        counts: Counts::new(ranges),
    }
}

/// Borders of chunks, for the estimation of normals: still empty.
fn new_borders(
    store: &mut Store,
    context: &Context,
    buckets: &[Bucket],
    options: &Options,
    task: &dyn Task,
) -> Result<Borders, BuildError> {
    let distances = store.distances(buckets, context.rows.bytes(), context.scale)?;
    note_reach(&distances, context.scale, task);
    Ok(borders_of(context, &distances, options))
}

/// A note if the steps of the axes limit how far normals are estimated.
pub(crate) fn note_reach(distances: &Distances, scale: [f64; 3], task: &dyn Task) {
    if let Some(longest) = distances.limit(scale) {
        task.note(&format!(
            "normals are estimated from points within {longest:.3e} at most, since the steps of the axes differ by orders of magnitude; points without near neighbours get none. Files with the same step on all axes have no such limit"
        ));
    }
}

/// Borders of chunks of points that are so far apart: still empty.
pub(crate) fn borders_of(context: &Context, distances: &Distances, options: &Options) -> Borders {
    let bounds = Bounds::new(context.scale, distances);
    let mut borders = Borders::new(bounds, context.rows.clone(), options.sharp_features);
    borders.finds_shapes = options.tangents;
    borders.blocks = options.estimates_fast().then(|| Blocks::new(context.scale, distances));
    borders
}

/// Counts the points that were decoded, and those that were refused, by reason.
///
/// # Errors
/// If there are points, but all were refused.
fn count_points(
    intake: &Intake,
    reports: &[ReadReport],
) -> Result<(u64, BTreeMap<String, u64>), BuildError> {
    let points: u64 = reports.iter().map(|r| r.points).sum();
    let mut refused = BTreeMap::new();
    for (reason, n) in reports.iter().flat_map(|r| &r.refused) {
        *refused.entry(reason.clone()).or_default() += n;
    }
    if points == 0 && !refused.is_empty() {
        return Err(all_refused(intake, &refused));
    }
    Ok((points, refused))
}

/// The error for inputs that have points, all of which were refused.
fn all_refused(intake: &Intake, refused: &BTreeMap<String, u64>) -> BuildError {
    let remedy = if refused.contains_key(OFF_LATTICE) {
        "build them into a file of their own"
    } else {
        "look at what wrote them"
    };
    BuildError::Refused {
        inputs: names_of(intake),
        points: refused.values().sum(),
        why: format!("{}; {remedy}", reasons(refused)),
    }
}

/// The error for inputs of which some points were refused.
fn some_refused(intake: &Intake, refused: &BTreeMap<String, u64>) -> BuildError {
    let points = refused.values().sum();
    BuildError::Lost { inputs: names_of(intake), points, why: reasons(refused) }
}

/// Names of the inputs, or of the first ones.
fn names_of(intake: &Intake) -> String {
    let paths = intake.sources.iter().map(|s| s.info().path.display().to_string());
    let mut inputs: Vec<_> = paths.take(NAMES_MAX).collect();
    if intake.sources.len() > NAMES_MAX {
        inputs.push(format!("{} more", intake.sources.len() - NAMES_MAX));
    }
    inputs.join(", ")
}

/// Numbers of refused points, each with its reason.
pub(crate) fn reasons(refused: &BTreeMap<String, u64>) -> String {
    refused.iter().map(|(why, n)| format!("{n}: {why}")).collect::<Vec<_>>().join(", ")
}
