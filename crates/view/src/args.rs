//! The command line of the window.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Parser, ValueEnum};
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::method::{DEFAULT_METHOD, METHODS, method_of_name};
use esker_engine::io::{polygon, quantity};
use esker_engine::{Bounds, Classes, Filter, Method, Polygon};
use std::path::PathBuf;

/// Flies through an .esker file, or a scan, in a window.
#[derive(Clone, Debug, Parser)]
#[command(name = "esker-view", version, about)]
pub struct Args {
    /// An .esker file; or scans, which are built first, into a temporary file.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// What draws the scene: a GPU where there is one that is no software driver, else the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub backend: Backend,
    /// What paints the window itself: a real GPU where there is one, else the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub window: WindowBy,
    /// Width and height of the window, in points.
    #[arg(long, default_value = "1280x800", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Points alone, closed surfaces, or splats.
    #[arg(long, value_parser = method_parser(), default_value = DEFAULT_METHOD)]
    pub method: Method,
    /// Where the camera stands first: "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=60", in the scan's
    /// coordinates.
    #[arg(long, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// rgb, intensity, elevation, classification, return_number, number_of_returns, source_id,
    /// time, normal, level, depth, plain, or any attribute's name; where it has a range of values,
    /// that may follow, with either end open.
    #[arg(long, value_name = "NAME[:MIN..MAX]", aliases = ["colour-by", "color"])]
    pub colour: Option<String>,
    /// Points in this box, its faces included, in the scan's coordinates; with four numbers, seen
    /// from above.
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    pub bounds: Option<Bounds>,
    /// Points over this polygon, its edges included: corners as "x,y x,y x,y", or a file of such
    /// lines or of GeoJSON.
    #[arg(long, value_name = "POLYGON", allow_hyphen_values = true, value_parser = parse_polygon)]
    pub polygon: Option<Polygon>,
    /// Points of these classes: numbers, ranges, names; such as 2,6 or ground,3-5.
    #[arg(long, value_name = "CLASSES")]
    pub classes: Option<Classes>,
    /// An even sample whose points are about this far apart: a length above 0, in the scan's unit.
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = quantity::length)]
    pub max_spacing: Option<f64>,
    /// Light surfaces without highlights.
    #[arg(long)]
    pub no_highlights: bool,
    /// Even out differences of exposure where scans cover the same surface; point_source_id, scan
    /// or scan_id tells them apart.
    #[arg(long)]
    pub even_exposure: bool,
    /// Draw exact colours where the file has compact planes, too (see esker build --compact).
    #[arg(long)]
    pub full: bool,
    /// Drawing memory.
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Main memory beside that: table, statistics, staging, the renderer's buffers.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
    /// Points drawn at most; what the backend draws fluently where not said.
    #[arg(long, value_name = "N", value_parser = quantity::points_budget)]
    pub budget_points: Option<u64>,
    /// Distance of neighbouring points on the picture that is fine enough, in pixels.
    #[arg(long, value_name = "PX", default_value_t = 1.0, allow_negative_numbers = true, value_parser = quantity::spacing_px)]
    pub target_spacing: f64,
    /// Draw what is hidden, too.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Memory that building from scans may use, such as 4GiB.
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Folder for what is built from scans; the system's temporary one where not said.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Do what this file says in place of a hand, write what came of it, and close.
    #[arg(long, value_name = "SCRIPT.json")]
    pub script: Option<PathBuf>,
    /// Start without the panel.
    #[arg(long)]
    pub no_panel: bool,
}

impl Args {
    /// Which points are wanted.
    pub fn filter(&self) -> Filter {
        Filter {
            bounds: self.bounds,
            polygon: self.polygon.clone(),
            classes: self.classes,
            max_spacing: self.max_spacing,
        }
    }
}

/// What draws the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// A GPU that is no software driver, else the CPU.
    #[default]
    Auto,
    /// A GPU, software drivers included.
    Gpu,
    /// The CPU renderer.
    Cpu,
}

/// What draws the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum WindowBy {
    /// A graphics driver of a real GPU, else the CPU.
    #[default]
    Auto,
    /// A graphics driver: Vulkan, Metal, Direct3D or OpenGL.
    Driver,
    /// A graphics driver: OpenGL.
    Gl,
    /// The CPU.
    Cpu,
}

/// Parses the name of a drawing method.
fn method_parser() -> impl TypedValueParser<Value = Method> {
    let values = METHODS.map(|(_, name, help)| PossibleValue::new(name).help(help));
    let parser = PossibleValuesParser::new(values);
    parser.try_map(|name| method_of_name(&name).ok_or("no such method"))
}

fn parse_polygon(word: &str) -> Result<Polygon, String> {
    polygon::read(word).map_err(|e| format!("{e:#}"))
}
