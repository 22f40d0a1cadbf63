//! Options of all steps of `esker job`.

use crate::shared::Threads;
use clap::Args as ClapArgs;
use esker_engine::JobResources;
use esker_engine::io::quantity;
use std::path::PathBuf;

/// The place of a divided build.
#[derive(ClapArgs)]
pub struct To {
    /// Place that all steps share, for the plan and what each step leaves for others: a folder, or
    /// a prefix in object storage such as s3://bucket/work.
    #[arg(long, value_name = "DIR")]
    pub to: PathBuf,
}

/// What a step may use.
#[derive(ClapArgs)]
pub struct StepHow {
    /// Memory that the step may use, such as 4GiB; at least 256MiB. Half of the machine's memory by
    /// default.
    #[arg(long, value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Folder for rows that do not fit in memory, best on a disk of the machine; the system's
    /// temporary folder by default.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    #[command(flatten)]
    pub threads: Threads,
}

impl StepHow {
    /// What the step may use.
    pub fn resources(&self) -> JobResources {
        let usual = JobResources::default();
        JobResources {
            memory_bytes: self.memory.unwrap_or(usual.memory_bytes),
            scratch: self.scratch.clone(),
        }
    }
}
