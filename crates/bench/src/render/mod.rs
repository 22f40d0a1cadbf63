//! Table 1 of marroquim2007: the time of a frame for models of several sizes and pictures of two, by every method
//! and backend; beside each row the time in which the same bytes are copied once. All points are drawn, as in
//! the paper. Frames of the backends take turns, so that they share what else the machine does.
//!
//! What a GPU draws has another floor beside it: its memory moves the bytes of the points, or those of the pixels, whichever
//! are more, and every dispatch takes [`DISPATCH_MS`]. Where radii are asked for, each row has the time of the same points and passes
//! where every pixel is covered: what no radius may exceed.

mod models;
mod report;
pub(crate) mod stand;

use crate::draw::copy_rate;
use crate::flight::quantile;
use anyhow::Result;
use esker_engine::draw::scene::PictureRequest as Picture;
use esker_engine::draw::scene::open;
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_points::Task;
use esker_render::gpu::Gpu;
use esker_render::{Method, Pass, Stages};
use models::{TABLE_1, write_pebble};
use rayon::prelude::*;
use serde_json::{Value, json};
use stand::{Changes, Stand};
use std::path::PathBuf;
use std::time::{Duration, Instant};

pub use report::text;

/// Frames as the paper has them: a pixel shows the one point that wins it.
const PUBLISHED: Changes = Changes {
    one_wins: true,
    is_rough: true,
    is_flat: true,
    always_pushes: false,
    keeps_back_faces: false,
    is_matt: false,
};
/// The methods that are measured, by the names of the command line.
const METHODS: [(Method, &str); 3] =
    [(Method::PullPush, "pull-push"), (Method::Ewa, "ewa"), (Method::Points, "points")];
/// Frames at least and at most, and how long they may take before the least is enough.
const FRAMES: [usize; 2] = [3, 15];
const PATIENCE: Duration = Duration::from_secs(4);
/// Bytes that a frame writes and reads of each pixel at least, by the method: what projection leaves, and the picture.
const POINT_PIXEL_BYTES: u64 = 8 + 8;
/// The pyramid's planes, with normals, and a third more for the levels above.
const SURFACE_PIXEL_BYTES: u64 = (16 + 16 + 4 + 16) * 4 / 3;
/// Milliseconds that a dispatch takes on a GPU at least.
const DISPATCH_MS: f64 = 0.01;
/// Bytes that a thread copies at once.
const COPY_PIECE: usize = 1 << 18;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Request {
    /// `.esker` files or scans; generated models of the sizes of the paper's where there are none.
    pub models: Vec<PathBuf>,
    /// Numbers of points of generated models; the paper's where not said.
    pub points: Vec<u64>,
    /// Widths and heights of pictures, pixels.
    pub sizes: Vec<[u32; 2]>,
    /// The only method; all where not said.
    pub method: Option<Method>,
    /// Points are drawn with so many times their radii; with their own where none is said.
    pub radii: Vec<f32>,
    /// The GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 is one a core.
    pub threads: usize,
}

/// A model and what the paper measured of the like.
struct Model {
    name: String,
    file: Forest,
    /// For pictures of 512 x 512 and of 1024 x 1024, milliseconds.
    paper_ms: Option<[f64; 2]>,
    _folder: Option<tempfile::TempDir>,
}

/// Measures; the report.
///
/// # Errors
/// Where a model cannot be read or built, a GPU is asked for and there is none, or it fails; on request.
pub fn measure(request: &Request, task: &dyn Task) -> Result<Value> {
    let (gpu, drawer) = request.with.choose(None)?;
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for index in 0..request.count() {
            let model = request.model(index, task)?;
            for &size in &request.sizes {
                let asked = |method| request.method.is_none_or(|only| only == method);
                for (method, name) in METHODS.into_iter().filter(|&(method, _)| asked(method)) {
                    let picture = Picture {
                        size,
                        method,
                        target_spacing_px: 0.0,
                        budget_points: u64::MAX,
                        colour_by: Some("plain".into()),
                        ..Picture::default()
                    };
                    let mut stand = Stand::new(&model.file, &picture, gpu.as_ref(), task)?;
                    let own = [1.0];
                    let radii = if request.radii.is_empty() { &own } else { &request.radii[..] };
                    let full = if request.radii.is_empty() || method == Method::Points {
                        [None; 2]
                    } else {
                        full_screen_ms(&mut stand, task)?
                    };
                    for &radius in radii {
                        stand.set_radii(radius);
                        let found = rows_of(&model, &mut stand, size, name, gpu.as_ref(), task)?;
                        for mut row in found {
                            row["radius_factor"] = json!(radius);
                            row["full_screen_ms"] =
                                json!(full[usize::from(row["backend"] == "gpu")]);
                            rows.push(row);
                        }
                    }
                }
            }
        }
        Ok(json!({
            "adapter": gpu.as_ref().map(|gpu| &gpu.name),
            "is_software": gpu.as_ref().map(|gpu| gpu.tier.is_software),
            "note": drawer.note,
            "threads": rayon::current_num_threads(),
            "rows": rows,
        }))
    })
}

