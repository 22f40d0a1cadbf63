//! The frame on the GPU from first pass to last, as its plan says: all passes in one command buffer, submitted
//! once. Nothing waits for the GPU but [`GpuRenderer::read`]. Twin: [`crate::renderer`].

use crate::frame::{Frame, Method, Picture, Stats};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::readback;
use crate::gpu::device::{Counted, Gpu, ProjectPath};
use crate::gpu::feedback::Feedback;
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::frame::FrameUniform;
use crate::gpu::memory::hits::Hits;
use crate::gpu::memory::lookup::{GpuLookup, Won};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::pyramid::GpuPyramid;
use crate::gpu::memory::table::PlaneAt;
use crate::gpu::passes::average::Average;
use crate::gpu::passes::ewa::{self, GpuEwa, Room};
use crate::gpu::passes::exposure::Exposure;
use crate::gpu::passes::gather::Gather;
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
use wgpu::{BufferUsages, CommandEncoder, TextureView};

/// Bytes of the widest plane of pictures and pyramids, a pixel.
const PIXEL_BYTES_MAX: u64 = 16;

/// Draws frames on a GPU; keeps its buffers between them. Used by the render thread alone.
pub struct GpuRenderer {
    gpu: Gpu,
    uniform: Counted,
    cut: GpuCut,
    hits: Hits,
    points: Points,
    lookup: GpuLookup,
    gather: Gather,
    average: Average,
    resolve: Resolve,
    store: Store,
    pyramid: GpuPyramid,
    surface: Surface,
    /// EWA splatting, made when it is first drawn with, and its room.
    ewa: Option<GpuEwa>,
    room: Room,
    shown: Option<Shown>,
    feedback: Feedback,
}

/// How points become pixels.
enum Points {
    Atomics(Project),
    Primitives(Primitives),
}

/// The newest picture.
struct Shown {
    picture: GpuPicture,
    view: TextureView,
}

