//! One build from first to last: intake, chunks, levels, the file, the proof.

use crate::attributes::clips::Clips;
use crate::attributes::normals::{Bounds, NormalsMode};
use crate::budget::disk::{Needs, free_bytes};
use crate::budget::memory::{self, Peak};
use crate::budget::shares::{SPILLED_BYTES_MAX, Shares};
use crate::calls::onto::{OFF_LATTICE, Onto};
use crate::error::BuildError;
use crate::input::crs::{are_same, one_system};
use crate::input::gps_times;
use crate::input::identity::Identity;
use crate::input::intake::{Intake, Plan, Taken, open_with};
use crate::page::histograms::Counts;
use crate::rows::borders::Borders;
use crate::rows::journal::{Journal, Resume};
use crate::rows::scratch::Scratch;
use crate::rows::store::Store;
use crate::sample::cell::Context;
use crate::sample::wires::has_wires;
use crate::tree::levels::Raiser;
use crate::tree::proof::{bounds_of, hash_of, prove, prove_merged};
use crate::tree::subtree::assemble;
use esker_format::{
    Codec, CrsRecord, FileWriter, Metadata, NODE_BYTES_MAX, Normals, PageLayout, SourceRecord,
    Statistics,
};
use esker_points::attribute::names;
use esker_points::palette::Misfit;
use esker_points::{AttrType, Attribute, ColourDepth, MultisetHash, Schema, Task};
use esker_scan::las::gps_times;
use esker_scan::{OpenOptions, ReadReport, Source};
use rayon::ThreadBuilder;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Node capacities that are taken.
pub const CAPACITY_RANGE: std::ops::RangeInclusive<u32> = 64..=1 << 17;
/// The least memory a build works with, in bytes.
pub const MEMORY_BYTES_MIN: u64 = 256 << 20;
/// A build has memory for the points of so many nodes, those of a chunk and the samples of cells
/// that wait for others; or for so many copies of all.
const NODES_MIN: u64 = 80;
const COPIES: u64 = 6;
/// Memory that a build takes whatever works on it, and for each thread: nodes or samples in hand,
/// and what the allocator keeps for it.
const BASE_BYTES: u64 = 128 << 20;
const THREAD_BYTES: u64 = 56 << 20;

/// More chunks than these are told to the journal, also where all rows are in memory: fewer are
/// soon built again.
const UNKEPT_CHUNKS: u64 = 16;

/// Inputs that a message names.
const NAMES_MAX: usize = 3;

/// What the user chose.
#[derive(Clone, Debug)]
pub struct Options {
    /// Anonymous memory that the build may use above that of the empty program, in bytes.
    pub memory_bytes: u64,
    /// Where scratch files go; the system's place for temporary files where not said.
    pub scratch: Option<PathBuf>,
    /// Points a node holds.
    pub node_capacity: u32,
    /// Overrides what is detected of 16-bit colours.
    pub colour_depth: Option<ColourDepth>,
    /// How planes that are not drawn are compressed.
    pub compress: Codec,
    /// Whether inputs of different coordinate reference systems are taken as they are.
    pub ignore_crs: bool,
    /// What becomes of a build that is cut short.
    pub resume: Resume,
    /// What is taken from files that are there already: see [`crate::append()`] and
    /// [`crate::merge()`].
    pub onto: Onto,
    /// Where the normals that are drawn come from.
    pub normals: NormalsMode,
    /// Whether edges are found, at which splats are clipped; normals are estimated for it.
    pub sharp_features: bool,
    /// Whether the shapes of splats are told and kept; normals are estimated for it.
    pub tangents: bool,
    /// Whether positions are kept a second time, with their colours in a palette: what is read and
    /// resident to draw them falls from 12 bytes a point to 8.
    pub compact: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            memory_bytes: memory::default_bytes(),
            scratch: None,
            node_capacity: 1 << 16,
            colour_depth: None,
            compress: Codec::default(),
            ignore_crs: false,
            resume: Resume::default(),
            onto: Onto::default(),
            normals: NormalsMode::default(),
            sharp_features: false,
            tangents: false,
            compact: false,
        }
    }
}

