//! What smaller hot planes would cost: each form of them ([`packing`]) drawn beside the planes as they are, over an
//! overview, a closer view and a near one; error of the picture, of places, colours and normals, against bytes a point.
//! kanzok2015 takes 24 bytes a point; a file of Esker 8, with colour 12, with normals too 16.

pub mod packing;

use anyhow::Result;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::path::Path;
use esker_engine::draw::frame::draw_node;
use esker_engine::draw::scene::PictureRequest as Look;
use esker_engine::draw::scene::PictureScene;
use esker_engine::draw::scene::open;
use esker_engine::machine::pool;
use esker_format::{Forest, PlaneKind, Planes};
use esker_lod::CompactOctree;
use esker_points::Task;
use esker_points::palette::{Histogram, Palette};
use esker_render::{Picture, Renderer};
use packing::{Colours, Normals, Packing, Positions};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The forms that are compared: as in the file; one thing at a time; and together, 8 and 6 bytes with colour.
pub const PACKINGS: [Packing; 8] = {
    let full = Packing {
        name: "as in the file",
        positions: Positions::Full,
        colours: Colours::Full,
        normals: Normals::Full,
    };
    let compact = Packing {
        name: "compact: 10 bits, 565, 8-bit octahedron",
        positions: Positions::Bits(10),
        colours: Colours::Packed565,
        normals: Normals::Octahedron8,
    };
    [
        full,
        Packing { name: "positions of 10 bits", positions: Positions::Bits(10), ..full },
        Packing {
            name: "positions of 8 bits in small nodes",
            positions: Positions::BySize,
            ..full
        },
        Packing { name: "colours 565", colours: Colours::Packed565, ..full },
        Packing { name: "colours by palette", colours: Colours::Palette, ..full },
        Packing { name: "normals by codebook", normals: Normals::Codebook, ..full },
        compact,
        Packing {
            name: "least: 8 bits in small nodes, palette, codebook",
            positions: Positions::BySize,
            colours: Colours::Palette,
            normals: Normals::Codebook,
        },
    ]
};

/// Difference of a channel from which a pixel counts as changed.
const CHANGED: u8 = 8;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Request {
    /// `.esker` files or scans.
    pub files: Vec<PathBuf>,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Threads; 0 is one a core.
    pub threads: usize,
}

/// Measures; the report.
///
/// # Errors
/// Where a file cannot be read or has no points in view; on request.
pub fn measure(request: &Request, task: &dyn Task) -> Result<Value> {
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for path in &request.files {
            let (file, _folder) = open(std::slice::from_ref(path), &Look::default(), task)?;
            for stop in Path::of(&file, request.size).views {
                task.phase(&stop.name, None, "packings");
                let camera = Camera {
                    eye: Some(stop.view.eye),
                    target: Some(stop.target),
                    ..Camera::default()
                };
                let look = Look { size: request.size, camera, full: true, ..Look::default() };
                let scene = PictureScene::read(&file, &look, task)?;
                for mut row in of_view(&file, &scene, task)? {
                    row["file"] = json!(path.display().to_string());
                    row["view"] = json!(stop.name);
                    rows.push(row);
                }
            }
        }
        Ok(json!({ "size": request.size, "rows": rows }))
    })
}

/// A row for each packing of a view.
fn of_view(file: &Forest, scene: &PictureScene, task: &dyn Task) -> Result<Vec<Value>> {
    let histogram = Histogram::default();
    scene
        .planes
        .iter()
        .flat_map(|p| p.get(PlaneKind::Colour).unwrap_or_default().as_chunks().0)
        .filter(|[_, _, _, has]| *has != 0)
        .for_each(|&[red, green, blue, _]| histogram.add([red, green, blue]));
    let palette = histogram.palette();
    let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
    let mut renderer = Renderer::default();
    let mut reference = None;
    let mut rows = Vec::new();
    let mut seen = Vec::new();
    for packing in PACKINGS.map(|packing| packing.of(file)) {
        // What the file has not is not packed: the same form twice says nothing.
        if seen.contains(&packing.parts()) {
            continue;
        }
        seen.push(packing.parts());
        task.check()?;
        let nodes = scene.selection.drawn.iter().zip(&scene.planes);
        let packed: Vec<Packed> = nodes
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(drawn, planes)| {
                Packed::new(
                    file,
                    scene,
                    drawn.node,
                    drawn.prefix,
                    planes,
                    &packing,
                    palette.as_ref(),
                )
            })
            .collect();
        let picture = draw(file, scene, &octree, &packed, &mut renderer)?;
        let lost = packed.iter().fold(Lost::default(), |sum, p| sum.and(&p.lost));
        let reference = reference.get_or_insert_with(|| picture.clone());
        rows.push(lost.row(&packing, &picture, reference));
    }
    Ok(rows)
}