impl GpuRenderer {
    /// For a device, by the path of its tier.
    ///
    /// # Errors
    /// Where the driver refuses a shader, or memory.
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
            resolve: Resolve::new(gpu)?,
            store: Store::new(gpu)?,
            pyramid: GpuPyramid::default(),
            surface: Surface::default(),
            ewa: None,
            room: Room::default(),
            shown: None,
            feedback: Feedback::new(gpu)?,
            gpu: gpu.clone(),
        })
    }

    /// Draws a frame whose planes lie in `pool`: encodes and submits, and does not wait.
    ///
    /// # Errors
    /// Where the view is no usable camera or too large, memory is refused, or the device has failed.
    pub fn render(&mut self, frame: &Frame<'_, PlaneAt>, pool: &NodePool) -> Result<(), GpuError> {
        let encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.render_after(encoder, frame, pool)
    }

    /// As [`GpuRenderer::render`], after the commands that `encoder` has (uploads), in one submission.
    ///
    /// # Errors
    /// As [`GpuRenderer::render`]; the commands are then not submitted.
    pub fn render_after(
        &mut self,
        mut encoder: CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let camera = Camera::new(frame.view, frame.lattice)?;
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
        let uniform = FrameUniform::new(frame, &camera);
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.encode(&mut encoder, frame, &camera, &plan, pool)?;
        self.gpu.queue.submit([encoder.finish()]);
        if let Points::Atomics(project) = &self.points {
            project.submitted(pool);
        }
        self.feedback.submitted(&self.gpu);
        self.gpu.fault().map_or(Ok(()), Err)
    }

    /// Whether runs of points off the picture are left unread, as they are at first; for measurements and tests.
    /// Point primitives leave none.
    ///
    /// # Errors
    /// Where the driver refuses a shader.
    pub fn skip_runs(&mut self, skips: bool) -> Result<(), GpuError> {
        if let Points::Atomics(project) = &mut self.points {
            let make = if skips { Project::new } else { Project::without_skips };
            *project = make(&self.gpu)?;
        }
        Ok(())
    }

    /// Whether the device has room for pictures of this size.
    fn holds(&self, [width, height]: [u32; 2]) -> bool {
        let bytes = u64::from(width) * u64::from(height) * PIXEL_BYTES_MAX;
        width.max(height) <= self.gpu.device.limits().max_texture_dimension_2d
            && bytes <= self.gpu.tier.binding_bytes_max
    }

    /// Takes the size of a picture and its margin, and what its plan needs.
    fn fit(&mut self, camera: &Camera, plan: &FramePlan) -> Result<(), GpuError> {
        let (size, margin_px) = (camera.size, camera.margin_px);
        let [width, height] = size;
        let is_new = self.shown.as_ref().is_none_or(|Shown { picture, .. }| {
            ([picture.width, picture.height], picture.margin_px) != (size, margin_px)
        });
        let has_surface = plan.passes.contains(&Pass::Shade);
        let planes = match (plan.planes(), self.pyramid.planes) {
            // Views that are dense now and then tell none, and keep their room.
            (Planes::None, Planes::Fitted) if plan.passes.contains(&Pass::Gather) => Planes::Fitted,
            (planes, _) => planes,
        };
        if is_new || !has_surface || self.pyramid.planes != planes {
            // The old ones go first, so that never both are there; and none is kept that is not needed.
            self.surface.release();
            self.pyramid = GpuPyramid::default();
        }
        if has_surface {
            self.resolve.release(&self.gpu)?;
        }
        if is_new {
            self.shown = None;
            if !self.holds(size) {
                return Err(GpuError::Size { width, height });
            }
            self.hits.fit(&self.gpu, size)?;
            let picture = GpuPicture::new(&self.gpu, size, margin_px)?;
            let view = picture.texture.create_view(&Default::default());
            self.shown = Some(Shown { picture, view });
        }
        if has_surface {
            self.pyramid.fit(&self.gpu, width, height, planes)?;
        }
        Ok(())
    }

    fn encode(
        &mut self,
        encoder: &mut CommandEncoder,
        frame: &Frame<'_, PlaneAt>,
        camera: &Camera,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, points, lookup, feedback, .. } = self;
        let Some(Shown { picture, .. }) = &self.shown else { return Ok(()) };
        let size = [picture.width, picture.height];
        if let Some(ewa) = self.ewa.as_mut().filter(|_| frame.method != Method::Ewa) {
            ewa.release();
        }
        feedback.begin(encoder);
        let timing = &mut feedback.timing;
        match points {
            _ if !plan.passes.contains(&Pass::Project) => {}
            Points::Atomics(project) => {
                project.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing)?;
            }
            Points::Primitives(primitives) => {
                primitives.fit(gpu, size)?;
                primitives.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing);
            }
        }
        let Some(hits) = hits.buffer() else { return Ok(()) };
        let (draws, chunks, counts) = (cut.draws(), cut.chunks(), &*feedback.counts);
        let pages = cut.pages(pool, plan.fetches);
        let won = Won { uniform, size, hits, draws, chunks, pages: &pages, counts };
        match frame.method {
            Method::Ewa => {
                let (pyramid, counts) = (&self.pyramid, won.counts);
                let grain = Grain::new(frame.lattice.scale);
                let frame = FrameUniform::new(frame, camera);
                let target = ewa::Target {
                    uniform,
                    frame,
                    plan,
                    cut,
                    pool,
                    pyramid,
                    picture,
                    counts,
                    camera,
                    grain,
                };
                let ewa = match &mut self.ewa {
                    Some(ewa) => ewa,
                    none => none.insert(GpuEwa::new(gpu, self.room)?),
                };
                ewa.encode(gpu, encoder, lookup, &target, timing)?;
                self.surface.encode(gpu, encoder, plan, uniform, pyramid, picture, timing)?;
            }
            Method::Points => {
                let mut pass = timing.compute(encoder, Pass::Resolve);
                self.resolve.encode(gpu, &mut pass, plan, lookup, &won, picture)?;
                self.store.dispatch(gpu, uniform, picture).run(&mut pass);
            }
            Method::PullPush => {
                let pyramid = &self.pyramid;
                if plan.planes() == Planes::Fitted {
                    self.gather.fit_planes.encode(gpu, encoder, uniform, won.hits, plan, timing);
                }
                let mut pass = timing.compute(encoder, Pass::Gather);
                self.gather.encode(gpu, &mut pass, plan, lookup, &won, pyramid)?;
                drop(pass);
                if plan.averages()
                    && let Some(level) = pyramid.levels.first()
                {
                    self.average
                        .encode(gpu, encoder, uniform, plan, cut, pool, lookup, level, timing)?;
                }
                if plan.evens_exposure()
                    && let Some(level) = pyramid.levels.first()
                {
                    self.gather.exposure.encode(gpu, encoder, uniform, level, timing);
                }
                self.surface.encode(gpu, encoder, plan, uniform, pyramid, picture, timing)?;
            }
        }
        let stats = Stats {
            points_drawn: cut.points,
            nodes_drawn: cut.rows.len() as u32,
            ..Stats::default()
        };
        let view = frame.view.with_margin(camera.margin_px);
        feedback.end(gpu, encoder, uniform, picture, (&view, frame.method, stats));
        Ok(())
    }

    /// The newest picture as a texture, `rgba8unorm` with sRGB bytes and straight alpha, for a window. Another
    /// one after the picture's size has changed.
    pub fn texture(&self) -> Option<&TextureView> {
        self.shown.as_ref().map(|s| &s.view)
    }

    /// The newest picture and its depths; waits for it.
    ///
    /// # Errors
    /// Where memory is refused or the device has failed.
    pub fn read(&mut self) -> Result<Picture, GpuError> {
        let Some(Shown { picture, .. }) = &self.shown else { return Ok(Picture::default()) };
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
        let mut shown = Picture { stats, ..Picture::default() };
        crop(&drawn, margin_px, &mut shown);
        Ok(shown)
    }

    /// Counts and times of the newest frame that has come back; does not wait. Without times where the device
    /// has no timestamps.
    pub fn stats(&mut self) -> Option<Stats> {
        self.feedback.stats(&self.gpu)
    }

    /// The newest depth that has come back, with the view that it was seen from; does not wait.
    pub fn feedback(&mut self) -> Option<DepthFeedback> {
        self.feedback.depth(&self.gpu)
    }

    /// The room that EWA splatting has when it is first drawn with.
    pub fn set_room(&mut self, room: Room) {
        self.room = room;
    }

    /// Takes another way of EWA splatting, or other room for it.
    pub fn set_ewa(&mut self, ewa: GpuEwa) {
        self.ewa = Some(ewa);
    }

    /// The frame buffer of the newest frame and the tables that its numbers mean.
    pub fn hits(&self) -> (&Hits, &GpuCut) {
        (&self.hits, &self.cut)
    }

    /// Makes kernels anew whose shaders have changed on the disk (where [`crate::gpu::device::shader::folder`] is). Whether any has.
    ///
    /// # Errors
    /// Where a changed shader does not build; what it made before goes on.
    pub fn reload(&mut self) -> Result<bool, GpuError> {
        let gpu = &self.gpu;
        let points = match &mut self.points {
            Points::Atomics(project) => project.reload(gpu)?,
            Points::Primitives(primitives) => primitives.reload(gpu)?,
        };
        let won = self.lookup.reload(gpu)? | self.gather.reload(gpu)? | self.resolve.reload(gpu)?;
        let averages = self.average.reload(gpu)?;
        let splats = self.ewa.as_mut().map_or(Ok(false), |ewa| ewa.reload(gpu))?;
        let rest =
            self.hits.reload(gpu)? | self.surface.reload(gpu)? | self.feedback.reload(gpu)?;
        Ok(points | won | averages | splats | rest)
    }
}
