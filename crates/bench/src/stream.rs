//! The benchmark of streaming (kanzok2015, section 4): one `.esker` file, flown along a path with and
//! without the depth test, against plain reads of the same file in the same run. Measures the process
//! that it runs in, so each file gets one of its own ([`crate::process`]).

use crate::disk;
use crate::flight::{Flight, Passes, fly, quantile};
use anyhow::{Context, Result};
use esker_builder::budget::memory::usage;
use esker_engine::calls::info;
use esker_engine::cameras::path::Path;
use esker_engine::draw::budget::Shares;
use esker_engine::draw::session::{Options, Session};
use esker_engine::io::picture;
use esker_engine::machine::backend::{Backend, DrawWith, Drawer};
use esker_engine::machine::system;
use esker_format::Forest;
use esker_points::Task;
use esker_stream::Priority;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Loadings of a view that the median is taken of: from cold, and else.
const LOADINGS: [usize; 2] = [10, 3];
/// Plain reads in flight.
const IN_FLIGHT: usize = 8;
/// What the resident set may be above the budgets and the empty program.
const MARGIN: f64 = 1.05;

/// What is measured, and how.
#[derive(Clone, Debug)]
pub struct Request {
    /// The camera's path; derived from the scan where not said.
    pub path: Option<PathBuf>,
    /// What draws.
    pub with: DrawWith,
    /// Bytes of drawing memory; on a GPU of all its buffers.
    pub budget_gpu_bytes: u64,
    /// Bytes of main memory.
    pub budget_ram_bytes: u64,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Whether what is hidden is left out; then the flight without is measured as well.
    pub occlusion: bool,
    /// Whether the system's cache is emptied of the file before each flight.
    pub cold: bool,
    /// Esker's settings, or the paper's.
    pub settings: Settings,
    /// Whether full planes are read where there are compact ones, too.
    pub full: bool,
    /// A folder for a picture of each view.
    pub pictures: Option<PathBuf>,
    /// Threads that draw; 0 is one a core.
    pub threads: usize,
}

/// How much is lent, cached and read at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Settings {
    /// What Esker does by itself.
    #[default]
    Own,
    /// kanzok2015, sections 3.2.3 to 3.2.5: five buffers on their way, one loader thread, the nearest
    /// node first, a cache of 2,000 nodes.
    Paper,
}

impl Settings {
    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Paper => "paper",
        }
    }

    fn options(self, request: &Request) -> Options {
        let own = Options {
            backend: request.with.backend,
            gpu: request.with.gpu,
            budget_gpu_bytes: request.budget_gpu_bytes,
            budget_ram_bytes: request.budget_ram_bytes,
            size: request.size,
            occlusion: request.occlusion,
            full: request.full,
            ..Options::default()
        };
        match self {
            Self::Own => own,
            Self::Paper => Options {
                runs: Some(5),
                loaders: 1,
                priority: Priority::Distance,
                nodes_max: 2_000,
                ..own
            },
        }
    }
}

/// What the paper calls interactive: each thread's pass within so many milliseconds (section 3.2.5).
const INTERACTIVE_MS: f64 = 100.0;

/// Measures one `.esker` file in this process; the report.
///
/// # Errors
/// Where the file or the path cannot be read, a budget is too small, or on request.
pub fn measure(path: &std::path::Path, request: &Request, task: &dyn Task) -> Result<Value> {
    let empty_rss_bytes = usage().rss_peak_bytes;
    let file = Arc::new(Forest::open(path)?);
    let way = match &request.path {
        Some(way) => Path::read(way, info::bounds(&file), request.size)?,
        None => Path::of(&file, request.size),
    };
    let mut options = request.settings.options(request);
    // What is too small is told before a driver is looked at.
    Shares::of(&file, &options)?;
    let (device, drawer) = request.with.choose(None)?;
    // One device for all sessions of the run; its driver's own memory is nobody's budget.
    if device.is_none() {
        options.backend = Backend::Cpu;
    }
    options.device = device;
    let driver_rss_bytes = usage().rss_peak_bytes.saturating_sub(empty_rss_bytes);
    let run = Run { path, file, way, options, request, task, drawer, driver_rss_bytes };
    run.chill()?;
    // Of the largest file: a small one tells nothing.
    let largest = run.file.files().max_by_key(|file| file.footer().file_bytes);
    let sequential = disk::sequential_rate(largest.map_or(path, |file| file.path()), task)?;
    let flight = run.flight(true)?;
    let without = if request.occlusion { Some(run.flight(false)?) } else { None };
    let loading = run.loading()?;
    let mut report = run.report(&flight, without.as_ref(), empty_rss_bytes);
    report["sequential_bytes_per_s"] = json!(sequential);
    report["read_bytes_per_s"] = loading["streamed_bytes_per_s"].clone();
    report["loading"] = loading;
    Ok(report)
}