impl Options {
    /// How inputs are opened.
    pub(crate) fn opening(&self) -> OpenOptions {
        OpenOptions { colour_depth: self.colour_depth, memory_bytes: Some(self.memory_bytes) }
    }
}

/// What a build did.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Points decoded, those refused included.
    pub points_in: u64,
    /// Points in the file.
    pub points_out: u64,
    /// Points refused, by reason.
    pub points_refused: BTreeMap<String, u64>,
    /// Multiset hash of the points.
    pub hash: MultisetHash,
    /// Greatest anonymous memory above that at the start, in bytes, sampled.
    pub peak_anon_bytes: u64,
    /// Greatest resident set, in bytes.
    pub peak_rss_bytes: u64,
    /// What scratch would hold at once at most, as was estimated before work started; not where a
    /// build was gone on with.
    pub scratch_bytes_estimated: Option<u64>,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
    /// The most bytes that scratch held at once.
    pub scratch_bytes_peak: u64,
    /// The most bytes that scratch and the file had at once.
    pub disk_bytes_peak: u64,
    /// Bytes of the file.
    pub bytes_out: u64,
    /// Nodes.
    pub nodes: u64,
    /// Greatest depth of a node; 0 for the root alone.
    pub depth: u32,
    /// Greatest distance by which a coordinate was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// How far colours are from those of the compact plane, where there is one.
    pub palette_misfit: Option<Misfit>,
    /// Where the normals come from that are drawn.
    pub normals: Normals,
    /// Whether the file keeps the shapes of splats.
    pub has_tangents: bool,
    /// What the user should know, a line each.
    pub notes: Vec<String>,
}

/// Builds `out` from `inputs`, in the current rayon pool, or in one of fewer threads where memory
/// is scarce. Nothing is left under the final name where it fails.
///
/// # Errors
/// Where an input is damaged, space runs out, or on request.
pub fn build(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    if let Some(same) = inputs.iter().find(|i| same_file(i, out)) {
        let same = same.display();
        return Err(BuildError::Options(format!(
            "{same}: is input and output at once; choose another output"
        )));
    }
    build_sources(open_with(inputs, &options.opening(), task)?, out, options, task)
}

/// As [`build`], from opened inputs.
///
/// # Errors
/// As [`build`].
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

/// As [`build_sources`], with the memory shared out as told, also less than any machine has: so the
/// ways of clouds larger than memory can be tried on small ones.
///
/// # Errors
/// As [`build`].
pub fn build_shared(
    sources: Vec<Box<dyn Source>>,
    out: &Path,
    options: &Options,
    shares: Shares,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    check(&sources, options)?;
    let folder = options.scratch.clone().unwrap_or_else(std::env::temp_dir);
    let scratch = Scratch::new(&folder)?;
    // A journal without a file is of a build that is finished: it was stopped between its last two
    // acts, taking its name and deleting its journal.
    let was_cut = FileWriter::has_left(out);
    let goes_on = options.resume == Resume::Now && was_cut;
    let resume =
        if options.resume == Resume::Now && !goes_on { Resume::Later } else { options.resume };
    let mut writer = if goes_on { FileWriter::resume(out)? } else { FileWriter::create(out)? };
    writer.keep(goes_on);
    let identity = Identity::of(&sources, options, &shares);
    let journal = Journal::open(out, resume, identity)?;
    let mut store = Store { writer, scratch, journal, borders: None };
    if options.resume == Resume::Now && !store.journal.is_resumed() {
        task.note("there is nothing to resume; starting afresh");
    }
    if let Some(how) = store.journal.given_up().filter(|_| was_cut) {
        let out = out.display();
        task.note(&format!("{out}: an earlier build of it was cut; it is begun afresh ({how})"));
    }
    let built = build_into(&mut store, sources, (out, &folder), options, shares, task);
    let is_passing = built.as_ref().is_err_and(BuildError::is_passing);
    let is_kept = is_passing && store.journal.is_begun();
    store.keep(is_kept);
    match built {
        // Proven before, so what the earlier build has left is not what it was.
        Err(BuildError::Proof(_)) if store.journal.is_resumed() => {
            Err(store.journal.damaged("what it has left"))
        }
        Err(error) if is_kept && !matches!(error, BuildError::Resume { .. }) => {
            Err(BuildError::Kept(Box::new(error)))
        }
        built => built,
    }
}

