//! The drawing rate of the GPU's passes from points to single pixels, over points that lie in its memory, and
//! the bandwidth of that memory as copies reach it. Every frame is submitted and waited for; where the device has
//! timestamps, they time it beside the clock on the wall.

use super::{Covered, Times};
use crate::draw::cloud::Cloud;
use crate::draw::cpu::{draw_of, frame_of};
use esker_points::Node;
use esker_points::quant::HOT_POSITION_BYTES;
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::kernel::{Kernel, groups_of};
use esker_render::gpu::device::readback;
use esker_render::gpu::device::shader::sources;
use esker_render::gpu::device::timing::Timing;
use esker_render::gpu::memory::cut::GpuCut;
use esker_render::gpu::memory::frame::FrameUniform;
use esker_render::gpu::memory::hits::{HIT_BYTES, Hits};
use esker_render::gpu::passes::primitives::Primitives;
use esker_render::gpu::passes::project::Project;
use esker_render::gpu::wgpu::{BufferUsages, CommandEncoder, PollType};
use esker_render::gpu::{Gpu, GpuError, NodePool, PlaneAt, ProjectPath};
use esker_render::inputs::camera::Camera;
use esker_render::{FramePlan, Pass};
use std::time::Instant;

/// Bytes of each of the two buffers of a copy: more than caches hold.
const COPY_BYTES: u64 = 128 << 20;
/// A submission of copies takes at least so long that submitting it does not count.
const COPY_MS: f64 = 20.0;
/// Submissions that the median is taken of.
const COPIES: usize = 5;
/// Bytes that are sent before the queue is told to take them: it keeps a copy until then.
const SENT_MAX: u64 = 64 << 20;

/// A pass that is measured.
enum Way {
    Project(Project),
    Primitives(Primitives),
}

