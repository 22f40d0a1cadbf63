//! Steps of a build that is divided among processes or machines, as calls: each reads and writes a
//! folder that all of them share, or objects below an address, and returns a report, which is
//! printed as JSON or as text.

use crate::calls::build::{BuildReport, within_memory};
use crate::io::inputs;
use crate::io::output;
use crate::io::quantity::{grouped, readable_bytes};
use crate::machine::{pool, system};
use anyhow::{Context, Result};
use esker_builder::Options;
use esker_builder::jobs::place::{self, Place};
use esker_builder::jobs::plan::{self, PlanHow};
use esker_builder::jobs::status::{self, StepsState};
use esker_builder::jobs::{Resources, build, cut, join, take};
use esker_points::Task;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A plan.
#[derive(Clone, Debug, Serialize)]
pub struct PlanReport {
    /// Whether the folder had the same plan already.
    pub was_there: bool,
    /// Hash of the plan.
    pub plan: String,
    /// Points that the headers of the scans state.
    pub points: u64,
    /// Number of takes.
    pub takes: u32,
    /// Points of a part, unless a single cell has more.
    pub part_points_max: u64,
    /// Least memory of a take and of a build, in bytes.
    pub memory_bytes_min: u64,
    /// Most scratch of a take, if memory does not hold its points, in bytes.
    pub take_scratch_bytes_max: u64,
    /// Most memory of the cut, in bytes.
    pub cut_memory_bytes_max: u64,
    /// Most scratch of a build of parts, in bytes.
    pub build_scratch_bytes_max: u64,
    /// Bytes that all takes together leave in the folder.
    pub takes_bytes: u64,
    /// Least bytes of the file, and of the parts of which it is joined.
    pub file_bytes_min: u64,
}

/// A take.
#[derive(Clone, Debug, Serialize)]
pub struct TakeReport {
    /// Its index.
    pub index: u32,
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Points that were taken.
    pub points: u64,
    /// Cells that have them.
    pub cells: u64,
    /// Bytes that it left in the folder.
    pub bytes: u64,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
}

/// The cut.
#[derive(Clone, Debug, Serialize)]
pub struct CutReport {
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Points of all takes.
    pub points: u64,
    /// Points that were refused, by reason.
    pub refused_reasons: BTreeMap<String, u64>,
    /// Points far from nearly all others.
    pub points_set_aside: u64,
    /// Multiset hash of the points, hexadecimal.
    pub multiset_hash: String,
    /// Number of parts.
    pub parts: u32,
    /// Number of jobs that build them.
    pub builds: u32,
    /// Points of the largest of these jobs.
    pub build_points_max: u64,
}

/// A build of parts.
#[derive(Clone, Debug, Serialize)]
pub struct PartsReport {
    /// Its index.
    pub index: u32,
    /// Whether it was finished before, or another job was faster.
    pub was_done: bool,
    /// Number of parts.
    pub parts: u32,
    /// Points of these.
    pub points: u64,
    /// Bytes that it left in the folder.
    pub bytes: u64,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
}

/// State of the steps of one kind.
#[derive(Clone, Debug, Serialize)]
pub struct StepsReport {
    /// Number of steps; none while an earlier step decides it.
    pub count: Option<u32>,
    /// Steps that are not finished, as a list of ranges: `3,5-7`.
    pub missing: String,
    /// Their indices.
    #[serde(skip)]
    pub missing_indices: Vec<u32>,
    /// What is wrong with finished steps.
    pub damaged: Vec<String>,
}

/// State of the steps of all kinds.
#[derive(Clone, Debug, Serialize)]
pub struct AllSteps {
    /// The takes.
    pub take: StepsReport,
    /// The cut.
    pub cut: StepsReport,
    /// Builds of parts.
    pub build: StepsReport,
    /// The joining of the parts.
    pub join: StepsReport,
}

/// State of a divided build.
#[derive(Clone, Debug, Serialize)]
pub struct StatusReport {
    /// Hash of the plan.
    pub plan: String,
    /// The steps.
    pub steps: AllSteps,
    /// Objects of jobs that are writing, or were killed, with their bytes.
    pub leftovers: Vec<(String, u64)>,
}

/// The place that `to` names: a folder, or below an address.
fn place(to: &Path) -> Result<Box<dyn Place>> {
    place::at(to).with_context(|| to.display().to_string())
}

