//! Runs decoding, Esker and the rival in turn on all inputs, and hands what they took to `report`.

use crate::build::child::{self, ChildRun};
use crate::build::program::Program;
use crate::build::report::{self, BuildBenchReport};
use crate::build::request::BuildBenchRequest;
use anyhow::{Context, Result, ensure};
use esker_points::Task;

/// Measures building.
///
/// # Errors
/// If there is nothing to measure, a folder cannot be made, or `task` is cancelled. A program that
/// fails is no error, but a row of the report.
pub fn measure(request: &BuildBenchRequest, task: &dyn Task) -> Result<BuildBenchReport> {
    ensure!(!request.inputs.is_empty(), "no input: name scans");
    ensure!(request.runs > 0, "--runs must be at least 1");
    let folder = request.folder.clone().unwrap_or_else(std::env::temp_dir);
    let mut programs = vec![Program::Decode, Program::Esker];
    programs.extend(request.rival.clone().map(Program::Rival));
    // Runs of each input and program.
    let mut runs: Vec<Vec<Vec<ChildRun>>> =
        vec![vec![Vec::new(); programs.len()]; request.inputs.len()];
    for run in 0..request.runs {
        for (input, runs) in request.inputs.iter().zip(&mut runs) {
            for (program, runs) in programs.iter().zip(runs) {
                // A program that failed once would fail again.
                if runs.iter().any(|r| r.error.is_some()) {
                    continue;
                }
                let name = program.name();
                let phase =
                    format!("{}: {name}, run {} of {}", input.display(), run + 1, request.runs);
                task.phase(&phase, None, "");
                let run_folder = tempfile::tempdir_in(&folder)
                    .with_context(|| format!("{}: cannot make a folder", folder.display()))?;
                let invocation = program.invocation(request, input, run_folder.path())?;
                runs.push(child::run(invocation, task)?);
            }
        }
    }
    let first = &runs[0];
    let rows = request.inputs.iter().zip(&runs);
    let rows = rows.flat_map(|(input, runs)| report::rows(input, &programs, runs, first));
    Ok(BuildBenchReport { runs: request.runs, rows: rows.collect() })
}
