//! One run of the benchmark of streaming: an `.esker` file flown along a path with and without the
//! depth test, beside plain reads of the same file. Peaks of memory are those of the whole process,
//! so each run has a process of its own (`process`).

use crate::quantile::quantile;
use crate::stream::disk;
use crate::stream::flight::{Flight, Transition, fly};
use crate::stream::line::LineReport;
use crate::stream::report::{LoadingReport, StreamRun, TransitionReport, ViewReport};
use crate::stream::request::FlightRequest;
use anyhow::{Context, Result};
use esker_builder::budget::memory::usage;
use esker_engine::cameras::path::Path;
use esker_engine::draw::budget::Shares;
use esker_engine::draw::session::{Options, Session};
use esker_engine::io::file::open_copc;
use esker_engine::io::picture;
use esker_engine::machine::backend::{Backend, Drawer};
use esker_engine::machine::system;
use esker_format::Forest;
use esker_points::Task;
use esker_points::read_at::is_remote;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Loadings of a view whose median is reported: with an emptied cache, and without.
const LOADINGS: [usize; 2] = [10, 3];
/// Time after which loading a view is given up.
const SETTLE_PATIENCE: Duration = Duration::from_secs(120);
/// Plain reads in flight.
const IN_FLIGHT: usize = 8;
/// Factor by which the resident set may exceed the budgets and the empty program.
const MARGIN: f64 = 1.05;
/// Time of each thread's pass that counts as interactive (`kanzok2015`, section 3.2.5).
const INTERACTIVE_MS: f64 = 100.0;

/// Measures one `.esker` file in this process, whose `line` was measured before.
///
/// # Errors
/// If the file or the path cannot be read, a budget is too small, or `task` is cancelled.
pub(super) fn measure(
    file_path: &std::path::Path,
    request: &FlightRequest,
    line: Option<LineReport>,
    task: &dyn Task,
) -> Result<StreamRun> {
    let empty_rss_bytes = usage().rss_peak_bytes;
    let forest = match open_copc(file_path, &esker_builder::Options::default())? {
        Some(forest) => forest,
        None => Forest::open_in_parts(file_path)?,
    };
    let file = Arc::new(forest);
    let path = match &request.path {
        Some(path) => Path::read(path, &file, request.size)?,
        None => Path::of(&file, request.size),
    };
    let mut options = request.options();
    // Budgets that are too small are refused before a driver is loaded.
    Shares::of(&file, &options)?;
    let (device, drawer) = request.with.choose(None)?;
    // All sessions of the run share one device; its driver's own memory is in no budget.
    if device.is_none() {
        options.backend = Backend::Cpu;
    }
    options.device = device;
    let driver_rss_bytes = usage().rss_peak_bytes.saturating_sub(empty_rss_bytes);
    let run = Run {
        file_path,
        file,
        path,
        options,
        request,
        task,
        drawer,
        empty_rss_bytes,
        driver_rss_bytes,
    };
    run.empty_cache()?;
    // The largest file is read: the rate of a small one depends on the cache.
    let largest = run.file.files().max_by_key(|file| file.footer().file_bytes);
    let sequential = disk::sequential_rate(largest.map_or(file_path, |file| file.path()), task)?;
    let flight = run.flight(true)?;
    let without = if request.occlusion { Some(run.flight(false)?) } else { None };
    let loading = run.loading()?;
    Ok(StreamRun { line, ..run.report(&flight, without.as_ref(), sequential, loading) })
}

/// A file that is open, and how it is flown through.
struct Run<'a> {
    file_path: &'a std::path::Path,
    file: Arc<Forest>,
    /// The camera's path.
    path: Path,
    options: Options,
    request: &'a FlightRequest,
    task: &'a dyn Task,
    /// What was chosen to draw.
    drawer: Drawer,
    /// Resident set before the file was opened.
    empty_rss_bytes: u64,
    /// Growth of the resident set by opening the device.
    driver_rss_bytes: u64,
}

