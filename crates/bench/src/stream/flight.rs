//! Flies a session along a path, frame by frame, and records what each frame did: at each view
//! until it is complete and then for as long as the path stays there; and on the way to each view.

use crate::pass_times;
use crate::quantile::quantile;
use crate::stream::report::ViewFigures;
use anyhow::Result;
use esker_engine::cameras::path::{Path, Stop};
use esker_engine::draw::session::{DrawnFrame, GpuBytes, Session};
use esker_engine::machine::backend::Drawer;
use esker_points::Task;
use esker_stream::Status;
use std::time::{Duration, Instant};

/// Time after which a view that is not complete is given up.
const COMPLETE_PATIENCE: Duration = Duration::from_secs(120);
/// Frames of a view that are timed at least.
const FRAMES_MIN: usize = 5;

/// Record of a flight.
#[derive(Clone, Debug, Default)]
pub(super) struct Flight {
    /// Figures of each view of the path.
    pub views: Vec<ViewFigures>,
    /// The way to each view but the first.
    pub transitions: Vec<Transition>,
    /// Times of all frames, milliseconds.
    pub frame_ms: Vec<f64>,
    /// Times of the choices of all frames, milliseconds.
    pub lod_ms: Vec<f64>,
    /// Seconds in which requests were waiting or in flight.
    pub loading_s: f64,
    /// Counters of streaming at the end.
    pub status: Status,
    /// Waits of the render thread.
    pub stalls: u64,
    /// What drew at the end.
    pub drawer: Drawer,
    /// Bytes of GPU buffers at the end.
    pub gpu_bytes: Option<GpuBytes>,
}

/// Record of the way to a view.
#[derive(Clone, Debug, Default)]
pub(super) struct Transition {
    /// Name of the view that it leads to.
    pub to: String,
    /// Times of its frames, milliseconds.
    pub frame_ms: Vec<f64>,
    /// Bytes read on the way.
    pub read_bytes: u64,
    /// Points of a frame, on average.
    pub points: f64,
}

/// Flies `session` along `path`; calls `seen` for each view once it is complete and drawn.
///
/// # Errors
/// If a frame cannot be drawn, `seen` fails, or `task` is cancelled.
pub(super) fn fly(
    session: &mut Session,
    path: &Path,
    task: &dyn Task,
    seen: &mut dyn FnMut(&Stop, &mut Session) -> Result<()>,
) -> Result<Flight> {
    let mut flight = Flight::default();
    for (i, stop) in path.views.iter().enumerate() {
        if i > 0 {
            let transition = flight.travel(session, path, i, task)?;
            flight.transitions.push(transition);
        }
        let figures = flight.stay(session, stop, task)?;
        session.frame(&stop.view)?;
        seen(stop, session)?;
        flight.views.push(figures);
    }
    flight.status = session.status();
    flight.stalls = session.stalls();
    flight.drawer = session.drawer().clone();
    flight.gpu_bytes = session.gpu_bytes();
    Ok(flight)
}

impl Flight {
    /// Draws the frames of the way to view `to`.
    fn travel(
        &mut self,
        session: &mut Session,
        path: &Path,
        to: usize,
        task: &dyn Task,
    ) -> Result<Transition> {
        let stop = &path.views[to];
        let mut figures = Transition { to: stop.name.clone(), ..Default::default() };
        let read_before = session.status().read_bytes;
        let start = Instant::now();
        let mut points = 0;
        loop {
            task.check()?;
            let share = start.elapsed().as_secs_f64() / stop.travel_s.max(1e-9);
            if share >= 1.0 {
                break;
            }
            let frame = session.frame(&path.between(to, share))?;
            self.record(&frame);
            points += frame.stats.points_drawn;
            figures.frame_ms.push(frame.times.total_ms);
        }
        figures.points = points as f64 / figures.frame_ms.len().max(1) as f64;
        figures.read_bytes = session.status().read_bytes - read_before;
        Ok(figures)
    }

    /// Draws frames of a view until it is complete, then for as long as the path stays there.
    fn stay(&mut self, session: &mut Session, stop: &Stop, task: &dyn Task) -> Result<ViewFigures> {
        let mut figures = ViewFigures { name: stop.name.clone(), ..Default::default() };
        let mut lod_ms = Vec::new();
        let mut epoch = 0;
        let mut record_choice = |frame: &DrawnFrame<'_>| {
            if frame.cut.epoch != epoch && frame.is_of_view {
                epoch = frame.cut.epoch;
                lod_ms.push(frame.cut.lod_ms);
            }
        };
        let arrived = Instant::now();
        while arrived.elapsed() < COMPLETE_PATIENCE && !figures.is_complete {
            task.check()?;
            let frame = session.frame(&stop.view)?;
            self.record(&frame);
            record_choice(&frame);
            figures.is_complete = frame.cut.settled && frame.is_of_view;
        }
        figures.complete_ms = arrived.elapsed().as_secs_f64() * 1e3;
        let (mut stages, mut frame_ms) = (Vec::new(), Vec::new());
        let complete = Instant::now();
        while frame_ms.len() < FRAMES_MIN || complete.elapsed().as_secs_f64() < stop.stay_s {
            task.check()?;
            let frame = session.frame(&stop.view)?;
            self.record(&frame);
            record_choice(&frame);
            stages.push(frame.stats.stages);
            frame_ms.push(frame.times.total_ms);
            let counters = &frame.cut.counters;
            figures.nodes = frame.cut.nodes.len() as u64;
            figures.points = frame.stats.points_drawn;
            figures.nodes_occluded = counters.occluded + counters.contour_occluded;
            figures.resident_bytes = frame.status.drawing_bytes;
        }
        figures.lod_ms = quantile(&lod_ms, 0.5);
        figures.passes_ms = pass_times::of_frames(&stages, |ms| quantile(ms, 0.5));
        figures.render_ms = figures.passes_ms.total_ms;
        figures.frame_ms = quantile(&frame_ms, 0.5);
        figures.fps = 1e3 / figures.frame_ms.max(1e-9);
        Ok(figures)
    }

    /// Adds a frame's times to the flight's.
    fn record(&mut self, frame: &DrawnFrame<'_>) {
        let ms = frame.times.total_ms;
        self.frame_ms.push(ms);
        self.lod_ms.push(frame.cut.lod_ms);
        let status = &frame.status;
        let is_loading = status.requests_waiting + status.requests_in_flight > 0;
        if is_loading || frame.uploaded_bytes > 0 {
            self.loading_s += ms / 1e3;
        }
    }
}
