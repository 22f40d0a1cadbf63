//! `esker job run`: runs the steps of a divided build as processes of this program, some at a time,
//! and joins the parts. A step that fails is run once more. Ctrl-C is passed on, and no step is
//! begun after it.

use crate::job_options::{StepHow, To};
use crate::output::Output;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args as ClapArgs;
use esker_engine::calls::{build, job};
use esker_engine::io::progress::Progress;
use esker_engine::{JobResources, Task};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

/// Times that a step is tried.
const TRIES: u32 = 2;
/// Interval at which processes are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Least memory of a process, in bytes.
const MEMORY_BYTES_MIN: u64 = 256 << 20;

/// Options of `esker job run`.
#[derive(ClapArgs)]
pub struct Run {
    #[command(flatten)]
    pub to: To,
    /// The file to write.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
    /// Number of processes at a time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1025))]
    pub local: u32,
    // Of each process; by default they share the machine's cores, and half of its memory.
    #[command(flatten)]
    pub how: StepHow,
    #[command(flatten)]
    pub output: Output,
}

/// A step as a command: its words behind `esker job`.
type Words = Vec<String>;

/// A running process of a step.
struct Running {
    words: Words,
    /// Number of this try, from 1.
    tries: u32,
    child: Child,
}

/// Runs all steps that are missing.
pub fn run(run: &Run, stop: Arc<AtomicBool>) -> Result<()> {
    let to = &run.to.to;
    run.output.report(
        stop,
        |progress| {
            for kind in ["take", "cut", "build"] {
                let state = job::status(to)?;
                let (_, step) = state
                    .steps
                    .by_name()
                    .into_iter()
                    .find(|(name, _)| *name == kind)
                    .context("no such step")?;
                if let Some(damaged) = step.damaged.first() {
                    bail!("{damaged}");
                }
                let steps: VecDeque<_> = match (kind, step.missing.is_empty()) {
                    (_, true) => VecDeque::new(),
                    ("cut", false) => [vec!["cut".to_owned()]].into(),
                    (kind, false) => step
                        .missing_indices
                        .iter()
                        .map(|i| vec![kind.to_owned(), "--job".into(), i.to_string()])
                        .collect(),
                };
                run_steps(run, steps, kind, progress)?;
            }
            let (resources, threads) = (run.how.resources(), run.how.threads.count);
            job::join(to, &run.out, &resources, threads, progress)
        },
        |report| build::text(report, &run.out),
    )
}

/// Runs the steps of one kind, some at a time.
fn run_steps(run: &Run, steps: VecDeque<Words>, kind: &str, progress: &Progress) -> Result<()> {
    progress.phase(kind, Some(steps.len() as u64), "jobs");
    let mut waiting: VecDeque<(Words, u32)> = steps.into_iter().map(|words| (words, 1)).collect();
    let mut running: Vec<Running> = Vec::new();
    let mut failure = None;
    let mut is_told = false;
    while !running.is_empty() || (failure.is_none() && !waiting.is_empty()) {
        if let Err(cancelled) = progress.check() {
            failure.get_or_insert_with(|| cancelled.into());
        }
        if failure.is_some() && !is_told {
            running.iter_mut().for_each(|running| interrupt(&mut running.child));
            is_told = true;
        }
        while failure.is_none() && running.len() < run.local as usize {
            let Some((words, tries)) = waiting.pop_front() else { break };
            match start(run, &words) {
                Ok(child) => running.push(Running { words, tries, child }),
                Err(error) => failure = Some(error),
            }
        }
        let mut still = Vec::with_capacity(running.len());
        for mut one in running {
            match one.child.try_wait() {
                Ok(None) => still.push(one),
                Ok(Some(status)) if status.success() => progress.advance(1),
                Ok(Some(_)) if failure.is_some() => {}
                Ok(Some(_)) if one.tries < TRIES => {
                    progress.note(&format!("{} failed; it is run again", one.words.join(" ")));
                    waiting.push_back((one.words, one.tries + 1));
                }
                Ok(Some(_)) => {
                    let words = one.words.join(" ");
                    failure = Some(anyhow!("esker job {words}: failed {TRIES} times"));
                }
                Err(error) => failure = Some(error.into()),
            }
        }
        running = still;
        thread::sleep(LOOK_EVERY);
    }
    failure.map_or(Ok(()), Err)
}

/// Starts the process of a step.
fn start(run: &Run, words: &Words) -> Result<Child> {
    let program = std::env::current_exe().context("cannot find the program itself")?;
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let threads = match run.how.threads.count {
        0 => (cores / run.local as usize).max(1),
        threads => threads,
    };
    let shared = JobResources::default().memory_bytes / u64::from(run.local);
    let memory = run.how.memory.unwrap_or(shared.max(MEMORY_BYTES_MIN));
    let mut command = Command::new(program);
    command.arg("job").args(words).arg("--to").arg(&run.to.to);
    command.args(["--threads", &threads.to_string(), "--memory", &memory.to_string()]);
    if let Some(scratch) = &run.how.scratch {
        command.arg("--scratch").arg(scratch);
    }
    command.args(["--progress", "none"]).stdin(Stdio::null()).stdout(Stdio::null());
    // A group of its own: else a terminal's Ctrl-C reaches the process beside the one that is
    // passed on, and a second one ends it at once.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command.spawn().with_context(|| format!("esker job {}: cannot be started", words.join(" ")))
}

/// Passes Ctrl-C on to a process, which then ends and leaves nothing half done.
#[cfg(unix)]
fn interrupt(child: &mut Child) {
    if let Ok(id) = libc::pid_t::try_from(child.id()) {
        // SAFETY: `kill` touches no memory of this process. The process is a child that was not
        // waited for, so the number is still its own.
        unsafe { libc::kill(id, libc::SIGINT) };
    }
}

#[cfg(not(unix))]
fn interrupt(child: &mut Child) {
    let _ = child.kill();
}
