//! Groups of options that several commands share, and the engine's types that they become.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args as ClapArgs, ValueEnum};
use esker_engine::draw::method::{METHODS, method_of_name};
use esker_engine::io::file::is_esker;
use esker_engine::io::visible::visible;
use esker_engine::io::{polygon, quantity};
use esker_engine::machine::backend::{Api, Backend, DrawWith, GpuRequest, ProjectPath};
use esker_engine::{
    Bounds, BuildOptions, Classes, Clip, Codec, ColourDepth, Columns, Crs, Filter, Flags, Method,
    NormalsMode, OpenOptions, Polygon, Resume, ValueRange,
};
use esker_engine::{UNITS, read_crs};
use std::path::{Path, PathBuf};

/// Number of threads.
#[derive(ClapArgs)]
pub struct Threads {
    /// Number of threads; one a core by default.
    #[arg(long = "threads", value_name = "N", value_parser = quantity::threads, default_value = "0", hide_default_value = true)]
    pub count: usize,
}

/// How scans are built.
#[derive(ClapArgs)]
pub struct BuildHow {
    /// Memory that building may use, such as 4GiB; at least 256MiB. Half of the machine's memory by
    /// default, or that least.
    #[arg(long, value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Folder for rows that do not fit in memory; the system's temporary folder by default.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Points that a node holds, 64 to 131072; 65536 by default, or as many as in the file that is
    /// appended to.
    #[arg(long)]
    pub node_capacity: Option<u32>,
    /// What 16-bit colour fields hold: values of 8 or of 16 bits. Detected for each input by
    /// default.
    #[arg(long, value_enum)]
    pub colour_bits: Option<ColourBits>,
    /// Compression of attributes that are not drawn; nothing is lost. Fast by default.
    #[arg(long, value_enum)]
    pub compress: Option<Compress>,
    /// Accept inputs of different coordinate reference systems, and take their coordinates as they
    /// are.
    #[arg(long)]
    pub ignore_crs: bool,
    /// Where the normals that are drawn come from; keep by default.
    #[arg(long, value_enum)]
    pub normals: Option<NormalsArg>,
    /// Find sharp edges, at which --method ewa clips its splats; estimates
    /// normals where the scans have none.
    #[arg(long)]
    pub sharp_features: bool,
    /// Store the shapes of splats (4 bytes a point), with which --method ewa closes the gaps
    /// between scan lines; estimates normals where the scans have none.
    #[arg(long)]
    pub tangents: bool,
    /// Store positions a second time, with palette colours (8 bytes a point), so that drawing
    /// colours reads 8 bytes a point instead of 12.
    #[arg(long)]
    pub compact: bool,
    /// Accept coordinates that are rounded by more than the typical distance of points.
    #[arg(long)]
    pub allow_rounding: bool,
    #[command(flatten)]
    pub reading: ReadHow,
    /// Coordinate reference system of inputs that state none: EPSG:2154, EPSG:2154+5720 with that
    /// of heights, WKT, or a file of WKT. Inputs that state another one are refused.
    #[arg(long, value_name = "CRS", value_parser = parse_crs)]
    pub crs: Option<Crs>,
    /// Unit of the coordinates of inputs that state none.
    #[arg(long, value_name = "UNIT", value_parser = unit_parser())]
    pub unit: Option<String>,
    #[command(flatten)]
    pub threads: Threads,
}