/// The passes, and a cloud in the GPU's memory.
pub struct OnGpu {
    gpu: Gpu,
    ways: Vec<(&'static str, Way)>,
    uniform: Counted,
    cut: GpuCut,
    hits: Hits,
    timing: Timing,
    pool: NodePool,
    nodes: Vec<(Node, PlaneAt)>,
    places: std::vec::IntoIter<PlaneAt>,
    sent: u64,
    size: [u32; 2],
    plan: Option<FramePlan>,
}

/// What the pass without its frame buffer is called.
pub const NO_PIXELS: &str = "atomics-no-pixels";

impl OnGpu {
    /// The passes that the device has, or the one that `only` names; and memory for a cloud.
    ///
    /// # Errors
    /// Where the driver refuses a shader, or memory.
    pub fn new(gpu: &Gpu, only: Option<ProjectPath>, cloud: &Cloud<'_>) -> Result<Self, GpuError> {
        let mut ways = Vec::new();
        if gpu.tier.path == ProjectPath::Atomics {
            ways.push(("atomics", Way::Project(Project::new(gpu)?)));
            ways.push((NO_PIXELS, Way::Project(Project::without_pixels(gpu)?)));
        }
        if only != Some(ProjectPath::Atomics) {
            ways.push(("primitives", Way::Primitives(Primitives::new(gpu)?)));
        }
        let (places, bytes) = places(cloud, gpu.tier.page_bytes_max);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            ways,
            uniform: gpu.buffer("frame", size_of::<FrameUniform>() as u64, usage)?,
            cut: GpuCut::new(gpu)?,
            hits: Hits::new(gpu)?,
            timing: Timing::new(gpu)?,
            pool: NodePool::new(gpu, bytes),
            nodes: Vec::new(),
            places: places.into_iter(),
            sent: 0,
            size: [0; 2],
            plan: None,
            gpu: gpu.clone(),
        })
    }

    /// Names of its passes.
    pub fn ways(&self) -> Vec<&'static str> {
        self.ways.iter().map(|(name, _)| *name).collect()
    }

    /// Takes the cloud's next node.
    ///
    /// # Errors
    /// Where memory is refused.
    pub fn push(&mut self, node: Node, plane: &[u8]) -> Result<(), GpuError> {
        let Some(at) = self.places.next() else { return Ok(()) };
        self.pool.write(&self.gpu, at.offset, plane)?;
        self.nodes.push((node, at));
        self.sent += at.bytes;
        if self.sent > SENT_MAX {
            self.sent = 0;
            send(&self.gpu)?;
        }
        Ok(())
    }

    /// Takes the size of the picture, and lists the nodes for it.
    ///
    /// # Errors
    /// Where the view is no usable camera or too large, or memory is refused.
    pub fn fit(&mut self, cloud: &Cloud<'_>, size: [u32; 2]) -> Result<(), GpuError> {
        let (view, lattice) = (cloud.view(size), cloud.lattice());
        let draws: Vec<_> = self.nodes.iter().map(|(node, at)| draw_of(node, *at)).collect();
        let frame = frame_of(&view, &lattice, &draws);
        let (camera, plan) = (Camera::new(&view, &lattice)?, FramePlan::new(&frame));
        self.hits.fit(&self.gpu, size)?;
        self.cut.fill(&self.gpu, &frame, &camera, &plan, &self.pool)?;
        for (_, way) in &mut self.ways {
            if let Way::Primitives(primitives) = way {
                primitives.fit(&self.gpu, size)?;
            }
        }
        let uniform = FrameUniform::new(&frame, &camera);
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        (self.size, self.plan) = (size, Some(plan));
        send(&self.gpu)
    }

    /// Draws all points once by one of [`OnGpu::ways`], and waits.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn frame(&mut self, way: usize) -> Result<Times, GpuError> {
        let Self { gpu, ways, uniform, cut, hits, timing, pool, plan, .. } = self;
        let (Some((_, way)), Some(plan)) = (ways.get_mut(way), plan) else {
            return Ok(Times::default());
        };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        timing.begin();
        match way {
            Way::Project(p) => {
                p.encode(gpu, &mut encoder, uniform, plan, cut, pool, hits, timing)?;
            }
            Way::Primitives(p) => {
                p.encode(gpu, &mut encoder, uniform, plan, cut, pool, hits, timing);
            }
        }
        timing.end(&mut encoder);
        let commands = encoder.finish();
        let start = Instant::now();
        gpu.queue.submit([commands]);
        if let Way::Project(p) = way {
            p.submitted(pool);
        }
        timing.submitted();
        wait(gpu)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(Times { wall_ms, gpu_ms: timing.newest().map(|stages| stages.ms(Pass::Project)) })
    }

    /// Pixels that the last frame drew points on; of no frame that has no pixels.
    ///
    /// # Errors
    /// Where memory is refused or the device fails.
    pub fn covered(&self, way: usize) -> Result<Covered, GpuError> {
        let Some(hits) = self.hits.buffer().filter(|_| self.ways[way].0 != NO_PIXELS) else {
            return Ok(None);
        };
        let bytes = u64::from(self.size[0]) * u64::from(self.size[1]) * HIT_BYTES;
        let read = readback::read(&self.gpu, &[(hits, bytes)])?;
        let pixels = read[0].as_chunks::<{ HIT_BYTES as usize }>().0;
        Ok(Some(pixels.iter().filter(|&&pixel| pixel != [0xff; HIT_BYTES as usize]).count() as u64))
    }
}

/// Bytes a second, read and written, of copying a large buffer to another, by the driver or by a kernel, whichever is
/// faster (an H100's driver copies at 0.84 TB/s, which its kernels exceed): a median.
///
/// # Errors
/// Where memory is refused or the device fails.
pub fn copy_rate(gpu: &Gpu) -> Result<f64, GpuError> {
    let bytes = COPY_BYTES.min(gpu.device.limits().max_storage_buffer_binding_size);
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
    let source = gpu.buffer("copied from", bytes, usage)?;
    let target = gpu.buffer("copied to", bytes, usage)?;
    let kernel = Kernel::new(gpu, sources::BENCH_COPY, "main", &[])?;
    let bind = kernel.bind(gpu, &[(0, &source), (1, &target)]);
    let by_driver = rate_of(gpu, bytes, |encoder| {
        encoder.copy_buffer_to_buffer(&source, 0, &target, 0, bytes);
    })?;
    let by_kernel = rate_of(gpu, bytes, |encoder| {
        kernel.dispatch(
            &mut encoder.begin_compute_pass(&Default::default()),
            &bind,
            groups_of(bytes / 16),
        );
    })?;
    Ok(by_driver.max(by_kernel))
}

