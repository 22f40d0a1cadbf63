//! The command line.

use crate::bench::{BenchRender, LeaveOut};
use crate::export::FilterArgs;
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use esker_engine::backend::{Api, Backend, DrawWith, GpuRequest, ProjectPath};
use esker_engine::bench::build::Against;
use esker_engine::bench::draw::POINTS_MAX;
use esker_engine::bench::stream::Settings;
use esker_engine::camera::Camera;
use esker_engine::progress::Style;
use esker_engine::{Codec, ColourDepth, Method, NormalsMode, quantity};
use std::ffi::OsString;
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
    /// Build an .esker file from scans (LAS, LAZ, PLY, XYZ, TXT, CSV; or generated ones,
    /// synthetic:SCENE:POINTS[:SEED]).
    Build(Build),
    /// Add scans to an .esker file without writing it again: a new file holds their points and names the old
    /// one, and is opened in its place. Points between the old file's steps are rounded, those outside of its
    /// lattice refused.
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

#[derive(Subcommand)]
pub enum Benchmark {
    /// Fly a camera through a scan without a window and measure streaming: nodes, points, times, bytes
    /// read, memory against the budgets; with and without the depth test.
    Stream(Box<Stream>),
    /// Draw points that lie in memory and measure how many a second become pixels, by every path of the GPU
    /// and by the CPU, in Morton and in random order; and the share of memory bandwidth that they reach.
    Draw(Box<Draw>),
    /// Draw models whole by every method and backend, as table 1 of marroquim2007 does: project, pull-push, shade and
    /// total milliseconds, beside the time in which the same bytes are copied.
    Render(Box<BenchRender>),
    /// Draw a scene with and without each thing that it can do without: bytes read, bytes resident, milliseconds.
    LeaveOut(Box<LeaveOut>),
    /// Build scans beside a rival program, turn by turn: seconds, CPU time, memory, scratch space, bytes out, and
    /// what decoding alone takes.
    Build(BenchBuild),
    /// Read scans and drop their points: the floor of building.
    Decode(Decode),
}