fn too_little_memory(least: u64, why: &str) -> BuildError {
    let least = least.div_ceil(1 << 20);
    BuildError::Options(format!("--memory must be at least {least} MiB{why}"))
}

fn build_into(
    store: &mut Store,
    sources: Vec<Box<dyn Source>>,
    (out, folder): (&Path, &Path),
    options: &Options,
    mut shares: Shares,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    let start = memory::usage().anon_bytes;
    let peak = Peak::default();
    shares.chunk_bytes_max = store.journal.chunk_bytes_max();
    let mut intake = Intake::new(sources, options.colour_depth.is_some());
    intake.estimates_normals = options.normals == NormalsMode::Estimate;
    intake.finds_edges = options.sharp_features;
    intake.finds_shapes = options.tangents;
    intake.lattice = options.onto.lattice;
    let mut scratch_bytes_estimated = None;
    if !store.journal.is_resumed() {
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
        let chunk_rows_max = shares.chunk_rows_max(options, plan.row_bytes());
        let needs = Needs::of(&intake, &plan, shares.buffer_bytes_max, chunk_rows_max);
        needs.check(folder, out, free_bytes)?;
        let spills = needs.spills(free_bytes(folder));
        scratch_bytes_estimated = Some(needs.scratch_bytes(spills));
        if spills {
            shares.buffer_bytes_max = SPILLED_BYTES_MAX;
        }
    }
    let buffer_bytes_max = usize::try_from(shares.buffer_bytes_max).unwrap_or(usize::MAX);
    let (plan, taken) =
        intake.take((&mut store.scratch, &mut store.journal), buffer_bytes_max, task, &peak)?;
    let Taken { partition, reports, hash, ranges, knows_scanners } = taken;
    let points: u64 = reports.iter().map(|r| r.points).sum();
    let points_refused = refused(&reports);
    if points == 0 && !points_refused.is_empty() {
        return Err(all_refused(&intake, &points_refused));
    }
    let chunk_rows_max = shares.chunk_rows_max(options, plan.row_bytes());
    if points / chunk_rows_max.0 >= UNKEPT_CHUNKS && store.journal.may_begin() {
        store.journal.begin(None)?;
        store.journal.tell(intake.known())?;
    }

    let pages = PageLayout::new(&plan.schema, &plan.classes);
    let normals = match options.normals {
        NormalsMode::Keep => pages.normals(),
        NormalsMode::Estimate if knows_scanners => Normals::Oriented,
        NormalsMode::Estimate => Normals::Estimated,
        NormalsMode::None => Normals::None,
    };
    let clips = Clips::of(&plan.schema, &plan.lattice, options.sharp_features);
    let clips = clips.filter(|_| normals != Normals::None);
    let pages = pages.with_codec(options.compress).with_normals(normals);
    let buckets = partition.finish(&mut store.scratch)?;
    let palette = store.palette(&buckets, &plan.rows(), &pages, options, task)?;
    let (palette, palette_misfit) = palette.unzip();
    let pages = pages.with_palette(palette.clone());
    let rows = plan.rows();
    let class = plan.schema.find_typed(names::CLASSIFICATION, AttrType::U8);
    let class = class.filter(|&attribute| has_wires(ranges.of(attribute).into()));
    let context = Context {
        class_at: class.map(|attribute| rows.attribute(attribute).start),
        rows,
        pages: pages.with_clip_lines(clips.is_some()).with_tangents(options.tangents),
        clips,
        scale: plan.lattice.scale,
        capacity: options.node_capacity as usize,
        counts: Counts::new(ranges),
    };
    let has_clip_lines = context.clips.is_some();
    task.phase("building", Some(points), "points");
    if normals.is_estimated() && !buckets.is_empty() {
        let spacing = store.spacing(&buckets, context.rows.bytes())?;
        let bounds = Bounds::new(plan.lattice.scale, spacing);
        let mut borders = Borders::new(bounds, context.rows.clone(), options.sharp_features);
        borders.finds_shapes = options.tangents;
        store.borders = Some(borders);
    }
    let root = Raiser {
        chunk_rows_max,
        context: &context,
        store: &mut *store,
        buffer_bytes_max,
        task,
        peak: &peak,
    }
    .tree(buckets)?;

    let bounds = root.as_ref().and_then(bounds_of);
    let written = root.as_ref().map_or_else(MultisetHash::default, hash_of);
    let (table, own) = assemble(root);
    prove(&table, points, written, hash)?;
    if let Some(merged) = &options.onto.merged {
        prove_merged(merged, points, hash)?;
    }
    let histograms = context.counts.into_inner();
    let statistics = Statistics::assemble(&table, &plan.schema, own, histograms);
    let depth = table.depths().into_iter().max().unwrap_or(0);
    let mut metadata = metadata(&intake, &plan, &reports, options);
    metadata.normals = normals;
    metadata.has_clip_lines = has_clip_lines;
    metadata.has_tangents = options.tangents;
    metadata.palette = palette;
    metadata.bounds = bounds;
    peak.sample();
    task.check()?;
    let bytes_out = store.writer.finish(&table, &statistics, &metadata, points, hash)?;

    Ok(Report {
        points_in: points + points_refused.values().sum::<u64>(),
        points_out: points,
        points_refused,
        hash,
        peak_anon_bytes: peak.bytes().saturating_sub(start),
        peak_rss_bytes: memory::usage().rss_peak_bytes,
        scratch_bytes_estimated,
        scratch_bytes: store.scratch.bytes(),
        scratch_bytes_peak: store.scratch.bytes_peak(),
        disk_bytes_peak: store.scratch.disk_bytes_peak().max(bytes_out),
        bytes_out,
        nodes: table.nodes.len() as u64,
        depth,
        rounding_error_max: reports.iter().map(|r| r.rounding_error_max).fold(0.0, f64::max),
        palette_misfit,
        normals,
        has_tangents: options.tangents,
        notes: notes(&metadata),
    })
}