impl Packing {
    /// What of it a file's planes allow.
    fn of(self, file: &Forest) -> Self {
        let colours = if file.has(PlaneKind::Colour) { self.colours } else { Colours::Full };
        let normals = if file.has(PlaneKind::Normal) { self.normals } else { Normals::Full };
        Self { colours, normals, ..self }
    }

    fn parts(&self) -> (Positions, Colours, Normals) {
        (self.positions, self.colours, self.normals)
    }
}

/// The planes of a node after packing and unpacking.
struct Packed {
    position: Vec<u8>,
    residual: Option<Vec<u8>>,
    colour: Option<Vec<u8>>,
    normal: Option<Vec<u8>>,
    lost: Lost,
}

/// What packing lost, over some nodes.
#[derive(Clone, Copy, Debug, Default)]
struct Lost {
    points: u64,
    bytes: u64,
    /// Sum over points of the squared step of their positions, in pixels; and the greatest step.
    step_px_squares: f64,
    step_px_most: f64,
    colour_squares: f64,
    angle_squares: f64,
    normals: u64,
}

impl Packed {
    fn new(
        file: &Forest,
        scene: &PictureScene,
        node: u32,
        prefix: usize,
        planes: &Planes,
        packing: &Packing,
        palette: Option<&Palette>,
    ) -> Self {
        let of = |kind| planes.get(kind).map(<[u8]>::to_vec);
        let (mut position, mut colour, mut normal) = (
            of(PlaneKind::Position).unwrap_or_default(),
            of(PlaneKind::Colour),
            of(PlaneKind::Normal),
        );
        let record = file.record(node);
        let step = packing.positions.lose(&mut position, record.points());
        let mut lost = Lost { points: prefix as u64, ..Lost::default() };
        // Dropped bits refine places of the file's own steps only.
        let is_full = packing.positions == Positions::Full;
        let residual = of(PlaneKind::Residual).filter(|_| is_full);
        if !is_full {
            let scale = file.lattice().scale.into_iter().fold(0.0, f64::max);
            let distance =
                esker_lod::OrientedBox::of_contour(record, file.lattice()).distance(scene.view.eye);
            let px = scene.view.focal_px() / distance.max(scene.view.near);
            let step_px = f64::from(step) * f64::from(1u32 << record.hot_shift) * scale * px;
            lost.step_px_squares = step_px * step_px * prefix as f64;
            lost.step_px_most = step_px;
        }
        lost.bytes = (packing.positions.bytes(record.points()) * prefix) as u64;
        lost.bytes += residual
            .as_ref()
            .map_or(0, |plane| (plane.len() * prefix / record.points().max(1)) as u64);
        if let Some(plane) = &mut colour {
            let share = prefix as f64 / (plane.len() / 4).max(1) as f64;
            lost.colour_squares = packing.colours.lose(plane, palette) * share;
            lost.bytes += (packing.colours.bytes() * prefix) as u64;
        }
        if let Some(plane) = &mut normal {
            (lost.angle_squares, lost.normals) = packing.normals.lose(plane);
            lost.bytes += (packing.normals.bytes() * prefix) as u64;
        }
        Self { position, residual, colour, normal, lost }
    }

    fn plane(&self, kind: PlaneKind) -> Option<&[u8]> {
        match kind {
            PlaneKind::Position => Some(&self.position),
            PlaneKind::Residual => self.residual.as_deref(),
            PlaneKind::Colour => self.colour.as_deref(),
            PlaneKind::Normal => self.normal.as_deref(),
            _ => None,
        }
    }
}

