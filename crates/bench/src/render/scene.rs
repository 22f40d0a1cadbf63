//! A scene that stays in memory and is drawn again and again, by the CPU and by a GPU. Its camera
//! is fixed; frames differ by [`Changes`], which leave the planes as they are.

use crate::draw::wait;
use anyhow::Result;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::whole::GpuScene;
use esker_format::{Forest, PlaneKind, Planes};
use esker_lod::{CompactOctree, View};
use esker_points::Task;
use esker_render::gpu::{Gpu, PlaneAt};
use esker_render::{
    DrawNode, Frame, FramePlan, PassChoice, PassSet, PassTimes, Picture, Renderer, Stats,
};
use glam::DVec3;
use std::time::Instant;

/// Steps of the eye on its way to the middle of a file, until the picture is full.
const STEPS: u32 = 32;
/// Pixels of a full picture of which one may be empty, between points at the picture's corners.
const PIXELS_AN_EMPTY_ONE: u64 = 1000;

/// A scene in main memory, and in that of a GPU.
pub struct ResidentScene<'a> {
    file: &'a Forest,
    /// View, nodes and planes.
    pub picture: PictureScene,
    octree: CompactOctree,
    renderer: Renderer,
    cpu_picture: Picture,
    gpu: Option<(Gpu, GpuScene)>,
    /// Dispatches of the newest frame on the GPU.
    gpu_dispatches: u64,
    /// Pixels that the newest frame on the GPU covered.
    gpu_pixels_covered: u64,
}

/// Changes of a frame before it is drawn, on the CPU or on the GPU.
#[derive(Clone, Copy, Debug)]
pub struct Changes {
    /// Runs pull and push although the view is dense.
    pub always_pushes: bool,
    /// Shows the nearest point of a pixel in place of an average.
    pub one_wins: bool,
    /// Leaves pixels that show one point unsmoothed.
    pub is_rough: bool,
    /// Fits no planes to depths if there are no normals.
    pub is_flat: bool,
    /// Lights surfaces without highlights.
    pub is_matt: bool,
    /// Draws no margin around the picture.
    pub has_no_margin: bool,
    /// Draws points in the middle of their hot step, on the CPU.
    pub has_no_residuals: bool,
    /// Passes that are chosen otherwise than by the plan.
    pub passes: PassChoice,
}

impl Changes {
    /// Leaves frames as they are.
    pub const NONE: Self = Self {
        always_pushes: false,
        one_wins: false,
        is_rough: false,
        is_flat: false,
        is_matt: false,
        has_no_margin: false,
        has_no_residuals: false,
        passes: PassChoice { skipped: PassSet::of(&[]), forced: PassSet::of(&[]) },
    };

    /// The view to draw for `view`.
    fn view(self, view: &View) -> View {
        if self.has_no_margin { view.with_margin(0) } else { *view }
    }

    fn apply<P>(self, frame: &mut Frame<'_, P>) {
        frame.skips_push &= !self.always_pushes;
        frame.averages &= !self.one_wins;
        frame.smooths &= !self.is_rough;
        frame.fits_planes &= !self.is_flat;
        frame.shines &= !self.is_matt;
        frame.passes = self.passes;
    }
}

impl<'a> ResidentScene<'a> {
    /// Chooses and reads the nodes and planes of a picture.
    ///
    /// # Errors
    /// If planes cannot be read, or the GPU refuses memory.
    pub fn new(
        file: &'a Forest,
        request: &PictureRequest,
        gpu: Option<&Gpu>,
        task: &dyn Task,
    ) -> Result<Self> {
        let picture = PictureScene::read(file, request, task)?;
        let octree = CompactOctree::with_hidden(
            file.table(),
            &picture.selection.drawn,
            &picture.selection.hidden,
        );
        let on_gpu = |gpu: &Gpu| GpuScene::new(gpu, &picture).map(|on| (gpu.clone(), on));
        let gpu = gpu.map(on_gpu).transpose()?;
        Ok(Self {
            file,
            picture,
            octree,
            renderer: Renderer::default(),
            cpu_picture: Picture::default(),
            gpu,
            gpu_dispatches: 0,
            gpu_pixels_covered: 0,
        })
    }

    /// Multiplies the radii of points by `factor`.
    pub fn set_radii(&mut self, factor: f32) {
        let mut drawn = self.picture.selection.drawn.clone();
        drawn.iter_mut().for_each(|drawn| drawn.effective_spacing *= factor);
        self.octree = CompactOctree::new(self.file.table(), &drawn);
    }

