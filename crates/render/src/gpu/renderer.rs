//! A frame on the GPU: encodes the passes of the frame's plan into one command buffer and submits
//! it once. Only [`GpuRenderer::read`] waits for the GPU. Twin: [`crate::renderer`].

use crate::frame::{Frame, Method, Picture, Stats};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::readback;
use crate::gpu::device::{Counted, Gpu, ProjectPath};
use crate::gpu::feedback::Feedback;
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::frame::FrameUniform;
use crate::gpu::memory::hits::Hits;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::pyramid::GpuPyramid;
use crate::gpu::memory::table::PlaneAt;
use crate::gpu::passes::average::Average;
use crate::gpu::passes::ewa::{BatchCapacity, EwaTarget, GpuEwa};
use crate::gpu::passes::exposure::Exposure;
use crate::gpu::passes::eye_dome::EyeDome;
use crate::gpu::passes::gather::Gather;
use crate::gpu::passes::grow::Grow;
use crate::gpu::passes::overlay::Overlay;
use crate::gpu::passes::primitives::Primitives;
use crate::gpu::passes::project::Project;
use crate::gpu::passes::resolve::Resolve;
use crate::gpu::passes::store::Store;
use crate::gpu::surface::Surface;
use crate::inputs::camera::Camera;
use crate::pass::Pass;
use crate::picture::margin::crop;
use crate::picture::pyramid::Planes;
use crate::plan::FramePlan;
use esker_lod::DepthFeedback;
use esker_points::Grain;
use wgpu::{Buffer, BufferUsages, CommandEncoder, TextureView};

/// Bytes a pixel of the widest plane of pictures and pyramids.
const PIXEL_BYTES_MAX: u64 = 16;

/// Draws frames on a GPU, and keeps its buffers from frame to frame. Only the render thread uses
/// it.
pub struct GpuRenderer {
    gpu: Gpu,
    uniform: Counted,
    cut: GpuCut,
    hits: Hits,
    points: Points,
    lookup: GpuLookup,
    gather: Gather,
    average: Average,
    grow: Grow,
    overlay: Overlay,
    resolve: Resolve,
    eye_dome: EyeDome,
    store: Store,
    pyramid: GpuPyramid,
    surface: Surface,
    /// EWA splatting, created when it is first drawn with, with this capacity.
    ewa: Option<GpuEwa>,
    capacity: BatchCapacity,
    output: Option<Output>,
    feedback: Feedback,
}

/// The pass that draws points, by the tier of the device.
enum Points {
    Atomics(Project),
    Primitives(Primitives),
}

/// The newest picture, and a view of its texture.
struct Output {
    picture: GpuPicture,
    view: TextureView,
}

