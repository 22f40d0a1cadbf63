//! Drawing on a GPU: loaders fill mapped upload runs. For each frame the render thread writes one
//! list of commands, which copies the runs into the pool of node planes and draws the cut, and
//! submits it once. It waits for the GPU only if two frames are in flight.

use super::{FrameInput, GpuBytes, Image, Painter, report_complete};
use crate::draw::budget::GpuShares;
use crate::draw::method::Method;
use crate::draw::options::Options;
use crate::draw::staging::{GpuRun, Landed, RUN_BYTES, Staging};
use crate::light::progressive::GpuProgressive;
use crate::light::status::LitStatus;
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_lod::DepthFeedback;
use esker_render::gpu::device::shader::folder;
use esker_render::gpu::wgpu::{CommandEncoder, PollType};
use esker_render::gpu::{Gpu, GpuError, GpuRenderer, NodePool, PlaneAt, UploadRing};
use esker_render::{Picture, Stats};
use esker_stream::{Shown, Slot, StreamError, Streamer, Transfer};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::AcqRel, Ordering::Acquire};
use std::time::{Duration, Instant};

/// Most bytes of a point in the longest plane that is drawn from.
const MADE_POINT_BYTES: u64 = 16;

/// Most frames in flight when the next one begins.
const FLYING_MAX: usize = 2;
/// A frame that takes longer means that the GPU is lost.
const FRAME_PATIENCE: Duration = Duration::from_secs(20);
/// Interval of checks for shaders that have changed on the disk.
const SHADER_INTERVAL: Duration = Duration::from_secs(1);
/// Interval of checks for finished frames.
const NAP: Duration = Duration::from_micros(200);

/// The GPU renderer and its memory.
pub(crate) struct GpuPainter {
    gpu: Gpu,
    landing: Arc<Staging<GpuRun>>,
    ring: UploadRing,
    landed: Vec<Landed<GpuRun>>,
    /// Transfers that were copied and not reported yet.
    copied: Vec<Vec<Transfer>>,
    /// Transfers that go back with the runs that are mapped next.
    spent: Vec<Vec<Transfer>>,
    pool: NodePool,
    /// Shares of the budget that it was made for.
    shares: GpuShares,
    renderer: GpuRenderer,
    /// Copies that are not submitted yet.
    commands: Option<CommandEncoder>,
    flying: Arc<AtomicUsize>,
    stats: Stats,
    /// Drawer of lit frames, once there is one, and its last picture.
    lit: Option<(GpuProgressive, Picture)>,
    shaders_checked: Instant,
    shader_fault: Option<String>,
}

impl GpuPainter {
    /// A painter on `gpu`, within the budget of `options`.
    ///
    /// # Errors
    /// If the budget is too small (the message has the smallest possible one), or the GPU refuses
    /// memory or a shader.
    pub(crate) fn new(gpu: Gpu, file: &Forest, options: &Options) -> Result<Self> {
        let shares = GpuShares::of(file, options)?;
        let mut renderer = GpuRenderer::new(&gpu)?;
        renderer.set_batch_capacity(shares.batch);
        let runs = UploadRing::runs(&gpu, shares.runs)?.into_iter().map(GpuRun).collect();
        // A small file needs no large page. Pages that are made are larger than what they are of.
        let made_bytes = if file.is_growing() { file.points() * MADE_POINT_BYTES } else { 0 };
        let page_bytes = file.file_bytes().max(made_bytes).next_power_of_two();
        Ok(Self {
            landing: Arc::new(Staging::new(runs)),
            ring: UploadRing::default(),
            landed: Vec::new(),
            copied: Vec::new(),
            spent: Vec::new(),
            pool: NodePool::with_pages(&gpu, shares.pool_bytes, page_bytes),
            shares,
            renderer,
            commands: None,
            flying: Arc::default(),
            stats: Stats::default(),
            lit: None,
            shaders_checked: Instant::now(),
            shader_fault: None,
            gpu,
        })
    }

    /// Frees the runs that are mapped again.
    fn recycle(&mut self) -> Result<(), GpuError> {
        let Self { gpu, landing, ring, spent, .. } = self;
        ring.ready(gpu, |run| landing.free(GpuRun(run), spent.pop().unwrap_or_default()))
    }

