//! From what the user names to runs, each in a process of its own, so that peaks of memory and the
//! program's own caches are that run's alone. Scans are built first, into a temporary file, once for
//! each node capacity.

use crate::stream::{Request, Settings, measure};
use anyhow::{Context, Result, bail, ensure};
use esker_engine::io::file::is_esker;
use esker_engine::io::output;
use esker_engine::machine::pool;
use esker_points::Task;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

/// Between two looks at a running process.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// What is to be measured.
#[derive(Clone, Debug)]
pub struct Plan {
    /// `.esker` files and scans.
    pub inputs: Vec<PathBuf>,
    /// Each run's settings.
    pub request: Request,
    /// Whether each file is measured with the paper's settings as well.
    pub paper_too: bool,
    /// Node capacities that scans are built with; that of `build` where there is none.
    pub capacities: Vec<u32>,
    /// How scans are built.
    pub build: esker_builder::Options,
    /// The `esker` program, for further processes.
    pub program: PathBuf,
}

/// Measures; one object of a single run, else an object with a list of `runs`.
///
/// # Errors
/// Where a run fails, or on request.
pub fn stream(plan: &Plan, task: &dyn Task) -> Result<Value> {
    ensure!(!plan.inputs.is_empty(), "no input: name .esker files or scans");
    if let Some(folder) = &plan.request.pictures {
        ensure!(folder.is_dir(), "{}: no folder for pictures; make it first", folder.display());
    }
    if let ([input], false, []) = (&plan.inputs[..], plan.paper_too, &plan.capacities[..])
        && is_esker(input)?
    {
        return pool::run(plan.request.threads, || measure(input, &plan.request, task));
    }
    let mut runs = Vec::new();
    for input in &plan.inputs {
        if is_esker(input)? {
            ensure!(
                plan.capacities.is_empty(),
                "{}: is built already; --capacities needs scans",
                input.display()
            );
            plan.runs_of(input, input, task, &mut runs)?;
            continue;
        }
        let own = [plan.build.node_capacity];
        let capacities = if plan.capacities.is_empty() { &own } else { &plan.capacities[..] };
        for &node_capacity in capacities {
            let folder = output::temporary(plan.build.scratch.as_deref())?;
            let built = folder.path().join("scan.esker");
            output::may_write(&built, std::slice::from_ref(input))?;
            let options = esker_builder::Options { node_capacity, ..plan.build.clone() };
            pool::run(plan.request.threads, || {
                Ok(esker_builder::build(std::slice::from_ref(input), &built, &options, task)?)
            })?;
            plan.runs_of(input, &built, task, &mut runs)?;
        }
    }
    Ok(match runs.len() {
        1 => runs.remove(0),
        _ => json!({ "runs": runs }),
    })
}

impl Plan {
    fn runs_of(
        &self,
        input: &Path,
        file: &Path,
        task: &dyn Task,
        runs: &mut Vec<Value>,
    ) -> Result<()> {
        let paper = self.paper_too.then_some(Settings::Paper);
        for settings in [Some(self.request.settings), paper].into_iter().flatten() {
            // Each run's pictures in a folder of its own, named after its place in the list.
            let pictures = self.request.pictures.as_ref().map(|f| f.join(runs.len().to_string()));
            if let Some(folder) = &pictures {
                std::fs::create_dir_all(folder)
                    .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
            }
            let request = Request { settings, pictures, ..self.request.clone() };
            task.phase(&format!("{} ({})", input.display(), settings.name()), None, "");
            let mut report = measure_elsewhere(&self.program, file, &request, task)
                .with_context(|| format!("{}: the benchmark failed", input.display()))?;
            report["file"] = json!(input.display().to_string());
            runs.push(report);
        }
        Ok(())
    }
}

/// Measures in a process of its own: the same command with one file.
fn measure_elsewhere(
    program: &Path,
    file: &Path,
    request: &Request,
    task: &dyn Task,
) -> Result<Value> {
    let mut output = tempfile::tempfile().context("cannot make a temporary file")?;
    let mut command = Command::new(program);
    command.args(["bench", "stream", "--json", "--progress", "none"]).args(arguments(request));
    command.arg(file).stdin(Stdio::null());
    command.stdout(output.try_clone().context("cannot make a temporary file")?);
    let status = wait(command, task)?;
    ensure!(status.success(), "its process ended with {status}");
    let mut text = String::new();
    output.rewind()?;
    output.read_to_string(&mut text)?;
    let last = text.lines().last().unwrap_or_default();
    serde_json::from_str(last).context("its process did not end with a report")
}

/// Waits for a process; ends it where the user wants to stop.
fn wait(mut command: Command, task: &dyn Task) -> Result<ExitStatus> {
    let mut child = command.spawn().context("cannot start a further process of the program")?;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if let Err(cancelled) = task.check() {
            child.kill()?;
            child.wait()?;
            bail!(cancelled);
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// The command line that gives this request.
fn arguments(request: &Request) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec![
        format!("--budget-gpu={}", request.budget_gpu_bytes).into(),
        format!("--budget-ram={}", request.budget_ram_bytes).into(),
        format!("--size={}x{}", request.size[0], request.size[1]).into(),
        format!("--threads={}", request.threads).into(),
        format!("--settings={}", request.settings.name()).into(),
    ];
    arguments.extend(request.with.arguments().into_iter().map(OsString::from));
    for (name, path) in [("--path", &request.path), ("--pictures", &request.pictures)] {
        arguments.extend(path.iter().flat_map(|p| [name.into(), p.clone().into_os_string()]));
    }
    arguments.extend((!request.occlusion).then(|| "--no-occlusion".into()));
    arguments.extend(request.full.then(|| "--full".into()));
    arguments.extend(request.cold.then(|| "--cold".into()));
    arguments
}
