//! `esker bench`: the options of each benchmark, and the call of `esker_bench` that they become.

use crate::output::Output;
use crate::shared::{BuildHow, DrawWithArgs, Threads, note_built, passes_parser};
use anyhow::{Context, Result, bail, ensure};
use clap::{Args as ClapArgs, Subcommand, ValueEnum};
use esker_bench::build::{self, BuildBenchRequest, Rival};
use esker_bench::draw::{self, DrawBenchRequest};
use esker_bench::error_time::{self, ErrorTimeRequest};
use esker_bench::leave_out::{self, LeaveOutRequest};
use esker_bench::render::{self, RenderBenchRequest};
use esker_bench::size::{self, SizeBenchRequest};
use esker_bench::splats::{self, SplatsBenchRequest};
use esker_bench::stability::{self, StabilityRequest};
use esker_bench::stream::{self, FlightRequest, Settings, StreamBenchRequest};
#[cfg(feature = "light")]
use esker_bench::trace::{self, Part, TraceBenchRequest};
use esker_engine::Method;
use esker_engine::cameras::camera::Camera;
use esker_engine::io::progress::Progress;
use esker_engine::io::quantity;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Subcommand)]
pub enum Benchmark {
    /// Fly a camera through a scan without a window and measure streaming: nodes, points, times,
    /// bytes read, memory against the budgets; with and without the depth test.
    Stream(Box<Stream>),
    /// Draw points that are in memory: points a second by every path of the GPU and by the CPU, in
    /// Morton and in random order, and the share of memory bandwidth that they reach.
    Draw(Box<Draw>),
    /// Draw models whole by every method and backend, as table 1 of marroquim2007 does:
    /// milliseconds a pass, beside the time in which the same bytes are copied; on a GPU also
    /// beside the floor that its memory and dispatches set.
    Render(Box<BenchRender>),
    /// Draw a scene with and without each thing that it can do without: bytes read, bytes resident,
    /// milliseconds.
    LeaveOut(Box<LeaveOut>),
    /// Draw scans by every method and setting: the error of the picture, against a reference of all
    /// points, over the time of a frame; which settings are best at their time; a page for a scan.
    ErrorTime(Box<BenchErrorTime>),
    /// Change scans in ways that must not change their pictures, and make conditions worse, one at
    /// a time, until a bound on the error of the picture breaks: rated and limiting conditions.
    Stability(BenchStability),
    /// Draw a scene from smaller forms of its data: error of the picture, of positions, colours and
    /// normals, against bytes a point.
    Size(BenchSize),
    /// Build scans and, in turn, have another program build them: seconds, CPU time, memory,
    /// scratch space, bytes written, and what decoding alone takes.
    Build(BenchBuild),
    /// Read scans and discard their points: the least time that building can take.
    Decode(Decode),
    /// Trace light in generated meshes and scans: times by bounces, samples and filters, and errors
    /// against references, as tables 1 and 2 and figures 2 and 5 to 8 of bauszat2011.
    #[cfg(feature = "light")]
    Trace(BenchTrace),
}