impl Run<'_> {
    /// Removes the files from the system's cache if the request is for cold runs.
    fn empty_cache(&self) -> Result<()> {
        if self.request.cold {
            let files = self.file.files().map(|file| file.path());
            for path in files.filter(|path| !is_remote(path)) {
                let context = || format!("{}: cannot drop it from the cache", path.display());
                let file = std::fs::File::open(path).with_context(context)?;
                system::forget(&file).with_context(context)?;
            }
        }
        Ok(())
    }

    /// Flies along the path, with the depth test if both the options and `depth_test` have it.
    fn flight(&self, depth_test: bool) -> Result<Flight> {
        self.empty_cache()?;
        let occlusion = self.options.settings.occlusion && depth_test;
        let mut options = self.options.clone();
        options.settings.occlusion = occlusion;
        let mut session = Session::open(self.file.clone(), options)?;
        let folder = self.request.pictures.as_ref().filter(|_| depth_test);
        fly(&mut session, &self.path, self.task, &mut |stop, session| match folder {
            Some(folder) => {
                let picture = session.picture()?;
                picture::write_png(&picture, &folder.join(format!("{}.png", stop.name)))
            }
            None => Ok(()),
        })
    }

    /// Loads the view in the middle of the path without drawing, and reads the same ranges plainly.
    fn loading(&self) -> Result<LoadingReport> {
        let mut ratios = Vec::new();
        let (mut streamed, mut plain, mut bytes) = (Vec::new(), Vec::new(), 0);
        let stop = self.path.views.get(self.path.views.len() / 2).or(self.path.views.first());
        let stop = stop.context("the path has no view")?;
        let runs = LOADINGS[usize::from(!self.request.cold)];
        for _ in 0..runs {
            self.task.check()?;
            let mut session = Session::open(self.file.clone(), self.options.clone())?;
            self.empty_cache()?;
            let start = Instant::now();
            let cut = session.settle(&stop.view, SETTLE_PATIENCE)?;
            let seconds = start.elapsed().as_secs_f64();
            drop(session);
            let ranges = disk::ranges_of(&self.file, &cut);
            self.empty_cache()?;
            let plain_s = disk::plain_seconds(&self.file, &ranges, IN_FLIGHT)?;
            bytes = ranges.iter().map(|r| r.end - r.start).sum::<u64>();
            streamed.push(bytes as f64 / seconds.max(1e-9));
            plain.push(bytes as f64 / plain_s.max(1e-9));
            ratios.push(plain_s / seconds.max(1e-9));
        }
        Ok(LoadingReport {
            view: stop.name.clone(),
            bytes,
            runs,
            streamed_bytes_per_s: quantile(&streamed, 0.5),
            plain_bytes_per_s: quantile(&plain, 0.5),
            ratio: quantile(&ratios, 0.5),
            from_cold: self.request.cold && system::CAN_FORGET,
        })
    }

    fn report(
        &self,
        flight: &Flight,
        without: Option<&Flight>,
        sequential_bytes_per_s: f64,
        loading: LoadingReport,
    ) -> StreamRun {
        let (request, forest, status) = (self.request, &self.file, &flight.status);
        let node_capacity = forest.files().map(|file| file.footer().node_capacity).max();
        let flights = || [Some(flight), without].into_iter().flatten();
        let gpu = flight.gpu_bytes;
        let slots = flights().map(|f| f.status.drawing_bytes_peak).max().unwrap_or(0);
        let peak_gpu_bytes = gpu.map_or(slots, |gpu| gpu.peak_bytes);
        let peak_rss_bytes = usage().rss_peak_bytes;
        let drawer = self.drawer_of(flight);
        let [frame_ms_p50, frame_ms_p99, frame_ms_max] = summary(&flight.frame_ms);
        let [lod_ms_p50, lod_ms_p99, lod_ms_max] = summary(&flight.lod_ms);
        StreamRun {
            file: self.file_path.display().to_string(),
            points: forest.points(),
            trees: forest.files().len(),
            nodes: forest.nodes() as usize,
            node_capacity: node_capacity.unwrap_or(0),
            structure_bytes: forest.table().bytes() as u64,
            table_bytes_a_node: forest.table().bytes_a_node(),
            file_bytes: forest.file_bytes(),
            backend: drawer.backend().into(),
            adapter: drawer.adapter.clone(),
            gpu_path: drawer.path_name().into(),
            backend_note: drawer.note.clone(),
            size: request.size,
            settings: request.settings,
            depth_test: request.occlusion,
            cold: request.cold,
            peak_rss_bytes,
            empty_rss_bytes: self.empty_rss_bytes,
            driver_rss_bytes: self.driver_rss_bytes,
            budget_ram_bytes: request.budget_ram_bytes,
            peak_gpu_bytes,
            fixed_gpu_bytes: gpu.map(|gpu| gpu.fixed_bytes),
            budget_gpu_bytes: request.budget_gpu_bytes,
            budget_exceeded: self.exceeds(peak_gpu_bytes, peak_rss_bytes),
            render_stalls: flights().map(|f| f.stalls).sum(),
            frames: flight.frame_ms.len(),
            frame_ms_p50,
            frame_ms_p99,
            frame_ms_max,
            lod_ms_p50,
            lod_ms_p99,
            lod_ms_max,
            frames_within_100_ms: interactive_share(&flight.frame_ms),
            lod_within_100_ms: interactive_share(&flight.lod_ms),
            read_bytes: status.read_bytes,
            useful_bytes: status.useful_bytes,
            reads: status.reads,
            flight_bytes_per_s: status.read_bytes as f64 / flight.loading_s.max(1e-9),
            nodes_loaded: status.nodes_loaded,
            nodes_evicted: status.nodes_evicted,
            requests_dropped: status.requests_dropped,
            nodes_failed: status.nodes_failed,
            fault: status.fault.clone(),
            views: views(flight, without),
            transitions: flight.transitions.iter().map(transition).collect(),
            sequential_bytes_per_s,
            read_bytes_per_s: loading.streamed_bytes_per_s,
            loading,
            line: None,
        }
    }

    /// What drew `flight`: a session whose GPU failed continued on the CPU.
    fn drawer_of<'a>(&'a self, flight: &'a Flight) -> &'a Drawer {
        let left_gpu = self.options.device.is_some() && flight.gpu_bytes.is_none();
        if left_gpu { &flight.drawer } else { &self.drawer }
    }

    /// Whether peaks of memory exceed the budgets; that of the process may by up to [`MARGIN`].
    fn exceeds(&self, peak_gpu_bytes: u64, peak_rss_bytes: u64) -> bool {
        let request = self.request;
        let budgets = request.budget_gpu_bytes
            + request.budget_ram_bytes
            + self.empty_rss_bytes
            + self.driver_rss_bytes;
        peak_gpu_bytes > request.budget_gpu_bytes || peak_rss_bytes as f64 > budgets as f64 * MARGIN
    }
}

/// Median, 99 % quantile and greatest of some times, milliseconds.
fn summary(ms: &[f64]) -> [f64; 3] {
    [0.5, 0.99, 1.0].map(|share| quantile(ms, share))
}

/// Share of times that count as interactive.
fn interactive_share(ms: &[f64]) -> f64 {
    ms.iter().filter(|&&v| v <= INTERACTIVE_MS).count() as f64 / ms.len().max(1) as f64
}

fn views(flight: &Flight, without: Option<&Flight>) -> Vec<ViewReport> {
    let without = |i| without.and_then(|flight| flight.views.get(i).cloned());
    let views = flight.views.iter().enumerate();
    views
        .map(|(i, figures)| ViewReport { figures: figures.clone(), without_depth_test: without(i) })
        .collect()
}

fn transition(transition: &Transition) -> TransitionReport {
    let [frame_ms_p50, frame_ms_p99, frame_ms_max] = summary(&transition.frame_ms);
    TransitionReport {
        to: transition.to.clone(),
        frames: transition.frame_ms.len(),
        points: transition.points,
        read_bytes: transition.read_bytes,
        frame_ms_p50,
        frame_ms_p99,
        frame_ms_max,
    }
}
