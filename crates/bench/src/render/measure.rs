//! Runs the benchmark of rendering: makes or opens each model, draws it by each method on all
//! backends in turns, and measures copies of the same bytes.

use crate::draw::copy_rate;
use crate::quantile::{median_ms, quantile};
use crate::render::models::{TABLE_1, write_pebble};
use crate::render::report::{RenderBenchReport, RenderRow};
use crate::render::scene::{Changes, ResidentScene};
use anyhow::Result;
use esker_engine::Method;
use esker_engine::draw::scene::{PictureRequest, open};
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_points::Task;
use esker_render::gpu::Gpu;
use esker_render::{Pass, PassTimes};
use rayon::prelude::*;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Frames as in the paper: a pixel shows the one point that wins it.
const PUBLISHED: Changes =
    Changes { one_wins: true, is_rough: true, is_flat: true, ..Changes::NONE };
/// Methods and their names on the command line, in the order of the rows.
const METHODS: [(Method, &str); 3] =
    [(Method::PullPush, "pull-push"), (Method::Ewa, "ewa"), (Method::Points, "points")];
/// Least and greatest number of frames of a row.
const FRAMES: [usize; 2] = [3, 15];
/// Time after which the least number of frames is enough.
const PATIENCE: Duration = Duration::from_secs(4);
/// Bytes of a pixel that a frame of points writes and reads: projection's hit, and the picture.
const POINT_PIXEL_BYTES: u64 = 8 + 8;
/// Bytes of a pixel that a frame of surfaces needs in addition: the planes of the pyramid with
/// normals, and a third more for its upper levels.
const SURFACE_PIXEL_BYTES: u64 = (16 + 16 + 4 + 16) * 4 / 3;
/// Least time of a dispatch on a GPU, milliseconds.
const DISPATCH_MS: f64 = 0.01;
/// Bytes of a copy by one thread.
const COPY_PIECE: usize = 1 << 18;
/// Copies whose median is returned.
const COPIES: usize = 5;

/// Models, pictures, methods and devices to measure.
#[derive(Clone, Debug)]
pub struct RenderBenchRequest {
    /// `.esker` files or scans; generated models if the list is empty.
    pub models: Vec<PathBuf>,
    /// Numbers of points of generated models; those of the paper if the list is empty.
    pub points: Vec<u64>,
    /// Widths and heights of pictures, pixels.
    pub sizes: Vec<[u32; 2]>,
    /// The only method to measure; all by default.
    pub method: Option<Method>,
    /// Factors of the radii of points; 1 if the list is empty.
    pub radii: Vec<f32>,
    /// Choice of the GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// A model, and the times of the paper for one of its size.
struct Model {
    name: String,
    file: Forest,
    /// Times of pictures of 512 x 512 and of 1024 x 1024 pixels, milliseconds.
    paper_ms: Option<[f64; 2]>,
    _folder: Option<tempfile::TempDir>,
}

/// One model in pictures of one size by one method.
struct Setting<'a> {
    model: &'a Model,
    size: [u32; 2],
    method: Method,
    method_name: &'static str,
    gpu: Option<&'a Gpu>,
}

/// Measures rendering.
///
/// # Errors
/// If a model cannot be read or built, a required GPU is missing or fails, or `task` is cancelled.
pub fn measure(request: &RenderBenchRequest, task: &dyn Task) -> Result<RenderBenchReport> {
    let (gpu, drawer) = request.with.choose(None)?;
    let is_wanted = |method| request.method.is_none_or(|only| only == method);
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for index in 0..request.count() {
            let model = request.model(index, task)?;
            for &size in &request.sizes {
                let methods = METHODS.into_iter().filter(|&(method, _)| is_wanted(method));
                for (method, method_name) in methods {
                    let setting =
                        Setting { model: &model, size, method, method_name, gpu: gpu.as_ref() };
                    rows.extend(setting.measure(&request.radii, task)?);
                }
            }
        }
        Ok(RenderBenchReport {
            adapter: gpu.as_ref().map(|gpu| gpu.name.clone()),
            is_software: gpu.as_ref().map(|gpu| gpu.tier.is_software),
            note: drawer.note,
            threads: rayon::current_num_threads(),
            rows,
        })
    })
}

