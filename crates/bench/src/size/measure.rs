//! Draws views of a file from each packing of its planes, and compares the pictures.

use crate::size::packing::{Colours, Normals, Packing, Positions};
use crate::size::report::{SizeReport, SizeRow};
use anyhow::Result;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::path::Path;
use esker_engine::draw::frame::draw_node;
use esker_engine::draw::scene::{PictureRequest, PictureScene, open};
use esker_engine::machine::pool;
use esker_format::{Forest, PlaneKind, Planes};
use esker_lod::CompactOctree;
use esker_points::palette::{Histogram, Palette};
use esker_points::{Task, quant};
use esker_render::{Picture, Renderer};
use glam::DVec3;
use rayon::prelude::*;
use std::path::PathBuf;

/// Packings that are compared: as in the file, one plane at a time, and all planes together.
const PACKINGS: [Packing; 8] = {
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

/// Greatest difference of a channel that does not count as a change of the pixel.
const CHANGED: u8 = 8;

/// Files and pictures to measure.
#[derive(Clone, Debug)]
pub struct SizeBenchRequest {
    /// `.esker` files or scans.
    pub files: Vec<PathBuf>,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// Measures error against size.
///
/// # Errors
/// If a file cannot be read or has no points in view, or `task` is cancelled.
pub fn measure(request: &SizeBenchRequest, task: &dyn Task) -> Result<SizeReport> {
    let size = request.size;
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for path in &request.files {
            let (file, _folder) =
                open(std::slice::from_ref(path), &PictureRequest::default(), task)?;
            for stop in Path::of(&file, size).views {
                task.phase(&stop.name, None, "packings");
                let camera = Camera {
                    eye: Some(stop.view.eye),
                    target: Some(stop.target),
                    ..Camera::default()
                };
                let camera = camera.unmeasured(file.lattice());
                let picture =
                    PictureRequest { size, camera, full: true, ..PictureRequest::default() };
                let scene = PictureScene::read(&file, &picture, task)?;
                let view = ViewName { file: path.display().to_string(), view: stop.name };
                rows.extend(rows_of(&view, &file, &scene, task)?);
            }
        }
        Ok(SizeReport { size, rows })
    })
}

/// Names of a file and of a view of it.
struct ViewName {
    file: String,
    view: String,
}

/// Draws a view from each packing and makes their rows.
fn rows_of(
    name: &ViewName,
    file: &Forest,
    scene: &PictureScene,
    task: &dyn Task,
) -> Result<Vec<SizeRow>> {
    let histogram = Histogram::default();
    scene
        .planes
        .iter()
        .flat_map(|p| p.get(PlaneKind::Colour).unwrap_or_default().as_chunks().0)
        .filter(|[_, _, _, has]| *has != 0)
        .for_each(|&[red, green, blue, _]| histogram.add([red, green, blue]));
    let palette = histogram.palette();
    let octree =
        CompactOctree::with_hidden(file.table(), &scene.selection.drawn, &scene.selection.hidden);
    let mut renderer = Renderer::default();
    let mut reference = None;
    let mut rows = Vec::new();
    let mut seen = Vec::new();
    for packing in PACKINGS.map(|packing| packing.for_file(file)) {
        // A packing of planes that the file lacks equals one that was measured.
        if seen.contains(&packing.forms()) {
            continue;
        }
        seen.push(packing.forms());
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
        let loss = packed.iter().fold(Loss::default(), |sum, p| sum.plus(&p.loss));
        let reference = reference.get_or_insert_with(|| picture.clone());
        rows.push(loss.row(name, &packing, &picture, reference));
    }
    Ok(rows)
}

impl Packing {
    /// The packing, limited to planes that `file` has.
    fn for_file(self, file: &Forest) -> Self {
        let colours = if file.has(PlaneKind::Colour) { self.colours } else { Colours::Full };
        let normals = if file.has(PlaneKind::Normal) { self.normals } else { Normals::Full };
        Self { colours, normals, ..self }
    }

    /// Forms of all planes.
    fn forms(&self) -> (Positions, Colours, Normals) {
        (self.positions, self.colours, self.normals)
    }
}

/// The planes of a node after packing and unpacking.
struct Packed {
    position: Vec<u8>,
    residual: Option<Vec<u8>>,
    colour: Option<Vec<u8>>,
    normal: Option<Vec<u8>>,
    loss: Loss,
}

/// Sums over the points of some nodes of what packing loss.
#[derive(Clone, Copy, Debug, Default)]
struct Loss {
    points: u64,
    bytes: u64,
    /// Number of points on the picture whose positions were packed.
    seen: u64,
    /// Sum and greatest of their squared errors on the picture, pixels.
    place_px_squares: f64,
    place_px_squares_most: f64,
    /// Sum of squared differences of colour channels.
    colour_squares: f64,
    /// Sum of squared angles between normals, radians.
    angle_squares: f64,
    /// Number of normals.
    normals: u64,
}

