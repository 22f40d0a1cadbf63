//! The first step of a divided build: opens the sources as a build does, chooses lattice, schema,
//! classes and the size of cells, divides the sources into pieces, and writes it all into the
//! place, with what each step will need.

use crate::budget::memory::MEMORY_BYTES_MIN;
use crate::calls::build::{COPIES, NODES_MIN, check, new_intake, too_little_memory};
use crate::error::BuildError;
use crate::input::attribute_types::join_types;
use crate::input::guesses::note_guesses;
use crate::input::identity::time_of_change;
use crate::input::intake::{Intake, open_with};
use crate::input::plan::Plan;
use crate::jobs::pieces::{Piece, divide};
use crate::jobs::place::Place;
use crate::jobs::planned::{Needs, Planned, PlannedSource};
use crate::jobs::step::refused;
use crate::options::{Inherited, Options};
use crate::rows::borders::Borders;
use crate::rows::partition::BUCKETS_MAX;
use crate::sample::cell::Context;
use esker_format::NODE_BYTES_MAX;
use esker_points::Task;
use esker_points::address::is_remote;
use esker_points::quant::HOT_POSITION_BYTES;
use esker_scan::synthetic::is_spec;
use esker_scan::{BESIDE_HELD_BYTES, SourceInfo};
use std::path::{Path, PathBuf};

/// Points of a take or a part where the user states no number of jobs: some minutes of work.
const JOB_POINTS: u64 = 1 << 26;
/// Parts of a job that builds, about: jobs are the more alike the more there are.
const PARTS_A_JOB: u64 = 4;
/// Most takes: names of records have five digits.
pub const JOBS_MAX: u32 = 99_999;
/// Bytes that the cut holds for each cell of each take.
const CELL_BYTES: u64 = 96;
/// Memory of the cut besides: counts of colours and of densities.
const CUT_BYTES: u64 = 256 << 20;

/// How a build is divided.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlanHow {
    /// Number of takes, and of jobs that build parts; chosen by the number of points if absent.
    pub jobs: Option<u32>,
    /// Whether all points are read for the bounds and colour depths of the sources, whatever their
    /// headers state.
    pub measures: bool,
}

/// The plan that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanReport {
    /// Whether the place had the same plan already.
    pub was_there: bool,
    /// XXH3-128 of the plan.
    pub hash: String,
    /// Number of takes.
    pub takes: u32,
    /// Points that headers state.
    pub points: u64,
    /// Rows of a part, unless a single cell has more.
    pub part_rows_max: u64,
    /// What the steps need.
    pub needs: Needs,
}

/// Plans the build of `inputs`, and writes the plan into a place that has none, or the same.
///
/// # Errors
/// If an input cannot be opened, inputs or options do not fit each other, or the place has another
/// plan.
pub fn plan(
    inputs: &[PathBuf],
    place: &dyn Place,
    options: &Options,
    how: &PlanHow,
    task: &dyn Task,
) -> Result<PlanReport, BuildError> {
    if options.one_in > 1 || options.inherited != Inherited::default() {
        let why = "only whole builds are divided, no previews, appends and merges";
        return Err(BuildError::Options(why.into()));
    }
    let mut sources = open_with(inputs, &options.open_options(), task)?;
    note_guesses(&sources, options, task);
    join_types(&mut sources);
    check(&sources, options)?;
    let mut intake = new_intake(sources, options);
    if how.measures {
        intake.measure_all(task)?;
    } else {
        intake.measure_doubtful(task)?;
    }
    let plan = intake.plan()?;
    let points = intake.points_likely();
    let advised = || points.div_ceil(JOB_POINTS).clamp(1, JOBS_MAX.into()) as u32;
    let jobs = how.jobs.unwrap_or_else(advised).clamp(1, JOBS_MAX);
    let mut planned = Planned::new(&plan, options);
    let rows_max = points.div_ceil(u64::from(jobs) * PARTS_A_JOB);
    planned.part_rows_max = rows_max.max(Context::undivided_points_max(options.node_capacity));
    planned.takes = divide(&intake.sources, jobs);
    planned.jobs = jobs;
    // Takes of nearby sources have few of the cells. Where a take has too many, they coarsen.
    let cells_max = BUCKETS_MAX as u64 * (planned.takes.len() as u64).max(1);
    planned.cell_log2 = intake.partition_log2(&plan, cells_max);
    planned.needs = needs(&intake, &plan, &planned, options)?;
    planned.sources = sources_of(&intake, &plan, place)?;
    let was_there = !planned.create(place)?;
    Ok(PlanReport {
        was_there,
        takes: planned.takes.len() as u32,
        points: intake.points_hint(),
        part_rows_max: planned.part_rows_max,
        needs: planned.needs,
        hash: planned.hash,
    })
}