    /// Requests, after a submission, that its runs are mapped again, and counts the frame until it
    /// is finished.
    fn submitted(&mut self) -> Result<(), GpuError> {
        self.ring.map();
        self.flying.fetch_add(1, AcqRel);
        let flying = Arc::clone(&self.flying);
        self.gpu.queue.on_submitted_work_done(move || {
            flying.fetch_sub(1, AcqRel);
        });
        self.gpu.fault().map_or(Ok(()), Err)
    }

    /// Reloads shaders that have changed on the disk, if reloading is on.
    fn reload_shaders(&mut self) {
        if folder().is_none() || self.shaders_checked.elapsed() < SHADER_INTERVAL {
            return;
        }
        self.shaders_checked = Instant::now();
        match self.renderer.reload() {
            Ok(false) => {}
            Ok(true) => self.shader_fault = None,
            Err(fault) => self.shader_fault = Some(fault.to_string()),
        }
    }

    /// Waits until few enough frames are in flight.
    fn wait_for_frames(&self) -> Result<(), GpuError> {
        let start = Instant::now();
        while self.flying.load(Acquire) >= FLYING_MAX {
            // An error here is recorded as the fault of the GPU.
            let _ = self.gpu.device.poll(PollType::Poll);
            if self.flying.load(Acquire) < FLYING_MAX {
                break;
            }
            self.gpu.fault().map_or(Ok(()), Err)?;
            if start.elapsed() > FRAME_PATIENCE {
                let waited = FRAME_PATIENCE.as_secs();
                return Err(GpuError::Lost(format!("a frame has not ended within {waited} s")));
            }
            std::thread::sleep(NAP);
        }
        Ok(())
    }
}

impl GpuPainter {
    /// Draws a lit frame, and waits for it: its scene is a copy of the points of the pool.
    fn draw_lit(&mut self, input: &FrameInput<'_>) -> Result<()> {
        self.flush()?;
        let FrameInput { file, view, cut, appearance, light, splats_max } = *input;
        let plane = |slot: Slot| PlaneAt { offset: slot.offset, bytes: slot.bytes };
        let mut draws = input.draws(plane);
        draws.extend(input.draws_around(plane));
        let octree = cut.surroundings.as_ref().map_or(&cut.octree, |around| &around.octree);
        let frame = appearance.frame(file, view, &draws, octree);
        let (lit, picture) = match &mut self.lit {
            Some(lit) => lit,
            empty => {
                let lit = GpuProgressive::on_gpu(&self.gpu, light, splats_max)?;
                empty.insert((lit, Picture::default()))
            }
        };
        lit.draw(&frame, &self.pool, cut.epoch, light, picture)?;
        self.stats = picture.stats;
        self.gpu.fault().map_or(Ok(()), |fault| Err(fault.into()))
    }
}