/// Plans the build of scans, and of the scans in folders, into the folder `to`.
///
/// # Errors
/// If a scan cannot be opened, scans or options do not fit each other, or `to` has another plan.
pub fn plan(
    inputs: &[PathBuf],
    to: &Path,
    options: &Options,
    how: &PlanHow,
    threads: usize,
    task: &dyn Task,
) -> Result<PlanReport> {
    let inputs = &inputs::scans(inputs, task)?;
    inputs::note_repeated(inputs, task);
    let report = pool::run(threads, || Ok(plan::plan(inputs, &*place(to)?, options, how, task)?))?;
    let needs = report.needs;
    Ok(PlanReport {
        was_there: report.was_there,
        plan: report.hash,
        points: report.points,
        takes: report.takes,
        part_points_max: report.part_rows_max,
        memory_bytes_min: needs.memory,
        take_scratch_bytes_max: needs.take_scratch,
        cut_memory_bytes_max: needs.cut_memory,
        build_scratch_bytes_max: needs.build_scratch,
        takes_bytes: needs.takes,
        file_bytes_min: needs.file,
    })
}

/// Number of takes of the plan in the folder `to`.
///
/// # Errors
/// If there is no plan.
pub fn takes(to: &Path) -> Result<u32> {
    Ok(take::count(&*place(to)?)?)
}

/// Does a take of the plan in the folder `to`, unless it is done.
///
/// # Errors
/// If a scan is damaged or has changed, a disk is full, or `task` is cancelled.
pub fn take(
    to: &Path,
    index: u32,
    resources: &Resources,
    threads: usize,
    task: &dyn Task,
) -> Result<TakeReport> {
    system::give_back_freed_memory();
    let report = pool::run(threads, || Ok(take::take(&*place(to)?, index, resources, task)?))?;
    let take::TakeReport { index, was_done, points, cells, bytes, scratch_bytes } = report;
    Ok(TakeReport { index, was_done, points, cells, bytes, scratch_bytes })
}

/// Sums up all takes of the plan in the folder `to`, and divides their cells into parts, unless
/// that is done.
///
/// # Errors
/// If a take is missing or damaged, the disk is full, or `task` is cancelled.
pub fn cut(to: &Path, resources: &Resources, threads: usize, task: &dyn Task) -> Result<CutReport> {
    system::give_back_freed_memory();
    let report = pool::run(threads, || Ok(cut::cut(&*place(to)?, resources, task)?))?;
    Ok(CutReport {
        was_done: report.was_done,
        points: report.points,
        refused_reasons: report.points_refused,
        points_set_aside: report.points_set_aside,
        multiset_hash: report.hash.to_string(),
        parts: report.parts,
        builds: report.builds,
        build_points_max: report.build_rows_max,
    })
}

/// Number of jobs that build parts of the plan in the folder `to`.
///
/// # Errors
/// If there is no plan, or it is not cut.
pub fn builds(to: &Path) -> Result<u32> {
    Ok(build::count(&*place(to)?)?)
}

/// Builds the parts of one job of the plan in the folder `to`, unless that is done.
///
/// # Errors
/// If the cut is missing, rows are damaged, a disk is full, or `task` is cancelled.
pub fn build(
    to: &Path,
    index: u32,
    resources: &Resources,
    threads: usize,
    task: &dyn Task,
) -> Result<PartsReport> {
    system::give_back_freed_memory();
    let built = || Ok(build::build_parts(&*place(to)?, index, resources, task)?);
    let report = pool::run(threads, built)?;
    let build::PartsReport { index, was_done, parts, points, bytes, scratch_bytes } = report;
    Ok(PartsReport { index, was_done, parts, points, bytes, scratch_bytes })
}

/// Joins the parts of the plan in the folder `to` to the file `out`.
///
/// # Errors
/// If a step is missing or damaged, the disk is full, or `task` is cancelled; no file has the final
/// name then.
pub fn join(
    to: &Path,
    out: &Path,
    resources: &Resources,
    threads: usize,
    task: &dyn Task,
) -> Result<BuildReport> {
    let start = Instant::now();
    output::may_join(out)?;
    within_memory(threads, start, || Ok(join::join(&*place(to)?, out, resources, task)?))
}

/// What is done of the plan in the folder `to`, what is missing, and what killed jobs have left.
///
/// # Errors
/// If there is no plan, or the folder cannot be read.
pub fn status(to: &Path) -> Result<StatusReport> {
    let status::Status { plan, takes, cut, builds, join, leftovers } =
        status::status(&*place(to)?)?;
    Ok(StatusReport {
        plan,
        steps: AllSteps {
            take: takes.into(),
            cut: cut.into(),
            build: builds.into(),
            join: join.into(),
        },
        leftovers: leftovers.into_iter().map(|object| (object.name, object.bytes)).collect(),
    })
}