impl Request {
    fn count(&self) -> usize {
        match (self.models.len(), self.points.len()) {
            (0, 0) => TABLE_1.len(),
            (0, points) => points,
            (models, _) => models,
        }
    }

    fn model(&self, index: usize, task: &dyn Task) -> Result<Model> {
        if let Some(path) = self.models.get(index) {
            let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            let (file, folder) = open(std::slice::from_ref(path), &Picture::default(), task)?;
            return Ok(Model { name, file, paper_ms: None, _folder: folder });
        }
        let row = TABLE_1.get(index).filter(|_| self.points.is_empty());
        let (name, points) = match (row, self.points.get(index)) {
            (Some(&(name, points, _)), _) => (format!("like-{name}"), points),
            (None, points) => {
                let points = points.copied().unwrap_or(1);
                (format!("pebble-{points}"), points)
            }
        };
        let folder = tempfile::tempdir()?;
        let scan = folder.path().join("pebble.ply");
        task.phase(&format!("making {name}"), None, "points");
        write_pebble(&scan, points)?;
        let (file, built) = open(&[scan], &Picture::default(), task)?;
        let paper_ms = row.map(|&(.., paper_ms)| paper_ms);
        Ok(Model { name, file, paper_ms, _folder: built })
    }
}

/// The rows of a model at one size by one method: one a backend.
fn rows_of(
    model: &Model,
    stand: &mut Stand<'_>,
    size: [u32; 2],
    method: &str,
    gpu: Option<&Gpu>,
    task: &dyn Task,
) -> Result<Vec<Value>> {
    task.phase(&format!("{} {}x{} {method}", model.name, size[0], size[1]), None, "frames");
    let frames = frames_of(stand, task)?;
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let surface = if method == "points" { 0 } else { SURFACE_PIXEL_BYTES };
    let (plane_bytes, pixel_bytes) = (stand.plane_bytes(), pixels * (POINT_PIXEL_BYTES + surface));
    let bytes = plane_bytes + pixel_bytes;
    let rate = gpu.map(copy_rate).transpose()?;
    // The rate counts bytes read and bytes written.
    let ms = |bytes: u64, rate: f64| bytes as f64 / rate.max(1.0) * 1e3;
    let floors = [Some(copy_ms(bytes)), rate.map(|rate| ms(2 * bytes, rate))];
    let dispatches = stand.dispatches();
    let gpu_floor_ms =
        rate.map(|rate| ms(plane_bytes.max(pixel_bytes), rate) + DISPATCH_MS * dispatches as f64);
    let paper = model.paper_ms.filter(|_| method == "pull-push").and_then(|ms| match size {
        [512, 512] => Some(ms[0]),
        [1024, 1024] => Some(ms[1]),
        _ => None,
    });
    let mut rows = Vec::new();
    let backends = ["cpu", "gpu"].into_iter().zip(stand.pixels_covered());
    for ((backend, pixels_covered), (frames, floor)) in backends.zip(frames.iter().zip(floors)) {
        let Some(floor) = floor.filter(|_| !frames.is_empty()) else { continue };
        let gpu_floor_ms = gpu_floor_ms.filter(|_| backend == "gpu");
        let median =
            |of: fn(&Stages) -> f64| quantile(&frames.iter().map(of).collect::<Vec<_>>(), 0.5);
        let total_ms = median(|s| s.total_ms);
        rows.push(json!({
            "model": model.name,
            "points": stand.points(),
            "width": size[0],
            "height": size[1],
            "backend": backend,
            "method": method,
            "project_ms": median(|s| s.sum_ms(&FIRST_PASSES)),
            "pull_push_ms": median(|s| s.sum_ms(&FILLING_PASSES)),
            "shade_ms": median(|s| s.sum_ms(&SHADING_PASSES)),
            "total_ms": total_ms,
            "pixels_covered": pixels_covered,
            "copy_floor_ms": floor,
            "dispatches": gpu_floor_ms.map(|_| dispatches),
            "gpu_floor_ms": gpu_floor_ms,
            "over_floor": gpu_floor_ms.map(|floor| total_ms / floor),
            "mpoints_per_s": stand.points() as f64 / total_ms.max(1e-9) * 1e-3,
            "frames": frames.len(),
            "least_ms": least(frames),
            "paper_total_ms": paper,
        }));
    }
    Ok(rows)
}

