//! What traces the frames of a session: the CPU, whose scenes are copies of the points in main
//! memory, or a GPU, whose scenes are copies of the points in its own memory. Both read planes only
//! while a scene is built.

use crate::light::document::Lights;
use crate::light::refining::Refining;
use crate::light::scene::{LitScene, Meshes, albedo};
use anyhow::Result;
use esker_render::Frame;
use esker_render::gpu::{Gpu, NodePool, PlaneAt};
use esker_trace::gpu::{GpuScene, GpuTracer, SceneCollector, Unsupported};
use esker_trace::{Camera, LitImage, Options, PreparedLights, Tracer};
use glam::DVec3;

/// Which picture samples are of.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quality {
    /// The picture of one sample that is shown while something moves.
    Coarse,
    /// The picture that is refined at rest.
    Fine,
}

/// Splats and bytes of a scene and of the samples of its pictures.
#[derive(Clone, Copy, Default)]
pub(crate) struct Held {
    /// Splats of the frame, those that no ray can meet among them.
    pub(crate) splats: usize,
    /// Splats that no ray can meet.
    pub(crate) dropped: usize,
    pub(crate) bytes: usize,
}

/// Builds scenes and traces pictures of them.
pub(crate) trait SceneTracer {
    /// A plane of a node.
    type Plane<'a>;
    /// What a scene is built of beside the frame: the pages that planes lie in, or the classes of
    /// the points of each draw, where lights choose points by them.
    type Memory<'a>: ?Sized;

    /// Changes the options of the pictures and the lights.
    ///
    /// # Errors
    /// If a GPU does not draw such lights.
    fn set_options(&mut self, options: &Options, lights: &Lights) -> Result<()>;

    /// Forgets all samples.
    fn clear(&mut self);

    /// Replaces the scene by that of a frame, relative to `origin`.
    ///
    /// # Errors
    /// If a GPU fails.
    fn build(
        &mut self,
        frame: &Frame<'_, Self::Plane<'_>>,
        memory: &Self::Memory<'_>,
        lights: &Lights,
        origin: DVec3,
    ) -> Result<()>;

    /// Replaces the tree of scene `number` by one that rays pass faster, once it is made; never
    /// waits. `is_at_rest`: whether to make one, if its memory is within `splats_max` splats.
    fn poll_refined(&mut self, number: u64, splats_max: u64, is_at_rest: bool) {
        let _ = (number, splats_max, is_at_rest);
    }

    /// Adds a sample to all pixels of a picture, unless `should_stop`, and waits for it. Begins
    /// afresh with another scene (by its number), other lights or another camera.
    ///
    /// # Errors
    /// If a GPU fails, or does not draw such pictures.
    fn trace(
        &mut self,
        quality: Quality,
        scene: u64,
        lights: &PreparedLights,
        camera: &Camera,
        should_stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<()>;

    /// Samples of the fine picture.
    fn samples(&self) -> u32;

    /// A picture of the samples so far.
    ///
    /// # Errors
    /// If a GPU fails.
    fn resolve(&mut self, quality: Quality) -> Result<LitImage>;

    /// What is in memory.
    fn held(&self) -> Held;
}

/// Traces on the CPU.
pub(crate) struct OnCpu {
    meshes: Meshes,
    scene: Option<LitScene>,
    refining: Refining,
    fine: Tracer,
    coarse: Tracer,
}

impl OnCpu {
    /// A tracer of scenes with these meshes.
    pub(crate) fn new(meshes: Meshes, options: &Options) -> Self {
        let tracer = || Tracer::new(options.clone());
        let refining = Refining::default();
        Self { meshes, scene: None, refining, fine: tracer(), coarse: tracer() }
    }
}

impl SceneTracer for OnCpu {
    type Plane<'a> = &'a [u8];
    type Memory<'a> = [Option<&'a [u8]>];

    fn set_options(&mut self, options: &Options, _: &Lights) -> Result<()> {
        self.fine.set_options(options.clone());
        self.coarse.set_options(options.clone());
        Ok(())
    }

    fn clear(&mut self) {
        self.fine.clear();
        self.coarse.clear();
    }

