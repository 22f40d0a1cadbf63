//! The pure drawing rate: how many points a second become single pixels when all of them lie in memory. Each way
//! to draw is measured on the same points in turns, frame by frame, so that all share what else the machine does;
//! beside them the bandwidth of copies of the same memory, and the dispatch of 64-bit atomics without its
//! frame buffer (schuetz2021, Rendering Point Clouds with Compute Shaders and Vertex Order Optimization, compares orders
//! of points in this way).

mod cloud;
mod cpu;
mod gpu;
mod report;

use crate::flight::quantile;
use anyhow::{Result, ensure};
use cloud::{Cloud, Order};
use cpu::OnCpu;
use esker_engine::io::quantity::{grouped, readable_bytes};
use esker_engine::machine::backend::{DrawWith, GpuRequest};
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_points::Task;
use esker_points::quant::HOT_POSITION_BYTES;
use esker_render::gpu::{Gpu, GpuError};
use gpu::{NO_PIXELS, OnGpu};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

pub(crate) use gpu::{copy_rate, wait};
pub use report::text;

/// Points where there is no real GPU and nobody says how many.
const POINTS_SOFTWARE: [u64; 3] = [1_000_000, 5_000_000, 20_000_000];
/// The least on a real GPU, and by how much they grow until memory is full.
const POINTS_GPU: u64 = 1_000_000;
const GROWTH: u64 = 4;
/// Frames of each way at least and at most, and how long they may take before the least is enough.
const FRAMES: [usize; 2] = [3, 31];
const PATIENCE: Duration = Duration::from_secs(6);

/// What is measured.
#[derive(Clone, Debug)]
pub struct Request {
    /// An `.esker` file; generated points where there is none.
    pub file: Option<PathBuf>,
    /// Numbers of generated points; by the machine where not said.
    pub points: Vec<u64>,
    /// Widths and heights of pictures, pixels.
    pub sizes: Vec<[u32; 2]>,
    /// The GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Bytes of positions on the GPU at most.
    pub budget_gpu_bytes: u64,
    /// Bytes of positions in main memory at most.
    pub budget_ram_bytes: u64,
    /// Threads; 0 is one a core.
    pub threads: usize,
}

/// Pixels that a frame drew points on, where it has pixels.
type Covered = Option<u64>;

/// What a frame took.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    /// From submitting it until it was there.
    wall_ms: f64,
    /// Its passes by the GPU's own clock, where it has one.
    gpu_ms: Option<f64>,
}

/// Measures; the report.
///
/// # Errors
/// Where a GPU is asked for and there is none, or it fails; where a file cannot be read; where nothing fits the
/// budgets; on request.
pub fn measure(request: &Request, task: &dyn Task) -> Result<Value> {
    ensure!(!request.sizes.is_empty(), "no size of pictures");
    let file = request.file.as_ref().map(|path| Forest::open(path)).transpose()?;
    let (gpu, drawer) = request.with.choose(None)?;
    pool::run(request.threads, || {
        let mut bench = Bench { request, task, gpu, rows: Vec::new(), notes: Vec::new() };
        bench.notes.extend(drawer.note.map(|note| format!("the CPU alone is measured: {note}")));
        match &file {
            Some(file) => bench.cloud(&Cloud::File(file))?,
            None => bench.ground()?,
        }
        let Bench { gpu, rows, notes, .. } = bench;
        ensure!(!rows.is_empty(), "nothing could be measured: {}", notes.join("; "));
        Ok(json!({
            "file": request.file.as_ref().map(|path| path.display().to_string()),
            "adapter": gpu.as_ref().map(|gpu| &gpu.name),
            "is_software": gpu.as_ref().map(|gpu| gpu.tier.is_software),
            "threads": rayon::current_num_threads(),
            "bytes_a_point": HOT_POSITION_BYTES,
            "notes": notes,
            "rows": rows,
        }))
    })
}

struct Bench<'a> {
    request: &'a Request,
    task: &'a dyn Task,
    gpu: Option<Gpu>,
    rows: Vec<Value>,
    notes: Vec<String>,
}

/// A cloud where it fits, and the bandwidth of what it lies in.
#[derive(Default)]
struct Resident<'a> {
    cpu: Option<(OnCpu<'a>, f64)>,
    gpu: Option<(OnGpu, f64)>,
}