impl BuildHow {
    /// Names of the given options that change what is built; they have no effect on .esker files.
    fn given(&self) -> Vec<&'static str> {
        let all = [
            (self.node_capacity.is_some(), "--node-capacity"),
            (self.colour_bits.is_some(), "--colour-bits"),
            (!matches!(self.compress, None | Some(Compress::Fast)), "--compress"),
            (!matches!(self.normals, None | Some(NormalsArg::Keep)), "--normals"),
            (self.sharp_features, "--sharp-features"),
            (self.tangents, "--tangents"),
            (self.compact, "--compact"),
            (self.reading.columns.is_some(), "--columns"),
            (self.reading.skip_lines > 0, "--skip-lines"),
            (self.reading.apply_viewpoint, "--apply-viewpoint"),
            (self.crs.is_some(), "--crs"),
            (self.unit.is_some(), "--unit"),
        ];
        all.into_iter().filter(|(is_given, _)| *is_given).map(|(_, name)| name).collect()
    }

    /// Options of a build that can be continued when it is interrupted; `resumes` continues one.
    pub fn resumable(&self, resumes: bool) -> BuildOptions {
        let resume = if resumes { Resume::Now } else { Resume::Later };
        BuildOptions { resume, ..self.options() }
    }

    /// Options of a build.
    pub fn options(&self) -> BuildOptions {
        self.over(BuildOptions::default())
    }

    /// Options of a build, those of `base` where none is given.
    pub fn over(&self, base: BuildOptions) -> BuildOptions {
        let BuildHow { reading, .. } = self;
        let skip_lines = if reading.skip_lines > 0 { reading.skip_lines } else { base.skip_lines };
        BuildOptions {
            memory_bytes: self.memory.unwrap_or(base.memory_bytes),
            scratch: self.scratch.clone().or(base.scratch),
            node_capacity: self.node_capacity.unwrap_or(base.node_capacity),
            colour_depth: self.colour_bits.map(Into::into).or(base.colour_depth),
            compress: self.compress.map_or(base.compress, Into::into),
            normals: self.normals.map_or(base.normals, Into::into),
            sharp_features: base.sharp_features || self.sharp_features,
            tangents: base.tangents || self.tangents,
            compact: base.compact || self.compact,
            ignore_crs: base.ignore_crs || self.ignore_crs,
            allow_rounding: base.allow_rounding || self.allow_rounding,
            columns: reading.columns.clone().or(base.columns),
            skip_lines,
            apply_viewpoint: base.apply_viewpoint || reading.apply_viewpoint,
            crs: self.crs.clone().or(base.crs),
            unit: self.unit.clone().or(base.unit),
            ..base
        }
    }
}

/// How scans are read.
#[derive(ClapArgs)]
pub struct ReadHow {
    /// Which column of text files is which, by numbers from 1 or by the names in the file, in place
    /// of what the files tell: x=3,y=2,z=4,intensity=5.
    #[arg(long, value_name = "NAME=COLUMN,...")]
    pub columns: Option<Columns>,
    /// Lines at the beginning of text files that are passed over.
    #[arg(long, value_name = "N", default_value_t, hide_default_value = true)]
    pub skip_lines: u64,
    /// Transform the points and normals of PCD files by the pose in their headers (VIEWPOINT).
    #[arg(long)]
    pub apply_viewpoint: bool,
}

impl ReadHow {
    /// Options with which scans are opened.
    pub fn open_options(&self) -> OpenOptions {
        let Self { columns, skip_lines, apply_viewpoint } = self;
        OpenOptions {
            columns: columns.clone(),
            skip_lines: *skip_lines,
            apply_viewpoint: *apply_viewpoint,
            ..OpenOptions::default()
        }
    }
}

