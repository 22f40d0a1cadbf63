//! A build that is divided among processes or machines, in steps that any scheduler may run
//! (`docs/clusters.md`): `plan`, takes, which decode pieces of the sources, `cut`, which sums them
//! up and divides the cells into parts, builds of parts, and `join`. Steps share nothing but a
//! [`place::Place`].

pub mod build;
pub(crate) mod built;
pub mod cut;
pub(crate) mod cut_file;
pub mod join;
pub(crate) mod joined;
mod loading;
pub(crate) mod parts;
mod pieces;
pub mod place;
pub mod plan;
pub(crate) mod planned;
mod refine;
mod splitting;
pub mod status;
pub(crate) mod step;
pub(crate) mod summary;
pub mod take;
#[cfg(test)]
mod tests;

pub use planned::Needs;

use crate::budget::memory;
use crate::calls::build::{BASE_BYTES, THREAD_BYTES, too_little_memory};
use crate::error::BuildError;
use esker_points::Task;
use rayon::ThreadBuilder;
use std::path::PathBuf;

/// What a step may use.
#[derive(Clone, Debug)]
pub struct Resources {
    /// Anonymous memory above that of the empty program, in bytes.
    pub memory_bytes: u64,
    /// Folder of scratch files; `None` for the system's folder of temporary files.
    pub scratch: Option<PathBuf>,
}

impl Default for Resources {
    fn default() -> Self {
        Self { memory_bytes: memory::default_bytes(), scratch: None }
    }
}

impl Resources {
    /// Folder of scratch files.
    pub fn folder(&self) -> PathBuf {
        self.scratch.clone().unwrap_or_else(std::env::temp_dir)
    }

    /// Does some work in the current pool, or in one of fewer threads if memory is scarce.
    fn run<T: Send>(
        &self,
        task: &dyn Task,
        work: impl FnOnce() -> Result<T, BuildError> + Send,
    ) -> Result<T, BuildError> {
        if self.memory_bytes < memory::MEMORY_BYTES_MIN {
            return Err(too_little_memory(memory::MEMORY_BYTES_MIN, ""));
        }
        let threads_max = ((self.memory_bytes - BASE_BYTES) / THREAD_BYTES) as usize;
        if rayon::current_num_threads() <= threads_max {
            return work();
        }
        task.note(&format!(
            "{threads_max} threads work: more need more --memory, {} MiB each",
            THREAD_BYTES >> 20
        ));
        let threads = rayon::ThreadPoolBuilder::new().num_threads(threads_max);
        threads
            .build_scoped(ThreadBuilder::run, |pool| pool.install(work))
            .map_err(BuildError::no_thread)?
    }
}