/// The path of a file from any folder; generated scans and addresses stay.
fn path_from_anywhere(path: &Path) -> std::io::Result<PathBuf> {
    if is_spec(path) || is_remote(path) { Ok(path.to_owned()) } else { std::path::absolute(path) }
}

fn sources_of(
    intake: &Intake,
    plan: &Plan,
    place: &dyn Place,
) -> Result<Vec<PlannedSource>, BuildError> {
    let known = intake.known();
    let source = |(i, info): (usize, &SourceInfo)| {
        let at = path_from_anywhere(&info.path).map_err(|e| {
            let path = info.path.display();
            refused(place, "plan.json", format!("{path} has no absolute path: {e}"))
        })?;
        Ok(PlannedSource {
            path: info.path.clone(),
            changed: time_of_change(&at),
            at,
            bytes: info.bytes,
            points: info.points_hint,
            grid: known.grids[i].clone(),
            is_measured: known.measured[i],
            colour_depth: intake.colour_depth(i),
            class: plan.class_of[i],
        })
    };
    intake.sources.iter().map(|source| source.info()).enumerate().map(source).collect()
}

/// What the steps need at most.
///
/// # Errors
/// If nodes have too many bytes, or the memory is too small for any step.
fn needs(
    intake: &Intake,
    plan: &Plan,
    planned: &Planned,
    options: &Options,
) -> Result<Needs, BuildError> {
    let (points, row_bytes) = (intake.points_likely(), plan.row_bytes() as u64);
    let node_points = points.min(options.node_capacity.into());
    if node_points.saturating_mul(plan.schema.record_bytes() as u64) > NODE_BYTES_MAX {
        return Err(BuildError::Options(format!(
            "attributes of {} bytes a point are too many for nodes of {node_points} points; choose a smaller --node-capacity",
            plan.schema.record_bytes(),
        )));
    }
    let node_rows =
        (u64::from(options.node_capacity) * NODES_MIN).min(points.saturating_mul(COPIES));
    let held = intake.sources.iter().map(|s| s.held_bytes()).max().unwrap_or(0);
    let reading = if held > 0 { held + BESIDE_HELD_BYTES } else { 0 };
    let memory = MEMORY_BYTES_MIN.max(node_rows * row_bytes).max(reading);
    if options.memory_bytes < memory {
        return Err(too_little_memory(memory, " for each take and each build"));
    }
    let of_piece = |piece: &Piece| match piece.points {
        Some([first, end]) => end - first,
        None => intake.sources[piece.source as usize].info().points_hint,
    };
    let of_take = |pieces: &Vec<Piece>| pieces.iter().map(of_piece).fold(0, u64::saturating_add);
    let take_points = planned.takes.iter().map(of_take).max().unwrap_or(0).min(points);
    let part_points = planned.part_rows_max.min(points);
    let cells = take_points.min(BUCKETS_MAX as u64) * planned.takes.len() as u64;
    let border = if plan.computed.is_any() { Borders::point_bytes(&plan.rows()) as u64 } else { 0 };
    Ok(Needs {
        memory,
        take_scratch: take_points.saturating_mul(row_bytes),
        cut_memory: cells.saturating_mul(CELL_BYTES).saturating_add(CUT_BYTES),
        build_scratch: part_points.saturating_mul(2 * row_bytes + border),
        takes: points.saturating_mul(row_bytes),
        file: points.saturating_mul(HOT_POSITION_BYTES as u64),
    })
}