impl Packed {
    /// Packs and unpacks the planes of `node`, of which `prefix` points are drawn.
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
        packing.positions.round_trip(&mut position, record.points());
        let mut loss = Loss { points: prefix as u64, ..Loss::default() };
        // Residuals refine only the steps of the file's own positions.
        let is_full = packing.positions == Positions::Full;
        let residual = of(PlaneKind::Residual).filter(|_| is_full);
        if !is_full {
            let place = |hot: &[u8; 8]| {
                let q = [0, 2, 4].map(|i| u16::from_le_bytes([hot[i], hot[i + 1]]));
                let at =
                    [0, 1, 2].map(|i| quant::exact(q[i], 0, record.box_min[i], record.hot_shift));
                scene.view.project(DVec3::from_array(file.metric().world(at)))
            };
            let own = planes.get(PlaneKind::Position).unwrap_or_default().as_chunks().0;
            for (own, packed) in own.iter().zip(position.as_chunks().0).take(prefix) {
                let Some(own) = place(own).filter(|&p| scene.view.is_on_picture(p)) else {
                    continue;
                };
                loss.seen += 1;
                if let Some(packed) = place(packed) {
                    let squares = (packed - own).truncate().length_squared();
                    loss.place_px_squares += squares;
                    loss.place_px_squares_most = loss.place_px_squares_most.max(squares);
                }
            }
        }
        loss.bytes = (packing.positions.bytes(record.points()) * prefix) as u64;
        loss.bytes += residual
            .as_ref()
            .map_or(0, |plane| (plane.len() * prefix / record.points().max(1)) as u64);
        if let Some(plane) = &mut colour {
            let share = prefix as f64 / (plane.len() / 4).max(1) as f64;
            loss.colour_squares = packing.colours.round_trip(plane, palette) * share;
            loss.bytes += (packing.colours.bytes() * prefix) as u64;
        }
        if let Some(plane) = &mut normal {
            (loss.angle_squares, loss.normals) = packing.normals.round_trip(plane);
            loss.bytes += (packing.normals.bytes() * prefix) as u64;
        }
        Self { position, residual, colour, normal, loss }
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

/// Draws the view of `scene` from packed planes.
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
            draw_node(
                file.table(),
                drawn.node,
                entry,
                drawn.prefix,
                &scene.appearance.colouring,
                plane,
            )
        })
        .collect();
    Ok(renderer.render(&scene.appearance.frame(file, &scene.view, &draws, octree))?)
}

/// Kinds of planes that packings replace.
const PACKED: [PlaneKind; 4] =
    [PlaneKind::Position, PlaneKind::Residual, PlaneKind::Colour, PlaneKind::Normal];

impl Loss {
    fn plus(self, other: &Self) -> Self {
        Self {
            points: self.points + other.points,
            bytes: self.bytes + other.bytes,
            seen: self.seen + other.seen,
            place_px_squares: self.place_px_squares + other.place_px_squares,
            place_px_squares_most: self.place_px_squares_most.max(other.place_px_squares_most),
            colour_squares: self.colour_squares + other.colour_squares,
            angle_squares: self.angle_squares + other.angle_squares,
            normals: self.normals + other.normals,
        }
    }

    fn row(
        &self,
        name: &ViewName,
        packing: &Packing,
        picture: &Picture,
        reference: &Picture,
    ) -> SizeRow {
        let points = self.points.max(1) as f64;
        let (picture_difference, pixels_changed) = compare(picture, reference);
        let normals = self.normals.max(1) as f64;
        SizeRow {
            file: name.file.clone(),
            view: name.view.clone(),
            packing: packing.name,
            points: self.points,
            bytes: self.bytes,
            bytes_a_point: self.bytes as f64 / points,
            place_px_rms: (self.place_px_squares / self.seen.max(1) as f64).sqrt(),
            place_px_most: self.place_px_squares_most.sqrt(),
            colour_rms: (self.colour_squares / points / 3.0).sqrt(),
            normal_degrees_rms: (self.angle_squares / normals).sqrt().to_degrees(),
            picture_difference,
            pixels_changed,
        }
    }
}

/// Returns the mean difference of a channel, 0 to 255, and the share of pixels that differ by more
/// than [`CHANGED`].
fn compare(a: &Picture, b: &Picture) -> (f64, f64) {
    let pairs = || a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let off = |(a, b): (&[u8], &[u8])| [0, 1, 2].map(|i| a[i].abs_diff(b[i]));
    let count = (a.rgba.len() / 4).max(1) as f64;
    let sum: u64 = pairs().flat_map(off).map(u64::from).sum();
    let changed = pairs().filter(|&pair| off(pair).into_iter().any(|d| d > CHANGED)).count();
    (sum as f64 / 3.0 / count, changed as f64 / count)
}
