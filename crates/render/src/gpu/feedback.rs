//! Results of a frame that reach the host some frames later: counts, times, and the depth tiles by
//! which the LOD thread finds hidden nodes. They are copied after the frame's passes, and polled,
//! never waited for.

use crate::frame::{Method, Stats};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::readback::ReadbackRing;
use crate::gpu::device::shader::sources;
use crate::gpu::device::timing::Timing;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::passes::tiles::{TILES_BYTES, Tiles, tiles_from};
use esker_lod::{DepthFeedback, View};
use wgpu::{BufferUsages, CommandEncoder, PollType};

/// Bytes of the four counts.
const COUNTS_BYTES: u64 = 16;

/// Counts, times and depth tiles of frames.
pub struct Feedback {
    /// Four words: pixels with a winning point, pixels that show a surface, splats drawn, splats
    /// dropped.
    pub counts: Counted,
    /// Times of the passes.
    pub timing: Timing,
    count: Kernel,
    tiles: Tiles,
    counts_ring: ReadbackRing<Stats>,
    tiles_ring: ReadbackRing<View>,
    stats: Option<Stats>,
    newest: Option<DepthFeedback>,
}

impl Feedback {
    /// Creates buffers and kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        Ok(Self {
            counts: gpu.buffer("counts", COUNTS_BYTES, usage)?,
            timing: Timing::new(gpu)?,
            count: Kernel::new(gpu, sources::PICTURE_COUNT, "main", &[])?,
            tiles: Tiles::new(gpu)?,
            counts_ring: ReadbackRing::new(gpu, "counts read back", COUNTS_BYTES)?,
            tiles_ring: ReadbackRing::new(gpu, "tiles read back", TILES_BYTES)?,
            stats: None,
            newest: None,
        })
    }

    /// Begins a frame, before its passes.
    pub fn begin(&mut self, encoder: &mut CommandEncoder) {
        self.timing.begin();
        encoder.clear_buffer(&self.counts, 0, None);
    }

    /// Ends a frame, after its passes: counts the pixels of `picture` and encodes the copies.
    /// `stats` has the counts that the host already knows.
    pub fn end(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        uniform: &wgpu::Buffer,
        picture: &GpuPicture,
        (view, method, stats): (&View, Method, Stats),
    ) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        if method != Method::Points {
            let buffers = [(0, uniform), (1, &*picture.depth), (2, &*self.counts)];
            let pixels = u64::from(picture.width) * u64::from(picture.height);
            self.count.dispatch(&mut pass, &self.count.bind(gpu, &buffers), groups_of(pixels));
        }
        if self.tiles_ring.has_room() {
            self.tiles.encode(gpu, &mut pass, uniform, &picture.depth);
        }
        drop(pass);
        self.counts_ring.copy(encoder, &self.counts, COUNTS_BYTES, stats);
        self.tiles_ring.copy(encoder, self.tiles.buffer(), TILES_BYTES, *view);
        self.timing.end(encoder);
    }

    /// To be called after the submission of the frame.
    pub fn submitted(&mut self, gpu: &Gpu) {
        self.counts_ring.submitted();
        self.tiles_ring.submitted();
        self.timing.submitted();
        self.arrive(gpu);
    }

    /// Polls the device and takes the copies that have arrived.
    fn arrive(&mut self, gpu: &Gpu) {
        // `Gpu::fault` reports a lost device.
        let _ = gpu.device.poll(PollType::Poll);
        if let Some((stats, bytes)) = self.counts_ring.newest() {
            let counts: &[u32] = bytemuck::try_cast_slice(&bytes).unwrap_or(&[0; 4]);
            self.stats = Some(Stats {
                splats_drawn: u64::from(counts[2]),
                splats_dropped: u64::from(counts[3]),
                pixels_projected: u64::from(counts[0]),
                pixels_covered: u64::from(counts[1]),
                ..stats
            });
        }
        if let (Some(stages), Some(stats)) = (self.timing.newest(), &mut self.stats) {
            stats.stages = stages;
        }
        if let Some((view, bytes)) = self.tiles_ring.newest() {
            self.newest = DepthFeedback::new(&view, &tiles_from(&bytes));
        }
    }

    /// Counts and times of the newest frame whose counts have arrived; the times are zero if the
    /// device has no timestamps.
    pub fn stats(&mut self, gpu: &Gpu) -> Option<Stats> {
        self.arrive(gpu);
        self.stats
    }

    /// The newest depth tiles, if they have arrived since the last call.
    pub fn depth(&mut self, gpu: &Gpu) -> Option<DepthFeedback> {
        self.arrive(gpu);
        self.newest.take()
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        Ok(self.count.reload(gpu)? | self.tiles.reload(gpu)?)
    }
}
