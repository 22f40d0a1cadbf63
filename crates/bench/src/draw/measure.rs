//! Runs the benchmark of the drawing rate: brings each cloud into the memories that it fits in, and
//! draws it by every path in turns.

use crate::draw::cloud::{Cloud, Order};
use crate::draw::cpu::{self, OnCpu};
use crate::draw::frame::{Covered, Times};
use crate::draw::gpu::{NO_PIXELS, OnGpu, copy_rate};
use crate::draw::report::{DrawReport, DrawRow};
use crate::quantile::quantile;
use anyhow::{Result, ensure};
use esker_engine::io::quantity::{POINTS_MAX, grouped, readable_bytes};
use esker_engine::machine::backend::{DrawWith, GpuRequest};
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_points::Task;
use esker_points::quant::HOT_POSITION_BYTES;
use esker_render::gpu::{Gpu, GpuError};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Default numbers of points without a real GPU.
const POINTS_SOFTWARE: [u64; 3] = [1_000_000, 5_000_000, 20_000_000];
/// Least default number of points on a real GPU.
const POINTS_GPU: u64 = 1_000_000;
/// Factor from one default number of points to the next, until memory is full.
const GROWTH: u64 = 4;
/// Least and greatest number of frames of a path.
const FRAMES: [usize; 2] = [3, 31];
/// Time after which the least number of frames is enough.
const PATIENCE: Duration = Duration::from_secs(6);

/// Clouds, sizes of pictures and devices to measure.
#[derive(Clone, Debug)]
pub struct DrawBenchRequest {
    /// An `.esker` file; generated points if there is none.
    pub file: Option<PathBuf>,
    /// Numbers of generated points; chosen by the machine if the list is empty.
    pub points: Vec<u64>,
    /// Widths and heights of pictures, pixels.
    pub sizes: Vec<[u32; 2]>,
    /// Choice of the GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Greatest sum of positions on the GPU.
    pub budget_gpu_bytes: u64,
    /// Greatest sum of positions in main memory.
    pub budget_ram_bytes: u64,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// Measures the drawing rate.
///
/// # Errors
/// If a required GPU is missing or fails, a file cannot be read, nothing fits the budgets, or
/// `task` is cancelled.
pub fn measure(request: &DrawBenchRequest, task: &dyn Task) -> Result<DrawReport> {
    ensure!(!request.sizes.is_empty(), "no picture size: --size needs one at least");
    let file = request.file.as_ref().map(|path| Forest::open(path)).transpose()?;
    let (gpu, drawer) = request.with.choose(None)?;
    pool::run(request.threads, || {
        let mut bench = Bench { request, task, gpu, rows: Vec::new(), notes: Vec::new() };
        bench.notes.extend(drawer.note.map(|note| format!("the CPU alone is measured: {note}")));
        match &file {
            Some(file) => bench.measure_cloud(&Cloud::File(file))?,
            None => bench.measure_grounds()?,
        }
        let Bench { gpu, rows, notes, .. } = bench;
        ensure!(!rows.is_empty(), "nothing could be measured: {}", notes.join("; "));
        Ok(DrawReport {
            file: request.file.as_ref().map(|path| path.display().to_string()),
            adapter: gpu.as_ref().map(|gpu| gpu.name.clone()),
            is_software: gpu.as_ref().map(|gpu| gpu.tier.is_software),
            threads: rayon::current_num_threads(),
            bytes_a_point: HOT_POSITION_BYTES,
            notes,
            rows,
        })
    })
}

/// A benchmark under way.
struct Bench<'a> {
    request: &'a DrawBenchRequest,
    task: &'a dyn Task,
    gpu: Option<Gpu>,
    rows: Vec<DrawRow>,
    notes: Vec<String>,
}

/// A cloud in the memories that it fits in, each with its bandwidth.
#[derive(Default)]
struct ResidentCloud<'a> {
    cpu: Option<(OnCpu<'a>, f64)>,
    gpu: Option<(OnGpu, f64)>,
}