impl GpuRenderer {
    /// Creates the passes of the device's tier.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            uniform: gpu.buffer("frame", size_of::<FrameUniform>() as u64, usage)?,
            cut: GpuCut::new(gpu)?,
            hits: Hits::new(gpu)?,
            points: match gpu.tier.path {
                ProjectPath::Atomics => Points::Atomics(Project::new(gpu)?),
                ProjectPath::Primitives => Points::Primitives(Primitives::new(gpu)?),
            },
            lookup: GpuLookup::new(gpu)?,
            gather: Gather::default(),
            average: Average::default(),
            grow: Grow::new(gpu)?,
            overlay: Overlay::new(gpu)?,
            resolve: Resolve::new(gpu)?,
            eye_dome: EyeDome::default(),
            store: Store::new(gpu)?,
            pyramid: GpuPyramid::default(),
            surface: Surface::default(),
            ewa: None,
            capacity: BatchCapacity::default(),
            output: None,
            feedback: Feedback::new(gpu)?,
            gpu: gpu.clone(),
        })
    }

    /// Draws a frame whose planes are in `pool`: encodes and submits, and does not wait.
    ///
    /// # Errors
    /// If the view makes no valid camera or is too large, memory is refused, or the device has
    /// failed.
    pub fn render(&mut self, frame: &Frame<'_, PlaneAt>, pool: &NodePool) -> Result<(), GpuError> {
        let encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.render_after(encoder, frame, pool)
    }

    /// Draws a frame like [`GpuRenderer::render`], in the submission of the commands that `encoder`
    /// already has (uploads), and after them.
    ///
    /// # Errors
    /// On the same conditions; the commands are then not submitted.
    pub fn render_after(
        &mut self,
        mut encoder: CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let camera = Camera::of(frame)?;
        let mut plan = FramePlan::new(frame);
        let drawn_px = if self.holds(camera.size) { plan.margin_px } else { 0 };
        let camera = camera.with_margin(drawn_px);
        let pixels = camera.size.into_iter().map(u64::from).product();
        if !Average::fits(&self.gpu, pixels, &plan) {
            plan = plan.without_averages();
        }
        if !Exposure::fits(&self.gpu, camera.size) {
            plan = plan.without_exposure();
        }
        self.average.fit(&self.gpu, pixels, &plan)?;
        self.gather.fit_planes.fit(&self.gpu, camera.size, &plan)?;
        self.gather.exposure.fit(&self.gpu, camera.size, &plan)?;
        self.fit(&camera, &plan)?;
        self.cut.fill(&self.gpu, frame, &camera, &plan, pool)?;
        self.lookup.set(&self.gpu, frame)?;
        let uniform = FrameUniform::new(frame, &camera, plan.shares());
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.encode(&mut encoder, frame, &camera, &plan, pool)?;
        self.gpu.queue.submit([encoder.finish()]);
        if let Points::Atomics(project) = &self.points {
            project.submitted(pool);
        }
        self.feedback.submitted(&self.gpu);
        self.gpu.fault().map_or(Ok(()), Err)
    }

    /// Sets whether runs of points outside the picture are skipped, for measurements and tests. By
    /// default they are; point primitives never skip any.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn skip_runs(&mut self, skips: bool) -> Result<(), GpuError> {
        if let Points::Atomics(project) = &mut self.points {
            let make = if skips { Project::new } else { Project::without_skips };
            *project = make(&self.gpu)?;
        }
        Ok(())
    }

    /// Whether the device can hold pictures of this size.
    fn holds(&self, [width, height]: [u32; 2]) -> bool {
        let bytes = u64::from(width) * u64::from(height) * PIXEL_BYTES_MAX;
        width.max(height) <= self.gpu.device.limits().max_texture_dimension_2d
            && bytes <= self.gpu.tier.binding_bytes_max
    }

    /// Creates the picture, the frame buffer and the pyramid that a frame needs, and releases what
    /// it does not need.
    fn fit(&mut self, camera: &Camera, plan: &FramePlan) -> Result<(), GpuError> {
        let (size, margin_px) = (camera.size, camera.margin_px);
        let [width, height] = size;
        let is_new = self.output.as_ref().is_none_or(|Output { picture, .. }| {
            ([picture.width, picture.height], picture.margin_px) != (size, margin_px)
        });
        let has_surface = plan.passes.contains(&Pass::Shade);
        let planes = match (plan.planes(), self.pyramid.planes) {
            // In dense views no planes are fitted; their memory is kept for the next sparser view.
            (Planes::None, Planes::Fitted) if plan.passes.contains(&Pass::Gather) => Planes::Fitted,
            (planes, _) => planes,
        };
        if is_new || !has_surface || self.pyramid.planes != planes {
            // The old buffers are released first, so that both never exist at once.
            self.surface.release();
            self.pyramid = GpuPyramid::default();
        }
        if has_surface {
            self.resolve.release(&self.gpu)?;
        }
        if !plan.passes.contains(&Pass::Grow) {
            self.grow.release(&self.gpu)?;
        }
        if is_new {
            self.output = None;
            if !self.holds(size) {
                return Err(GpuError::Size { width, height });
            }
            self.hits.fit(&self.gpu, size)?;
            let picture = GpuPicture::new(&self.gpu, size, margin_px)?;
            let view = picture.texture.create_view(&Default::default());
            self.output = Some(Output { picture, view });
        }
        if has_surface {
            self.pyramid.fit(&self.gpu, width, height, planes)?;
        }
        Ok(())
    }

    /// Encodes the passes of a frame, between the beginning and the end of its feedback.
    fn encode(
        &mut self,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        camera: &Camera,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        if self.output.is_none() {
            return Ok(());
        }
        if let Some(ewa) = self.ewa.as_mut().filter(|_| frame.method != Method::Ewa) {
            ewa.release();
        }
        self.feedback.begin(encoder);
        self.encode_project(encoder, plan, pool)?;
        match frame.method {
            Method::Points => self.encode_points(encoder, plan, pool)?,
            Method::PullPush => self.encode_pull_push(encoder, plan, pool)?,
            Method::Ewa => self.encode_ewa(encoder, frame, camera, plan, pool)?,
        }
        self.encode_feedback(encoder, frame, camera);
        Ok(())
    }

    /// Encodes the projection of points to the frame buffer.
    fn encode_project(
        &mut self,
        encoder: &mut CommandEncoder,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, points, feedback, .. } = self;
        let Some(Output { picture, .. }) = &self.output else { return Ok(()) };
        let timing = &mut feedback.timing;
        match points {
            _ if !plan.passes.contains(&Pass::Project) => Ok(()),
            Points::Atomics(project) => {
                project.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing)
            }
            Points::Primitives(primitives) => {
                primitives.fit(gpu, [picture.width, picture.height])?;
                primitives.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing);
                Ok(())
            }
        }
    }

    /// Encodes the passes that write the colours of the winning points to the picture.
    fn encode_points(
        &mut self,
        encoder: &mut CommandEncoder,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, lookup, feedback, .. } = self;
        let Some(Output { picture, .. }) = &self.output else { return Ok(()) };
        let pages = cut.pages(pool, plan.fetches);
        let Some(won) = winning(uniform, picture, hits, cut, &pages, &feedback.counts) else {
            return Ok(());
        };
        let timing = &mut feedback.timing;
        let won = if plan.passes.contains(&Pass::Grow) {
            let mut pass = timing.compute(encoder, Pass::Grow);
            if plan.adapts {
                self.resolve.fetch(gpu, &mut pass, plan, lookup, &won)?;
            }
            self.grow.encode(gpu, &mut pass, plan, lookup, &won, self.resolve.words())?;
            WinningPoints { hits: self.grow.hits(), ..won }
        } else {
            won
        };
        let mut pass = timing.compute(encoder, Pass::Resolve);
        self.resolve.encode(gpu, &mut pass, plan, lookup, &won, picture)?;
        if plan.passes.contains(&Pass::EyeDome) {
            drop(pass);
            pass = timing.compute(encoder, Pass::EyeDome);
            self.eye_dome.dispatch(gpu, uniform, picture, None)?.run(&mut pass);
        }
        self.store.dispatch(gpu, uniform, picture).run(&mut pass);
        Ok(())
    }

    /// Encodes pull-push: level 0 of the pyramid from the winning points, then the surface.
    fn encode_pull_push(
        &mut self,
        encoder: &mut CommandEncoder,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, lookup, feedback, pyramid, .. } = self;
        let Some(Output { picture, .. }) = &self.output else { return Ok(()) };
        let pages = cut.pages(pool, plan.fetches);
        let Some(won) = winning(uniform, picture, hits, cut, &pages, &feedback.counts) else {
            return Ok(());
        };
        let timing = &mut feedback.timing;
        let Some(level) = pyramid.levels.first() else { return Ok(()) };
        // Level 0 takes the words of dots before it is filled, and after it is shaded.
        let words = [&*level.front, &*level.tint];
        if plan.mixes_dots() {
            let mut pass = timing.compute(encoder, Pass::Split);
            lookup.fetch(gpu, &mut pass, &won, plan, words)?;
            self.grow.split(gpu, &mut pass, plan, lookup, &won, words)?;
        }
        if plan.planes() == Planes::Fitted {
            self.gather.fit_planes.encode(gpu, encoder, uniform, won.hits, timing);
        }
        let mut pass = timing.compute(encoder, Pass::Gather);
        self.gather.encode(gpu, &mut pass, plan, lookup, &won, pyramid)?;
        drop(pass);
        if plan.averages() {
            self.average.encode(gpu, encoder, uniform, plan, cut, pool, lookup, level, timing)?;
        }
        if plan.evens_exposure() {
            self.gather.exposure.encode(gpu, encoder, uniform, level, timing);
        }
        self.surface.encode(gpu, encoder, plan, uniform, pyramid, picture, timing)?;
        if !plan.mixes_dots() {
            return Ok(());
        }
        let mut pass = timing.compute(encoder, Pass::Grow);
        self.grow.encode(gpu, &mut pass, plan, lookup, &won, words)?;
        drop(pass);
        let won = WinningPoints { hits: self.grow.hits(), ..won };
        let mut pass = timing.compute(encoder, Pass::Overlay);
        lookup.fetch(gpu, &mut pass, &won, plan, words)?;
        self.overlay.encode(gpu, &mut pass, plan, lookup, &won, words, picture)?;
        if plan.passes.contains(&Pass::EyeDome) {
            drop(pass);
            pass = timing.compute(encoder, Pass::EyeDome);
            self.eye_dome.dispatch(gpu, uniform, picture, Some(won.hits))?.run(&mut pass);
        }
        self.store.dispatch(gpu, uniform, picture).run(&mut pass);
        Ok(())
    }

    /// Encodes EWA splatting to level 0 of the pyramid, then the surface.
    fn encode_ewa(
        &mut self,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        camera: &Camera,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, lookup, feedback, pyramid, .. } = self;
        let Some(Output { picture, .. }) = &self.output else { return Ok(()) };
        let Some(won) = hits.buffer() else { return Ok(()) };
        let fit_planes = &self.gather.fit_planes;
        if plan.fits_planes() {
            fit_planes.encode(gpu, encoder, uniform, won, &mut feedback.timing);
        }
        let target = EwaTarget {
            uniform,
            frame: FrameUniform::new(frame, camera, plan.shares()),
            plan,
            cut,
            pool,
            pyramid,
            planes: fit_planes.planes(),
            picture,
            counts: &feedback.counts,
            camera,
            grain: Grain::new(frame.lattice.scale),
        };
        let ewa = match &mut self.ewa {
            Some(ewa) => ewa,
            none => none.insert(GpuEwa::new(gpu, self.capacity)?),
        };
        let timing = &mut feedback.timing;
        ewa.encode(gpu, encoder, lookup, &target, timing)?;
        self.surface.encode(gpu, encoder, plan, uniform, pyramid, picture, timing)
    }

    /// Encodes the copies of counts, times and depth tiles that the host reads later.
    fn encode_feedback(
        &mut self,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        camera: &Camera,
    ) {
        let Some(Output { picture, .. }) = &self.output else { return };
        let stats = Stats {
            points_drawn: self.cut.points,
            nodes_drawn: self.cut.rows.len() as u32,
            ..Stats::default()
        };
        let view = frame.view.with_margin(camera.margin_px);
        let of = (&view, frame.method, stats);
        self.feedback.end(&self.gpu, encoder, &self.uniform, picture, of);
    }

    /// The newest picture as a texture for a window: `rgba8unorm` with sRGB bytes and straight
    /// alpha. A frame of another size has another texture.
    pub fn texture(&self) -> Option<&TextureView> {
        self.output.as_ref().map(|output| &output.view)
    }

    /// Reads the newest picture and its depths back, and waits for them.
    ///
    /// # Errors
    /// If memory is refused or the device has failed.
    pub fn read(&mut self) -> Result<Picture, GpuError> {
        let Some(Output { picture, .. }) = &self.output else { return Ok(Picture::default()) };
        let (width, height) = (picture.width, picture.height);
        let bytes = u64::from(width) * u64::from(height) * 4;
        let planes = [(&*picture.rgba, bytes), (&*picture.depth, bytes)];
        let mut planes = readback::read(&self.gpu, &planes)?;
        let depth = planes.pop().unwrap_or_default();
        let rgba = planes.pop().unwrap_or_default();
        self.gpu.fault().map_or(Ok(()), Err)?;
        let (depth, margin_px) = (bytemuck::pod_collect_to_vec(&depth), picture.margin_px);
        let stats = self.stats().unwrap_or_default();
        let drawn = Picture { width, height, rgba, depth, stats };
        if margin_px == 0 {
            return Ok(drawn);
        }
        let mut cropped = Picture { stats, ..Picture::default() };
        crop(&drawn, margin_px, &mut cropped);
        Ok(cropped)
    }

    /// Counts and times of the newest frame whose counts have arrived; does not wait. The times are
    /// zero if the device has no timestamps.
    pub fn stats(&mut self) -> Option<Stats> {
        self.feedback.stats(&self.gpu)
    }

    /// The newest depth tiles that have arrived, with the view that they were drawn from; does not
    /// wait.
    pub fn feedback(&mut self) -> Option<DepthFeedback> {
        self.feedback.depth(&self.gpu)
    }

    /// Sets the capacity that EWA splatting is created with.
    pub fn set_batch_capacity(&mut self, capacity: BatchCapacity) {
        self.capacity = capacity;
    }

    /// Replaces EWA splatting by one with other options or another capacity.
    pub fn set_ewa(&mut self, ewa: GpuEwa) {
        self.ewa = Some(ewa);
    }

    /// The frame buffer of the newest frame, and the tables that its point numbers refer to.
    pub fn hits(&self) -> (&Hits, &GpuCut) {
        (&self.hits, &self.cut)
    }

    /// Rebuilds the kernels whose shaders have changed in [`crate::gpu::device::shader::folder`].
    /// Whether any has.
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self) -> Result<bool, GpuError> {
        let gpu = &self.gpu;
        let points = match &mut self.points {
            Points::Atomics(project) => project.reload(gpu)?,
            Points::Primitives(primitives) => primitives.reload(gpu)?,
        };
        let won = self.lookup.reload(gpu)? | self.gather.reload(gpu)? | self.resolve.reload(gpu)?;
        let dots = self.grow.reload(gpu)? | self.overlay.reload(gpu)?;
        let dots = dots | self.eye_dome.reload(gpu)?;
        let averages = self.average.reload(gpu)?;
        let splats = self.ewa.as_mut().map_or(Ok(false), |ewa| ewa.reload(gpu))?;
        let rest =
            self.hits.reload(gpu)? | self.surface.reload(gpu)? | self.feedback.reload(gpu)?;
        Ok(points | won | dots | averages | splats | rest)
    }
}

/// The winning points of the frame buffer, and the tables and pages that they refer to; `None`
/// before there is a frame buffer.
fn winning<'a>(
    uniform: &'a Buffer,
    picture: &GpuPicture,
    hits: &'a Hits,
    cut: &'a GpuCut,
    pages: &'a [(u32, &'a Buffer)],
    counts: &'a Buffer,
) -> Option<WinningPoints<'a>> {
    let size = [picture.width, picture.height];
    let (hits, draws, chunks) = (hits.buffer()?, cut.draws(), cut.chunks());
    Some(WinningPoints { uniform, size, hits, draws, chunks, pages, counts })
}
