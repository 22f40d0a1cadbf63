//! The command line.

use crate::bench::Benchmark;
use crate::output::Output;
use crate::shared::{BuildHow, DrawWithArgs, FilterArgs, MethodArg, Threads, parse_camera};
use clap::{Args as ClapArgs, Parser, Subcommand};
use esker_engine::cameras::camera::Camera;
use esker_engine::io::quantity;
use std::path::PathBuf;

/// Laser scans of any size, as one layered file and as pictures.
#[derive(Parser)]
#[command(name = "esker", version, about)]
pub struct Args {
    /// Without a command: `demo`.
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[derive(Subcommand)]
pub enum Command {
    /// Build an .esker file from scans (LAS, LAZ, E57, PTX, PTS, PLY, PCD, XYZ, TXT, CSV; or generated ones,
    /// synthetic:SCENE:POINTS or synthetic:SCENE:POINTS:SEED).
    Build(Build),
    /// Add scans to an .esker file without writing it again: a new file holds their points and names the old
    /// one, and is opened in its place. Points between the old file's steps are rounded, those outside of its
    /// lattice refused and counted; where that is all of them it is an error.
    Append(Append),
    /// Say what an .esker file, or a scan, holds; or what the machine can draw with.
    Info {
        /// The file.
        #[arg(required_unless_present = "system")]
        file: Option<PathBuf>,
        /// Say which graphics adapters there are, which one would draw, and why.
        #[arg(long, conflicts_with = "file")]
        system: bool,
        #[command(flatten)]
        with: DrawWithArgs,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Check an .esker file, byte for byte; with --against also that its points are those of the scans.
    Verify(Verify),
    /// Write an .esker file, or a part of it, as a scan: LAS, LAZ, PLY or text, told by the ending. All of it is
    /// the points, records and header of the scans that it was built from.
    Export(crate::export::Export),
    /// Draw a picture of an .esker file, or of scans (which are built first, into a temporary file).
    Render(Box<Render>),
    /// Fly through an .esker file, or scans, in a window.
    View(crate::view::View),
    /// Build, verify and draw the sample scan of the project.
    Demo {
        /// Folder for the file and the picture.
        #[arg(short, long, default_value = "out")]
        out: PathBuf,
    },
    /// Measure; without a name: say what can be measured.
    Bench {
        #[command(subcommand)]
        benchmark: Option<Benchmark>,
    },
}

#[derive(ClapArgs)]
pub struct Build {
    /// The scans, or folders, for all scans directly in them (.las, .laz, .ply, .pcd, .e57, .ptx, .xyz, .txt, .csv, .pts), or with --merge .esker files; also generated ones, named as synthetic:SCENE:POINTS or synthetic:SCENE:POINTS:SEED: SCENE is bridge, office,
    /// terrain, or a model with sharp edges, cube or csg; POINTS such as 250000, 100k, 10M or 1G, SEED a whole number (1 where not said).
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// The file to build.
    #[arg(short, long, value_name = "OUT.esker")]
    pub out: PathBuf,
    /// Make one tree of .esker files and of all that they name by append: every point and what is known of its
    /// source is kept.
    #[arg(long)]
    pub merge: bool,
    /// Go on with an earlier build of this output that was cut short, with the same inputs and options; where there is
    /// none, start afresh.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Append {
    /// The .esker file to add to; it may name others itself.
    #[arg(value_name = "OLD.esker")]
    pub old: PathBuf,
    /// The scans to add, or folders of them.
    #[arg(required = true, value_name = "MORE")]
    pub inputs: Vec<PathBuf>,
    /// The file to build.
    #[arg(short, long, value_name = "OUT.esker")]
    pub out: PathBuf,
    /// Go on with an earlier build of this output that was cut short, with the same inputs and options; where there is
    /// none, start afresh.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Verify {
    /// The file.
    pub file: PathBuf,
    /// The scans that it was built from, or folders of them; of a file made by append those that were added last, or all, in any order.
    #[arg(long, num_args = 1.., value_name = "IN")]
    pub against: Vec<PathBuf>,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Render {
    /// An .esker file, or scans.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// The picture to write.
    #[arg(short, long, value_name = "P.png", required_unless_present = "explain")]
    pub out: Option<PathBuf>,
    /// Say what the picture would take, passes, planes and pipelines, and what is left out, and draw nothing.
    #[arg(long)]
    pub explain: bool,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Points alone, closed surfaces, or splats.
    #[arg(long, value_enum, default_value_t)]
    pub method: MethodArg,
    /// "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=60", in the scan's coordinates. Every part may be missing;
    /// without a target it looks along "direction=x,y,z", without an eye the scan is fitted, seen along it.
    #[arg(long, value_parser = parse_camera, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// Show all of the scan, whatever eye and target the camera names.
    #[arg(long)]
    pub fit: bool,
    /// Points drawn at most.
    #[arg(long, value_name = "N", default_value_t = 10_000_000, value_parser = quantity::points_budget)]
    pub budget_points: u64,
    /// Distance of neighbouring points on the picture that is fine enough, in pixels; 0 draws all.
    #[arg(long, value_name = "PX", default_value_t = 1.0, allow_negative_numbers = true, value_parser = quantity::spacing_px)]
    pub target_spacing: f64,
    /// rgb, intensity, elevation, classification, return_number, number_of_returns, source_id, time, normal, level, depth, plain, or any
    /// attribute's name; where it has a range of values, that may follow, with either end open.
    #[arg(long, value_name = "NAME[:MIN..MAX]", aliases = ["colour-by", "color"])]
    pub colour: Option<String>,
    #[command(flatten)]
    pub filter: FilterArgs,
    /// Light surfaces without highlights.
    #[arg(long)]
    pub no_highlights: bool,
    /// Even out differences of exposure where scans cover the same surface; point_source_id, scan or scan_id tells
    /// them apart.
    #[arg(long)]
    pub even_exposure: bool,
    /// Draw exact colours where the file has compact planes, too (see build --compact).
    #[arg(long)]
    pub full: bool,
    #[command(flatten)]
    pub with: DrawWithArgs,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}