impl From<StepsState> for StepsReport {
    fn from(state: StepsState) -> Self {
        let StepsState { count, missing, damaged } = state;
        Self { count, missing: ranges(&missing), missing_indices: missing, damaged }
    }
}

/// Numbers in order as a list of ranges, as schedulers take it: `3,5-7`.
fn ranges(numbers: &[u32]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b);
    let text = runs.map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        alone => alone.iter().map(u32::to_string).collect(),
    });
    text.collect::<Vec<_>>().join(",")
}

impl PlanReport {
    /// The report as text.
    pub fn text(&self, to: &Path) -> String {
        let was_there = if self.was_there { ", which was there already" } else { "" };
        let last = self.takes.max(1) - 1;
        [
            format!(
                "{}: plan {}{was_there}, for {} points",
                to.display(),
                self.plan,
                grouped(self.points)
            ),
            format!(
                "take: {} jobs (--job 0 to {last}), each with --memory {} or more, and up to {} of scratch where memory does not hold its points",
                self.takes,
                readable_bytes(self.memory_bytes_min),
                readable_bytes(self.take_scratch_bytes_max)
            ),
            format!(
                "cut: one job with up to {} of memory",
                readable_bytes(self.cut_memory_bytes_max)
            ),
            format!(
                "build: parts of up to {} points, each with --memory {} or more, and up to {} of scratch",
                grouped(self.part_points_max),
                readable_bytes(self.memory_bytes_min),
                readable_bytes(self.build_scratch_bytes_max)
            ),
            format!(
                "the folder takes up to {} of points, and the file and its parts {} or more each",
                readable_bytes(self.takes_bytes),
                readable_bytes(self.file_bytes_min)
            ),
        ]
        .join("\n")
    }
}

/// Words on a step that may have been done before.
fn done(was_done: bool) -> &'static str {
    if was_done { " (done before)" } else { "" }
}

impl TakeReport {
    /// The report as text.
    pub fn text(&self) -> String {
        format!(
            "take {}{}: {} points in {} cells, {}; {} through scratch",
            self.index,
            done(self.was_done),
            grouped(self.points),
            grouped(self.cells),
            readable_bytes(self.bytes),
            readable_bytes(self.scratch_bytes)
        )
    }
}

impl PartsReport {
    /// The report as text.
    pub fn text(&self) -> String {
        format!(
            "build {}{}: {} points in {} parts, {}; {} through scratch",
            self.index,
            done(self.was_done),
            grouped(self.points),
            self.parts,
            readable_bytes(self.bytes),
            readable_bytes(self.scratch_bytes)
        )
    }
}

impl CutReport {
    /// The report as text.
    pub fn text(&self) -> String {
        let mut lines = vec![format!(
            "cut{}: {} points, multiset hash {}; {} parts for {} jobs of up to {} points",
            done(self.was_done),
            grouped(self.points),
            self.multiset_hash,
            self.parts,
            self.builds,
            grouped(self.build_points_max)
        )];
        if self.points_set_aside > 0 {
            lines.push(format!("set aside: {} points", grouped(self.points_set_aside)));
        }
        for (reason, n) in &self.refused_reasons {
            lines.push(format!("refused: {} points: {reason}", grouped(*n)));
        }
        lines.join("\n")
    }
}

impl AllSteps {
    /// The steps by name, in their order.
    pub fn by_name(&self) -> [(&'static str, &StepsReport); 4] {
        let Self { take, cut, build, join } = self;
        [("take", take), ("cut", cut), ("build", build), ("join", join)]
    }
}

impl StatusReport {
    /// The report as text.
    pub fn text(&self, to: &Path) -> String {
        let mut lines = vec![format!("{}: plan {}", to.display(), self.plan)];
        for (name, steps) in self.steps.by_name() {
            lines.push(match (steps.count, steps.missing.as_str()) {
                (None, _) => format!("{name}: the number of jobs is known after the cut"),
                (Some(_), "") => format!("{name}: done"),
                (Some(1), _) => format!("{name}: missing"),
                (Some(n), missing) => format!("{name}: of {n}, missing {missing}"),
            });
            lines.extend(steps.damaged.iter().map(|damaged| format!("damaged: {damaged}")));
        }
        for (name, bytes) in &self.leftovers {
            let bytes = readable_bytes(*bytes);
            lines.push(format!("unfinished: {name}, {bytes}: a job is writing it, or was killed"));
        }
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_steps_are_listed_as_ranges() {
        assert_eq!(ranges(&[]), "");
        assert_eq!(ranges(&[3]), "3");
        assert_eq!(ranges(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
    }
}
