//! The passes of the GPU that turn points into single pixels, over points in its memory, and the
//! bandwidth of that memory that copies reach. Each frame is submitted and waited for; timestamps
//! time it beside the wall clock if the device has them.

use crate::draw::cloud::Cloud;
use crate::draw::frame::{Covered, Times, draw_of, frame_of};
use crate::quantile::quantile;
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

/// Bytes of each of the two buffers of a copy, more than fits in caches.
const COPY_BYTES: u64 = 128 << 20;
/// Least time of a submission of copies, milliseconds: far more than submitting it takes.
const COPY_MS: f64 = 20.0;
/// Submissions whose median is returned.
const COPIES: usize = 5;
/// Bytes that are written before they are submitted: the queue keeps a copy of them until then.
const UNSUBMITTED_MAX: u64 = 64 << 20;

/// A pass that is measured.
enum Projection {
    Project(Project),
    Primitives(Primitives),
}

/// The passes that are measured, and a cloud in the GPU's memory.
pub(super) struct OnGpu {
    gpu: Gpu,
    paths: Vec<(&'static str, Projection)>,
    uniform: Counted,
    cut: GpuCut,
    hits: Hits,
    timing: Timing,
    pool: NodePool,
    nodes: Vec<(Node, PlaneAt)>,
    /// Places of the nodes that are still to be appended.
    places: std::vec::IntoIter<PlaneAt>,
    /// Bytes written since the last submission.
    unsubmitted: u64,
    size: [u32; 2],
    plan: Option<FramePlan>,
}

/// Name of the pass that writes no pixels.
pub(super) const NO_PIXELS: &str = "atomics-no-pixels";

impl OnGpu {
    /// Makes the passes that the device supports, or `only` one of them, and memory for `cloud`.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn new(gpu: &Gpu, only: Option<ProjectPath>, cloud: &Cloud<'_>) -> Result<Self, GpuError> {
        let mut paths = Vec::new();
        if gpu.tier.path == ProjectPath::Atomics {
            paths.push(("atomics", Projection::Project(Project::new(gpu)?)));
            paths.push((NO_PIXELS, Projection::Project(Project::without_pixels(gpu)?)));
        }
        if only != Some(ProjectPath::Atomics) {
            paths.push(("primitives", Projection::Primitives(Primitives::new(gpu)?)));
        }
        let (places, bytes) = places(cloud, gpu.tier.page_bytes_max);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            paths,
            uniform: gpu.buffer("frame", size_of::<FrameUniform>() as u64, usage)?,
            cut: GpuCut::new(gpu)?,
            hits: Hits::new(gpu)?,
            timing: Timing::new(gpu)?,
            pool: NodePool::new(gpu, bytes),
            nodes: Vec::new(),
            places: places.into_iter(),
            unsubmitted: 0,
            size: [0; 2],
            plan: None,
            gpu: gpu.clone(),
        })
    }

    /// Names of the passes.
    pub fn paths(&self) -> Vec<&'static str> {
        self.paths.iter().map(|(name, _)| *name).collect()
    }

    /// Appends the cloud's next node.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn push(&mut self, node: Node, plane: &[u8]) -> Result<(), GpuError> {
        let Some(at) = self.places.next() else { return Ok(()) };
        self.pool.write(&self.gpu, at.offset, plane)?;
        self.nodes.push((node, at));
        self.unsubmitted += at.bytes;
        if self.unsubmitted > UNSUBMITTED_MAX {
            self.unsubmitted = 0;
            submit_writes(&self.gpu)?;
        }
        Ok(())
    }

    /// Sets the size of the picture, and uploads the table of nodes for it.
    ///
    /// # Errors
    /// If the view makes no valid camera, the picture is too large, or memory is refused.
    pub fn resize(&mut self, cloud: &Cloud<'_>, size: [u32; 2]) -> Result<(), GpuError> {
        let (view, lattice) = (cloud.view(size), cloud.lattice());
        let draws: Vec<_> = self.nodes.iter().map(|(node, at)| draw_of(node, *at)).collect();
        let frame = frame_of(&view, &lattice, &draws);
        let (camera, plan) = (Camera::new(&view, &lattice)?, FramePlan::new(&frame));
        self.hits.fit(&self.gpu, size)?;
        self.cut.fill(&self.gpu, &frame, &camera, &plan, &self.pool)?;
        for (_, pass) in &mut self.paths {
            if let Projection::Primitives(primitives) = pass {
                primitives.fit(&self.gpu, size)?;
            }
        }
        let uniform = FrameUniform::new(&frame, &camera, [0.0; 2]);
        self.gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        (self.size, self.plan) = (size, Some(plan));
        submit_writes(&self.gpu)
    }

    /// Draws all points once by pass `path`, an index into [`OnGpu::paths`], and waits.
    ///
    /// # Errors
    /// If the device fails.
    pub fn frame(&mut self, path: usize) -> Result<Times, GpuError> {
        let Self { gpu, paths, uniform, cut, hits, timing, pool, plan, .. } = self;
        let (Some((_, pass)), Some(plan)) = (paths.get_mut(path), plan) else {
            return Ok(Times::default());
        };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        timing.begin();
        match pass {
            Projection::Project(p) => {
                p.encode(gpu, &mut encoder, uniform, plan, cut, pool, hits, timing)?;
            }
            Projection::Primitives(p) => {
                p.encode(gpu, &mut encoder, uniform, plan, cut, pool, hits, timing);
            }
        }
        timing.end(&mut encoder);
        let commands = encoder.finish();
        let start = Instant::now();
        gpu.queue.submit([commands]);
        if let Projection::Project(p) = pass {
            p.submitted(pool);
        }
        timing.submitted();
        wait(gpu)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(Times { wall_ms, gpu_ms: timing.newest().map(|stages| stages.ms(Pass::Project)) })
    }

    /// Counts the pixels that the last frame, drawn by pass `path`, drew points to.
    ///
    /// # Errors
    /// If memory is refused or the device fails.
    pub fn covered(&self, path: usize) -> Result<Covered, GpuError> {
        let Some(hits) = self.hits.buffer().filter(|_| self.paths[path].0 != NO_PIXELS) else {
            return Ok(None);
        };
        let bytes = u64::from(self.size[0]) * u64::from(self.size[1]) * HIT_BYTES;
        let read = readback::read(&self.gpu, &[(hits, bytes)])?;
        let pixels = read[0].as_chunks::<{ HIT_BYTES as usize }>().0;
        Ok(Some(pixels.iter().filter(|&&pixel| pixel != [0xff; HIT_BYTES as usize]).count() as u64))
    }
}

