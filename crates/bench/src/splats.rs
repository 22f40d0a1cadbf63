//! Table 1 of `zwicker2004`: million splats a second, in one pass and in three. All splats face the
//! viewer, are in view, and cover nine pixels each with the low-pass filter, so that time should be
//! linear in their number.

use anyhow::Result;
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_lod::View;
use esker_points::quant::{oct_encode, radius_code};
use esker_points::{Lattice, Node, Task};
use esker_render::ewa::{Options, Passes};
use esker_render::gpu::passes::ewa::{BatchCapacity, GpuEwa};
use esker_render::gpu::{Gpu, GpuRenderer, NodePool, PlaneAt};
use esker_render::{ColourPlane, DrawNode, Frame, Method, Pass, PassTimes, Picture, Renderer};
use glam::DVec3;
use serde::Serialize;
use std::time::Instant;

/// Default numbers of splats: those of the paper's models, and five million.
const SPLATS: [u64; 4] = [100_000, 330_000, 650_000, 5_000_000];
/// Default sizes of pictures: those of the paper.
const SIZES: [[u32; 2]; 2] = [[512, 512], [1280, 1024]];
/// Area of a splat in the picture, pixels.
const SPLAT_PIXELS: f64 = 9.0;
/// Points of a node.
const NODE_POINTS: u64 = 1 << 16;
/// Length of the wall's sides, steps.
const SIDE: f64 = 65_536.0;
/// Least number of frames.
const FRAMES: usize = 3;
/// Least time of all frames, milliseconds: memory and processor are cold in the first ones.
const FRAMES_MS: f64 = 500.0;

/// Numbers of splats, pictures and devices to measure.
#[derive(Clone, Debug)]
pub struct SplatsBenchRequest {
    /// Numbers of splats; defaults if the list is empty.
    pub splats: Vec<u64>,
    /// Widths and heights of pictures, pixels; defaults if the list is empty.
    pub sizes: Vec<[u32; 2]>,
    /// Choice of the GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// Rows of all sizes, numbers of splats, numbers of passes and backends.
#[derive(Clone, Debug, Serialize)]
pub struct SplatsReport {
    method: &'static str,
    /// Area of a splat in the picture.
    splat_pixels: f64,
    /// Name of the GPU.
    adapter: Option<String>,
    /// Whether the GPU is a software driver.
    is_software: Option<bool>,
    /// Why the CPU alone is measured.
    note: Option<String>,
    /// Threads of the CPU renderer.
    threads: usize,
    rows: Vec<SplatsRow>,
}

/// One number of splats in one picture by one backend.
#[derive(Clone, Debug, Serialize)]
struct SplatsRow {
    /// Width and height, pixels.
    size: [u32; 2],
    /// Splats in the picture.
    splats: u64,
    /// Passes over the splats: one or three.
    passes: u32,
    /// `cpu` or `gpu`.
    drawn_by: &'static str,
    /// Median time of a frame.
    ms: f64,
    /// Least time of a frame.
    ms_least: f64,
    /// Times of passes in the median frame, measured on the CPU only.
    place_ms: f64,
    blend_ms: f64,
    shade_ms: f64,
    msplats_per_s: f64,
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
    /// Makes a wall of `splats` splats. Its nodes share one record, that of the whole wall.
    fn new([width, height]: [u32; 2], splats: u64, options: &Options) -> Self {
        let middle = f64::from(1u32 << 31) + SIDE / 2.0;
        let lattice =
            Lattice { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let world = |i: usize| lattice.world_axis(i, middle);
        // The wall is as high as the picture, and stretched to its width.
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
            // In Morton order, as in a file.
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

    /// Lists the nodes of the wall. `plane` gives a plane of a node: of normals or of positions,
    /// with its first byte and its bytes.
    fn draws<'a, P>(&'a self, plane: impl Fn(bool, u64, u64) -> P) -> Vec<DrawNode<'a, P>> {
        let firsts = (0..self.splats).step_by(NODE_POINTS as usize);
        firsts
            .map(|first| {
                let count = NODE_POINTS.min(self.splats - first);
                DrawNode {
                    node: &self.node,
                    entry: 0,
                    prefix: count as usize,
                    above: 0.0,
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

    /// A frame of the wall.
    fn frame<'a, P>(&'a self, draws: &'a [DrawNode<'a, P>]) -> Frame<'a, P> {
        Frame {
            method: Method::Ewa,
            cull_back_faces: true,
            skips_push: false,
            ..Frame::new(&self.view, &self.lattice, draws)
        }
    }

    /// Draws frames on the CPU; returns their times, and the splats of one frame.
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

    /// Draws frames on a GPU, each timed from its commands until its picture is read back.
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
            Ok(PassTimes { total_ms, ..PassTimes::default() })
        })
    }
}