/// Prints a note for each input that is an `.esker` file, if there are options that have no effect
/// on it.
pub fn note_built(inputs: &[PathBuf], how: &BuildHow) {
    let options = how.given().join(", ");
    let is_built = |file: &&PathBuf| is_esker(file).is_ok_and(|is_built| is_built);
    for file in inputs.iter().filter(is_built).filter(|_| !options.is_empty()) {
        let name = visible(&file.display().to_string());
        eprintln!("note: {name}: is built already, {options} does not change it");
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

impl From<ColourBits> for ColourDepth {
    fn from(arg: ColourBits) -> Self {
        match arg {
            ColourBits::Eight => Self::Eight,
            ColourBits::Sixteen => Self::Sixteen,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum NormalsArg {
    /// From the scans, if any of them has normals; otherwise as fast.
    Keep,
    /// Estimated for all points, from their nearest neighbours.
    Estimate,
    /// Estimated for all points, in a fifth of that time; edges are blurred more.
    Fast,
    /// None.
    None,
}

impl From<NormalsArg> for NormalsMode {
    fn from(arg: NormalsArg) -> Self {
        match arg {
            NormalsArg::Keep => Self::Keep,
            NormalsArg::Estimate => Self::Estimate,
            NormalsArg::Fast => Self::Fast,
            NormalsArg::None => Self::None,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Compress {
    /// LZ4: fast.
    Fast,
    /// Zstandard: smaller, slower.
    Small,
    /// No compression.
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

/// Choice of points; all by default.
#[derive(ClapArgs)]
pub struct FilterArgs {
    /// Points in this box, its faces included, in the scan's coordinates; with four numbers, seen
    /// from above.
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    pub bounds: Option<Bounds>,
    /// Points above or below this polygon, its edges included, in the scan's coordinates: corners
    /// as "x,y x,y x,y", or a file of lines of x and y, in which an empty line begins another ring,
    /// or of GeoJSON.
    #[arg(long, value_name = "POLYGON", allow_hyphen_values = true, value_parser = parse_polygon)]
    pub polygon: Option<Polygon>,
    /// Points that a clip keeps, in the scan's coordinates: "box=x0,y0,z0,x1,y1,z1";
    /// "centre=x,y,z;size=x,y,z;rotation=z,y,x", a box that is turned by degrees about z, y and x;
    /// or "point=x,y,z;normal=x,y,z", the side of a plane away from its normal. With
    /// ";keep=outside" the points outside. May be repeated; all clips must keep a point then.
    #[arg(long = "clip", value_name = "CLIP")]
    pub clips: Vec<Clip>,
    /// Points of these classes: numbers, ranges and names, such as 2,6 or ground,3-5; overlap
    /// is class 12 and the flag.
    #[arg(long, value_name = "CLASSES")]
    pub classes: Option<Classes>,
    /// Points with any of these flags: withheld, synthetic, key-point, overlap. Classes 8 and 12,
    /// which mark key points and overlap in older files, count as well.
    #[arg(long, value_name = "FLAGS")]
    pub flags: Option<Flags>,
    /// No points with any of these flags.
    #[arg(long, value_name = "FLAGS")]
    pub without_flags: Option<Flags>,
    /// Points whose value of an attribute lies in this range, its ends included, either of which
    /// may be left out: intensity:..4000. May be repeated; all ranges must hold then.
    #[arg(long = "where", value_name = "ATTRIBUTE:MIN..MAX", allow_hyphen_values = true)]
    pub values: Vec<ValueRange>,
    /// An even sample whose points are about this length apart, above 0, in the scan's unit.
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = quantity::length)]
    pub max_spacing: Option<f64>,
}

impl FilterArgs {
    /// The filter, with the conditions of `base` where none is given.
    pub fn over(&self, base: Filter) -> Filter {
        Filter {
            bounds: self.bounds.or(base.bounds),
            polygon: self.polygon.clone().or(base.polygon),
            clips: if self.clips.is_empty() { base.clips } else { self.clips.clone() },
            classes: self.classes.or(base.classes),
            flags: self.flags.unwrap_or(base.flags),
            without_flags: self.without_flags.unwrap_or(base.without_flags),
            values: if self.values.is_empty() { base.values } else { self.values.clone() },
            max_spacing: self.max_spacing.or(base.max_spacing),
        }
    }
}

/// Parses a coordinate reference system, or reads the file that has it.
pub fn parse_crs(word: &str) -> Result<Crs, String> {
    let path = Path::new(word);
    let is_file = !word.contains('[') && path.is_file();
    if is_file { read_crs(path).map_err(|e| e.to_string()) } else { word.parse() }
}

/// Parses the word for a unit to its name.
fn unit_parser() -> impl TypedValueParser<Value = String> {
    let parser = PossibleValuesParser::new(UNITS.map(|(word, _)| word));
    parser.try_map(|word| {
        let named = UNITS.iter().find(|(other, _)| *other == word);
        named.map(|(_, name)| (*name).to_owned()).ok_or("no such unit")
    })
}

fn parse_polygon(word: &str) -> Result<Polygon, String> {
    polygon::read(word).map_err(|e| format!("{e:#}"))
}

/// Choice of the CPU or of a GPU.
#[derive(ClapArgs)]
pub struct DrawWithArgs {
    /// What draws: a real GPU if there is one, else the CPU (auto); a GPU or an error; the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub backend: BackendArg,
    /// How a GPU makes pixels of points; by default the best path that it supports.
    #[arg(long, value_enum, hide = true)]
    pub gpu_path: Option<PathArg>,
    /// Graphics interface of the GPU.
    #[arg(long, value_enum, hide = true)]
    pub gpu_api: Option<ApiArg>,
    /// Accept software drivers as GPUs.
    #[arg(long, hide = true)]
    pub gpu_software: bool,
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum BackendArg {
    /// A real GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// A GPU or an error.
    Gpu,
    /// The CPU renderer.
    Cpu,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum PathArg {
    /// A 64-bit atomic minimum for each point.
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

/// Parses the name of a drawing method.
pub fn method_parser() -> impl TypedValueParser<Value = Method> {
    method_parser_of(|_| true)
}

/// Parses the name of a drawing method whose passes are measured by themselves.
pub fn passes_parser() -> impl TypedValueParser<Value = Method> {
    method_parser_of(|method| !matches!(method, Method::Auto | Method::Lit))
}

fn method_parser_of(is_offered: fn(Method) -> bool) -> impl TypedValueParser<Value = Method> {
    let offered = METHODS.into_iter().filter(|&(method, ..)| is_offered(method));
    let values = offered.map(|(_, name, help)| PossibleValue::new(name).help(help));
    let parser = PossibleValuesParser::new(values);
    parser.try_map(|name| method_of_name(&name).ok_or("no such method"))
}