/// Frames on the CPU, and on the GPU where there is one, in turns.
fn frames_of(stand: &mut Stand<'_>, task: &dyn Task) -> Result<[Vec<Stages>; 2]> {
    let mut frames = [Vec::new(), Vec::new()];
    // The first frames pay for fresh memory and for pipelines.
    stand.on_cpu(PUBLISHED)?;
    stand.on_gpu(PUBLISHED)?;
    let start = Instant::now();
    for round in 0..FRAMES[1] {
        if round >= FRAMES[0] && start.elapsed() > PATIENCE {
            break;
        }
        task.check()?;
        frames[0].push(stand.on_cpu(PUBLISHED)?);
        if stand.has_gpu() {
            frames[1].push(stand.on_gpu(PUBLISHED)?);
        }
    }
    Ok(frames)
}

/// Milliseconds of a frame of the same points from so near that every pixel is covered, on the CPU and on the GPU; `None` where
/// no view does that.
fn full_screen_ms(stand: &mut Stand<'_>, task: &dyn Task) -> Result<[Option<f64>; 2]> {
    task.phase("a full screen", None, "frames");
    let view = stand.scene.view;
    if !stand.fill(PUBLISHED)? {
        return Ok([None; 2]);
    }
    let frames = frames_of(stand, task)?;
    stand.scene.view = view;
    Ok(frames.map(|frames| {
        let all: Vec<f64> = frames.iter().map(|s| s.total_ms).collect();
        (!all.is_empty()).then(|| quantile(&all, 0.5))
    }))
}

/// Passes whose times are reported as `project_ms`.
const FIRST_PASSES: [Pass; 6] =
    [Pass::Project, Pass::FitPlanes, Pass::Gather, Pass::Average, Pass::Exposure, Pass::Place];
/// Passes whose times are reported as `pull_push_ms`.
const FILLING_PASSES: [Pass; 5] =
    [Pass::Pull, Pass::Push, Pass::FillHoles, Pass::Silhouette, Pass::Blend];
/// Passes whose times are reported as `shade_ms`.
const SHADING_PASSES: [Pass; 3] = [Pass::SmoothDepth, Pass::Shade, Pass::Antialias];

/// The least time of each pass among frames: its time where nothing else is running.
fn least(frames: &[Stages]) -> Value {
    let least = |ms: &dyn Fn(&Stages) -> f64| frames.iter().map(ms).fold(f64::INFINITY, f64::min);
    let passes = Pass::ALL.iter().map(|&pass| (pass.name(), least(&|s| s.ms(pass))));
    let all = passes.chain([("total", least(&|s| s.total_ms))]);
    Value::Object(all.map(|(name, ms)| (name.to_owned(), json!(ms))).collect())
}

/// Milliseconds in which all threads copy so many bytes in main memory: a median.
fn copy_ms(bytes: u64) -> f64 {
    let source = vec![1u8; bytes as usize];
    let mut target = vec![0u8; bytes as usize];
    let mut copy = || {
        let start = Instant::now();
        let pieces = target.par_chunks_mut(COPY_PIECE).zip(source.par_chunks(COPY_PIECE));
        pieces.for_each(|(to, from)| to.copy_from_slice(from));
        std::hint::black_box(&mut target);
        start.elapsed().as_secs_f64() * 1e3
    };
    // The first one pays for fresh memory.
    copy();
    let copies: Vec<f64> = (0..5).map(|_| copy()).collect();
    quantile(&copies, 0.5)
}
