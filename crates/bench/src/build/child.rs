//! One run of a program: its wall time, what the system says it used, what its files took on the disk while
//! it ran, and what it left.

use crate::build::program::Run;
use anyhow::{Context, Result, bail};
use esker_engine::machine::system;
use esker_points::Task;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Between two looks whether it has ended: the error of its time.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// Between two looks at its files.
const SUM_EVERY: Duration = Duration::from_millis(100);
/// Bytes that are read of what it printed.
const PRINTED_BYTES: i64 = 64 << 10;

/// What a run did.
#[derive(Clone, Debug, Default)]
pub struct Ran {
    /// From starting it to its end, seconds.
    pub seconds: f64,
    /// Of all its threads, user and system, seconds; where the system tells.
    pub cpu_seconds: Option<f64>,
    /// Greatest resident set; where the system tells.
    pub peak_rss_bytes: Option<u64>,
    /// Bytes of its files that were gone in the end, at most.
    pub scratch_bytes_peak: u64,
    /// Bytes of the files that it left.
    pub bytes_out: u64,
    /// The object that it printed last, where it did.
    pub report: Value,
    /// Why it failed.
    pub error: Option<String>,
}

/// Runs it to its end; one that cannot be started, or fails, is told by `error`.
///
/// # Errors
/// Where the system refuses files, or on request; the program is ended then.
pub fn run(mut run: Run, task: &dyn Task) -> Result<Ran> {
    let printed = || tempfile::tempfile().context("cannot make a temporary file");
    let (mut stdout, mut stderr) = (printed()?, printed()?);
    run.command.stdin(Stdio::null());
    run.command.stdout(stdout.try_clone()?).stderr(stderr.try_clone()?);
    let start = Instant::now();
    let mut child = match run.command.spawn() {
        Ok(child) => child,
        Err(e) => {
            let program = run.command.get_program().display().to_string();
            let error = Some(format!("{program}: cannot be run: {e}"));
            return Ok(Ran { error, ..Ran::default() });
        }
    };
    let mut sums = Vec::new();
    let mut summed = start;
    let (status, used) = loop {
        if let Some(ended) = system::try_wait(&mut child).context("cannot wait for it")? {
            break ended;
        }
        if let Err(cancelled) = task.check() {
            child.kill()?;
            child.wait()?;
            bail!(cancelled);
        }
        if summed.elapsed() >= SUM_EVERY {
            sums.push(entries(&run.folder));
            summed = Instant::now();
        }
        std::thread::sleep(LOOK_EVERY);
    };
    let seconds = start.elapsed().as_secs_f64();
    // What it left in its place for scratch files is no output.
    let _ = std::fs::remove_dir_all(&run.scratch);
    let left = entries(&run.folder);
    let gone = |sum: &BTreeMap<OsString, u64>| {
        sum.iter().filter(|(name, _)| !left.contains_key(*name)).map(|(_, bytes)| bytes).sum()
    };
    let (out, err) = (last_lines(&mut stdout)?, last_lines(&mut stderr)?);
    let report = out.last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default();
    let mut ran = Ran {
        seconds,
        cpu_seconds: used.map(|u| u.cpu_seconds),
        peak_rss_bytes: used.map(|u| u.peak_rss_bytes),
        scratch_bytes_peak: sums.iter().map(gone).max().unwrap_or(0),
        bytes_out: left.values().sum(),
        report,
        error: None,
    };
    if !status.success() {
        let said = err.last().or(out.last()).map_or("it said nothing", |line| line.trim());
        ran.error = Some(format!("ended with {status}: {said}"));
    }
    Ok(ran)
}

/// Bytes below each entry of a folder and of the folders in it: fine enough to tell what stays from what goes.
fn entries(folder: &Path) -> BTreeMap<OsString, u64> {
    let mut sums = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        // What goes away while it is looked at counts no more.
        for entry in std::fs::read_dir(&inner).into_iter().flatten().flatten() {
            let (path, Ok(what)) = (entry.path(), entry.metadata()) else { continue };
            if what.is_dir() {
                open.push(path);
                continue;
            }
            let below = path.strip_prefix(folder).unwrap_or(&path);
            let key: std::path::PathBuf = below.components().take(2).collect();
            *sums.entry(key.into_os_string()).or_default() += what.len();
        }
    }
    sums
}

/// The last lines that it printed, without empty ones.
fn last_lines(file: &mut File) -> Result<Vec<String>> {
    let end = i64::try_from(file.metadata()?.len())?;
    file.seek(std::io::SeekFrom::End(-end.min(PRINTED_BYTES)))?;
    let mut text = Vec::new();
    file.read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    Ok(text.split(['\n', '\r']).filter(|l| !l.trim().is_empty()).map(str::to_owned).collect())
}
