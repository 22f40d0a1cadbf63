//! Copies the file that was built from scans to a place that the user chooses. The copy gets its
//! name when it is complete, and never replaces a file.

use crate::job::Job;
use anyhow::{Context, Result, anyhow, ensure};
use esker_engine::io::output::folder_of;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// Bytes that are copied at a time.
const BLOCK: usize = 4 << 20;

/// A copy that is being made. Dropping it ends the copy and removes what there is of it.
pub struct Keeping {
    state: Arc<State>,
    job: Job<PathBuf>,
}

#[derive(Default)]
struct State {
    stop: AtomicBool,
    done: AtomicU64,
    total: AtomicU64,
}

impl Keeping {
    /// Starts to copy the file at `from` to `to`.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(from: PathBuf, to: PathBuf) -> Result<Self> {
        let state = Arc::new(State::default());
        let shared = Arc::clone(&state);
        let copied = move || copy(&from, &to, &shared).map(|()| to);
        Ok(Self { state, job: Job::start("esker-keep", copied)? })
    }

    /// Share that is copied, 0 to 1.
    pub fn share(&self) -> f32 {
        let [done, total] = [&self.state.done, &self.state.total].map(|bytes| bytes.load(Relaxed));
        if total > 0 { (done as f64 / total as f64) as f32 } else { 0.0 }
    }

    /// Ends the copy, which then fails.
    pub fn cancel(&self) {
        self.state.stop.store(true, Relaxed);
    }

    /// The path of the copy, once it is made; nothing follows it.
    pub fn poll(&mut self) -> Option<Result<PathBuf>> {
        self.job.poll()
    }
}

impl Drop for Keeping {
    fn drop(&mut self) {
        self.cancel();
    }
}

fn copy(from: &Path, to: &Path, state: &State) -> Result<()> {
    let shown = to.display();
    let there = || anyhow!("{shown}: is there already; choose another name");
    ensure!(to.symlink_metadata().is_err(), there());
    let mut source = File::open(from).with_context(|| format!("{}", from.display()))?;
    state.total.store(source.metadata()?.len(), Relaxed);
    let written = || format!("{shown}: cannot write");
    let mut copy = tempfile::NamedTempFile::new_in(folder_of(to)).with_context(written)?;
    let mut block = vec![0; BLOCK];
    loop {
        ensure!(!state.stop.load(Relaxed), "{shown}: copying was cancelled");
        let bytes = source.read(&mut block).with_context(|| format!("{}", from.display()))?;
        if bytes == 0 {
            break;
        }
        copy.write_all(&block[..bytes]).with_context(written)?;
        state.done.fetch_add(bytes as u64, Relaxed);
    }
    copy.as_file().sync_all().with_context(written)?;
    // Temporary files are private.
    let permissions = source.metadata()?.permissions();
    copy.as_file().set_permissions(permissions).with_context(written)?;
    copy.persist_noclobber(to).map_err(|fault| match fault.error.kind() {
        ErrorKind::AlreadyExists => there(),
        _ => anyhow::Error::from(fault.error).context(written()),
    })?;
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn a_copy_is_complete_or_not_there_and_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = ["scan.esker", "town.esker"].map(|name| folder.path().join(name));
        let bytes: Vec<u8> = (0..BLOCK + 1000).map(|i| (i % 251) as u8).collect();
        std::fs::write(&from, &bytes).unwrap();
        let state = State::default();
        state.stop.store(true, Relaxed);
        let fault = copy(&from, &to, &state).unwrap_err();
        assert!(fault.to_string().contains("cancelled"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left");
        copy(&from, &to, &State::default()).unwrap();
        let mut copied = Vec::new();
        File::open(&to).unwrap().read_to_end(&mut copied).unwrap();
        assert!(copied == bytes, "the copy is the file");
        std::fs::write(&to, "a scan").unwrap();
        let fault = copy(&from, &to, &State::default()).unwrap_err();
        assert!(fault.to_string().contains("is there already"), "{fault}");
        assert_eq!(std::fs::read_to_string(&to).unwrap(), "a scan");
    }
}