#[derive(ClapArgs)]
pub struct BenchBuild {
    /// Scans; each is built by itself, in a process of its own, into a temporary file.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// A rival: the path of PotreeConverter or copc_converter, or a command line such as
    /// "program -i {in} -o {out}".
    #[arg(long, value_name = "PROGRAM", value_parser = parse_against)]
    pub against: Option<Against>,
    /// Runs that medians are taken of.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: usize,
    /// Memory that our builds may use; half of what the machine grants where not said.
    #[arg(long, value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Threads of ours; one a core where not said.
    #[arg(long, value_parser = quantity::threads)]
    pub threads: Option<usize>,
    /// Folder for all outputs and scratch files, which are deleted after each run; the system's where not said.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Further options of `esker build`, for ours.
    #[arg(last = true, value_name = "OPTIONS")]
    pub options: Vec<OsString>,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

#[derive(ClapArgs)]
pub struct Decode {
    /// The scans.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
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

#[derive(ClapArgs)]
pub struct Stream {
    /// .esker files; scans, and synthetic:SCENE:POINTS:SEED, are built first, into a temporary file. Each
    /// is measured in a process of its own.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// The camera's path; where not said: an overview, nearer, then a dense place.
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Drawing memory (in main memory, for the CPU renderer).
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Main memory beside that: table, statistics, staging, the renderer's buffers.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
    #[command(flatten)]
    pub with: DrawWithArgs,
    /// Draw what is hidden, too. Else the flight without the depth test is measured beside the one with.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Empty the system's cache of the file before each flight, and compare loading a view with plain
    /// reads of the same ranges.
    #[arg(long)]
    pub cold: bool,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Measure with the settings of kanzok2015 as well: 5 buffers on their way, one loader, 2,000 nodes.
    #[arg(long)]
    pub paper: bool,
    /// Whose settings a single run has.
    #[arg(long, value_enum, default_value_t, hide = true)]
    pub settings: SettingsArg,
    /// Build scans once with each of these node capacities, such as 32768,65536,131072.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    pub capacities: Vec<u32>,
    /// Folder for a picture of each view.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    #[command(flatten)]
    pub how: BuildHow,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

#[derive(ClapArgs)]
pub struct Draw {
    /// An .esker file, whose points are drawn in its order; generated points where not said.
    #[arg(value_name = "FILE", conflicts_with = "points")]
    pub file: Option<PathBuf>,
    /// Numbers of generated points, such as 1M,20M; where not said 1, 5 and 20 million, on a GPU from 1 million
    /// to as many as fit.
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = parse_points)]
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
    #[command(flatten)]
    pub with: DrawWithArgs,
    /// Positions on the GPU, at most.
    #[arg(long, value_name = "BYTES", default_value = "4GiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Positions in main memory, for the CPU renderer, at most.
    #[arg(long, value_name = "BYTES", default_value = "2GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
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

/// What draws.
#[derive(ClapArgs)]
pub struct DrawWithArgs {
    /// What draws: a GPU where there is a real one, else the CPU (auto); a GPU or nothing; the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub backend: BackendArg,
    /// How a GPU makes pixels of points; the best that it has where not said.
    #[arg(long, value_enum, hide = true)]
    pub gpu_path: Option<PathArg>,
    /// The interface that a GPU is driven by.
    #[arg(long, value_enum, hide = true)]
    pub gpu_api: Option<ApiArg>,
    /// A driver on the CPU counts as a GPU, too.
    #[arg(long, hide = true)]
    pub gpu_software: bool,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum BackendArg {
    /// A GPU where there is a real one, else the CPU.
    #[default]
    Auto,
    /// A GPU or an error.
    Gpu,
    /// The CPU renderer.
    Cpu,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum PathArg {
    /// One 64-bit atomic minimum a point.
    Atomics,
    /// Point primitives.
    Primitives,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum ApiArg {
    Vulkan,
    Gl,
    Metal,
    Dx12,
}

impl From<&DrawWithArgs> for DrawWith {
    fn from(args: &DrawWithArgs) -> Self {
        let backend = match args.backend {
            BackendArg::Auto => Backend::Auto,
            BackendArg::Gpu => Backend::Gpu,
            BackendArg::Cpu => Backend::Cpu,
        };
        let path = args.gpu_path.map(|path| match path {
            PathArg::Atomics => ProjectPath::Atomics,
            PathArg::Primitives => ProjectPath::Primitives,
        });
        let api = args.gpu_api.map(|api| match api {
            ApiArg::Vulkan => Api::Vulkan,
            ApiArg::Gl => Api::Gl,
            ApiArg::Metal => Api::Metal,
            ApiArg::Dx12 => Api::Dx12,
        });
        let default = GpuRequest::default();
        let backends = api.map_or(default.backends, Api::backends);
        let allow_software = args.gpu_software;
        Self { backend, gpu: GpuRequest { backends, allow_software, path, ..default } }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum SettingsArg {
    /// Esker's.
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
pub struct Build {
    /// The scans, or with --merge .esker files; also generated ones, named as synthetic:SCENE:POINTS[:SEED]: SCENE is bridge, office or
    /// terrain, POINTS such as 250000, 100k, 10M or 1G, SEED a whole number (1 where not said).
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
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

#[derive(ClapArgs)]
pub struct Append {
    /// The .esker file to add to; it may name others itself.
    #[arg(value_name = "OLD.esker")]
    pub old: PathBuf,
    /// The scans to add.
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
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

/// How scans are built, wherever they are.
#[derive(ClapArgs)]
pub struct BuildHow {
    /// Memory that building may use, such as 4GiB; half of what the machine grants where not said.
    #[arg(long, value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Folder for what does not fit memory; the system's where not said.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Points that a node holds: 65536, or as many as in the file that is appended to, where not said.
    #[arg(long)]
    pub node_capacity: Option<u32>,
    /// What 16-bit colour fields hold: values of 8 or of 16 bits. Detected for each input where not said.
    #[arg(long, value_enum)]
    pub colour_bits: Option<ColourBits>,
    /// How attributes that are not drawn are compressed; nothing is lost.
    #[arg(long, value_enum, default_value_t)]
    pub compress: Compress,
    /// Take coordinates as they are where inputs name different coordinate reference systems.
    #[arg(long)]
    pub ignore_crs: bool,
    /// Where the normals that are drawn come from.
    #[arg(long, value_enum, default_value_t)]
    pub normals: NormalsArg,
    /// Threads; one a core where not said.
    #[arg(long, value_parser = quantity::threads, default_value = "0", hide_default_value = true)]
    pub threads: usize,
}

#[derive(ClapArgs)]
pub struct Verify {
    /// The file.
    pub file: PathBuf,
    /// The scans that it was built from.
    #[arg(long, num_args = 1.., value_name = "IN")]
    pub against: Vec<PathBuf>,
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
    /// without an eye the scan is fitted, seen along "direction=x,y,z".
    #[arg(long, value_parser = parse_camera, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// Show all of the scan, whatever eye and target the camera names.
    #[arg(long)]
    pub fit: bool,
    /// Points drawn at most.
    #[arg(long, value_name = "N", default_value_t = 10_000_000)]
    pub budget_points: u64,
    /// Distance of neighbouring points on the picture that is fine enough, in pixels; 0 draws all.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_spacing)]
    pub target_spacing: f64,
    /// rgb, intensity, elevation, classification, return_number, source_id, time, normal, level, depth, plain, or any
    /// attribute's name; where it has a range of values, that may follow, with either end open.
    #[arg(long, value_name = "NAME[:MIN..MAX]", aliases = ["colour-by", "color"])]
    pub colour: Option<String>,
    #[command(flatten)]
    pub filter: FilterArgs,
    /// Light surfaces without highlights.
    #[arg(long)]
    pub no_highlights: bool,
    #[command(flatten)]
    pub with: DrawWithArgs,
    #[command(flatten)]
    pub how: BuildHow,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum ProgressArg {
    /// A bar, on a terminal.
    #[default]
    Bar,
    /// Lines of JSON.
    Json,
    /// Nothing.
    None,
}

impl From<ProgressArg> for Style {
    fn from(arg: ProgressArg) -> Self {
        match arg {
            ProgressArg::Bar => Self::Bar,
            ProgressArg::Json => Self::Json,
            ProgressArg::None => Self::None,
        }
    }
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum MethodArg {
    /// One pixel a point.
    Points,
    /// Surfaces closed by pull-push interpolation.
    #[default]
    PullPush,
    /// Splats of exact perspective shape, filtered and blended: for quality.
    Ewa,
}

impl From<MethodArg> for Method {
    fn from(arg: MethodArg) -> Self {
        match arg {
            MethodArg::Points => Self::Points,
            MethodArg::PullPush => Self::PullPush,
            MethodArg::Ewa => Self::Ewa,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum ColourBits {
    /// 0 to 255 in 16-bit fields.
    #[value(name = "8")]
    Eight,
    /// The full 16 bits, or 8 bits in the upper byte.
    #[value(name = "16")]
    Sixteen,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum NormalsArg {
    /// From the scans, where they bring any.
    #[default]
    Keep,
    /// Estimated for all points, from their neighbours.
    Estimate,
    /// None.
    None,
}

impl From<NormalsArg> for NormalsMode {
    fn from(arg: NormalsArg) -> Self {
        match arg {
            NormalsArg::Keep => Self::Keep,
            NormalsArg::Estimate => Self::Estimate,
            NormalsArg::None => Self::None,
        }
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum Compress {
    /// LZ4: costs little.
    #[default]
    Fast,
    /// Zstandard: smaller, slower.
    Small,
    /// Not at all.
    None,
}

impl From<Compress> for Codec {
    fn from(arg: Compress) -> Self {
        match arg {
            Compress::Fast => Self::Fast,
            Compress::Small => Self::Small,
            Compress::None => Self::None,
        }
    }
}

impl From<ColourBits> for ColourDepth {
    fn from(arg: ColourBits) -> Self {
        match arg {
            ColourBits::Eight => Self::Eight,
            ColourBits::Sixteen => Self::Sixteen,
        }
    }
}

pub fn parse_camera(text: &str) -> Result<Camera, String> {
    Camera::parse(text).map_err(|e| format!("{e:#}"))
}

fn parse_against(text: &str) -> Result<Against, String> {
    Against::parse(text).map_err(|e| format!("{e:#}"))
}

pub fn parse_points(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.as_bytes().last() {
        Some(b'k') => (&text[..text.len() - 1], 1_000),
        Some(b'M') => (&text[..text.len() - 1], 1_000_000),
        Some(b'G') => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    let points = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(unit));
    points.filter(|points| (1..=POINTS_MAX).contains(points)).ok_or_else(|| {
        format!("`{text}` is no number of points from 1 to {POINTS_MAX}, such as 20M")
    })
}

fn parse_spacing(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("`{text}` is no number"))?;
    if (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err(format!("{value} pixels are out of range"))
    }
}