fn draw(
    file: &Forest,
    scene: &PictureScene,
    octree: &CompactOctree,
    packed: &[Packed],
    renderer: &mut Renderer,
) -> Result<Picture> {
    let nodes = scene.selection.drawn.iter().zip(packed).zip(&scene.planes).enumerate();
    let draws: Vec<_> = nodes
        .map(|(entry, ((drawn, packed), planes))| {
            let plane = |kind| {
                packed.plane(kind).or_else(|| planes.get(kind).filter(|_| !PACKED.contains(&kind)))
            };
            draw_node(file.record(drawn.node), entry, drawn.prefix, &scene.look.colouring, plane)
        })
        .collect();
    Ok(renderer.render(&scene.look.frame(file, &scene.view, &draws, octree))?)
}

/// Kinds of planes that packings change.
const PACKED: [PlaneKind; 4] =
    [PlaneKind::Position, PlaneKind::Residual, PlaneKind::Colour, PlaneKind::Normal];

impl Lost {
    fn and(self, other: &Self) -> Self {
        Self {
            points: self.points + other.points,
            bytes: self.bytes + other.bytes,
            step_px_squares: self.step_px_squares + other.step_px_squares,
            step_px_most: self.step_px_most.max(other.step_px_most),
            colour_squares: self.colour_squares + other.colour_squares,
            angle_squares: self.angle_squares + other.angle_squares,
            normals: self.normals + other.normals,
        }
    }

    fn row(&self, packing: &Packing, picture: &Picture, reference: &Picture) -> Value {
        let points = self.points.max(1) as f64;
        let (difference, changed) = compared(picture, reference);
        // A point is off by up to half a step on each axis: over many by the root of a twelfth of it, on three.
        let place = |squares: f64| (squares / points / 12.0 * 3.0).sqrt();
        json!({
            "packing": packing.name,
            "points": self.points,
            "bytes": self.bytes,
            "bytes_a_point": self.bytes as f64 / points,
            "place_px_rms": place(self.step_px_squares),
            "place_px_most": self.step_px_most * 0.75f64.sqrt(),
            "colour_rms": (self.colour_squares / points / 3.0).sqrt(),
            "normal_degrees_rms": (self.angle_squares / self.normals.max(1) as f64).sqrt().to_degrees(),
            "picture_difference": difference,
            "pixels_changed": changed,
        })
    }
}

/// Mean difference of a channel, 0 to 255, and the share of pixels that differ by more than [`CHANGED`].
fn compared(a: &Picture, b: &Picture) -> (f64, f64) {
    let pairs = || a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let off = |(a, b): (&[u8], &[u8])| [0, 1, 2].map(|i| a[i].abs_diff(b[i]));
    let count = (a.rgba.len() / 4).max(1) as f64;
    let sum: u64 = pairs().flat_map(off).map(u64::from).sum();
    let changed = pairs().filter(|&pair| off(pair).into_iter().any(|d| d > CHANGED)).count();
    (sum as f64 / 3.0 / count, changed as f64 / count)
}

/// The report for people.
pub fn text(report: &Value) -> String {
    let rows = report["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let mut lines = Vec::new();
    let mut heading = String::new();
    for row in rows {
        let of = |name: &str| row[name].as_str().unwrap_or("?");
        let number = |name: &str| row[name].as_f64().unwrap_or(f64::NAN);
        let now = format!("{}, {}", of("file"), of("view"));
        if now != heading {
            lines.push(format!("{now}: {} points", row["points"]));
            lines.push(format!(
                "  {:<48} {:>8} {:>14} {:>8} {:>8} {:>9} {:>9}",
                "", "bytes", "place px (most)", "colour", "normal", "picture", "changed"
            ));
            heading = now;
        }
        lines.push(format!(
            "  {:<48} {:>8.2} {:>7.3} ({:.2}) {:>8.2} {:>7.2}° {:>9.3} {:>8.2} %",
            of("packing"),
            number("bytes_a_point"),
            number("place_px_rms"),
            number("place_px_most"),
            number("colour_rms"),
            number("normal_degrees_rms"),
            number("picture_difference"),
            100.0 * number("pixels_changed"),
        ));
    }
    lines.join("\n")
}
