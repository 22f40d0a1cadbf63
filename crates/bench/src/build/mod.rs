//! The benchmark of building: in each run all inputs are decoded, built by us and built by a rival in turn, each in a
//! process of its own; so that what the machine does meanwhile meets all alike. Medians over the runs; what fails is
//! a row too.

mod child;
mod program;
mod report;

pub use program::Against;
pub use report::{decode_text, failure, text};

use anyhow::{Context, Result, ensure};
use child::Ran;
use esker_points::Task;
use program::Program;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What is to be measured.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Scans; each is built by itself.
    pub inputs: Vec<PathBuf>,
    /// The rival, where there is one.
    pub against: Option<Against>,
    /// Runs that medians are taken of.
    pub runs: usize,
    /// The folder that all outputs and scratch files go to; the system's where not said.
    pub folder: Option<PathBuf>,
    /// Further words for `esker build`.
    pub build_words: Vec<OsString>,
    /// Words for `esker bench decode`.
    pub decode_words: Vec<OsString>,
    /// The `esker` program, for further processes.
    pub esker: PathBuf,
}

/// Measures; an object with a list of `rows`, failures among them.
///
/// # Errors
/// Where there is nothing to measure or no place for it, and on request. What fails is told by its row.
pub fn measure(plan: &Plan, task: &dyn Task) -> Result<Value> {
    ensure!(!plan.inputs.is_empty(), "no input: name scans");
    ensure!(plan.runs > 0, "no run: --runs is 1 at least");
    let folder = plan.folder.clone().unwrap_or_else(std::env::temp_dir);
    let mut programs = vec![Program::Decode, Program::Esker];
    programs.extend(plan.against.clone().map(Program::Rival));
    // Of each input and program.
    let mut runs: Vec<Vec<Vec<Ran>>> = vec![vec![Vec::new(); programs.len()]; plan.inputs.len()];
    for run in 0..plan.runs {
        for (input, runs) in plan.inputs.iter().zip(&mut runs) {
            for (program, runs) in programs.iter().zip(runs) {
                // What failed once would fail again.
                if runs.iter().any(|r| r.error.is_some()) {
                    continue;
                }
                let name = program.name();
                let what = format!("{}: {name}, run {} of {}", input.display(), run + 1, plan.runs);
                task.phase(&what, None, "");
                let place = tempfile::tempdir_in(&folder)
                    .with_context(|| format!("{}: cannot make a folder", folder.display()))?;
                runs.push(child::run(program.command(plan, input, place.path())?, task)?);
            }
        }
    }
    let first = &runs[0];
    let rows = plan.inputs.iter().zip(&runs);
    let rows = rows.flat_map(|(input, runs)| report::rows(input, &programs, runs, first));
    Ok(json!({ "runs": plan.runs, "rows": rows.collect::<Vec<_>>() }))
}

/// Decodes scans and drops their points, looking at positions only: the floor of building. Points as their
/// headers tell them.
///
/// # Errors
/// Where an input is damaged, or on request.
pub fn decode(inputs: &[PathBuf], threads: usize, task: &dyn Task) -> Result<Value> {
    let start = Instant::now();
    let points = esker_engine::machine::pool::run(threads, || {
        let mut points = 0;
        for input in inputs {
            let source = esker_scan::open(input, &Default::default(), task)?;
            source.survey(task)?;
            points += source.info().points_hint;
        }
        Ok(points)
    })?;
    let seconds = start.elapsed().as_secs_f64();
    Ok(json!({
        "points": points,
        "seconds": seconds,
        "points_per_second": points as f64 / seconds.max(1e-9),
    }))
}

/// What a run makes, and where its scratch files go, in the folder of the run.
fn places(folder: &Path) -> [PathBuf; 2] {
    [folder.join("out"), folder.join("scratch")]
}