impl Bench<'_> {
    /// Generated points, in both orders.
    fn ground(&mut self) -> Result<()> {
        for points in self.counts() {
            for order in [Order::Random, Order::Morton] {
                let rows = self.rows.len();
                self.cloud(&Cloud::Ground(points, order))?;
                if self.rows.len() == rows {
                    // More would fit even less.
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Numbers of points.
    fn counts(&self) -> Vec<u64> {
        if !self.request.points.is_empty() {
            return self.request.points.clone();
        }
        if self.gpu.as_ref().is_none_or(|gpu| gpu.tier.is_software) {
            return POINTS_SOFTWARE.to_vec();
        }
        let most = (self.request.budget_gpu_bytes / HOT_POSITION_BYTES as u64)
            .min(esker_engine::io::quantity::POINTS_MAX);
        let grown = |&n: &u64| n.checked_mul(GROWTH);
        let mut counts: Vec<u64> =
            std::iter::successors(Some(POINTS_GPU), grown).take_while(|&n| n < most).collect();
        counts.push(most);
        counts
    }

    fn cloud(&mut self, cloud: &Cloud<'_>) -> Result<()> {
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
            let rows = self.picture(cloud, &mut resident, size)?;
            self.rows.extend(rows);
        }
        Ok(())
    }

    /// Brings a cloud into memory, of each kind that it fits.
    fn load<'c>(&mut self, cloud: &'c Cloud<'c>) -> Result<Resident<'c>> {
        let bytes = cloud.points() * HOT_POSITION_BYTES as u64;
        let Request { budget_gpu_bytes, budget_ram_bytes, .. } = *self.request;
        let mut fits = |budget: u64, name: &str| {
            if bytes > budget {
                let (bytes, budget) = (readable_bytes(bytes), readable_bytes(budget));
                let points = grouped(cloud.points());
                let note = format!("{points} points take {bytes}; --{name} grants {budget}");
                // Said once for both orders.
                if !self.notes.contains(&note) {
                    self.notes.push(note);
                }
            }
            bytes <= budget
        };
        let mut resident = Resident::default();
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

    /// Rows of all ways at one size.
    fn picture(
        &self,
        cloud: &Cloud<'_>,
        resident: &mut Resident<'_>,
        size: [u32; 2],
    ) -> Result<Vec<Value>> {
        let mut ways: Vec<Way> = Vec::new();
        let software = self.gpu.as_ref().is_some_and(|gpu| gpu.tier.is_software);
        if let Some((cpu, rate)) = &mut resident.cpu {
            cpu.fit(size);
            let device = format!("CPU, {} threads", rayon::current_num_threads());
            ways.push(Way::new("cpu", None, device, false, *rate));
        }
        if let Some((gpu, rate)) = &mut resident.gpu {
            gpu.fit(cloud, size)?;
            let device = self.gpu.as_ref().map(|gpu| gpu.name.clone()).unwrap_or_default();
            let names = gpu.ways().into_iter().enumerate();
            ways.extend(names.map(|(i, n)| Way::new(n, Some(i), device.clone(), software, *rate)));
        }
        // The first frames pay for fresh memory, and show whether all ways draw the same.
        for way in &mut ways {
            resident.frame(way.index)?;
            way.covered = resident.covered(way.index)?;
        }
        let start = Instant::now();
        let [least, most] = FRAMES;
        for round in 0..most {
            if round >= least && start.elapsed() > PATIENCE {
                break;
            }
            for way in &mut ways {
                self.task.check()?;
                way.times.push(resident.frame(way.index)?);
            }
        }
        let no_pixels = ways.iter().find(|way| way.name == NO_PIXELS).map(Way::median_ms);
        Ok(ways.iter().map(|way| way.row(cloud, size, no_pixels)).collect())
    }
}

impl Resident<'_> {
    /// A frame of a GPU's way, or of the CPU.
    fn frame(&mut self, way: Option<usize>) -> Result<Times> {
        match (way, &mut self.cpu, &mut self.gpu) {
            (Some(way), _, Some((gpu, _))) => Ok(gpu.frame(way)?),
            (None, Some((cpu, _)), _) => cpu.frame(),
            _ => Ok(Times::default()),
        }
    }

    fn covered(&self, way: Option<usize>) -> Result<Covered> {
        match (way, &self.cpu, &self.gpu) {
            (Some(way), _, Some((gpu, _))) => Ok(gpu.covered(way)?),
            (None, Some((cpu, _)), _) => Ok(cpu.covered()),
            _ => Ok(None),
        }
    }
}

/// A way to draw, and its frames.
struct Way {
    name: &'static str,
    /// On the GPU.
    index: Option<usize>,
    device: String,
    is_software: bool,
    copy_bytes_per_s: f64,
    covered: Covered,
    times: Vec<Times>,
}

impl Way {
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

    /// Times by the GPU's clock where all frames have one. Not of a software driver, whose stamps may miss what
    /// lies between them (llvmpipe, a pass of one dispatch: 0.08 ms where the wall says 65).
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

    fn row(&self, cloud: &Cloud<'_>, size: [u32; 2], no_pixels_ms: Option<f64>) -> Value {
        let (all, clock) = self.ms();
        let [p10, ms, p90] = [0.1, 0.5, 0.9].map(|share| quantile(&all, share));
        let points_per_s = cloud.points() as f64 / (ms * 1e-3).max(1e-9);
        let bytes_per_s = points_per_s * HOT_POSITION_BYTES as f64;
        let no_pixels = no_pixels_ms.filter(|_| self.name == "atomics");
        json!({
            "path": self.name,
            "order": cloud.order(),
            "points": cloud.points(),
            "nodes": cloud.nodes(),
            "size": size,
            "ms": ms,
            "ms_p10": p10,
            "ms_p90": p90,
            "clock": clock,
            "wall_ms": quantile(&self.wall_ms(), 0.5),
            "gpu_ms": self.gpu_ms().map(|all| quantile(&all, 0.5)),
            "frames": all.len(),
            "mpoints_per_s": points_per_s * 1e-6,
            "bytes_per_s": bytes_per_s,
            "copy_bytes_per_s": self.copy_bytes_per_s,
            "share_of_bandwidth": bytes_per_s / self.copy_bytes_per_s.max(1.0),
            "rate_to_no_pixels": no_pixels.map(|without| without / ms.max(1e-9)),
            "pixels_covered": self.covered,
            "device": self.device,
            "is_software": self.is_software,
        })
    }
}
