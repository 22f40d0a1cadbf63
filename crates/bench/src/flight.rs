//! Flies a session along a path, frame by frame, and notes what each frame did: for each view until it is
//! complete and then for as long as the path stays there; for each transition on the way.

use anyhow::Result;
use esker_engine::cameras::path::{Path, Stop};
use esker_engine::draw::session::{Frame, GpuBytes, Session};
use esker_engine::machine::backend::Drawer;
use esker_points::Task;
use esker_render::{Pass, Stages};
use esker_stream::Status;
use std::time::{Duration, Instant};

/// How long a view may take until nothing more comes.
const COMPLETE_PATIENCE: Duration = Duration::from_secs(120);
/// Frames timed of a view at least.
const FRAMES_MIN: usize = 5;

/// What a flight did.
#[derive(Clone, Debug, Default)]
pub struct Flight {
    /// Of each view of the path.
    pub views: Vec<ViewFigures>,
    /// Of the way to each view but the first.
    pub transitions: Vec<TransitionFigures>,
    /// Milliseconds of every frame.
    pub frame_ms: Vec<f64>,
    /// Milliseconds of every choice that was drawn.
    pub lod_ms: Vec<f64>,
    /// Seconds in which anything was on its way from the disk.
    pub loading_s: f64,
    /// What streaming was at in the end.
    pub status: Status,
    /// Waits of the render thread.
    pub stalls: u64,
    /// What drew in the end.
    pub drawer: Drawer,
    /// Bytes of GPU buffers in the end.
    pub gpu_bytes: Option<GpuBytes>,
}

/// A view of the path, figures as in table 3 of kanzok2015.
#[derive(Clone, Debug, Default)]
pub struct ViewFigures {
    /// Its name.
    pub name: String,
    /// Nodes drawn once it was complete.
    pub nodes: u64,
    /// Points drawn once it was complete.
    pub points: u64,
    /// Median of the choices' times, milliseconds.
    pub lod_ms: f64,
    /// Median of drawing, milliseconds.
    pub render_ms: f64,
    /// Median of each pass, milliseconds: by the GPU's own clock, where it draws.
    pub passes_ms: Passes,
    /// Median of whole frames, milliseconds.
    pub frame_ms: f64,
    /// From arriving at it until all that it wants was drawn.
    pub complete_ms: f64,
    /// Whether that was reached.
    pub is_complete: bool,
    /// Nodes that were hidden, with their subtrees or by themselves.
    pub occluded: u64,
    /// Bytes of drawing memory in slots.
    pub resident_bytes: u64,
}

/// The way to a view.
#[derive(Clone, Debug, Default)]
pub struct TransitionFigures {
    /// The view that it leads to.
    pub to: String,
    /// Milliseconds of its frames.
    pub frame_ms: Vec<f64>,
    /// Bytes read on it.
    pub read_bytes: u64,
    /// Points of its frames, on average.
    pub points: f64,
}

/// Flies; `seen` is called for each view once it is complete and drawn.
///
/// # Errors
/// Where a frame cannot be drawn, on request, and those of `seen`.
pub fn fly(
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
    fn travel(
        &mut self,
        session: &mut Session,
        path: &Path,
        to: usize,
        task: &dyn Task,
    ) -> Result<TransitionFigures> {
        let stop = &path.views[to];
        let mut figures = TransitionFigures { to: stop.name.clone(), ..Default::default() };
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
            self.note(&frame);
            points += frame.stats.points_drawn;
            figures.frame_ms.push(frame.times.total_ms);
        }
        figures.points = points as f64 / figures.frame_ms.len().max(1) as f64;
        figures.read_bytes = session.status().read_bytes - read_before;
        Ok(figures)
    }

    fn stay(&mut self, session: &mut Session, stop: &Stop, task: &dyn Task) -> Result<ViewFigures> {
        let mut figures = ViewFigures { name: stop.name.clone(), ..Default::default() };
        let mut lod_ms = Vec::new();
        let mut epoch = 0;
        let mut choice = |frame: &Frame<'_>| {
            if frame.cut.epoch != epoch && frame.is_of_view {
                epoch = frame.cut.epoch;
                lod_ms.push(frame.cut.lod_ms);
            }
        };
        let arrived = Instant::now();
        while arrived.elapsed() < COMPLETE_PATIENCE && !figures.is_complete {
            task.check()?;
            let frame = session.frame(&stop.view)?;
            self.note(&frame);
            choice(&frame);
            figures.is_complete = frame.cut.settled && frame.is_of_view;
        }
        figures.complete_ms = arrived.elapsed().as_secs_f64() * 1e3;
        let (mut stages, mut frame_ms) = (Vec::new(), Vec::new());
        let complete = Instant::now();
        while frame_ms.len() < FRAMES_MIN || complete.elapsed().as_secs_f64() < stop.stay_s {
            task.check()?;
            let frame = session.frame(&stop.view)?;
            self.note(&frame);
            choice(&frame);
            stages.push(frame.stats.stages);
            frame_ms.push(frame.times.total_ms);
            let counters = &frame.cut.counters;
            figures.nodes = frame.cut.nodes.len() as u64;
            figures.points = frame.stats.points_drawn;
            figures.occluded = counters.occluded + counters.contour_occluded;
            figures.resident_bytes = frame.status.drawing_bytes;
        }
        figures.lod_ms = quantile(&lod_ms, 0.5);
        figures.passes_ms = passes(&stages);
        figures.render_ms = figures.passes_ms.last().map_or(0.0, |p| p.1);
        figures.frame_ms = quantile(&frame_ms, 0.5);
        Ok(figures)
    }

    fn note(&mut self, frame: &Frame<'_>) {
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

/// Names of passes and their times, milliseconds; all of them together last.
pub type Passes = Vec<(&'static str, f64)>;

/// Medians of each pass.
fn passes(stages: &[Stages]) -> Passes {
    let median =
        |time: &dyn Fn(&Stages) -> f64| quantile(&stages.iter().map(time).collect::<Vec<_>>(), 0.5);
    let passes = Pass::ALL.iter().map(|&pass| (pass.name(), median(&|s| s.ms(pass))));
    passes.chain([("all", median(&|s| s.total_ms))]).collect()
}

/// The value that a share, 0 to 1, of the values does not pass; 0 of none.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|s| quantile(&values, s)), [1.0, 50.0, 99.0, 100.0]);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
