//! `esker export`: its options, and the call that they become.

use crate::output::Output;
use crate::shared::{ColourBits, FilterArgs, Threads, parse_crs};
use anyhow::Result;
use clap::Args as ClapArgs;
use esker_engine::calls::export;
use esker_engine::io::output::may_create;
use esker_engine::{Crs, ExportOptions, Filter};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(ClapArgs)]
pub struct Export {
    /// The .esker file.
    pub file: PathBuf,
    /// The scan to write: .las, .laz, .copc.laz, .ply, .xyz, .txt or .csv.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
    /// Replace OUT if it is there already.
    #[arg(long)]
    pub overwrite: bool,
    /// Bits of the colours: 8 rounds them, with a note on what is lost; 16 multiplies those of 8
    /// bits by 256. By default PLY has 8 where that loses nothing, and other formats those of the
    /// scan.
    #[arg(long, value_enum)]
    pub colour_bits: Option<ColourBits>,
    /// Coordinate reference system of a .copc.laz, in place of that of the scans: WKT, or a file of
    /// it. COPC has WKT only, so scans that state theirs otherwise need this.
    #[arg(long, value_name = "CRS", value_parser = parse_crs)]
    pub crs: Option<Crs>,
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
    let filter = args.filter.over(Filter::default());
    let options = ExportOptions {
        colour_depth: args.colour_bits.map(Into::into),
        crs: args.crs.map(|crs| crs.text),
    };
    args.output.report(
        stop,
        |progress| {
            export::export(
                &args.file,
                &args.out,
                &filter,
                options.clone(),
                args.threads.count,
                progress,
            )
        },
        |report| export::text(report, &args.out),
    )
}
