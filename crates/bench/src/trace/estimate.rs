//! Traces a scene and keeps what is measured: unfiltered incident indirect light, guides, the lit
//! picture, rays and times.

use super::scene::TraceScene;
use anyhow::{Result, ensure};
use esker_points::Task;
use esker_trace::filter::{FilterKind, Guides, Settings};
use esker_trace::{Gloss, Image, LitImage, Options, Sequence, Stats, Tracer};
use std::time::Instant;

/// What to trace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Effort {
    pub bounces: u32,
    pub samples: u32,
    pub sequence: Sequence,
    pub seed: u64,
    pub gloss: Option<Gloss>,
}

impl Effort {
    /// Options of the tracer without a filter. The figures compare single pictures, so nothing of
    /// earlier ones is used again.
    pub fn options(&self) -> Options {
        Options {
            bounces: self.bounces,
            sequence: self.sequence,
            seed: self.seed,
            gloss: self.gloss,
            filter: Settings::of(FilterKind::None),
            converges: false,
            reprojects: false,
            ..Options::default()
        }
    }
}

/// A traced picture.
pub(super) struct Estimate {
    pub incident: Image<3>,
    pub guides: Guides,
    pub stats: Stats,
    pub trace_ms: f64,
    /// Samples of a pixel.
    pub samples: u32,
    tracer: Tracer,
}

impl Estimate {
    /// Traces a picture.
    ///
    /// # Errors
    /// If `task` is cancelled, or the tracer makes a picture of another size.
    pub fn new(scene: &TraceScene, effort: Effort, task: &dyn Task) -> Result<Self> {
        let mut tracer = Tracer::new(effort.options());
        let start = Instant::now();
        let TraceScene { scene, lights, camera, .. } = scene;
        let stop = || task.is_cancelled();
        tracer.trace(scene, 0, lights, camera, effort.samples, &stop);
        let trace_ms = start.elapsed().as_secs_f64() * 1e3;
        task.check()?;
        let (incident, guides) = (tracer.incident(), tracer.guides());
        ensure!(
            incident.len() == camera.pixels() && guides.len() == camera.pixels(),
            "the tracer made a picture of another size than the camera's"
        );
        Ok(Self {
            incident,
            guides,
            stats: tracer.stats(),
            trace_ms,
            samples: effort.samples,
            tracer,
        })
    }

    /// The lit picture under a filter, and the milliseconds that it takes from the samples to the
    /// picture.
    pub fn lit(&mut self, filter: Settings) -> (LitImage, f64) {
        let options = Options { filter, ..self.tracer.options().clone() };
        self.tracer.set_options(options);
        let start = Instant::now();
        let picture = self.tracer.resolve();
        (picture, start.elapsed().as_secs_f64() * 1e3)
    }
}