    /// Moves the eye towards the middle of the file until nearly all pixels are covered, and
    /// returns whether they are; if not, the view is left as it was. Nodes and planes
    /// stay the same.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn fill(&mut self, changes: Changes) -> Result<bool> {
        let far = self.picture.view;
        let shown = far.with_margin(0);
        let pixels = u64::from(shown.width) * u64::from(shown.height);
        let [low, high] = esker_engine::calls::info::bounds(self.file).map(DVec3::from_array);
        for step in 1..STEPS {
            let share = f64::from(step) / f64::from(STEPS);
            self.picture.view.eye = far.eye.lerp(low.midpoint(high), share);
            self.on_cpu(changes)?;
            let missing = pixels.saturating_sub(self.pixels_covered()[0]);
            if missing <= pixels / PIXELS_AN_EMPTY_ONE {
                return Ok(true);
            }
        }
        self.picture.view = far;
        Ok(false)
    }

    /// Pixels that the newest frames covered, on the CPU and on the GPU.
    pub fn pixels_covered(&self) -> [u64; 2] {
        [self.cpu_picture.stats.pixels_covered, self.gpu_pixels_covered]
    }

    /// Dispatches of the newest frame on the GPU.
    pub fn dispatches(&self) -> u64 {
        self.gpu_dispatches
    }

    /// Whether a GPU draws the scene as well.
    pub fn has_gpu(&self) -> bool {
        self.gpu.is_some()
    }

    /// Points that a frame draws.
    pub fn points(&self) -> u64 {
        self.picture.selection.counters.points
    }

    /// Whether any node has residuals of positions.
    pub fn has_residuals(&self) -> bool {
        self.picture.planes.iter().any(|planes| planes.get(PlaneKind::Residual).is_some())
    }

    /// Bytes of the planes in memory.
    pub fn plane_bytes(&self) -> u64 {
        self.picture.planes.iter().map(Planes::bytes).sum()
    }

    /// Cost of a frame: its plan, its points, and the bytes of planes read and resident.
    pub fn cost(&self, changes: Changes) -> (FramePlan, u64, [u64; 2]) {
        let (draws, view) =
            (drawn(self.file, &self.picture, changes), changes.view(&self.picture.view));
        let mut frame = self.picture.appearance.frame(self.file, &view, &draws, &self.octree);
        changes.apply(&mut frame);
        let bytes = [self.picture.read_bytes, self.plane_bytes()];
        (FramePlan::new(&frame), self.points(), bytes)
    }

    /// Draws a frame on the CPU and returns its times.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn on_cpu(&mut self, changes: Changes) -> Result<PassTimes> {
        let Self { file, picture, octree, renderer, cpu_picture, .. } = self;
        let (draws, view) = (drawn(file, picture, changes), changes.view(&picture.view));
        let mut frame = picture.appearance.frame(file, &view, &draws, octree);
        changes.apply(&mut frame);
        renderer.render_into(&frame, cpu_picture)?;
        Ok(self.cpu_picture.stats.stages)
    }

    /// The newest picture of the CPU.
    pub fn cpu_picture(&self) -> &Picture {
        &self.cpu_picture
    }

    /// The newest picture of the CPU, or of the GPU; waits for it.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn shown(&mut self, on_gpu: bool) -> Result<Picture> {
        match &mut self.gpu {
            Some((_, scene)) if on_gpu => Ok(scene.picture()?),
            _ => Ok(self.cpu_picture.clone()),
        }
    }

    /// Draws a frame on the GPU, waits for it, and returns its times by the GPU's clock. On a
    /// software driver the total is by the wall clock. Without a GPU the times are zero.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn on_gpu(&mut self, changes: Changes) -> Result<PassTimes> {
        let Some((gpu, on_gpu)) = &mut self.gpu else { return Ok(PassTimes::default()) };
        let (start, before) = (Instant::now(), gpu.dispatches());
        let change = |frame: &mut Frame<'_, PlaneAt>| changes.apply(frame);
        let view = self.picture.view;
        self.picture.view = changes.view(&view);
        let drawn = on_gpu.draw(self.file, &self.picture, &self.octree, change);
        self.picture.view = view;
        drawn?;
        wait(gpu)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let Stats { stages, pixels_covered, .. } = on_gpu.stats().unwrap_or_default();
        self.gpu_dispatches = gpu.dispatches() - before;
        self.gpu_pixels_covered = pixels_covered;
        let total_ms = if gpu.tier.is_software { wall_ms } else { stages.total_ms.max(1e-6) };
        Ok(PassTimes { total_ms, ..stages })
    }
}

/// Nodes of a picture with their planes on the CPU.
fn drawn<'a>(file: &'a Forest, picture: &'a PictureScene, changes: Changes) -> Vec<DrawNode<'a>> {
    let mut draws = picture.draws(file);
    if changes.has_no_residuals {
        draws.iter_mut().for_each(|draw| draw.residual = None);
    }
    draws
}