/// Options of benchmarks that draw on the CPU and on a GPU.
#[derive(ClapArgs)]
pub struct DrawHow {
    #[command(flatten)]
    pub with: DrawWithArgs,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

/// Runs a benchmark.
pub fn run(benchmark: Benchmark, stop: Arc<AtomicBool>) -> Result<()> {
    match benchmark {
        Benchmark::Stream(args) => run_stream(*args, stop),
        Benchmark::Draw(args) => run_draw(*args, stop),
        Benchmark::Render(args) => run_render(*args, stop),
        Benchmark::LeaveOut(args) => run_leave_out(*args, stop),
        Benchmark::ErrorTime(args) => run_error_time(*args, stop),
        Benchmark::Stability(args) => run_stability(args, stop),
        Benchmark::Size(args) => run_size(args, stop),
        Benchmark::Build(args) => run_build(args, stop),
        Benchmark::Decode(args) => run_decode(args, stop),
        #[cfg(feature = "light")]
        Benchmark::Trace(args) => run_trace(args, stop),
    }
}

#[derive(ClapArgs)]
pub struct BenchRender {
    /// .esker files or scans; by default generated models as large as those of the paper.
    #[arg(value_name = "MODEL", conflicts_with = "points")]
    pub models: Vec<PathBuf>,
    /// Numbers of points of generated models, such as 25k,5M.
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = quantity::points)]
    pub points: Vec<u64>,
    /// Widths and heights in pixels; 512x512 and 1024x1024 by default.
    #[arg(
        long,
        value_name = "WxH,WxH",
        value_delimiter = ',',
        value_parser = quantity::picture_size
    )]
    pub size: Vec<[u32; 2]>,
    /// Measure this method alone. ewa without a model measures splats a second, in one pass and in
    /// three (table 1 of zwicker2004).
    #[arg(long, value_parser = passes_parser())]
    pub method: Option<Method>,
    /// Multiply the radii of points by these factors, such as 1,2,4: the time against the radius,
    /// beside that of a full screen.
    #[arg(long, value_name = "X,X", value_delimiter = ',', value_parser = radius_factor)]
    pub radii: Vec<f32>,
    #[command(flatten)]
    pub how: DrawHow,
}

#[derive(ClapArgs)]
pub struct LeaveOut {
    /// .esker files, or scans.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// The camera, as in `esker render`.
    #[arg(long, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    #[command(flatten)]
    pub how: DrawHow,
}

#[derive(ClapArgs)]
pub struct BenchErrorTime {
    /// Scans, or .esker files. Options of the build are compared for scans alone.
    #[arg(required = true, value_name = "SCAN")]
    pub files: Vec<PathBuf>,
    /// Width and height of the shown picture, pixels.
    #[arg(long, default_value = "960x600", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// The camera, as in `esker render`.
    #[arg(long, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// What colours show, as in `esker render`.
    #[arg(long, value_name = "NAME")]
    pub colour: Option<String>,
    /// Vary one setting at a time; this is the default.
    #[arg(long, conflicts_with = "full")]
    pub quick: bool,
    /// Cross the settings.
    #[arg(long)]
    pub full: bool,
    /// Bytes that are read a second at most while streaming is measured, such as 8MiB: orders of
    /// loading differ where a disk or network is slow.
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    pub read_rate: Option<u64>,
    /// Write a page about each scan to this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub how: DrawHow,
}

