//! `esker export`: its options, and the call that they become.

use crate::output::Output;
use crate::shared::{FilterArgs, Threads};
use anyhow::Result;
use clap::Args as ClapArgs;
use esker_engine::calls::export;
use esker_engine::io::output::may_create;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(ClapArgs)]
pub struct Export {
    /// The .esker file.
    pub file: PathBuf,
    /// The scan to write: .las, .laz, .ply, .xyz, .txt or .csv.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
    /// Replace OUT if it is there already.
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub filter: FilterArgs,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

/// Writes the scan and prints the report.
pub fn run(args: Export, stop: Arc<AtomicBool>) -> Result<()> {
    if !args.overwrite {
        may_create(&args.out)?;
    }
    let filter = args.filter.into();
    args.output.report(
        stop,
        |progress| export::export(&args.file, &args.out, &filter, args.threads.count, progress),
        |report| export::text(report, &args.out),
    )
}
