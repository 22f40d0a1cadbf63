//! Table 1 of zwicker2004: million splats a second, in one pass and in three. All splats face the viewer, are in view,
//! and have one size in the picture, nine pixels with the low-pass: so the time should be linear in their number.

use anyhow::Result;
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_lod::View;
use esker_points::quant::{oct_encode, radius_code};
use esker_points::{Lattice, Node, Task};
use esker_render::ewa::{Options, Passes};
use esker_render::gpu::passes::ewa::{BatchCapacity, GpuEwa};
use esker_render::gpu::{Gpu, GpuRenderer, NodePool, PlaneAt};
use esker_render::{ColourPlane, DrawNode, Frame, Method, Pass, Picture, Renderer, Stages};
use glam::DVec3;
use serde_json::{Value, json};
use std::time::Instant;

/// Splats, as many as the paper's models have, and five million.
pub const SPLATS: [u64; 4] = [100_000, 330_000, 650_000, 5_000_000];
/// The paper's pictures.
pub const SIZES: [[u32; 2]; 2] = [[512, 512], [1280, 1024]];
/// Pixels that a splat covers.
const SPLAT_PIXELS: f64 = 9.0;
/// Points of a node.
const NODE_POINTS: u64 = 1 << 16;
/// Steps of the wall's sides.
const SIDE: f64 = 65_536.0;
/// Frames at least, and for how long more are drawn, so that those of a few milliseconds are not all among the first,
/// which find memory and processor cold.
const FRAMES: usize = 3;
const FRAMES_MS: f64 = 500.0;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Request {
    /// Numbers of splats; [`SPLATS`] where none is said.
    pub splats: Vec<u64>,
    /// Widths and heights of pictures, pixels; [`SIZES`] where none is said.
    pub sizes: Vec<[u32; 2]>,
    /// The GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 is one a core.
    pub threads: usize,
}

/// A wall of splats that fills the picture.
struct Wall {
    view: View,
    lattice: Lattice,
    node: Node,
    position: Vec<u8>,
    normal: Vec<u8>,
    splats: u64,
}

impl Wall {
    /// Nodes of the wall share their record; their points are spread evenly over it.
    fn new([width, height]: [u32; 2], splats: u64, options: &Options) -> Self {
        let middle = f64::from(1u32 << 31) + SIDE / 2.0;
        let lattice = Lattice { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3] };
        let world = |i: usize| lattice.world_axis(i, middle);
        // As high as the picture, and stretched to its width.
        let wide = f64::from(width) / f64::from(height);
        let lattice = Lattice { scale: [wide, 1.0, 1.0], ..lattice };
        let at = DVec3::new(lattice.world_axis(0, middle), world(1), world(2));
        let distance = SIDE;
        let fovy = 2.0 * (0.5f64 * SIDE / distance).atan();
        let view = View::look_at(at - DVec3::Y * distance, at, DVec3::Z, fovy, width, height);
        let squared = f64::from(options.cutoff * options.cutoff);
        let radius_px = (SPLAT_PIXELS / std::f64::consts::PI - squared).max(0.1).sqrt();
        let radius = radius_px * distance / view.focal_px() / f64::from(options.radius_factor);
        let mut node: Node = bytemuck::Zeroable::zeroed();
        node.box_min = [1 << 31, (1 << 31) + (SIDE / 2.0) as u32, 1 << 31];
        (node.corner, node.cell_log2, node.spacing) = (node.box_min, 16, radius as f32);
        let code = radius_code(radius, radius);
        let step = (splats as f64).recip();
        let (mut position, mut normal) = (Vec::new(), Vec::new());
        let towards = oct_encode([0.0, -1.0, 0.0]).map(i16::to_le_bytes).concat();
        for i in 0..splats {
            // Along a Morton curve, as neighbours stand together in a file.
            let along = ((i as f64 + 0.5) * step * SIDE * SIDE) as u32;
            let [x, z] = [every_other(along), every_other(along >> 1)];
            for q in [x, 0, z] {
                position.extend(q.to_le_bytes());
            }
            position.extend([code, 0]);
            normal.extend(&towards);
        }
        Self { view, lattice, node, position, normal, splats }
    }

    /// Runs of the wall with the places of their planes.
    fn draws<'a, P>(&'a self, plane: impl Fn(bool, u64, u64) -> P) -> Vec<DrawNode<'a, P>> {
        let firsts = (0..self.splats).step_by(NODE_POINTS as usize);
        firsts
            .map(|first| {
                let count = NODE_POINTS.min(self.splats - first);
                DrawNode {
                    node: &self.node,
                    entry: 0,
                    prefix: count as usize,
                    position: plane(false, first * 8, count * 8),
                    residual: None,
                    colour: ColourPlane::None,
                    normal: Some(plane(true, first * 4, count * 4)),
                    clip: None,
                    tangents: None,
                }
            })
            .collect()
    }

    fn frame<'a, P>(&'a self, draws: &'a [DrawNode<'a, P>]) -> Frame<'a, P> {
        Frame {
            method: Method::Ewa,
            cull_back_faces: true,
            skips_push: false,
            ..Frame::new(&self.view, &self.lattice, draws)
        }
    }

    /// Frames on the CPU, and how many splats they drew.
    fn on_cpu(&self, options: Options) -> Result<(Times, u64)> {
        let range = |first: u64, bytes: u64| first as usize..(first + bytes) as usize;
        let draws = self.draws(|is_normal, first, bytes| {
            let plane = if is_normal { &self.normal } else { &self.position };
            &plane[range(first, bytes)]
        });
        let frame = self.frame(&draws);
        let (mut renderer, mut picture) = (Renderer::default(), Picture::default());
        renderer.ewa.options = options;
        let times = Times::of(|| {
            renderer.render_into(&frame, &mut picture)?;
            Ok(picture.stats.stages)
        })?;
        Ok((times, picture.stats.splats_drawn))
    }

    /// Frames on a GPU, each from its commands to its picture read back.
    fn on_gpu(&self, gpu: &Gpu, options: Options) -> Result<Times> {
        let page = gpu.tier.page_bytes_max;
        let a_page = page / (NODE_POINTS * 12);
        let at = |is_normal: bool, first: u64, bytes: u64| {
            let index = first / (NODE_POINTS * if is_normal { 4 } else { 8 });
            let normals = if is_normal { NODE_POINTS * 8 } else { 0 };
            let offset = index / a_page * page + index % a_page * NODE_POINTS * 12 + normals;
            PlaneAt { offset, bytes }
        };
        let draws = self.draws(at);
        let end = draws.iter().filter_map(|d| d.normal).map(|p| p.offset + p.bytes).max();
        let mut pool = NodePool::new(gpu, end.unwrap_or(0));
        for (i, draw) in draws.iter().enumerate() {
            let first = i * NODE_POINTS as usize;
            let bytes = &self.position[first * 8..][..draw.position.bytes as usize];
            pool.write(gpu, draw.position.offset, bytes)?;
            if let Some(normal) = draw.normal {
                let bytes = &self.normal[first * 4..][..normal.bytes as usize];
                pool.write(gpu, normal.offset, bytes)?;
            }
        }
        let mut renderer = GpuRenderer::new(gpu)?;
        let mut ewa = GpuEwa::new(gpu, BatchCapacity::default())?;
        ewa.options = options;
        renderer.set_ewa(ewa);
        let frame = self.frame(&draws);
        Times::of(|| {
            let start = Instant::now();
            renderer.render(&frame, &pool)?;
            renderer.read()?;
            let total_ms = start.elapsed().as_secs_f64() * 1e3;
            Ok(Stages { total_ms, ..Stages::default() })
        })
    }
}