struct Run<'a> {
    path: &'a std::path::Path,
    file: Arc<Forest>,
    way: Path,
    options: Options,
    request: &'a Request,
    task: &'a dyn Task,
    /// What was chosen to draw.
    drawer: Drawer,
    driver_rss_bytes: u64,
}

impl Run<'_> {
    /// Empties the system's cache of the files, where that is asked for.
    fn chill(&self) -> Result<()> {
        if self.request.cold {
            for path in self.file.files().map(|file| file.path()) {
                let context = || format!("{}: cannot drop it from the cache", path.display());
                let file = std::fs::File::open(path).with_context(context)?;
                system::forget(&file).with_context(context)?;
            }
        }
        Ok(())
    }

    /// One flight, with the options' depth test or without.
    fn flight(&self, depth_test: bool) -> Result<Flight> {
        self.chill()?;
        let occlusion = self.options.occlusion && depth_test;
        let options = Options { occlusion, ..self.options.clone() };
        let mut session = Session::open(self.file.clone(), options)?;
        let folder = self.request.pictures.as_ref().filter(|_| depth_test);
        fly(&mut session, &self.way, self.task, &mut |stop, session| match folder {
            Some(folder) => {
                let picture = session.picture()?;
                picture::write_png(&picture, &folder.join(format!("{}.png", stop.name)))
            }
            None => Ok(()),
        })
    }

    /// Loading the view in the middle of the path without drawing, against plain reads of the same
    /// ranges.
    fn loading(&self) -> Result<Value> {
        let mut ratios = Vec::new();
        let (mut streamed, mut plain, mut bytes) = (Vec::new(), Vec::new(), 0);
        let stop = self.way.views.get(self.way.views.len() / 2).or(self.way.views.first());
        let stop = stop.context("the path has no view")?;
        let runs = LOADINGS[usize::from(!self.request.cold)];
        for _ in 0..runs {
            self.task.check()?;
            let mut session = Session::open(self.file.clone(), self.options.clone())?;
            self.chill()?;
            let start = Instant::now();
            let cut = session.settle(&stop.view, Duration::from_secs(120))?;
            let seconds = start.elapsed().as_secs_f64();
            drop(session);
            let ranges = disk::ranges_of(&self.file, &cut);
            self.chill()?;
            let plain_s = disk::plain_seconds(&self.file, &ranges, IN_FLIGHT)?;
            bytes = ranges.iter().map(|r| r.end - r.start).sum::<u64>();
            streamed.push(bytes as f64 / seconds.max(1e-9));
            plain.push(bytes as f64 / plain_s.max(1e-9));
            ratios.push(plain_s / seconds.max(1e-9));
        }
        Ok(json!({
            "view": stop.name,
            "bytes": bytes,
            "runs": runs,
            "streamed_bytes_per_s": quantile(&streamed, 0.5),
            "plain_bytes_per_s": quantile(&plain, 0.5),
            "ratio": quantile(&ratios, 0.5),
            "from_cold": self.request.cold && system::CAN_FORGET,
        }))
    }

    fn report(&self, flight: &Flight, without: Option<&Flight>, empty_rss_bytes: u64) -> Value {
        let (request, forest) = (self.request, &self.file);
        let footers = || forest.files().map(|file| file.footer());
        let status = &flight.status;
        let flights = || [Some(flight), without].into_iter().flatten();
        let gpu = flight.gpu_bytes;
        let slots = flights().map(|f| f.status.drawing_bytes_peak).max().unwrap_or(0);
        let peak_gpu = gpu.map_or(slots, |gpu| gpu.peak_bytes);
        // A GPU that failed was left for the CPU.
        let drawer = if gpu.is_some() { &self.drawer } else { &flight.drawer };
        let drawer = if self.options.device.is_some() { drawer } else { &self.drawer };
        let peak_rss = usage().rss_peak_bytes;
        let budgets = request.budget_gpu_bytes
            + request.budget_ram_bytes
            + empty_rss_bytes
            + self.driver_rss_bytes;
        let exceeded =
            peak_gpu > request.budget_gpu_bytes || peak_rss as f64 > budgets as f64 * MARGIN;
        let frames = |share| quantile(&flight.frame_ms, share);
        let choices = |share| quantile(&flight.lod_ms, share);
        let mut report = json!({
            "file": self.path.display().to_string(),
            "points": forest.points(),
            "trees": forest.files().len(),
            "nodes": forest.table().nodes.len(),
            "node_capacity": footers().map(|f| f.node_capacity).max(),
            "structure_bytes": forest.table().bytes(),
            "table_bytes_a_node": forest.table().bytes_a_node(),
            "file_bytes": forest.file_bytes(),
            "backend": drawer.backend(),
            "adapter": drawer.adapter,
            "gpu_path": drawer.path_name(),
            "backend_note": drawer.note,
            "size": request.size,
            "settings": request.settings.name(),
            "depth_test": request.occlusion,
            "cold": request.cold,
            "peak_rss_bytes": peak_rss,
            "empty_rss_bytes": empty_rss_bytes,
            "driver_rss_bytes": self.driver_rss_bytes,
            "budget_ram_bytes": request.budget_ram_bytes,
            "peak_gpu_bytes": peak_gpu,
            "fixed_gpu_bytes": gpu.map(|gpu| gpu.fixed_bytes),
            "budget_gpu_bytes": request.budget_gpu_bytes,
            "budget_exceeded": exceeded,
            "render_stalls": flights().map(|f| f.stalls).sum::<u64>(),
            "frames": flight.frame_ms.len(),
            "frame_ms_p50": frames(0.5),
            "frame_ms_p99": frames(0.99),
            "frame_ms_max": frames(1.0),
            "lod_ms_p50": choices(0.5),
            "lod_ms_p99": choices(0.99),
            "lod_ms_max": choices(1.0),
        });
        let more = json!({
            "frames_within_100_ms": within(&flight.frame_ms),
            "lod_within_100_ms": within(&flight.lod_ms),
            "read_bytes": status.read_bytes,
            "useful_bytes": status.useful_bytes,
            "reads": status.reads,
            "flight_bytes_per_s": status.read_bytes as f64 / flight.loading_s.max(1e-9),
            "nodes_loaded": status.nodes_loaded,
            "nodes_evicted": status.nodes_evicted,
            "requests_dropped": status.requests_dropped,
            "nodes_failed": status.nodes_failed,
            "fault": status.fault,
            "views": views(flight, without),
            "transitions": transitions(flight),
        });
        if let (Some(report), Value::Object(more)) = (report.as_object_mut(), more) {
            report.extend(more);
        }
        report
    }
}

