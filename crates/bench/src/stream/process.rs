//! From files and scans to runs. Each run has a process of its own, so that peaks of memory and the
//! program's own caches belong to it alone. Scans are built first, into a temporary file, once for
//! each node capacity.

use crate::stream::report::{StreamReport, StreamRun};
use crate::stream::request::{FlightRequest, Settings, StreamBenchRequest};
use crate::stream::{line, run};
use anyhow::{Context, Result, bail, ensure};
use esker_engine::io::file::{is_copc, is_esker};
use esker_engine::io::output;
use esker_engine::machine::pool;
use esker_points::Task;
use esker_points::address::{is_remote, whole};
use std::ffi::OsString;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

/// Time between two checks whether a process has ended.
const POLL_EVERY: Duration = Duration::from_millis(20);

/// Measures streaming.
///
/// # Errors
/// If an input cannot be read or built, a run fails, or `task` is cancelled.
pub fn measure(request: &StreamBenchRequest, task: &dyn Task) -> Result<StreamReport> {
    ensure!(!request.inputs.is_empty(), "no input: name .esker files or scans");
    if let Some(folder) = &request.flight.pictures {
        ensure!(
            folder.is_dir(),
            "{}: the folder for pictures does not exist; make it first",
            folder.display()
        );
    }
    let flight = &request.flight;
    if let ([input], false, []) = (&request.inputs[..], request.paper_too, &request.capacities[..])
    {
        // Before anything of the file is read.
        let line = match flight.line.filter(|_| is_remote(input)) {
            Some(line) => Some(line::measure(input, flight, line)?),
            None => None,
        };
        if is_esker(input)? || is_copc(input)? {
            let run = pool::run(flight.threads, || run::measure(input, flight, line, task))?;
            return Ok(StreamReport::One(Box::new(run)));
        }
    }
    let mut runs = Vec::new();
    for input in &request.inputs {
        if is_esker(input)? || is_copc(input)? && request.capacities.is_empty() {
            ensure!(
                request.capacities.is_empty(),
                "{}: is an .esker file, which is built already; --capacities needs scans",
                input.display()
            );
            request.runs_of(input, input, task, &mut runs)?;
            continue;
        }
        let own = [request.build.node_capacity];
        let capacities = if request.capacities.is_empty() { &own } else { &request.capacities[..] };
        for &node_capacity in capacities {
            let folder = output::temporary(request.build.scratch.as_deref())?;
            let built = folder.path().join("scan.esker");
            output::may_write(&built, std::slice::from_ref(input))?;
            let options = esker_builder::Options { node_capacity, ..request.build.clone() };
            pool::run(request.flight.threads, || {
                Ok(esker_builder::build(std::slice::from_ref(input), &built, &options, task)?)
            })?;
            request.runs_of(input, &built, task, &mut runs)?;
        }
    }
    Ok(match runs.len() {
        1 => StreamReport::One(Box::new(runs.remove(0))),
        _ => StreamReport::Several { runs },
    })
}

impl StreamBenchRequest {
    /// Measures `file` with its settings, and with those of the paper if they are requested;
    /// appends the reports to `runs`, under the name of `input`, which `file` was built from.
    fn runs_of(
        &self,
        input: &Path,
        file: &Path,
        task: &dyn Task,
        runs: &mut Vec<StreamRun>,
    ) -> Result<()> {
        let paper = self.paper_too.then_some(Settings::Paper);
        for settings in [Some(self.flight.settings), paper].into_iter().flatten() {
            // Each run has a folder of pictures, named after its index in the list.
            let pictures = self.flight.pictures.as_ref().map(|f| f.join(runs.len().to_string()));
            if let Some(folder) = &pictures {
                std::fs::create_dir_all(folder)
                    .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
            }
            let flight = FlightRequest { settings, pictures, ..self.flight.clone() };
            task.phase(&format!("{} ({})", input.display(), settings.name()), None, "");
            let mut run = run_in_process(&self.program, file, &flight, task)
                .with_context(|| format!("{}: the benchmark failed", input.display()))?;
            run.file = input.display().to_string();
            runs.push(run);
        }
        Ok(())
    }
}

/// Starts the same command with one file, and reads its report.
fn run_in_process(
    program: &Path,
    file: &Path,
    flight: &FlightRequest,
    task: &dyn Task,
) -> Result<StreamRun> {
    let mut output = tempfile::tempfile().context("cannot make a temporary file")?;
    let mut command = Command::new(program);
    command.args(["bench", "stream", "--json", "--progress", "none"]).args(arguments(flight));
    command.arg(whole(file)).stdin(Stdio::null());
    command.stdout(output.try_clone().context("cannot make a temporary file")?);
    let status = wait(command, task)?;
    let mut text = String::new();
    output.rewind()?;
    output.read_to_string(&mut text)?;
    let last = text.lines().last().unwrap_or_default();
    // A run over its budgets fails, but has a report.
    serde_json::from_str(last)
        .with_context(|| format!("its process printed no complete report, and ended with {status}"))
}

/// Starts a process and waits for its end; kills it if `task` is cancelled.
fn wait(mut command: Command, task: &dyn Task) -> Result<ExitStatus> {
    let mut child = command.spawn().context("cannot start another process of the program")?;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if let Err(cancelled) = task.check() {
            child.kill()?;
            child.wait()?;
            bail!(cancelled);
        }
        std::thread::sleep(POLL_EVERY);
    }
}

/// Options of the command line that stand for `flight`.
fn arguments(flight: &FlightRequest) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec![
        format!("--budget-gpu={}", flight.budget_gpu_bytes).into(),
        format!("--budget-ram={}", flight.budget_ram_bytes).into(),
        format!("--size={}x{}", flight.size[0], flight.size[1]).into(),
        format!("--threads={}", flight.threads).into(),
        format!("--settings={}", flight.settings.name()).into(),
    ];
    arguments.extend(flight.with.arguments().into_iter().map(OsString::from));
    for (name, path) in [("--path", &flight.path), ("--pictures", &flight.pictures)] {
        arguments.extend(path.iter().flat_map(|p| [name.into(), p.clone().into_os_string()]));
    }
    let line = flight.line.map(|line| format!("--line={},{}", line.mbit_s, line.round_trip_ms));
    arguments.extend(line.map(OsString::from));
    arguments.extend((!flight.occlusion).then(|| "--no-occlusion".into()));
    arguments.extend(flight.full.then(|| "--full".into()));
    arguments.extend(flight.cold.then(|| "--cold".into()));
    arguments
}