#[derive(ClapArgs)]
pub struct BenchStability {
    /// Scans on which the relations are tested; generated ones by default.
    #[arg(value_name = "SCAN")]
    pub scans: Vec<PathBuf>,
    /// Measure these parts alone: relations, axes, stiffness, or the name of an axis, such as
    /// density-jump.
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    pub parts: Vec<String>,
    /// Take few values and points; this is the default.
    #[arg(long, conflicts_with = "full")]
    pub quick: bool,
    /// Take more values, more points and larger pictures.
    #[arg(long)]
    pub full: bool,
    /// Write the pictures of all conditions, beside the exact ones, to this folder.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Print the limits as a table in Markdown.
    #[arg(long, conflicts_with = "json")]
    pub markdown: bool,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct BenchBuild {
    /// The scans. Each is built by itself, in a process of its own, into a temporary file; each run
    /// builds all of them.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// The other program: the path of PotreeConverter or copc_converter, or a command line such as
    /// "program -i {in} -o {out}".
    #[arg(long, value_name = "PROGRAM", value_parser = parse_rival)]
    pub against: Option<Rival>,
    /// Runs whose median is reported.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: usize,
    /// Memory that `esker build` may use; half of the machine's memory by default.
    #[arg(long, value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Threads of `esker build`; one a core by default.
    #[arg(long, value_parser = quantity::threads)]
    pub threads: Option<usize>,
    /// Folder for outputs and scratch files, which are deleted after each run; the system's
    /// temporary folder by default.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Further options of `esker build`.
    #[arg(last = true, value_name = "OPTIONS")]
    pub options: Vec<OsString>,
    #[command(flatten)]
    pub output: Output,
}

#[cfg(feature = "light")]
#[derive(ClapArgs)]
pub struct BenchTrace {
    /// These scenes alone, such as bust,office; by default bust, knot, hall, office and terrain,
    /// and bunny and indoor where ESKER_DATA is set.
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// These parts alone: frames, filters, errors, sweep, convergence, limits or moving.
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',', value_parser = Part::parse)]
    pub parts: Vec<Part>,
    /// Width and height in pixels; 1024x768 by default, as in the paper, or 256x192 with --quick.
    #[arg(long, value_name = "WxH", value_parser = quantity::picture_size)]
    pub size: Option<[u32; 2]>,
    /// Take smaller pictures, scenes of fewer surfaces and references of fewer samples.
    #[arg(long)]
    pub quick: bool,
    /// Write the figures to this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Keep references in this folder; by default in the system's folder of temporary files.
    #[arg(long, value_name = "DIR")]
    pub references: Option<PathBuf>,
    /// Samples of each of the two references; 64 by default, or 16 with --quick.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub reference_samples: Option<u32>,
    /// Make references again that are in the folder.
    #[arg(long)]
    pub rebuild: bool,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Decode {
    /// The scans.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Stream {
    /// .esker files or scans; scans, and synthetic:SCENE:POINTS:SEED, are first built into a
    /// temporary file. Each file is measured in a process of its own.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// The camera path; by default an overview, a nearer view, then a dense place.
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Drawing memory, which is main memory for the CPU renderer.
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Main memory beside it: tables, statistics, staging, buffers of the renderer.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
    #[command(flatten)]
    pub with: DrawWithArgs,
    /// Draw hidden nodes too, and measure no second flight.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Remove the file from the system's cache before each flight, and compare loading a view with
    /// plain reads of the same bytes.
    #[arg(long)]
    pub cold: bool,
    /// Rate and round trip of the line to the server of files at addresses, such as 100,50 for 100
    /// Mbit/s and 50 ms: the time until the first view is complete is compared with what they
    /// allow.
    #[arg(long, value_name = "MBIT,MS", value_parser = parse_line)]
    pub line: Option<stream::Line>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Measure the settings of kanzok2015 as well: 5 buffers in flight, one loader, 2,000 nodes.
    #[arg(long)]
    pub paper: bool,
    /// Settings of a single run.
    #[arg(long, value_enum, default_value_t, hide = true)]
    pub settings: SettingsArg,
    /// Build scans once with each of these node capacities, such as 32768,65536,131072.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    pub capacities: Vec<u32>,
    /// Read exact colours although the file has compact ones (see build --compact).
    #[arg(long)]
    pub full: bool,
    /// Write a picture of each view to this folder.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Draw {
    /// An .esker file, whose points are drawn in its order; generated points by default.
    #[arg(value_name = "FILE", conflicts_with = "points")]
    pub file: Option<PathBuf>,
    /// Numbers of generated points, such as 1M,20M; by default 1, 5 and 20 million, on a GPU from 1
    /// million to as many as fit.
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = quantity::points)]
    pub points: Vec<u64>,
    /// Widths and heights in pixels.
    #[arg(
        long,
        value_name = "WxH,WxH",
        value_delimiter = ',',
        default_value = "1024x1024,1920x1080",
        value_parser = quantity::picture_size
    )]
    pub size: Vec<[u32; 2]>,
    /// Greatest sum of positions on the GPU.
    #[arg(long, value_name = "BYTES", default_value = "4GiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Greatest sum of positions in main memory, for the CPU renderer.
    #[arg(long, value_name = "BYTES", default_value = "2GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
    #[command(flatten)]
    pub how: DrawHow,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum SettingsArg {
    /// Esker's defaults.
    #[default]
    Own,
    /// Those of kanzok2015.
    Paper,
}

impl From<SettingsArg> for Settings {
    fn from(arg: SettingsArg) -> Self {
        match arg {
            SettingsArg::Own => Self::Own,
            SettingsArg::Paper => Self::Paper,
        }
    }
}

