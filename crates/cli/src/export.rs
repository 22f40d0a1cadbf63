//! `esker export`: its arguments, the filter among them, and the call.

use crate::args::ProgressArg;
use crate::commands::print;
use anyhow::Result;
use clap::Args as ClapArgs;
use esker_engine::progress::Progress;
use esker_engine::{Bounds, Classes, Filter, Polygon, export, quantity};
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
    #[command(flatten)]
    pub filter: FilterArgs,
    /// Threads; one a core where not said.
    #[arg(long, value_parser = quantity::threads, default_value = "0", hide_default_value = true)]
    pub threads: usize,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

/// Which points are wanted; all where nothing is said.
#[derive(ClapArgs)]
pub struct FilterArgs {
    /// Points in this box, its faces included, in the scan's coordinates; with four numbers, seen from above.
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    pub bounds: Option<Bounds>,
    /// Points over this polygon, its edges included, in the scan's coordinates: corners as "x,y x,y x,y", or a
    /// file of such lines or of GeoJSON.
    #[arg(long, value_name = "POLYGON", allow_hyphen_values = true, value_parser = parse_polygon)]
    pub polygon: Option<Polygon>,
    /// Points of these classes: numbers, ranges, names; such as 2,6 or ground,3-5.
    #[arg(long, value_name = "CLASSES")]
    pub classes: Option<Classes>,
    /// An even sample whose points are about this far apart, in the scan's unit.
    #[arg(long, value_name = "S")]
    pub max_spacing: Option<f64>,
}

impl From<FilterArgs> for Filter {
    fn from(args: FilterArgs) -> Self {
        let FilterArgs { bounds, polygon, classes, max_spacing } = args;
        Self { bounds, polygon, classes, max_spacing }
    }
}

fn parse_polygon(word: &str) -> Result<Polygon, String> {
    export::polygon(word).map_err(|e| format!("{e:#}"))
}

/// Exports.
pub fn run(args: Export, stop: Arc<AtomicBool>) -> Result<()> {
    let progress = Progress::new(args.progress.into(), stop);
    let filter = args.filter.into();
    let (report, seconds) =
        export::export(&args.file, &args.out, &filter, args.threads, &progress)?;
    drop(progress);
    print(args.json, &export::json(&report, seconds), || export::text(&report, seconds, &args.out))
}
