//! The command line: commands and their options, and the calls of `commands` that they become.

use crate::bench::Benchmark;
use crate::light::LightArgs;
use crate::output::Output;
use crate::shared::{BuildHow, DrawWithArgs, FilterArgs, ReadHow, Threads, method_parser};
use clap::{Args as ClapArgs, Parser, Subcommand};
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::io::quantity;
use esker_engine::{Method, PointSize, Window};
use std::path::PathBuf;

/// Builds one layered file from laser scans of any size, and draws it.
#[derive(Parser)]
#[command(name = "esker", version, about)]
pub struct Args {
    /// The command; `demo` by default.
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[cfg(feature = "remote")]
impl Args {
    /// Whether files are to be read as if for the first time.
    pub fn is_cold(&self) -> bool {
        match &self.command {
            Some(Command::Bench { benchmark: Some(benchmark) }) => benchmark.is_cold(),
            _ => false,
        }
    }
}

#[derive(Subcommand)]
pub enum Command {
    /// Build an .esker file from scans (LAS, LAZ, E57, PTX, PTS, PLY, PCD, XYZ, TXT, CSV), or from
    /// generated scans (synthetic:SCENE:POINTS or synthetic:SCENE:POINTS:SEED).
    Build(Build),
    /// Add scans to an .esker file without rewriting it: a new file holds the new points and names
    /// the old file. Open the new file from then on. Coordinates are rounded to the old file's
    /// steps. Points outside its range of coordinates are an error, unless --drop-outside leaves
    /// them out.
    Append(Append),
    /// Print what an .esker file, a scan, or a scene document holds; or what the machine can draw
    /// with.
    Info {
        /// The file.
        #[arg(required_unless_present = "system")]
        file: Option<PathBuf>,
        /// List the graphics adapters, the one that would draw, and the reason.
        #[arg(long, conflicts_with = "file")]
        system: bool,
        /// Measure how difficult the file's points are, beside what pictures are rated to: jumps of
        /// density, step, noise, scan lines, points at one place, thin parts.
        #[arg(long, conflicts_with = "system")]
        conditions: bool,
        #[command(flatten)]
        with: DrawWithArgs,
        #[command(flatten)]
        reading: ReadHow,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Check every byte of an .esker file; with --against also that its points are those of the
    /// scans.
    Verify(Verify),
    /// Write an .esker file, or a part of it, as a scan: LAS, LAZ, COPC, PLY or text, by the end of
    /// its name. The whole of a file has the points, records and header of the scans that it was
    /// built from.
    Export(crate::export::Export),
    /// Draw a picture of an .esker file, or of scans, which are first built into a temporary file.
    Render(Box<Render>),
    /// Print the point that a pixel of a picture shows: its exact coordinates and all attributes,
    /// as export writes them.
    Pick(Box<crate::pick::Pick>),
    /// Build one file by many jobs, on many machines that share a folder, or as processes of this
    /// one: plan, takes, cut.
    #[command(subcommand)]
    Job(crate::job::Job),
    /// Fly through an .esker file, or scans, in a window.
    View(crate::view::View),
    /// Build, verify and draw the sample scan of the project.
    Demo {
        /// Folder for the file and the picture.
        #[arg(short, long, default_value = "out")]
        out: PathBuf,
    },
    /// Measure; without a name, list the benchmarks.
    Bench {
        #[command(subcommand)]
        benchmark: Option<Benchmark>,
    },
}

#[derive(ClapArgs)]
pub struct Build {
    /// The scans, or folders, which stand for all scans directly in them (.las, .laz, .ply, .pcd,
    /// .e57, .ptx, and text: .xyz, .txt, .csv, .pts, .asc ...; also compressed, .zst and .gz). What
    /// is no scan is left out and listed. With --merge .esker files. Generated scans are named
    /// synthetic:SCENE:POINTS or synthetic:SCENE:POINTS:SEED: SCENE is bridge, office, terrain, or
    /// a model with sharp edges, cube or csg; POINTS such as 250000, 100k, 10M or 1G; SEED a whole
    /// number, 1 by default.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// The file to build.
    #[arg(short, long, value_name = "OUT.esker")]
    pub out: PathBuf,
    /// Take .esker files as inputs and make one tree of them and of all files that they name; every
    /// point and all that is known of its source is kept.
    #[arg(long)]
    pub merge: bool,
    /// Continue an earlier build of this output that was interrupted; inputs and options must be
    /// the same. Without one, start from the beginning.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Append {
    /// The .esker file to add to, which may itself name others.
    #[arg(value_name = "OLD.esker")]
    pub old: PathBuf,
    /// The scans to add, or folders of them.
    #[arg(required = true, value_name = "MORE")]
    pub inputs: Vec<PathBuf>,
    /// The file to build.
    #[arg(short, long, value_name = "OUT.esker")]
    pub out: PathBuf,
    /// Leave out and count points outside of the old file's range of coordinates.
    #[arg(long)]
    pub drop_outside: bool,
    /// Continue an earlier build of this output that was interrupted; inputs and options must be
    /// the same. Without one, start from the beginning.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Verify {
    /// The .esker file; or a LAS, LAZ or COPC file, with the .esker file that it was exported from
    /// as IN.
    pub file: PathBuf,
    /// The scans that the file was built from, or folders of them. For a file made by append, the
    /// scans that were added last, or those of all files, in any order.
    #[arg(long, num_args = 1.., value_name = "IN")]
    pub against: Vec<PathBuf>,
    #[command(flatten)]
    pub reading: ReadHow,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Render {
    /// An .esker file, or scans, or folders of scans; or a scene document (docs/scene.md), whose
    /// fields count as these options do. An option that is given replaces the document's.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// The picture to write.
    #[arg(
        short,
        long,
        value_name = "P.png",
        required_unless_present_any = ["explain", "save_scene"]
    )]
    pub out: Option<PathBuf>,
    /// Draw nothing, and print what the picture would take: passes, attributes, pipelines, and what
    /// is left out and why.
    #[arg(long)]
    pub explain: bool,
    /// Write a scene document of this picture: its scans, and all of these options but those of
    /// the machine (--backend, --threads, --memory, --scratch). Without --out nothing is drawn.
    #[arg(long, value_name = "OUT.json", conflicts_with = "explain")]
    pub save_scene: Option<PathBuf>,
    /// Width and height in pixels; 1024x1024 by default.
    #[arg(long, value_parser = quantity::picture_size)]
    pub size: Option<[u32; 2]>,
    /// Draw only this part of the picture: first column and row, width and height, in pixels. Parts
    /// fit together: they show the same points as the whole picture.
    #[arg(long, value_name = "X,Y,W,H", value_parser = quantity::window)]
    pub window: Option<Window>,
    /// Points alone, closed surfaces, splats, or splats that are lit; auto by default.
    #[arg(long, value_parser = method_parser())]
    pub method: Option<Method>,
    /// "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=60", in the scan's coordinates; each part may be
    /// missing. Without a target the camera looks along "direction=x,y,z"; without an eye it is
    /// placed so that the whole scan is in view. With "ortho=HEIGHT" in place of fovy the view is
    /// parallel (orthographic), its picture so high in the scan's unit, or as high as the scan with
    /// "ortho=fit"; nothing behind its eye is drawn.
    #[arg(long)]
    pub camera: Option<Camera>,
    /// Axis that points upwards, in place of the camera's "up": x, y, z, -x, -y or -z. Without
    /// either it is z, or guessed where PLY, PCD and E57 files name no coordinate system.
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub up: Option<Vertical>,
    /// Show the whole scan, whatever eye and target the camera names.
    #[arg(long)]
    pub fit: bool,
    /// Greatest number of points that are drawn; 10000000 by default.
    #[arg(long, value_name = "N", value_parser = quantity::points_budget)]
    pub budget_points: Option<u64>,
    /// Choose a coarser resolution, and if need be points alone, so that a frame takes at most so
    /// many milliseconds on this machine's CPU, whose speed is measured at first use.
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = quantity::milliseconds)]
    pub budget_ms: Option<f64>,
    /// Distance of neighbouring points in the picture that is fine enough, in pixels; 1 by default,
    /// 0 draws all points.
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = quantity::spacing_px)]
    pub target_spacing: Option<f64>,
    /// What gives points their colour: rgb, intensity, elevation (along the camera's up), x, y, z,
    /// classification, return_number, number_of_returns, source_id, time, normal, level, depth,
    /// plain, or the name of any attribute. A range of values may follow, with either end open.
    #[arg(long, value_name = "NAME[:MIN..MAX][:MAP]", aliases = ["colour-by", "color"])]
    pub colour: Option<String>,
    #[command(flatten)]
    pub filter: FilterArgs,
    /// Light surfaces without highlights.
    #[arg(long)]
    pub no_highlights: bool,
    /// Leave out points of surfaces whose normal looks away from the camera; else both sides are
    /// drawn.
    #[arg(long)]
    pub cull_back: bool,
    /// Diameter of points that are drawn alone, in pixels, or "adaptive": dots of neighbouring
    /// points touch; 1 by default.
    #[arg(long, value_name = "PX|adaptive", value_parser = quantity::point_size)]
    pub point_size: Option<PointSize>,
    /// Show the shape of points that are drawn alone: darken what lies behind its surroundings; a
    /// strength may follow, 1 by default.
    #[arg(long, value_name = "STRENGTH", num_args = 0..=1, default_missing_value = "1", value_parser = quantity::strength)]
    pub eye_dome: Option<f32>,
    /// Even out differences of exposure where scans cover the same surface; point_source_id, scan
    /// or scan_id distinguishes scans.
    #[arg(long)]
    pub even_exposure: bool,
    /// Draw exact colours although the file has compact ones (see build --compact).
    #[arg(long)]
    pub full: bool,
    #[command(flatten)]
    pub light: LightArgs,
    #[command(flatten)]
    pub with: DrawWithArgs,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}