impl Painter for GpuPainter {
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        shown: Shown,
    ) -> Result<Streamer, StreamError> {
        let (drawing_bytes, page_bytes) = (self.pool.bytes(), self.pool.page_bytes());
        let options = esker_stream::Options { drawing_bytes, page_bytes, ..options };
        Streamer::start(file, self.landing.clone(), options, shown)
    }

    fn bytes_within(&self, budget_gpu_bytes: u64) -> Option<u64> {
        // What else the budget holds stays as large as it is.
        let taken = self.shares.picture_bytes + self.shares.runs as u64 * RUN_BYTES as u64;
        let taken = taken + self.shares.splats_bytes();
        let pool_bytes = NodePool::bytes_within(budget_gpu_bytes.checked_sub(taken)?);
        if pool_bytes - pool_bytes % Slot::ALIGNMENT == self.pool.bytes() {
            return Some(self.pool.bytes());
        }
        // A page is one buffer, so that whole pages are freed.
        let page_bytes = self.pool.page_bytes();
        let pages_bytes = pool_bytes - pool_bytes % page_bytes;
        let may_change = pages_bytes > 0 && pool_bytes <= self.pool.bytes();
        may_change.then_some(pages_bytes)
    }

    fn resize(&mut self, _: u64) {
        // Pages are allocated when they are written, and freed by `free_beyond`.
    }

    fn free_beyond(&mut self, bytes: u64) {
        self.pool.free_beyond(bytes);
    }

    fn drain(&mut self, bytes_max: usize) {
        self.landed.extend(self.landing.take_up_to(bytes_max));
    }

    fn upload(&mut self) -> Result<u64> {
        self.gpu.fault().map_or(Ok(()), Err)?;
        self.recycle()?;
        let Self { gpu, ring, landed, copied, pool, commands, .. } = self;
        let mut uploaded_bytes = 0;
        for (run, transfers) in landed.drain(..) {
            let commands = commands
                .get_or_insert_with(|| gpu.device.create_command_encoder(&Default::default()));
            let buffer = ring.unmap(run.0);
            for t in &transfers {
                let to = t.slot.offset + t.slot_offset;
                pool.copy_from(gpu, commands, buffer, t.run_offset as u64, to, t.bytes as u64)?;
                uploaded_bytes += t.bytes as u64;
            }
            copied.push(transfers);
        }
        Ok(uploaded_bytes)
    }

    fn report_uploaded(&mut self, uploaded: &mut dyn FnMut(u64)) {
        for transfers in self.copied.drain(..) {
            report_complete(&transfers, uploaded);
            self.spent.push(transfers);
        }
    }

    fn flush(&mut self) -> Result<()> {
        if let Some(commands) = self.commands.take() {
            self.gpu.queue.submit([commands.finish()]);
            self.submitted()?;
        }
        Ok(())
    }

    fn draw(&mut self, input: &FrameInput<'_>) -> Result<()> {
        self.wait_for_frames()?;
        self.reload_shaders();
        if input.appearance.method == Method::Lit {
            return self.draw_lit(input);
        }
        let FrameInput { file, view, cut, appearance, .. } = *input;
        let draws = input.draws(|slot| PlaneAt { offset: slot.offset, bytes: slot.bytes });
        let frame = appearance.frame(file, view, &draws, &cut.octree);
        let commands = self.commands.take();
        let commands =
            commands.unwrap_or_else(|| self.gpu.device.create_command_encoder(&Default::default()));
        self.renderer.render_after(commands, &frame, &self.pool)?;
        self.submitted()?;
        self.stats = self.renderer.stats().unwrap_or(self.stats);
        Ok(())
    }

    fn image(&self) -> Option<Image<'_>> {
        match &self.lit {
            Some((_, picture)) => (!picture.rgba.is_empty()).then_some(Image::Memory(picture)),
            None => self.renderer.texture().map(Image::Texture),
        }
    }

    fn stats(&self) -> Stats {
        self.stats
    }

    fn feedback(&mut self) -> Option<DepthFeedback> {
        // Nodes that are hidden still cast light and shadows.
        if self.lit.is_some() { None } else { self.renderer.feedback() }
    }

    fn feedback_frames(&self) -> u32 {
        if self.lit.is_some() { 0 } else { FLYING_MAX as u32 + 1 }
    }

    fn light(&self) -> Option<LitStatus> {
        self.lit.as_ref().map(|(lit, _)| lit.status())
    }

    fn is_converged(&self) -> bool {
        self.lit.as_ref().is_none_or(|(lit, _)| lit.is_converged())
    }

    fn picture(&mut self) -> Result<Picture> {
        if let Some((_, picture)) = &self.lit {
            return Ok(picture.clone());
        }
        self.renderer.texture().context("no frame has been drawn")?;
        Ok(self.renderer.read()?)
    }

    fn gpu_bytes(&self) -> Option<GpuBytes> {
        let bytes = self.gpu.bytes();
        let fixed_bytes = bytes.saturating_sub(self.pool.taken_bytes());
        Some(GpuBytes { bytes, peak_bytes: self.gpu.peak_bytes(), fixed_bytes })
    }

    fn shader_fault(&self) -> Option<&str> {
        self.shader_fault.as_deref()
    }

    fn close(&self) {
        self.landing.close();
    }
}