/// The points that were refused, by reason.
fn refused(reports: &[ReadReport]) -> BTreeMap<String, u64> {
    let mut all = BTreeMap::new();
    for (reason, n) in reports.iter().flat_map(|r| &r.refused) {
        *all.entry(reason.clone()).or_default() += n;
    }
    all
}

/// Inputs that have points, of which none can be taken, make no file.
fn all_refused(intake: &Intake, refused: &BTreeMap<String, u64>) -> BuildError {
    let paths = intake.sources.iter().map(|s| s.info().path.display().to_string());
    let mut inputs: Vec<_> = paths.take(NAMES_MAX).collect();
    if intake.sources.len() > NAMES_MAX {
        inputs.push(format!("{} more", intake.sources.len() - NAMES_MAX));
    }
    let reasons: Vec<_> = refused.iter().map(|(why, n)| format!("{n}: {why}")).collect();
    let way_out = if refused.contains_key(OFF_LATTICE) {
        "build them into a file of their own"
    } else {
        "look at what wrote them"
    };
    BuildError::Refused {
        inputs: inputs.join(", "),
        points: refused.values().sum(),
        why: format!("{}; {way_out}", reasons.join(", ")),
    }
}

fn check(sources: &[Box<dyn Source>], options: &Options) -> Result<(), BuildError> {
    let say = |text: String| Err(BuildError::Options(text));
    if sources.is_empty() {
        return say("no input: name at least one scan file".into());
    }
    if !CAPACITY_RANGE.contains(&options.node_capacity) {
        let (low, high) = (CAPACITY_RANGE.start(), CAPACITY_RANGE.end());
        return say(format!(
            "a node capacity of {} is outside {low} to {high}",
            options.node_capacity
        ));
    }
    if options.sharp_features && options.normals != NormalsMode::Estimate {
        return say(
            "sharp features are found while normals are estimated; add --normals estimate".into()
        );
    }
    if options.tangents && options.normals != NormalsMode::Estimate {
        return say("tangents are told while normals are estimated; add --normals estimate".into());
    }
    one_meaning(sources.iter().map(|s| s.info()).map(|i| (i.path.as_path(), &*i.schema)))?;
    if options.ignore_crs {
        return Ok(());
    }
    let mut systems: Vec<_> =
        sources.iter().map(|s| s.info()).filter(|i| i.crs.is_some()).collect();
    systems.sort_by_key(|i| i.path.as_os_str().as_encoded_bytes());
    let said = systems
        .iter()
        .map(|i| (i.path.display().to_string(), i.crs.as_ref().map_or("", |c| &c.text)));
    let said: Vec<_> = said.collect();
    one_system(said.iter().map(|(path, text)| (path.as_str(), *text)))
}