#[derive(ClapArgs)]
pub struct BenchSize {
    /// .esker files, or scans.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub output: Output,
}

/// Parses a factor of radii.
fn radius_factor(text: &str) -> Result<f32> {
    let factor = text.parse().ok().filter(|factor| (0.01..=1000.0).contains(factor));
    factor.with_context(|| format!("{text:?} is not a number from 0.01 to 1000"))
}

/// Table 1 of `marroquim2007`: times of a frame.
fn run_render(mut args: BenchRender, stop: Arc<AtomicBool>) -> Result<()> {
    if args.models.is_empty() && args.method == Some(Method::Ewa) {
        return run_splats(args, stop);
    }
    if args.size.is_empty() {
        args.size = vec![[512, 512], [1024, 1024]];
    }
    let request = RenderBenchRequest {
        models: args.models,
        points: args.points,
        sizes: args.size,
        method: args.method,
        radii: args.radii,
        with: (&args.how.with).into(),
        threads: args.how.threads.count,
    };
    args.how.output.report(stop, |progress| render::measure(&request, progress), render::text)
}

/// Table 1 of `zwicker2004`: splats a second.
fn run_splats(args: BenchRender, stop: Arc<AtomicBool>) -> Result<()> {
    ensure!(args.radii.is_empty(), "--radii needs models: name one, or another --method");
    let request = SplatsBenchRequest {
        splats: args.points,
        sizes: args.size,
        with: (&args.how.with).into(),
        threads: args.how.threads.count,
    };
    args.how.output.report(stop, |progress| splats::measure(&request, progress), splats::text)
}

fn run_leave_out(args: LeaveOut, stop: Arc<AtomicBool>) -> Result<()> {
    let request = LeaveOutRequest {
        files: args.files,
        size: args.size,
        camera: args.camera,
        with: (&args.how.with).into(),
        threads: args.how.threads.count,
    };
    let output = &args.how.output;
    let report = output.watch(stop, |progress| leave_out::measure(&request, progress))?;
    output.print(&report, || leave_out::text(&report))?;
    let faults = report.faults();
    ensure!(
        faults.is_empty(),
        "left out as not needed, but the picture changes: {}",
        faults.join("; ")
    );
    Ok(())
}

fn run_error_time(args: BenchErrorTime, stop: Arc<AtomicBool>) -> Result<()> {
    let request = ErrorTimeRequest {
        files: args.files,
        size: args.size,
        camera: args.camera,
        colour_by: args.colour,
        is_full: args.full,
        with: (&args.how.with).into(),
        threads: args.how.threads.count,
        read_bytes_a_second: args.read_rate,
        out: args.out,
    };
    let measure = |progress: &Progress| error_time::measure(&request, progress);
    args.how.output.report(stop, measure, error_time::text)
}

fn run_stability(args: BenchStability, stop: Arc<AtomicBool>) -> Result<()> {
    let request = StabilityRequest {
        scans: args.scans,
        is_full: args.full,
        parts: args.parts,
        pictures: args.pictures,
        threads: args.threads.count,
    };
    let report = args.output.watch(stop, |progress| stability::measure(&request, progress))?;
    let text = if args.markdown { stability::markdown } else { stability::text };
    args.output.print(&report, || text(&report))?;
    match stability::failure(&report) {
        Some(failure) => bail!(failure),
        None => Ok(()),
    }
}

fn run_size(args: BenchSize, stop: Arc<AtomicBool>) -> Result<()> {
    let request =
        SizeBenchRequest { files: args.files, size: args.size, threads: args.threads.count };
    args.output.report(stop, |progress| size::measure(&request, progress), size::text)
}

impl Benchmark {
    /// Whether files are to be read as if for the first time.
    #[cfg(feature = "remote")]
    pub fn is_cold(&self) -> bool {
        matches!(self, Self::Stream(args) if args.cold)
    }
}

