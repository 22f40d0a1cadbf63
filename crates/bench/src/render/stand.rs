//! A scene that lies in memory and is drawn again and again: by the CPU, and by a GPU where there is one.

use crate::draw::wait;
use anyhow::Result;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::whole::OnGpu;
use esker_format::{Forest, Planes};
use esker_lod::CompactOctree;
use esker_points::Task;
use esker_render::gpu::{Gpu, PlaneAt};
use esker_render::{Frame, FramePlan, Picture, Renderer, Stages, Stats};
use glam::DVec3;
use std::time::Instant;

/// Parts of the way to the middle of a file, one after another of which the eye goes until the picture is full.
const NEARER: u32 = 32;
/// Of so many pixels of a full picture one may show nothing: between points at the picture's corners.
const MISSING: u64 = 1000;

/// A scene in main memory, and in a GPU's.
pub struct Stand<'a> {
    file: &'a Forest,
    /// What is drawn.
    pub scene: PictureScene,
    octree: CompactOctree,
    renderer: Renderer,
    picture: Picture,
    gpu: Option<(Gpu, OnGpu)>,
    /// Dispatches of the newest frame on the GPU, and pixels that it covered.
    on_gpu: (u64, u64),
}

/// What may be changed of a frame before it is drawn, wherever its planes lie.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes {
    /// Pulled and pushed though it is dense.
    pub always_pushes: bool,
    /// One point wins a pixel, however many share it.
    pub one_wins: bool,
    /// Pixels that show one point stay as they are.
    pub is_rough: bool,
    /// Without planes told from depths, where there are no normals.
    pub is_flat: bool,
    /// Drawn from both sides.
    pub keeps_back_faces: bool,
    /// Without highlights.
    pub is_matt: bool,
}

impl Changes {
    fn apply<P>(self, frame: &mut Frame<'_, P>) {
        frame.skips_push &= !self.always_pushes;
        frame.averages &= !self.one_wins;
        frame.smooths &= !self.is_rough;
        frame.fits_planes &= !self.is_flat;
        frame.cull_back_faces &= !self.keeps_back_faces;
        frame.shines &= !self.is_matt;
    }
}

impl<'a> Stand<'a> {
    /// Chooses and reads what a request asks for.
    ///
    /// # Errors
    /// Where planes cannot be read, or the GPU refuses memory.
    pub fn new(
        file: &'a Forest,
        request: &PictureRequest,
        gpu: Option<&Gpu>,
        task: &dyn Task,
    ) -> Result<Self> {
        let scene = PictureScene::read(file, request, task)?;
        let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
        let on_gpu = |gpu: &Gpu| OnGpu::new(gpu, &scene).map(|on| (gpu.clone(), on));
        let gpu = gpu.map(on_gpu).transpose()?;
        let (renderer, picture) = (Renderer::default(), Picture::default());
        Ok(Self { file, scene, octree, renderer, picture, gpu, on_gpu: (0, 0) })
    }

    /// Draws points with so many times their radii.
    pub fn set_radii(&mut self, factor: f32) {
        let mut drawn = self.scene.selection.drawn.clone();
        drawn.iter_mut().for_each(|drawn| drawn.effective_spacing *= factor);
        self.octree = CompactOctree::new(self.file.table(), &drawn);
    }

    /// Brings the eye nearer, towards the middle of the file, until all pixels are covered but one in a thousand. Whether it is so; else the view is
    /// as it was. What is drawn, and its planes, stay the same.
    ///
    /// # Errors
    /// Where the view is no usable camera.
    pub fn fill(&mut self, changes: Changes) -> Result<bool> {
        let far = self.scene.view;
        let shown = far.with_margin(0);
        let pixels = u64::from(shown.width) * u64::from(shown.height);
        let [low, high] = esker_engine::calls::info::bounds(self.file).map(DVec3::from_array);
        for step in 1..NEARER {
            let share = f64::from(step) / f64::from(NEARER);
            self.scene.view.eye = far.eye.lerp(low.midpoint(high), share);
            self.on_cpu(changes)?;
            let missing = pixels.saturating_sub(self.pixels_covered()[0]);
            if missing <= pixels / MISSING {
                return Ok(true);
            }
        }
        self.scene.view = far;
        Ok(false)
    }

    /// Pixels that the newest frames covered: on the CPU, on the GPU.
    pub fn pixels_covered(&self) -> [u64; 2] {
        [self.picture.stats.pixels_covered, self.on_gpu.1]
    }

    /// Dispatches of the newest frame on the GPU.
    pub fn dispatches(&self) -> u64 {
        self.on_gpu.0
    }

    /// Whether a GPU draws it as well.
    pub fn has_gpu(&self) -> bool {
        self.gpu.is_some()
    }

    /// Points that it draws.
    pub fn points(&self) -> u64 {
        self.scene.selection.counters.points
    }

    /// Bytes of its planes.
    pub fn plane_bytes(&self) -> u64 {
        self.scene.planes.iter().map(Planes::bytes).sum()
    }

    /// What a frame takes: its plan, points, and bytes of planes that are read and resident.
    pub fn takes(&self, changes: Changes) -> (FramePlan, u64, [u64; 2]) {
        let draws = self.scene.draws(self.file);
        let mut frame = self.scene.look.frame(self.file, &self.scene.view, &draws, &self.octree);
        changes.apply(&mut frame);
        let bytes = [self.scene.read_bytes, self.plane_bytes()];
        (FramePlan::new(&frame), self.points(), bytes)
    }

    /// A frame on the CPU: its stages.
    ///
    /// # Errors
    /// Where the view is no usable camera.
    pub fn on_cpu(&mut self, changes: Changes) -> Result<Stages> {
        let draws = self.scene.draws(self.file);
        let mut frame = self.scene.look.frame(self.file, &self.scene.view, &draws, &self.octree);
        changes.apply(&mut frame);
        self.renderer.render_into(&frame, &mut self.picture)?;
        Ok(self.picture.stats.stages)
    }

    /// A frame on the GPU: its stages by the GPU's clock, where it has one; and the time until it was there.
    ///
    /// # Errors
    /// Where the GPU fails.
    pub fn on_gpu(&mut self, changes: Changes) -> Result<Stages> {
        let Some((gpu, on_gpu)) = &mut self.gpu else { return Ok(Stages::default()) };
        let (start, before) = (Instant::now(), gpu.dispatches());
        let change = |frame: &mut Frame<'_, PlaneAt>| changes.apply(frame);
        on_gpu.draw(self.file, &self.scene, &self.octree, change)?;
        wait(gpu)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let Stats { stages, pixels_covered, .. } = on_gpu.stats().unwrap_or_default();
        self.on_gpu = (gpu.dispatches() - before, pixels_covered);
        let total_ms = if gpu.tier.is_software { wall_ms } else { stages.total_ms.max(1e-6) };
        Ok(Stages { total_ms, ..stages })
    }
}