impl RenderBenchRequest {
    /// Number of models.
    fn count(&self) -> usize {
        match (self.models.len(), self.points.len()) {
            (0, 0) => TABLE_1.len(),
            (0, points) => points,
            (models, _) => models,
        }
    }

    /// Opens or makes model `index`.
    fn model(&self, index: usize, task: &dyn Task) -> Result<Model> {
        if let Some(path) = self.models.get(index) {
            let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            let (file, folder) =
                open(std::slice::from_ref(path), &PictureRequest::default(), task)?;
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
        let (file, built) = open(&[scan], &PictureRequest::default(), task)?;
        let paper_ms = row.map(|&(.., paper_ms)| paper_ms);
        Ok(Model { name, file, paper_ms, _folder: built })
    }
}

impl Setting<'_> {
    /// Measures with all factors of radii; without any, with the points' own radii.
    fn measure(&self, radii: &[f32], task: &dyn Task) -> Result<Vec<RenderRow>> {
        let picture = PictureRequest {
            size: self.size,
            method: self.method,
            target_spacing_px: 0.0,
            budget_points: u64::MAX,
            colour_by: Some("plain".into()),
            ..PictureRequest::default()
        };
        let mut scene = ResidentScene::new(&self.model.file, &picture, self.gpu, task)?;
        let full_screen_ms = if radii.is_empty() || self.method == Method::Points {
            [None; 2]
        } else {
            full_screen_ms(&mut scene, task)?
        };
        let mut rows = Vec::new();
        for &radius_factor in if radii.is_empty() { &[1.0] } else { radii } {
            scene.set_radii(radius_factor);
            rows.extend(self.rows(&mut scene, radius_factor, full_screen_ms, task)?);
        }
        Ok(rows)
    }

    /// Measures frames of `scene` and makes a row a backend. `full_screen_ms` has the times of the
    /// CPU and of the GPU.
    fn rows(
        &self,
        scene: &mut ResidentScene<'_>,
        radius_factor: f32,
        full_screen_ms: [Option<f64>; 2],
        task: &dyn Task,
    ) -> Result<Vec<RenderRow>> {
        let Self { model, size: [width, height], method_name, .. } = *self;
        task.phase(&format!("{} {width}x{height} {method_name}", model.name), None, "frames");
        let frames = frames_of(scene, task)?;
        let pixels = u64::from(width) * u64::from(height);
        let surface = if self.method == Method::Points { 0 } else { SURFACE_PIXEL_BYTES };
        let (plane_bytes, pixel_bytes) =
            (scene.plane_bytes(), pixels * (POINT_PIXEL_BYTES + surface));
        let bytes = plane_bytes + pixel_bytes;
        let rate = self.gpu.map(copy_rate).transpose()?;
        // The rate counts bytes read and bytes written.
        let ms = |bytes: u64, rate: f64| bytes as f64 / rate.max(1.0) * 1e3;
        let copy_floors = [Some(copy_ms(bytes)), rate.map(|rate| ms(2 * bytes, rate))];
        let dispatches = scene.dispatches();
        let gpu_floor_ms = rate
            .map(|rate| ms(plane_bytes.max(pixel_bytes), rate) + DISPATCH_MS * dispatches as f64);
        let pixels_covered = scene.pixels_covered();
        let mut rows = Vec::new();
        for (i, backend) in ["cpu", "gpu"].into_iter().enumerate() {
            let frames = &frames[i];
            let Some(copy_floor_ms) = copy_floors[i].filter(|_| !frames.is_empty()) else {
                continue;
            };
            let gpu_floor_ms = gpu_floor_ms.filter(|_| backend == "gpu");
            let median = |of: fn(&PassTimes) -> f64| {
                quantile(&frames.iter().map(of).collect::<Vec<_>>(), 0.5)
            };
            let total_ms = median(|s| s.total_ms);
            rows.push(RenderRow {
                model: model.name.clone(),
                points: scene.points(),
                width,
                height,
                backend,
                method: method_name,
                project_ms: median(|s| s.sum_ms(&FIRST_PASSES)),
                pull_push_ms: median(|s| s.sum_ms(&FILLING_PASSES)),
                shade_ms: median(|s| s.sum_ms(&SHADING_PASSES)),
                total_ms,
                pixels_covered: pixels_covered[i],
                copy_floor_ms,
                dispatches: gpu_floor_ms.map(|_| dispatches),
                gpu_floor_ms,
                over_floor: gpu_floor_ms.map(|floor| total_ms / floor),
                mpoints_per_s: scene.points() as f64 / total_ms.max(1e-9) * 1e-3,
                frames: frames.len(),
                least_ms: fastest(frames),
                paper_total_ms: self.paper_ms(),
                radius_factor,
                full_screen_ms: full_screen_ms[i],
            });
        }
        Ok(rows)
    }