fn parse_line(text: &str) -> Result<stream::Line, String> {
    let number = |text: &str| text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
    let both = text.split_once(',').and_then(|(a, b)| Some((number(a)?, number(b)?)));
    let (mbit_s, round_trip_ms) = both.ok_or("two numbers above 0 are needed, such as 100,50")?;
    Ok(stream::Line { mbit_s, round_trip_ms })
}

fn run_stream(args: Stream, stop: Arc<AtomicBool>) -> Result<()> {
    note_built(&args.inputs, &args.how);
    let request = StreamBenchRequest {
        flight: FlightRequest {
            path: args.path,
            with: (&args.with).into(),
            budget_gpu_bytes: args.budget_gpu,
            budget_ram_bytes: args.budget_ram,
            size: args.size,
            occlusion: !args.no_occlusion,
            cold: args.cold,
            settings: args.settings.into(),
            full: args.full,
            pictures: args.pictures,
            line: args.line,
            threads: args.how.threads.count,
        },
        inputs: args.inputs,
        paper_too: args.paper,
        capacities: args.capacities,
        build: args.how.options(),
        program: std::env::current_exe().context("cannot find the program itself")?,
    };
    let report = args.output.watch(stop, |progress| stream::measure(&request, progress))?;
    args.output.print(&report, || stream::text(&report))?;
    ensure!(
        !report.is_over_budget(),
        "a run took more memory than its budgets, as the report says; please report this with the file"
    );
    Ok(())
}

fn run_draw(args: Draw, stop: Arc<AtomicBool>) -> Result<()> {
    let request = DrawBenchRequest {
        file: args.file,
        points: args.points,
        sizes: args.size,
        with: (&args.how.with).into(),
        budget_gpu_bytes: args.budget_gpu,
        budget_ram_bytes: args.budget_ram,
        threads: args.how.threads.count,
    };
    args.how.output.report(stop, |progress| draw::measure(&request, progress), draw::text)
}

fn run_build(args: BenchBuild, stop: Arc<AtomicBool>) -> Result<()> {
    let threads: Vec<_> = args.threads.iter().map(|n| format!("--threads={n}").into()).collect();
    let memory = args.memory.iter().map(|bytes| format!("--memory={bytes}").into());
    let request = BuildBenchRequest {
        inputs: args.inputs,
        rival: args.against,
        runs: args.runs,
        folder: args.scratch,
        build_arguments: memory.chain(threads.clone()).chain(args.options).collect(),
        decode_arguments: threads,
        esker: std::env::current_exe().context("cannot find the program itself")?,
    };
    let report = args.output.watch(stop, |progress| build::measure(&request, progress))?;
    args.output.print(&report, || build::text(&report))?;
    match build::failure(&report) {
        Some(failure) => bail!(failure),
        None => Ok(()),
    }
}

fn run_decode(args: Decode, stop: Arc<AtomicBool>) -> Result<()> {
    let (inputs, threads) = (&args.inputs, args.threads.count);
    let decode = |progress: &Progress| build::decode(inputs, threads, progress);
    args.output.report(stop, decode, build::decode_text)
}

/// Tables and figures of `bauszat2011`.
#[cfg(feature = "light")]
fn run_trace(args: BenchTrace, stop: Arc<AtomicBool>) -> Result<()> {
    let (size, samples) = if args.quick { ([256, 192], 16) } else { ([1024, 768], 64) };
    let request = TraceBenchRequest {
        scenes: args.scenes,
        parts: args.parts,
        size: args.size.unwrap_or(size),
        is_quick: args.quick,
        out: args.out,
        references: args
            .references
            .unwrap_or_else(|| std::env::temp_dir().join("esker-references")),
        reference_samples: args.reference_samples.unwrap_or(samples),
        rebuilds: args.rebuild,
        threads: args.threads.count,
    };
    args.output.report(stop, |progress| trace::measure(&request, progress), trace::text)
}

fn parse_rival(text: &str) -> Result<Rival, String> {
    Rival::parse(text).map_err(|e| format!("{e:#}"))
}
