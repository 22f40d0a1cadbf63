//! The frame on the GPU from first pass to last, as its plan says: all passes in one command buffer, submitted
//! once. Nothing waits for the GPU but [`GpuRenderer::read`]. Twin: [`crate::renderer`].

use super::cut::GpuCut;
use super::device::{Counted, Gpu, ProjectPath};
use super::error::GpuError;
use super::frame::FrameUniform;
use super::hits::Hits;
use super::pool::NodePool;
use super::primitives::Primitives;
use super::project::Project;
use super::table::PlaneAt;
use super::timing::Timing;
use crate::camera::Camera;
use crate::frame::Frame;
use crate::plan::FramePlan;
use wgpu::{BufferUsages, CommandEncoder, PollType};

/// Draws frames on a GPU; keeps its buffers between them. Used by the render thread alone.
pub struct GpuRenderer {
    gpu: Gpu,
    uniform: Counted,
    cut: GpuCut,
    hits: Hits,
    points: Points,
    timing: Timing,
}

/// How points become pixels.
enum Points {
    Atomics(Project),
    Primitives(Primitives),
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
            timing: Timing::new(gpu)?,
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
        let plan = FramePlan::new(frame);
        self.hits.fit(&self.gpu, camera.size)?;
        self.cut.fill(&self.gpu, frame, &camera, &plan, pool)?;
        let uniform = FrameUniform::new(frame, &camera);
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.timing.begin();
        self.project(&mut encoder, &plan, camera.size, pool)?;
        self.timing.end(&mut encoder);
        self.gpu.queue.submit([encoder.finish()]);
        self.timing.submitted();
        // A lost device shows in its fault.
        let _ = self.gpu.device.poll(PollType::Poll);
        self.gpu.fault().map_or(Ok(()), Err)
    }

    fn project(
        &mut self,
        encoder: &mut CommandEncoder,
        plan: &FramePlan,
        size: [u32; 2],
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let Self { gpu, uniform, cut, hits, timing, .. } = self;
        match &mut self.points {
            Points::Atomics(project) => {
                project.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing);
            }
            Points::Primitives(primitives) => {
                primitives.fit(gpu, size)?;
                primitives.encode(gpu, encoder, uniform, plan, cut, pool, hits, timing);
            }
        }
        Ok(())
    }

    /// The frame buffer of the newest frame and the tables that its numbers mean.
    pub fn hits(&self) -> (&Hits, &GpuCut) {
        (&self.hits, &self.cut)
    }
}