/// Bytes a second of a copy of so many.
fn rate_of(gpu: &Gpu, bytes: u64, copy: impl Fn(&mut CommandEncoder)) -> Result<f64, GpuError> {
    let copies_ms = |copies: u32| -> Result<f64, GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        (0..copies).for_each(|_| copy(&mut encoder));
        let commands = encoder.finish();
        let start = Instant::now();
        gpu.queue.submit([commands]);
        wait(gpu)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    };
    // The first ones pay for fresh memory and a clock that is low.
    copies_ms(1)?;
    let mut copies = 1;
    while copies < 1 << 12 && copies_ms(copies)? < COPY_MS {
        copies *= 2;
    }
    let rate = |ms: f64| 2.0 * bytes as f64 * f64::from(copies) / (ms * 1e-3).max(1e-9);
    let rates: Vec<f64> =
        (0..COPIES).map(|_| copies_ms(copies).map(rate)).collect::<Result<_, _>>()?;
    Ok(crate::flight::quantile(&rates, 0.5))
}

/// Submits what was written, and waits for it.
fn send(gpu: &Gpu) -> Result<(), GpuError> {
    gpu.queue.submit([]);
    wait(gpu)
}

/// Waits for all that was submitted.
pub fn wait(gpu: &Gpu) -> Result<(), GpuError> {
    let waited = gpu.device.poll(PollType::wait_indefinitely());
    waited.map_err(|e| gpu.fault().unwrap_or(GpuError::Lost(e.to_string())))?;
    gpu.fault().map_or(Ok(()), Err)
}

/// Places of a cloud's nodes one after another, none over a page's end; and the bytes of all.
fn places(cloud: &Cloud<'_>, page_bytes: u64) -> (Vec<PlaneAt>, u64) {
    /// What GPUs ask of bound ranges.
    const ALIGNMENT: u64 = 256;
    let mut end = 0;
    let of = |node| {
        let bytes = cloud.points_of(node) * HOT_POSITION_BYTES as u64;
        let left = page_bytes - end % page_bytes;
        let offset = if bytes > left { end + left } else { end };
        end = (offset + bytes).next_multiple_of(ALIGNMENT);
        PlaneAt { offset, bytes }
    };
    let places = (0..cloud.nodes()).map(of).collect();
    (places, end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::cloud::Order;
    use esker_points::task::Silent;
    use esker_render::gpu::GpuRequest;

    #[test]
    fn the_pass_without_pixels_leaves_them_as_they_are() {
        let Ok(gpu) = Gpu::open(&GpuRequest { allow_software: true, ..GpuRequest::default() })
        else {
            eprintln!("no adapter");
            return;
        };
        let cloud = Cloud::Ground(5_000, Order::Morton);
        let mut drawn = OnGpu::new(&gpu, None, &cloud).unwrap();
        let (Some(atomics), Some(no_pixels)) = (
            drawn.ways().iter().position(|&way| way == "atomics"),
            drawn.ways().iter().position(|&way| way == NO_PIXELS),
        ) else {
            eprintln!("no 64-bit atomics");
            return;
        };
        // Without a node a frame clears the pixels.
        drawn.fit(&cloud, [64, 64]).unwrap();
        drawn.frame(atomics).unwrap();
        assert_eq!(drawn.covered(atomics).unwrap(), Some(0));
        cloud.each(&Silent, |node, plane| Ok(drawn.push(node, &plane)?)).unwrap();
        drawn.fit(&cloud, [64, 64]).unwrap();
        drawn.frame(no_pixels).unwrap();
        assert_eq!(drawn.covered(atomics).unwrap(), Some(0));
        drawn.frame(atomics).unwrap();
        assert!(drawn.covered(atomics).unwrap() > Some(1_000));
    }
}