    /// Time of the paper, if it has one of this model, method and size.
    fn paper_ms(&self) -> Option<f64> {
        let ms = self.model.paper_ms.filter(|_| self.method == Method::PullPush)?;
        match self.size {
            [512, 512] => Some(ms[0]),
            [1024, 1024] => Some(ms[1]),
            _ => None,
        }
    }
}

/// Times of the frame that took least.
fn fastest(frames: &[PassTimes]) -> PassTimes {
    let least = frames.iter().min_by(|a, b| a.total_ms.total_cmp(&b.total_ms));
    least.copied().unwrap_or_default()
}

/// Draws frames on the CPU, and on the GPU if there is one, in turns.
fn frames_of(scene: &mut ResidentScene<'_>, task: &dyn Task) -> Result<[Vec<PassTimes>; 2]> {
    let mut frames = [Vec::new(), Vec::new()];
    // The first frames are slower: memory is new, and pipelines are made.
    scene.on_cpu(PUBLISHED)?;
    scene.on_gpu(PUBLISHED)?;
    let start = Instant::now();
    for round in 0..FRAMES[1] {
        if round >= FRAMES[0] && start.elapsed() > PATIENCE {
            break;
        }
        task.check()?;
        frames[0].push(scene.on_cpu(PUBLISHED)?);
        if scene.has_gpu() {
            frames[1].push(scene.on_gpu(PUBLISHED)?);
        }
    }
    Ok(frames)
}

/// Median time of a frame of the same points from so near that every pixel is covered, on the CPU
/// and on the GPU, milliseconds; `None` if no view does that.
fn full_screen_ms(scene: &mut ResidentScene<'_>, task: &dyn Task) -> Result<[Option<f64>; 2]> {
    task.phase("a full screen", None, "frames");
    let view = scene.picture.view;
    if !scene.fill(PUBLISHED)? {
        return Ok([None; 2]);
    }
    let frames = frames_of(scene, task)?;
    scene.picture.view = view;
    Ok(frames.map(|frames| median_ms(&frames)))
}

/// Passes whose times are reported as `project_ms`.
const FIRST_PASSES: [Pass; 6] =
    [Pass::Project, Pass::FitPlanes, Pass::Gather, Pass::Average, Pass::Exposure, Pass::Place];
/// Passes whose times are reported as `pull_push_ms`.
const FILLING_PASSES: [Pass; 5] =
    [Pass::Pull, Pass::Push, Pass::FillHoles, Pass::Silhouette, Pass::Blend];
/// Passes whose times are reported as `shade_ms`.
const SHADING_PASSES: [Pass; 3] = [Pass::SmoothDepth, Pass::Shade, Pass::Antialias];

/// Median time in which all threads copy `bytes` in main memory, milliseconds.
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
    // The first copy is slower: its pages are new.
    copy();
    let copies: Vec<f64> = (0..COPIES).map(|_| copy()).collect();
    quantile(&copies, 0.5)
}