/// Times of frames.
struct Times {
    /// Time of the fastest frame, milliseconds.
    least_ms: f64,
    /// Times of the median frame.
    median: PassTimes,
}

impl Times {
    /// Draws frames until there are enough of them; `frame` returns its times.
    fn of(mut frame: impl FnMut() -> Result<PassTimes>) -> Result<Self> {
        let start = Instant::now();
        let mut all = Vec::new();
        while all.len() < FRAMES || start.elapsed().as_secs_f64() * 1e3 < FRAMES_MS {
            all.push(frame()?);
        }
        all.sort_by(|a, b| a.total_ms.total_cmp(&b.total_ms));
        Ok(Self { least_ms: all[0].total_ms, median: all[all.len() / 2] })
    }
}

/// Packs the even bits of a number.
fn every_other(bits: u32) -> u16 {
    (0..16).map(|k| ((bits >> (2 * k) & 1) as u16) << k).sum()
}

/// Measures splats a second.
///
/// # Errors
/// If a required GPU is missing or fails, or `task` is cancelled.
pub fn measure(request: &SplatsBenchRequest, task: &dyn Task) -> Result<SplatsReport> {
    let (gpu, drawer) = request.with.choose(None)?;
    let all_splats = if request.splats.is_empty() { &SPLATS[..] } else { &request.splats };
    let sizes = if request.sizes.is_empty() { &SIZES[..] } else { &request.sizes };
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for &size in sizes {
            for &splats in all_splats {
                for (passes, count) in [(Passes::One, 1), (Passes::Three, 3)] {
                    task.check()?;
                    let options = Options { passes, ..Options::default() };
                    let wall = Wall::new(size, splats, &options);
                    let row = |drawn_by, times: Times, drawn: u64| SplatsRow {
                        size,
                        splats: drawn,
                        passes: count,
                        drawn_by,
                        ms: times.median.total_ms,
                        ms_least: times.least_ms,
                        place_ms: times.median.ms(Pass::Place),
                        blend_ms: times.median.ms(Pass::Blend),
                        shade_ms: times.median.ms(Pass::Shade),
                        msplats_per_s: drawn as f64 / times.median.total_ms / 1e3,
                    };
                    let (times, drawn) = wall.on_cpu(options)?;
                    rows.push(row("cpu", times, drawn));
                    if let Some(gpu) = &gpu {
                        rows.push(row("gpu", wall.on_gpu(gpu, options)?, drawn));
                    }
                }
            }
        }
        Ok(SplatsReport {
            method: "ewa",
            splat_pixels: SPLAT_PIXELS,
            adapter: gpu.as_ref().map(|gpu| gpu.name.clone()),
            is_software: gpu.as_ref().map(|gpu| gpu.tier.is_software),
            note: drawer.note,
            threads: rayon::current_num_threads(),
            rows,
        })
    })
}

/// Writes the report for people.
pub fn text(report: &SplatsReport) -> String {
    let mut lines = vec![format!(
        "{:>12} {:>9} {:>7} {:>4} {:>9} {:>10}",
        "picture", "splats", "passes", "by", "ms", "Msplats/s"
    )];
    lines.extend(report.rows.iter().map(|row| {
        format!(
            "{:>12} {:>9} {:>7} {:>4} {:>9.1} {:>10.2}",
            format!("{} x {}", row.size[0], row.size[1]),
            row.splats,
            row.passes,
            row.drawn_by,
            row.ms,
            row.msplats_per_s,
        )
    }));
    lines.join("\n")
}
