//! One run of a program in a child process: its time, the CPU time and memory that the system
//! counts, the bytes of its files while it ran and at its end, and the report that it printed.

use crate::build::program::Invocation;
use anyhow::{Context, Result, bail};
use esker_engine::machine::system;
use esker_points::Task;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Time between two checks whether the program has ended, and so the error of its time.
const POLL_EVERY: Duration = Duration::from_millis(2);
/// Time between two sums of its files.
const SUM_EVERY: Duration = Duration::from_millis(100);
/// Bytes that are read from the end of its output.
const PRINTED_BYTES: i64 = 64 << 10;

/// Record of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct ChildRun {
    /// Time from its start to its end.
    pub seconds: f64,
    /// User and system time of all its threads, if the system counts it.
    pub cpu_seconds: Option<f64>,
    /// Greatest resident set, if the system counts it.
    pub peak_rss_bytes: Option<u64>,
    /// Greatest sum of bytes of those files that were gone at its end.
    pub scratch_bytes_peak: u64,
    /// Bytes of the files that it left.
    pub bytes_out: u64,
    /// Fields of the object that it printed last.
    pub report: ChildReport,
    /// Why it failed.
    pub error: Option<String>,
}

/// Fields that are taken from the report of a program. Rivals print none of them; `esker build` and
/// `esker bench decode` print different ones.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct ChildReport {
    /// Points that `esker build` read.
    pub points_in: Option<u64>,
    /// Points that `esker bench decode` counted.
    pub points: Option<u64>,
    /// Greatest anonymous memory.
    pub peak_anon_bytes: Option<u64>,
    /// Greatest sum of scratch files, those without names included.
    pub scratch_bytes_peak: Option<u64>,
    /// Bytes written to scratch files.
    pub scratch_bytes: Option<u64>,
}

/// Runs a command to its end. A program that cannot be started, or fails, sets [`ChildRun::error`].
///
/// # Errors
/// If files cannot be made or the process cannot be waited for, or `task` is cancelled, which kills
/// the process.
pub(super) fn run(mut invocation: Invocation, task: &dyn Task) -> Result<ChildRun> {
    let printed = || tempfile::tempfile().context("cannot make a temporary file");
    let (mut stdout, mut stderr) = (printed()?, printed()?);
    invocation.command.stdin(Stdio::null());
    invocation.command.stdout(stdout.try_clone()?).stderr(stderr.try_clone()?);
    let start = Instant::now();
    let mut child = match invocation.command.spawn() {
        Ok(child) => child,
        Err(e) => {
            let program = invocation.command.get_program().display().to_string();
            let error = Some(format!("{program}: cannot be run: {e}"));
            return Ok(ChildRun { error, ..ChildRun::default() });
        }
    };
    let mut sums = Vec::new();
    let mut summed = start;
    let (status, used) = loop {
        if let Some(ended) = system::try_wait(&mut child).context("cannot wait for the program")? {
            break ended;
        }
        if let Err(cancelled) = task.check() {
            child.kill()?;
            child.wait()?;
            bail!(cancelled);
        }
        if summed.elapsed() >= SUM_EVERY {
            sums.push(entries(&invocation.folder));
            summed = Instant::now();
        }
        std::thread::sleep(POLL_EVERY);
    };
    let seconds = start.elapsed().as_secs_f64();
    // Scratch files that it left are no output.
    let _ = std::fs::remove_dir_all(&invocation.scratch);
    let left = entries(&invocation.folder);
    let gone = |sum: &BTreeMap<OsString, u64>| {
        sum.iter().filter(|(name, _)| !left.contains_key(*name)).map(|(_, bytes)| bytes).sum()
    };
    let (out, err) = (last_lines(&mut stdout)?, last_lines(&mut stderr)?);
    let report = out.last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default();
    let mut run = ChildRun {
        seconds,
        cpu_seconds: used.map(|u| u.cpu_seconds),
        peak_rss_bytes: used.map(|u| u.peak_rss_bytes),
        scratch_bytes_peak: sums.iter().map(gone).max().unwrap_or(0),
        bytes_out: left.values().sum(),
        report,
        error: None,
    };
    if !status.success() {
        let message = err.last().or(out.last()).map_or("it printed nothing", |line| line.trim());
        run.error = Some(format!("ended with {status}: {message}"));
    }
    Ok(run)
}

/// Sums the bytes below each entry of `folder` and of the folders in it, which is fine enough to
/// distinguish files that stay from files that are deleted.
fn entries(folder: &Path) -> BTreeMap<OsString, u64> {
    let mut sums = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        // A file that is deleted meanwhile does not count.
        for entry in std::fs::read_dir(&inner).into_iter().flatten().flatten() {
            let (path, Ok(metadata)) = (entry.path(), entry.metadata()) else { continue };
            if metadata.is_dir() {
                open.push(path);
                continue;
            }
            let below = path.strip_prefix(folder).unwrap_or(&path);
            let key: std::path::PathBuf = below.components().take(2).collect();
            *sums.entry(key.into_os_string()).or_default() += metadata.len();
        }
    }
    sums
}

/// Reads the last lines of an output, without empty ones.
fn last_lines(file: &mut File) -> Result<Vec<String>> {
    let end = i64::try_from(file.metadata()?.len())?;
    file.seek(std::io::SeekFrom::End(-end.min(PRINTED_BYTES)))?;
    let mut text = Vec::new();
    file.read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    Ok(text.split(['\n', '\r']).filter(|l| !l.trim().is_empty()).map(str::to_owned).collect())
}
