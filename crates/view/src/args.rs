//! The command line of `esker-view`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Parser, ValueEnum};
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::draw::method::{METHODS, method_of_name};
use esker_engine::io::{polygon, quantity};
use esker_engine::light::settings::{Gloss, LightSettings};
use esker_engine::light::spec::{LightSpec, joined};
use esker_engine::{Bounds, Classes, Clip, Filter, Flags, Method, PointSize, Polygon, ValueRange};
use std::path::PathBuf;

/// Flies through an .esker file, or scans, in a window.
#[derive(Clone, Debug, Parser)]
#[command(name = "esker-view", version, about)]
pub struct Args {
    /// An .esker file; or several, which are shown together; or scans and folders of scans, which
    /// are first built into one; or a scene document, whose fields the options replace. Without
    /// any, the window shows what was opened before, and takes files that are dropped on it.
    #[arg(value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// What draws the scene: a real GPU if there is one, else the CPU (auto); a GPU, software
    /// drivers included; the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub backend: Backend,
    /// What paints the window itself: a real GPU if there is one, else the CPU (auto); a graphics
    /// driver; OpenGL; the CPU.
    #[arg(long, value_enum, default_value_t)]
    pub window: WindowBackend,
    /// Width and height of the window, in points.
    #[arg(long, default_value = "1280x800", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Surfaces and points in one picture (the default), points alone, closed surfaces, splats, or
    /// light.
    #[arg(long, value_parser = method_parser())]
    pub method: Option<Method>,
    /// Lights of --method lit, as of esker render: sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]],
    /// sky[:STRENGTH], sky:PICTURE.png[,STRENGTH], lamp:X,Y,Z[,STRENGTH], or files of lights.
    #[arg(long, num_args = 1.., value_name = "LIGHT")]
    pub lights: Vec<LightSpec>,
    /// Filter the soft shadows of --method lit, as esker render does.
    #[arg(long, conflicts_with = "gloss")]
    pub filter_shadows: bool,
    /// Gloss of surfaces of --method lit, as of esker render.
    #[allow(rustdoc::broken_intra_doc_links, reason = "brackets stand for optional parts")]
    #[arg(long, value_name = "REFLECTANCE[,ROUGHNESS]")]
    pub gloss: Option<Gloss>,
    /// Where the camera is at the start, such as "eye=x,y,z;target=x,y,z;up=x,y,z;fovy=60", in the
    /// scan's coordinates. Each part may be missing. With "ortho=HEIGHT" or "ortho=fit" in place of
    /// fovy the picture is parallel (orthographic).
    #[arg(long, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// Axis that points upwards: x, y, z, -x, -y or -z. Without it and the camera's "up" it is z,
    /// or guessed where PLY, PCD and E57 files name no coordinate system.
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub up: Option<Vertical>,
    /// What gives points their colour: rgb, intensity, elevation (along the camera's up), x, y, z,
    /// classification, return_number, number_of_returns, source_id, time, normal, level, depth,
    /// plain, or the name of any attribute. A range of values may follow, such as
    /// elevation:100..250 or intensity:..4000.
    #[arg(long, value_name = "NAME[:MIN..MAX][:MAP]", aliases = ["colour-by", "color"])]
    pub colour: Option<String>,
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
    /// Points with any of these flags: withheld, synthetic, key-point, overlap.
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
    /// Light surfaces without highlights.
    #[arg(long)]
    pub no_highlights: bool,
    /// Leave out points of surfaces whose normal looks away from the camera; else both sides are
    /// drawn.
    #[arg(long)]
    pub cull_back: bool,
    /// Diameter of points that are drawn alone, in pixels, 1 by default; or "adaptive": dots of
    /// neighbouring points touch.
    #[arg(long, value_name = "PX|adaptive", value_parser = quantity::point_size)]
    pub point_size: Option<PointSize>,
    /// Show the shape of points that are drawn alone: darken what lies behind its surroundings; a
    /// strength may follow, 1 by default.
    #[arg(long, value_name = "STRENGTH", num_args = 0..=1, default_missing_value = "1", value_parser = quantity::strength)]
    pub eye_dome: Option<f32>,
    /// Even out differences of exposure where scans cover the same surface; the attribute
    /// point_source_id, scan or scan_id distinguishes the scans.
    #[arg(long)]
    pub even_exposure: bool,
    /// Draw exact colours, also from a file that esker build --compact has made.
    #[arg(long)]
    pub full: bool,
    /// Drawing memory: the points to draw and, on a GPU, all of its buffers.
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = quantity::bytes)]
    pub budget_gpu: u64,
    /// Main memory beside it: the table of nodes, statistics, points that are being read, the
    /// renderer's buffers.
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = quantity::bytes)]
    pub budget_ram: u64,
    /// Points drawn at most; by default as many as the backend draws fluently.
    #[arg(long, value_name = "N", value_parser = quantity::points_budget)]
    pub budget_points: Option<u64>,
    /// Distance of neighbouring points in the picture that is fine enough, in pixels; 1 by default.
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = quantity::spacing_px)]
    pub target_spacing: Option<f64>,
    /// Milliseconds that a frame may take while the camera moves: pictures are then drawn coarser
    /// if need be.
    #[arg(long, value_name = "MS", default_value_t = 33.0, value_parser = quantity::milliseconds)]
    pub frame_ms: f64,
    /// Draw hidden nodes too.
    #[arg(long)]
    pub no_occlusion: bool,
    /// Memory that building from scans may use, such as 4GiB; half of the machine's memory by
    /// default.
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    pub memory: Option<u64>,
    /// Folder for the file that is built from scans; the system's temporary folder by default.
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
    /// Most bytes of files built from scans that are kept in the user's cache folder, so that the
    /// same scans open at once the next time; 0 keeps none. With --scratch none is kept.
    #[arg(long, value_name = "BYTES", default_value = "16GiB", value_parser = quantity::bytes)]
    pub cache: u64,
    /// Follow this script instead of a user's input, write a report, and close.
    #[arg(long, value_name = "SCRIPT.json")]
    pub script: Option<PathBuf>,
    /// Start without the panel.
    #[arg(long)]
    pub no_panel: bool,
}

