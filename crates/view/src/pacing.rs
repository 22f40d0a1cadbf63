//! The model of the machine ([`Pace`]), which predicts the frames of moving pictures: read from the
//! user's cache, or measured on a thread while the picture rests. Input stops a measurement, which
//! begins again at the next rest.

use eframe::egui::Context;
use esker_engine::Task;
use esker_engine::draw::calibration;
use esker_engine::draw::pace::Pace;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;

/// Seconds for which the picture rests before a measurement begins.
const REST_S: f64 = 2.0;

/// Where the model is.
pub struct Pacing {
    state: State,
    /// Since when the picture has been at rest.
    rests_since: Option<f64>,
}

enum State {
    /// Not known: it was never measured on this machine.
    Unknown,
    Measuring(Measuring),
    /// Known, or not wanted: a GPU draws, or a measurement has failed.
    Settled,
}

/// A measurement. Dropping it stops it and waits for its thread, which removes its files.
struct Measuring {
    stop: Arc<Stop>,
    thread: Option<JoinHandle<anyhow::Result<Pace>>>,
}

#[derive(Default)]
struct Stop(AtomicBool);

impl Task for Stop {
    fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }
}

impl Pacing {
    /// Begins without a model, and gives the one that is kept, if there is one.
    pub fn new() -> (Self, Option<Pace>) {
        let kept = calibration::kept();
        let state = if kept.is_some() { State::Settled } else { State::Unknown };
        (Self { state, rests_since: None }, kept)
    }

    /// Begins or stops a measurement, and gives the model once it is known. `is_at_rest` tells
    /// whether the picture is complete and nothing moves; `is_by_cpu` whether the CPU draws it,
    /// whose frames alone the model predicts.
    pub fn update(
        &mut self,
        ctx: &Context,
        now_s: f64,
        is_at_rest: bool,
        is_by_cpu: bool,
    ) -> Option<Pace> {
        self.rests_since = if is_at_rest { self.rests_since.or(Some(now_s)) } else { None };
        match &mut self.state {
            State::Settled => None,
            State::Unknown => {
                let left_s = self.rests_since.map(|since| since + REST_S - now_s)?;
                if !is_by_cpu {
                    return None;
                }
                if left_s > 0.0 {
                    ctx.request_repaint_after_secs(left_s as f32);
                } else {
                    self.state = Measuring::start(ctx).map_or(State::Settled, State::Measuring);
                }
                None
            }
            State::Measuring(measuring) => {
                if !is_at_rest {
                    measuring.stop.0.store(true, Relaxed);
                }
                let measured = measuring.take_result()?;
                let is_stopped = measured.is_none() && measuring.stop.is_cancelled();
                self.state = if is_stopped { State::Unknown } else { State::Settled };
                measured
            }
        }
    }
}

impl Measuring {
    /// Starts to measure; `None` without a thread.
    fn start(ctx: &Context) -> Option<Self> {
        let stop = Arc::new(Stop::default());
        let (task, ctx) = (Arc::clone(&stop), ctx.clone());
        let work = move || {
            let pace = calibration::pace(&*task);
            ctx.request_repaint();
            pace
        };
        let thread = std::thread::Builder::new().name("esker-pace".into()).spawn(work).ok()?;
        Some(Self { stop, thread: Some(thread) })
    }

    /// The model, or `None` in it if measuring has failed, once the thread has ended.
    fn take_result(&mut self) -> Option<Option<Pace>> {
        let thread = self.thread.take_if(|thread| thread.is_finished())?;
        Some(thread.join().ok().and_then(Result::ok))
    }
}

impl Drop for Measuring {
    fn drop(&mut self) {
        self.stop.0.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic was already reported by the thread.
            let _ = thread.join();
        }
    }
}
