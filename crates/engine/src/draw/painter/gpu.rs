//! Drawing on a GPU: loaders fill mapped upload runs, the render thread writes one list of commands
//! a frame that copies them into the pool of node planes and draws the cut, and submits it once. It
//! waits for the GPU only where two frames are in flight already.

use super::{GpuBytes, Image, Painter, Scene};
use crate::draw::budget::GpuShares;
use crate::draw::frame::draw_node;
use crate::draw::options::Options;
use crate::draw::staging::{GpuRun, Landed, RUN_BYTES, Staging};
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_lod::DepthFeedback;
use esker_render::gpu::device::shader::folder;
use esker_render::gpu::wgpu::{CommandEncoder, PollType};
use esker_render::gpu::{Gpu, GpuError, GpuRenderer, NodePool, PlaneAt, UploadRing};
use esker_render::{Picture, Stats};
use esker_stream::{Needs, StreamError, Streamer, Transfer};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::AcqRel, Ordering::Acquire};
use std::time::{Duration, Instant};

/// Frames that may be in flight when the next one is begun.
const FLYING_MAX: usize = 2;
/// How long a frame may take until the GPU counts as lost.
const FRAME_PATIENCE: Duration = Duration::from_secs(20);
/// Between two looks whether a shader has changed on the disk.
const SHADER_LOOK: Duration = Duration::from_secs(1);
/// Between two looks whether a frame has finished.
const NAP: Duration = Duration::from_micros(200);

/// The GPU renderer and its memory.
pub(crate) struct GpuPainter {
    gpu: Gpu,
    landing: Arc<Staging<GpuRun>>,
    ring: UploadRing,
    landed: Vec<Landed<GpuRun>>,
    /// What was copied; to be told of.
    copied: Vec<Vec<Transfer>>,
    /// The lists of the runs that are mapped again go back with them.
    spent: Vec<Vec<Transfer>>,
    pool: NodePool,
    renderer: GpuRenderer,
    /// Copies that are not submitted yet.
    commands: Option<CommandEncoder>,
    flying: Arc<AtomicUsize>,
    stats: Stats,
    looked_at_shaders: Instant,
    shader_fault: Option<String>,
}

impl GpuPainter {
    /// On this device, with what the options allow.
    ///
    /// # Errors
    /// Where the budget is too small (the least is told), or the GPU refuses memory or a shader.
    pub(crate) fn new(gpu: Gpu, file: &Forest, options: &Options) -> Result<Self> {
        let shares = GpuShares::of(file, options)?;
        let mut renderer = GpuRenderer::new(&gpu)?;
        renderer.set_batch_capacity(shares.room);
        let runs = UploadRing::runs(&gpu, shares.runs)?.into_iter().map(GpuRun).collect();
        // A small file shall not take a large page.
        let page_bytes = file.file_bytes().next_power_of_two();
        Ok(Self {
            landing: Arc::new(Staging::new(runs)),
            ring: UploadRing::default(),
            landed: Vec::new(),
            copied: Vec::new(),
            spent: Vec::new(),
            pool: NodePool::with_pages(&gpu, shares.pool_bytes, page_bytes),
            renderer,
            commands: None,
            flying: Arc::default(),
            stats: Stats::default(),
            looked_at_shaders: Instant::now(),
            shader_fault: None,
            gpu,
        })
    }

    /// Frees the runs that are mapped again.
    fn recycle(&mut self) -> Result<(), GpuError> {
        let Self { gpu, landing, ring, spent, .. } = self;
        ring.ready(gpu, |run| landing.free(GpuRun(run), spent.pop().unwrap_or_default()))
    }

    /// After a submission: asks for what it read to be mapped again, and counts it until it is
    /// done.
    fn submitted(&mut self) -> Result<(), GpuError> {
        self.ring.map();
        self.flying.fetch_add(1, AcqRel);
        let flying = Arc::clone(&self.flying);
        self.gpu.queue.on_submitted_work_done(move || {
            flying.fetch_sub(1, AcqRel);
        });
        self.gpu.fault().map_or(Ok(()), Err)
    }

    /// Takes shaders that have changed on the disk, where developers have them reloaded.
    fn look_at_shaders(&mut self) {
        if folder().is_none() || self.looked_at_shaders.elapsed() < SHADER_LOOK {
            return;
        }
        self.looked_at_shaders = Instant::now();
        match self.renderer.reload() {
            Ok(false) => {}
            Ok(true) => self.shader_fault = None,
            Err(fault) => self.shader_fault = Some(fault.to_string()),
        }
    }

    /// Waits until few enough frames are in flight.
    fn make_room(&self) -> Result<(), GpuError> {
        let start = Instant::now();
        while self.flying.load(Acquire) >= FLYING_MAX {
            // What fails here shows in the fault.
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

impl Painter for GpuPainter {
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        needs: Needs,
    ) -> Result<Streamer, StreamError> {
        let (drawing_bytes, page_bytes) = (self.pool.bytes(), self.pool.page_bytes());
        let options = esker_stream::Options { drawing_bytes, page_bytes, ..options };
        Streamer::start(file, self.landing.clone(), options, needs)
    }

    fn drain(&mut self, bytes_max: usize) {
        let runs = (bytes_max / RUN_BYTES).max(1);
        self.landed.extend(std::iter::from_fn(|| self.landing.take()).take(runs));
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

    fn tell(&mut self, uploaded: &mut dyn FnMut(u64)) {
        for transfers in self.copied.drain(..) {
            transfers.iter().filter_map(|t| t.request).for_each(&mut *uploaded);
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

    fn draw(&mut self, scene: &Scene<'_>) -> Result<()> {
        self.make_room()?;
        self.look_at_shaders();
        let Scene { file, view, cut, look } = *scene;
        let draws: Vec<_> = cut
            .nodes
            .iter()
            .enumerate()
            .map(|(entry, n)| {
                let node = &file.table().nodes[n.node as usize];
                let at = |kind| {
                    n.slot(kind).map(|slot| PlaneAt { offset: slot.offset, bytes: slot.bytes })
                };
                draw_node(node, entry, n.prefix, &look.colouring, at)
            })
            .collect();
        let frame = look.frame(file, view, &draws, &cut.octree);
        let commands = self.commands.take();
        let commands =
            commands.unwrap_or_else(|| self.gpu.device.create_command_encoder(&Default::default()));
        self.renderer.render_after(commands, &frame, &self.pool)?;
        self.submitted()?;
        self.stats = self.renderer.stats().unwrap_or(self.stats);
        Ok(())
    }

    fn image(&self) -> Option<Image<'_>> {
        self.renderer.texture().map(Image::Texture)
    }

    fn stats(&self) -> Stats {
        self.stats
    }

    fn feedback(&mut self) -> Option<DepthFeedback> {
        self.renderer.feedback()
    }

    fn feedback_frames(&self) -> u32 {
        FLYING_MAX as u32 + 1
    }

    fn picture(&mut self) -> Result<Picture> {
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