    fn build(
        &mut self,
        frame: &Frame<'_, &[u8]>,
        classes: &[Option<&[u8]>],
        lights: &Lights,
        origin: DVec3,
    ) -> Result<()> {
        self.scene = Some(LitScene::new(frame, classes, &self.meshes, lights, origin));
        Ok(())
    }

    fn poll_refined(&mut self, number: u64, splats_max: u64, is_at_rest: bool) {
        let Some(lit) = &mut self.scene else { return };
        if let Some(refined) = self.refining.poll(&lit.scene, number, splats_max, is_at_rest) {
            // The same surfaces, so that samples stay.
            lit.scene = refined;
        }
    }

    fn trace(
        &mut self,
        quality: Quality,
        number: u64,
        lights: &PreparedLights,
        camera: &Camera,
        should_stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<()> {
        let Self { scene: Some(lit), fine, coarse, .. } = self else { return Ok(()) };
        let tracer = if quality == Quality::Fine { fine } else { coarse };
        tracer.trace(&lit.scene, number, lights, camera, 1, should_stop);
        Ok(())
    }

    fn samples(&self) -> u32 {
        self.fine.samples()
    }

    fn resolve(&mut self, quality: Quality) -> Result<LitImage> {
        Ok(match quality {
            Quality::Coarse => self.coarse.resolve(),
            Quality::Fine => self.fine.resolve(),
        })
    }

    fn held(&self) -> Held {
        let Some(LitScene { scene, splats }) = &self.scene else { return Held::default() };
        let bytes = scene.bytes() + self.fine.bytes() + self.coarse.bytes();
        Held { splats: *splats, dropped: scene.dropped(), bytes }
    }
}

/// Traces on a GPU. One tracer serves coarse and fine pictures: when one begins, the samples of the
/// other are of no use.
pub(crate) struct OnGpu {
    gpu: Gpu,
    collector: SceneCollector,
    scene: Option<GpuScene>,
    tracer: GpuTracer,
}

impl OnGpu {
    /// A tracer on `gpu`.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu, options: &Options) -> Result<Self> {
        Ok(Self {
            gpu: gpu.clone(),
            collector: SceneCollector::new(gpu)?,
            scene: None,
            tracer: GpuTracer::new(gpu, options.clone())?,
        })
    }
}

impl SceneTracer for OnGpu {
    type Plane<'a> = PlaneAt;
    type Memory<'a> = NodePool;

    fn set_options(&mut self, options: &Options, lights: &Lights) -> Result<()> {
        if !lights.emissive.is_empty() {
            return Err(Unsupported::Emitters.into());
        }
        self.tracer.set_options(options.clone());
        Ok(())
    }

    fn clear(&mut self) {
        self.tracer.clear();
    }

    fn build(
        &mut self,
        frame: &Frame<'_, PlaneAt>,
        pool: &NodePool,
        _: &Lights,
        origin: DVec3,
    ) -> Result<()> {
        // The old scene is freed first, so that both never exist at once.
        self.scene = None;
        let albedo = albedo(frame.colour);
        self.scene = Some(self.collector.collect(&self.gpu, frame, pool, origin, albedo)?);
        Ok(())
    }

    fn trace(
        &mut self,
        _: Quality,
        number: u64,
        lights: &PreparedLights,
        camera: &Camera,
        should_stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<()> {
        let Some(scene) = &self.scene else { return Ok(()) };
        self.tracer.trace(&self.gpu, scene, number, lights, camera, 1, should_stop)?;
        Ok(self.tracer.wait(&self.gpu)?)
    }

    fn samples(&self) -> u32 {
        self.tracer.samples()
    }

    fn resolve(&mut self, _: Quality) -> Result<LitImage> {
        Ok(self.tracer.resolve(&self.gpu)?)
    }

    fn held(&self) -> Held {
        let Some(scene) = &self.scene else { return Held::default() };
        let bytes = (scene.bytes() + self.tracer.bytes()) as usize;
        Held { splats: scene.splats() + scene.dropped(), dropped: scene.dropped(), bytes }
    }
}