/// Copies a large buffer by the driver and by a kernel, and returns the greater of both median
/// rates: bytes a second, read and written. The copies of some drivers are slower than a kernel.
///
/// # Errors
/// If memory is refused or the device fails.
pub(crate) fn copy_rate(gpu: &Gpu) -> Result<f64, GpuError> {
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

/// Median rate of `copy`, which copies `bytes`: bytes a second, read and written.
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
    // The first copies are slower: their memory is new, and the clock is low.
    copies_ms(1)?;
    let mut copies = 1;
    while copies < 1 << 12 && copies_ms(copies)? < COPY_MS {
        copies *= 2;
    }
    let rate = |ms: f64| 2.0 * bytes as f64 * f64::from(copies) / (ms * 1e-3).max(1e-9);
    let rates: Vec<f64> =
        (0..COPIES).map(|_| copies_ms(copies).map(rate)).collect::<Result<_, _>>()?;
    Ok(quantile(&rates, 0.5))
}

/// Submits what was written, and waits for it.
fn submit_writes(gpu: &Gpu) -> Result<(), GpuError> {
    gpu.queue.submit([]);
    wait(gpu)
}

/// Waits until everything that was submitted is done.
///
/// # Errors
/// If the device fails.
pub(crate) fn wait(gpu: &Gpu) -> Result<(), GpuError> {
    let waited = gpu.device.poll(PollType::wait_indefinitely());
    waited.map_err(|e| gpu.fault().unwrap_or(GpuError::Lost(e.to_string())))?;
    gpu.fault().map_or(Ok(()), Err)
}

/// Places the nodes of a cloud one after another, none across the end of a page, and returns the
/// end of the last one as well.
fn places(cloud: &Cloud<'_>, page_bytes: u64) -> (Vec<PlaneAt>, u64) {
    /// Alignment of bound ranges, bytes.
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
            drawn.paths().iter().position(|&path| path == "atomics"),
            drawn.paths().iter().position(|&path| path == NO_PIXELS),
        ) else {
            eprintln!("no 64-bit atomics");
            return;
        };
        // Without a node a frame clears the pixels.
        drawn.resize(&cloud, [64, 64]).unwrap();
        drawn.frame(atomics).unwrap();
        assert_eq!(drawn.covered(atomics).unwrap(), Some(0));
        cloud.each(&Silent, |node, plane| Ok(drawn.push(node, &plane)?)).unwrap();
        drawn.resize(&cloud, [64, 64]).unwrap();
        drawn.frame(no_pixels).unwrap();
        assert_eq!(drawn.covered(atomics).unwrap(), Some(0));
        drawn.frame(atomics).unwrap();
        assert!(drawn.covered(atomics).unwrap() > Some(1_000));
    }
}