impl Bench<'_> {
    /// Measures generated points, in both orders.
    fn measure_grounds(&mut self) -> Result<()> {
        for points in self.counts() {
            for order in [Order::Random, Order::Morton] {
                let rows = self.rows.len();
                self.measure_cloud(&Cloud::Ground(points, order))?;
                if self.rows.len() == rows {
                    // Larger clouds would not fit either.
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Numbers of generated points.
    fn counts(&self) -> Vec<u64> {
        if !self.request.points.is_empty() {
            return self.request.points.clone();
        }
        if self.gpu.as_ref().is_none_or(|gpu| gpu.tier.is_software) {
            return POINTS_SOFTWARE.to_vec();
        }
        let most = (self.request.budget_gpu_bytes / HOT_POSITION_BYTES as u64).min(POINTS_MAX);
        let grown = |&n: &u64| n.checked_mul(GROWTH);
        let mut counts: Vec<u64> =
            std::iter::successors(Some(POINTS_GPU), grown).take_while(|&n| n < most).collect();
        counts.push(most);
        counts
    }

    /// Measures one cloud at all sizes; notes it if the GPU has no memory for it.
    fn measure_cloud(&mut self, cloud: &Cloud<'_>) -> Result<()> {
        let title = format!("{} points, {} order", grouped(cloud.points()), cloud.order());
        self.task.phase(&title, Some(cloud.points()), "points");
        let mut resident = match self.load(cloud) {
            Err(e) if matches!(e.downcast_ref(), Some(GpuError::Memory { .. })) => {
                self.notes.push(format!("{title}: {e}"));
                return Ok(());
            }
            resident => resident?,
        };
        for &size in &self.request.sizes {
            let rows = self.measure_size(cloud, &mut resident, size)?;
            self.rows.extend(rows);
        }
        Ok(())
    }

    /// Brings a cloud into each memory whose budget it fits in.
    fn load<'c>(&mut self, cloud: &'c Cloud<'c>) -> Result<ResidentCloud<'c>> {
        let bytes = cloud.points() * HOT_POSITION_BYTES as u64;
        let DrawBenchRequest { budget_gpu_bytes, budget_ram_bytes, .. } = *self.request;
        let mut fits = |budget: u64, name: &str| {
            if bytes > budget {
                let (bytes, budget) = (readable_bytes(bytes), readable_bytes(budget));
                let points = grouped(cloud.points());
                let note = format!("{points} points take {bytes}; --{name} allows {budget}");
                // One note for both orders.
                if !self.notes.contains(&note) {
                    self.notes.push(note);
                }
            }
            bytes <= budget
        };
        let mut resident = ResidentCloud::default();
        if fits(budget_ram_bytes, "budget-ram") {
            resident.cpu = Some((OnCpu::new(cloud), cpu::copy_rate()));
        }
        if let Some(gpu) = self.gpu.as_ref().filter(|_| fits(budget_gpu_bytes, "budget-gpu")) {
            let rate = copy_rate(gpu)?;
            let GpuRequest { path, .. } = self.request.with.gpu;
            resident.gpu = Some((OnGpu::new(gpu, path, cloud)?, rate));
        }
        if resident.cpu.is_some() || resident.gpu.is_some() {
            cloud.each(self.task, |node, plane| {
                self.task.advance(node.points() as u64);
                if let Some((gpu, _)) = &mut resident.gpu {
                    gpu.push(node, &plane)?;
                }
                if let Some((cpu, _)) = &mut resident.cpu {
                    cpu.push(node, plane);
                }
                Ok(())
            })?;
        }
        Ok(resident)
    }

    /// Draws the cloud at one size by all paths, and makes their rows.
    fn measure_size(
        &self,
        cloud: &Cloud<'_>,
        resident: &mut ResidentCloud<'_>,
        size: [u32; 2],
    ) -> Result<Vec<DrawRow>> {
        let mut paths: Vec<MeasuredPath> = Vec::new();
        let software = self.gpu.as_ref().is_some_and(|gpu| gpu.tier.is_software);
        if let Some((cpu, rate)) = &mut resident.cpu {
            cpu.resize(size);
            let device = format!("CPU, {} threads", rayon::current_num_threads());
            paths.push(MeasuredPath::new("cpu", None, device, false, *rate));
        }
        if let Some((gpu, rate)) = &mut resident.gpu {
            gpu.resize(cloud, size)?;
            let device = self.gpu.as_ref().map(|gpu| gpu.name.clone()).unwrap_or_default();
            let names = gpu.paths().into_iter().enumerate();
            paths.extend(names.map(|(i, name)| {
                MeasuredPath::new(name, Some(i), device.clone(), software, *rate)
            }));
        }
        // The first frames are slower (memory is new), and show whether all paths draw the same.
        for path in &mut paths {
            resident.frame(path.index)?;
            path.covered = resident.covered(path.index)?;
        }
        let start = Instant::now();
        let [least, most] = FRAMES;
        for round in 0..most {
            if round >= least && start.elapsed() > PATIENCE {
                break;
            }
            for path in &mut paths {
                self.task.check()?;
                path.times.push(resident.frame(path.index)?);
            }
        }
        let no_pixels = paths.iter().find(|p| p.name == NO_PIXELS).map(MeasuredPath::median_ms);
        Ok(paths.iter().map(|path| path.row(cloud, size, no_pixels)).collect())
    }
}

impl ResidentCloud<'_> {
    /// Draws a frame by a pass of the GPU, or on the CPU if `path` is `None`.
    fn frame(&mut self, path: Option<usize>) -> Result<Times> {
        match (path, &mut self.cpu, &mut self.gpu) {
            (Some(path), _, Some((gpu, _))) => Ok(gpu.frame(path)?),
            (None, Some((cpu, _)), _) => cpu.frame(),
            _ => Ok(Times::default()),
        }
    }

    /// Counts the pixels that the last frame of `path` drew points to.
    fn covered(&self, path: Option<usize>) -> Result<Covered> {
        match (path, &self.cpu, &self.gpu) {
            (Some(path), _, Some((gpu, _))) => Ok(gpu.covered(path)?),
            (None, Some((cpu, _)), _) => Ok(cpu.covered()),
            _ => Ok(None),
        }
    }
}

/// A path from points to pixels, and the times of its frames.
struct MeasuredPath {
    name: &'static str,
    /// Index of a pass of the GPU; `None` for the CPU.
    index: Option<usize>,
    device: String,
    is_software: bool,
    copy_bytes_per_s: f64,
    covered: Covered,
    times: Vec<Times>,
}

impl MeasuredPath {
    fn new(
        name: &'static str,
        index: Option<usize>,
        device: String,
        is_software: bool,
        copy_bytes_per_s: f64,
    ) -> Self {
        Self {
            name,
            index,
            device,
            is_software,
            copy_bytes_per_s,
            covered: None,
            times: Vec::new(),
        }
    }

    /// Times by the GPU's clock if all frames have one, else by the wall clock. Timestamps of
    /// software drivers are not used: they may miss the work between them.
    fn ms(&self) -> (Vec<f64>, &'static str) {
        match self.gpu_ms().filter(|gpu| !self.is_software && gpu.iter().all(|&ms| ms > 0.0)) {
            Some(gpu) => (gpu, "timestamps"),
            None => (self.wall_ms(), "wall"),
        }
    }

    fn gpu_ms(&self) -> Option<Vec<f64>> {
        self.times.iter().map(|t| t.gpu_ms).collect()
    }

    fn wall_ms(&self) -> Vec<f64> {
        self.times.iter().map(|t| t.wall_ms).collect()
    }

    fn median_ms(&self) -> f64 {
        quantile(&self.ms().0, 0.5)
    }

    fn row(&self, cloud: &Cloud<'_>, size: [u32; 2], no_pixels_ms: Option<f64>) -> DrawRow {
        let (all, clock) = self.ms();
        let [ms_p10, ms, ms_p90] = [0.1, 0.5, 0.9].map(|share| quantile(&all, share));
        let points_per_s = cloud.points() as f64 / (ms * 1e-3).max(1e-9);
        let bytes_per_s = points_per_s * HOT_POSITION_BYTES as f64;
        let no_pixels = no_pixels_ms.filter(|_| self.name == "atomics");
        DrawRow {
            path: self.name,
            order: cloud.order(),
            points: cloud.points(),
            nodes: cloud.nodes(),
            size,
            ms,
            ms_p10,
            ms_p90,
            clock,
            wall_ms: quantile(&self.wall_ms(), 0.5),
            gpu_ms: self.gpu_ms().map(|all| quantile(&all, 0.5)),
            frames: all.len(),
            mpoints_per_s: points_per_s * 1e-6,
            bytes_per_s,
            copy_bytes_per_s: self.copy_bytes_per_s,
            share_of_bandwidth: bytes_per_s / self.copy_bytes_per_s.max(1.0),
            rate_to_no_pixels: no_pixels.map(|without| without / ms.max(1e-9)),
            pixels_covered: self.covered,
            device: self.device.clone(),
            is_software: self.is_software,
        }
    }
}