/// Times of frames.
struct Times {
    /// The quickest, milliseconds.
    least: f64,
    /// Of the middle one.
    median: Stages,
}

impl Times {
    /// Of as many frames as are drawn in time; each says how long it took.
    fn of(mut frame: impl FnMut() -> Result<Stages>) -> Result<Self> {
        let start = Instant::now();
        let mut all = Vec::new();
        while all.len() < FRAMES || start.elapsed().as_secs_f64() * 1e3 < FRAMES_MS {
            all.push(frame()?);
        }
        all.sort_by(|a, b| a.total_ms.total_cmp(&b.total_ms));
        Ok(Self { least: all[0].total_ms, median: all[all.len() / 2] })
    }
}

/// The even bits of a number.
fn every_other(bits: u32) -> u16 {
    (0..16).map(|k| ((bits >> (2 * k) & 1) as u16) << k).sum()
}

/// Measures; the report.
///
/// # Errors
/// Where a GPU is asked for and there is none, or it fails; on request.
pub fn measure(request: &Request, task: &dyn Task) -> Result<Value> {
    let (gpu, drawer) = request.with.choose(None)?;
    let or = |given: &[u64]| if given.is_empty() { SPLATS.to_vec() } else { given.to_vec() };
    let sizes = if request.sizes.is_empty() { SIZES.to_vec() } else { request.sizes.clone() };
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for &size in &sizes {
            for splats in or(&request.splats) {
                for (passes, count) in [(Passes::One, 1), (Passes::Three, 3)] {
                    task.check()?;
                    let options = Options { passes, ..Options::default() };
                    let wall = Wall::new(size, splats, &options);
                    let mut row = |drawn_by: &str, times: Times, drawn: u64| {
                        let Times { least, median } = times;
                        rows.push(json!({
                            "size": size, "splats": drawn, "passes": count, "drawn_by": drawn_by,
                            "ms": median.total_ms, "ms_least": least, "place_ms": median.ms(Pass::Place),
                            "blend_ms": median.ms(Pass::Blend), "shade_ms": median.ms(Pass::Shade),
                            "msplats_per_s": drawn as f64 / median.total_ms / 1e3,
                        }));
                    };
                    let (times, drawn) = wall.on_cpu(options)?;
                    row("cpu", times, drawn);
                    if let Some(gpu) = &gpu {
                        row("gpu", wall.on_gpu(gpu, options)?, drawn);
                    }
                }
            }
        }
        Ok(json!({
            "method": "ewa",
            "splat_pixels": SPLAT_PIXELS,
            "adapter": gpu.as_ref().map(|gpu| &gpu.name),
            "is_software": gpu.as_ref().map(|gpu| gpu.tier.is_software),
            "note": drawer.note,
            "threads": rayon::current_num_threads(),
            "rows": rows,
        }))
    })
}

/// [`measure`]'s report for people.
pub fn text(report: &Value) -> String {
    let mut lines = vec![format!(
        "{:>12} {:>9} {:>7} {:>4} {:>9} {:>10}",
        "picture", "splats", "passes", "by", "ms", "Msplats/s"
    )];
    for row in report["rows"].as_array().into_iter().flatten() {
        let number = |name: &str| row[name].as_f64().unwrap_or(0.0);
        lines.push(format!(
            "{:>12} {:>9} {:>7} {:>4} {:>9.1} {:>10.2}",
            format!("{} x {}", row["size"][0], row["size"][1]),
            number("splats"),
            number("passes"),
            row["drawn_by"].as_str().unwrap_or("?"),
            number("ms"),
            number("msplats_per_s"),
        ));
    }
    lines.join("\n")
}
