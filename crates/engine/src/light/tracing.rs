//! Traces a lit still, on the CPU or on a GPU: the splats of the picture go in, linear light with
//! counts and times comes out. A GPU draws what its kernels can; the CPU draws the rest.

use crate::io::quantity::grouped;
use crate::light::document::Lights;
use crate::light::options::MESHES_REFUSED;
use crate::light::scene::{GatheredSplats, Meshes};
use anyhow::Result;
use esker_points::{Cancelled, Task};
use esker_render::gpu::{Gpu, GpuError};
use esker_trace::gpu::{GpuLightError, GpuTracer, SPLATS_MAX, SceneKernels};
use esker_trace::{Camera, LitImage, Options, PreparedLights, Scene, Stats, Tracer};
use std::time::Instant;

/// Linear light of a picture, and what tracing it took.
pub(crate) struct Traced {
    pub(crate) image: LitImage,
    pub(crate) counts: Stats,
    /// Splats that no ray can meet.
    pub(crate) dropped: usize,
    pub(crate) scene_bytes: u64,
    /// Building the tree, tracing, filtering; milliseconds.
    pub(crate) times_ms: [f64; 3],
}

/// What is traced.
pub(crate) struct Job<'a> {
    pub(crate) splats: &'a GatheredSplats,
    pub(crate) meshes: &'a Meshes,
    pub(crate) lights: &'a Lights,
    pub(crate) camera: Camera,
    pub(crate) options: Options,
    pub(crate) samples: u32,
}

/// Why a GPU has not traced a picture.
pub(crate) enum GpuRefusal {
    /// The user wants to stop.
    Cancelled(Cancelled),
    /// The reason, for the user.
    Because(String),
}

impl From<GpuLightError> for GpuRefusal {
    fn from(fault: GpuLightError) -> Self {
        Self::Because(fault.to_string())
    }
}

impl From<GpuError> for GpuRefusal {
    fn from(fault: GpuError) -> Self {
        Self::Because(fault.to_string())
    }
}

impl Job<'_> {
    /// Traces on the CPU.
    ///
    /// # Errors
    /// If `task` is cancelled.
    pub(crate) fn on_cpu(&self, task: &dyn Task) -> Result<Traced> {
        let start = Instant::now();
        let objects = self.meshes.objects(self.splats.origin);
        let scene = Scene::new(self.splats.input()).with_objects(objects);
        let build_ms = ms(start);
        let (lights, pixels) = (self.prepared(), self.camera.pixels() as u64);
        let mut tracer = Tracer::new(self.options.clone());
        self.begin(task);
        let start = Instant::now();
        for _ in 0..self.samples {
            tracer.trace(&scene, 1, &lights, &self.camera, 1, &|| task.is_cancelled());
            task.check()?;
            task.advance(pixels);
        }
        let trace_ms = ms(start);
        let start = Instant::now();
        let image = tracer.resolve();
        Ok(Traced {
            image,
            counts: tracer.stats(),
            dropped: scene.dropped(),
            scene_bytes: scene.bytes() as u64,
            times_ms: [build_ms, trace_ms, ms(start)],
        })
    }

    /// Traces on a GPU.
    ///
    /// # Errors
    /// If the GPU does not draw such pictures, fails, or `task` is cancelled.
    pub(crate) fn on_gpu(&self, gpu: &Gpu, task: &dyn Task) -> Result<Traced, GpuRefusal> {
        if self.meshes.triangles() > 0 {
            return Err(GpuRefusal::Because(MESHES_REFUSED.into()));
        }
        let start = Instant::now();
        let scene = SceneKernels::new(gpu)?.scene(gpu, &self.splats.input())?;
        if scene.left_out() > 0 {
            let most = grouped(SPLATS_MAX as u64);
            return Err(GpuRefusal::Because(format!("a GPU lights at most {most} splats")));
        }
        let build_ms = ms(start);
        let (lights, pixels) = (self.prepared(), self.camera.pixels() as u64);
        let mut tracer = GpuTracer::new(gpu, self.options.clone())?;
        self.begin(task);
        let start = Instant::now();
        for _ in 0..self.samples {
            let should_stop = || task.is_cancelled();
            tracer.trace(gpu, &scene, 1, &lights, &self.camera, 1, &should_stop)?;
            task.check().map_err(GpuRefusal::Cancelled)?;
            task.advance(pixels);
        }
        let trace_ms = ms(start);
        let start = Instant::now();
        let image = tracer.resolve(gpu)?;
        Ok(Traced {
            image,
            counts: tracer.stats(gpu)?,
            dropped: self.splats.splats.len() - scene.splats(),
            scene_bytes: scene.bytes(),
            times_ms: [build_ms, trace_ms, ms(start)],
        })
    }

    /// Lights relative to the origin of the splats.
    fn prepared(&self) -> PreparedLights {
        esker_trace::Lights::from(self.lights.lights.clone()).prepare(self.splats.origin)
    }

    fn begin(&self, task: &dyn Task) {
        let rays = self.camera.pixels() as u64 * u64::from(self.samples);
        task.phase("tracing", Some(rays), "rays");
    }
}

/// Milliseconds since `start`.
pub(crate) fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