/// Refuses attributes of one name and type whose stored values mean different things in different
/// files.
pub(crate) fn one_meaning<'a>(
    files: impl Iterator<Item = (&'a Path, &'a Schema)>,
) -> Result<(), BuildError> {
    // Of thousands of files most have the same attributes.
    let mut known: Vec<(&Path, &Schema)> = Vec::new();
    for (path, schema) in files {
        if known.iter().any(|(_, other)| *other == schema) {
            continue;
        }
        let conflict = known.iter().find_map(|(at, other)| Some((at, other.conflict(schema)?)));
        if let Some((at, [theirs, own])) = conflict {
            let steps = |a: &Attribute| format!("{} * n + {}", a.scale, a.offset);
            return Err(BuildError::Options(format!(
                "`{}` of {} is {}, and of {} is {}: both cannot be kept under one name; give it one scale and offset in all of them, or another name, or build the files apart",
                own.name,
                at.display(),
                steps(theirs),
                path.display(),
                steps(own)
            )));
        }
        known.push((path, schema));
    }
    Ok(())
}

fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

fn metadata(intake: &Intake, plan: &Plan, reports: &[ReadReport], options: &Options) -> Metadata {
    let record = |(i, report): (usize, &ReadReport)| {
        let info = intake.sources[i].info();
        SourceRecord {
            path: info.path.display().to_string(),
            format: info.format.clone(),
            grid: intake.grid(i).clone(),
            points: report.points,
            refused: report.refused.clone(),
            rounding_error_max: report.rounding_error_max,
            colour_depth: intake.colour_depth(i),
            colour_depth_forced: options.colour_depth.is_some() && info.colour_depth.is_some(),
            class: plan.class_of[i],
            crs: info
                .crs
                .as_ref()
                .map(|c| CrsRecord { text: c.text.clone(), unit: c.unit.clone() }),
            notes: info.notes.iter().chain(&report.notes).cloned().collect(),
            verbatim: info.verbatim.clone(),
        }
    };
    Metadata {
        lattice: plan.lattice,
        bounds: None,
        schema: plan.schema.clone(),
        classes: plan.classes.clone(),
        node_capacity: options.node_capacity,
        normals: Normals::None,
        has_clip_lines: false,
        has_tangents: false,
        palette: None,
        codec: options.compress,
        sources: match &options.onto.merged {
            None => reports.iter().enumerate().map(record).collect(),
            Some(merged) => merged.records.iter().map(|r| of_merged(intake, plan, r)).collect(),
        },
        forest: options.onto.forest.clone(),
        generator: concat!("esker ", env!("CARGO_PKG_VERSION")).into(),
    }
}

/// The record of a source whose points were merged, with their class in the new file.
fn of_merged(
    intake: &Intake,
    plan: &Plan,
    (path, record): &(PathBuf, SourceRecord),
) -> SourceRecord {
    let at = intake.sources.iter().position(|source| source.info().path == *path);
    SourceRecord { class: at.map_or(0, |i| plan.class_of[i]), ..record.clone() }
}

/// The notes on all sources; and a word where their reference systems differ, or what their GPS
/// times are counted from.
fn notes(metadata: &Metadata) -> Vec<String> {
    let mut out: Vec<String> = metadata
        .sources
        .iter()
        .flat_map(|s| s.notes.iter().map(move |n| format!("{}: {n}", s.path)))
        .collect();
    let mut systems = metadata.sources.iter().filter_map(|s| Some((s, s.crs.as_ref()?)));
    if let Some((first, crs)) = systems.next()
        && let Some((other, _)) = systems.find(|(_, c)| !are_same(&c.text, &crs.text))
    {
        out.push(format!("{} and {} name different coordinate reference systems; coordinates are taken as they are", first.path, other.path));
    }
    out.extend(gps_times::mixed(
        metadata.sources.iter().map(|s| (s.path.clone(), gps_times(&s.verbatim))),
    ));
    out
}