/// Share of the values that the paper calls interactive.
fn within(ms: &[f64]) -> f64 {
    ms.iter().filter(|&&v| v <= INTERACTIVE_MS).count() as f64 / ms.len().max(1) as f64
}

fn views(flight: &Flight, without: Option<&Flight>) -> Vec<Value> {
    let figures = |flight: &Flight, i: usize| {
        flight.views.get(i).map(|v| {
            json!({
                "name": v.name, "nodes": v.nodes, "points": v.points, "lod_ms": v.lod_ms,
                "render_ms": v.render_ms, "passes_ms": passes(&v.passes_ms), "complete_ms": v.complete_ms, "complete": v.is_complete,
                "frame_ms": v.frame_ms, "fps": 1e3 / v.frame_ms.max(1e-9),
                "nodes_occluded": v.occluded, "resident_bytes": v.resident_bytes,
            })
        })
    };
    (0..flight.views.len())
        .filter_map(|i| {
            let mut view = figures(flight, i)?;
            view["without_depth_test"] = json!(without.and_then(|w| figures(w, i)));
            Some(view)
        })
        .collect()
}

fn passes(passes: &Passes) -> Value {
    passes.iter().map(|&(name, ms)| (name.to_owned(), json!(ms))).collect()
}

fn transitions(flight: &Flight) -> Vec<Value> {
    let figures = flight.transitions.iter().map(|t| {
        let frames = |share| quantile(&t.frame_ms, share);
        json!({
            "to": t.to, "frames": t.frame_ms.len(), "points": t.points, "read_bytes": t.read_bytes,
            "frame_ms_p50": frames(0.5), "frame_ms_p99": frames(0.99), "frame_ms_max": frames(1.0),
        })
    });
    figures.collect()
}