impl Args {
    /// The options for other `inputs`: without those of pictures, which belong to the files that
    /// they were given with.
    #[must_use]
    pub fn for_inputs(&self, inputs: Vec<PathBuf>) -> Self {
        Self {
            inputs,
            backend: self.backend,
            window: self.window,
            size: self.size,
            budget_gpu: self.budget_gpu,
            budget_ram: self.budget_ram,
            budget_points: self.budget_points,
            frame_ms: self.frame_ms,
            no_occlusion: self.no_occlusion,
            memory: self.memory,
            scratch: self.scratch.clone(),
            cache: self.cache,
            script: self.script.clone(),
            no_panel: self.no_panel,
            ..Self::parse_from(["esker-view"])
        }
    }

    /// How lit pictures are lit.
    pub fn light(&self) -> LightSettings {
        LightSettings {
            lights: joined(self.lights.clone()),
            filters_shadows: self.filter_shadows,
            gloss: self.gloss,
            ..LightSettings::default()
        }
    }

    /// Choice of the points that are shown.
    pub fn filter(&self) -> Filter {
        Filter {
            bounds: self.bounds,
            polygon: self.polygon.clone(),
            clips: self.clips.clone(),
            classes: self.classes,
            flags: self.flags.unwrap_or_default(),
            without_flags: self.without_flags.unwrap_or_default(),
            values: self.values.clone(),
            max_spacing: self.max_spacing,
        }
    }
}

/// What draws the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// A real GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// A GPU, software drivers included.
    Gpu,
    /// The CPU renderer.
    Cpu,
}

/// What paints the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum WindowBackend {
    /// The driver of a real GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// A graphics driver: Vulkan, Metal, Direct3D or OpenGL.
    Driver,
    /// The OpenGL driver.
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
