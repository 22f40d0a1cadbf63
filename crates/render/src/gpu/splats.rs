//! Splats of a frame on the GPU, for light: reads positions, normals, colours and radii of the
//! points of all drawn nodes from the pages of the pool, and writes them as discs in the world.
//! Points go batch by batch through the pass that fetches words ([`crate::gpu::memory::lookup`]),
//! so that memory is bounded. Twin: [`crate::inputs::splats`], with the same splats in the same
//! order.

use crate::frame::{Frame, Method};
use crate::gpu::device::dispatch::fixed_uniform;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{same_layout, sources, without_twin};
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{BINDING_BYTES_MAX, Counted, Gpu};
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::frame::FrameUniform;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::table::{CHUNK_POINTS, PlaneAt};
use crate::gpu::passes::ewa::Batch;
use crate::inputs::camera::Camera;
use crate::plan::FramePlan;
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_lod::View;
use glam::DVec3;
use wgpu::{BufferUsages, ComputePass};

without_twin!(splats_count { COUNTERS });
without_twin!(splats_make { MAKERS });

/// Bytes of a splat: place and radius, then the octahedral code of the normal and the colour.
pub const SPLAT_BYTES: u64 = 32;
/// Most splats: they fit in a binding that WebGPU guarantees.
pub const SPLATS_MAX: u64 = BINDING_BYTES_MAX / SPLAT_BYTES;
/// Chunks of a batch, whose words take 10 MB.
const BATCH_CHUNKS: u32 = 64;

/// The uniform of the eye (`shaders/splats/make.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Eye {
    place: [f32; 4],
}

same_layout!(Eye { place });

/// Splats in GPU memory.
#[derive(Debug)]
pub struct SplatBuffer {
    /// [`SPLAT_BYTES`] each: place relative to the origin and radius, the octahedral code of the
    /// normal as the bits of a float, and the colour in linear light.
    pub splats: Counted,
    /// Their number as one word; greater than [`SplatBuffer::room`] if some were left out.
    pub number: Counted,
    /// Most splats that `splats` has room for.
    pub room: u32,
}

/// Makes splats of frames.
pub struct GpuSplats {
    cut: GpuCut,
    lookup: GpuLookup,
    list: Kernel,
    /// Variants: whether a filter hides points.
    count: Variants<1>,
    scan: Kernel,
    /// Variants: whether a filter hides points, and the source of colours.
    make: Variants<2>,
}

/// Memory of a batch.
struct Words {
    hits: Counted,
    geometry: Counted,
    paint: Counted,
    /// Number of splats of each chunk, then of those before it.
    counts: Counted,
    /// Stands for the tiles of EWA splatting.
    none: Counted,
}

impl GpuSplats {
    /// Builds the kernels that all frames share.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            cut: GpuCut::new(gpu)?,
            lookup: GpuLookup::new(gpu)?,
            list: Kernel::new(gpu, sources::EWA_LIST, "main", &[])?,
            count: Variants::new(sources::SPLATS_COUNT, ["HIDES_POINTS"]),
            scan: Kernel::new(gpu, sources::SPLATS_SCAN, "main", &[])?,
            make: Variants::new(sources::SPLATS_MAKE, ["HIDES_POINTS", "COLOUR"]),
        })
    }

    /// Makes splats of all points of a frame relative to `origin` (world coordinates, the file's
    /// unit), at most [`SPLATS_MAX`], as [`crate::splats`] does. Submits the work and does not
    /// wait: planes may be overwritten by later submissions.
    ///
    /// # Errors
    /// If memory is refused or the driver refuses a shader.
    pub fn make(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_, PlaneAt>,
        pool: &NodePool,
        origin: DVec3,
    ) -> Result<SplatBuffer, GpuError> {
        let frame = &Frame { method: Method::Ewa, cull_back_faces: false, ..*frame };
        let view = View { eye: origin, parallel_at: None, ..*frame.view };
        let camera = Camera::new(&view, frame.lattice);
        let plan = FramePlan::new(frame);
        match &camera {
            Ok(camera) => self.cut.fill(gpu, frame, camera, &plan, pool)?,
            // Without a camera there are no splats, as on the CPU.
            Err(_) => self.cut = GpuCut::new(gpu)?,
        }
        let room = self.cut.points.min(SPLATS_MAX);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let made = SplatBuffer {
            splats: gpu.buffer("splats", room * SPLAT_BYTES, usage)?,
            number: gpu.buffer("number of splats", 4, usage)?,
            room: room as u32,
        };
        if let (Ok(camera), true) = (camera, room > 0) {
            self.lookup.set(gpu, frame)?;
            let eye = Eye { place: (frame.view.eye - origin).as_vec3().extend(0.0).to_array() };
            let eye = fixed_uniform(gpu, "eye", bytes_of(&eye))?;
            let uniform = FrameUniform::new(frame, &camera, [0.0; 2]);
            self.encode(gpu, (uniform, &eye), &plan, pool, &made)?;
        }
        Ok(made)
    }

    /// Submits the batches of a frame.
    fn encode(
        &mut self,
        gpu: &Gpu,
        (frame, eye): (FrameUniform, &wgpu::Buffer),
        plan: &FramePlan,
        pool: &NodePool,
        made: &SplatBuffer,
    ) -> Result<(), GpuError> {
        let chunks = self.cut.chunk_count();
        let words = Words::new(gpu, chunks.min(BATCH_CHUNKS))?;
        let points = chunks.min(BATCH_CHUNKS) * CHUNK_POINTS;
        // The points of a batch are fetched as if they were the pixels of a row.
        let row = frame.with_size([points, 1]);
        let uniform = fixed_uniform(gpu, "frame of splats", bytes_of(&row))?;
        let pages = self.cut.pages(pool, plan.fetches);
        for first in (0..chunks).step_by(BATCH_CHUNKS as usize) {
            let batch = Batch::of_points(first, chunks, points);
            let batch = fixed_uniform(gpu, "batch of splats", bytes_of(&batch))?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&Default::default());
            let list = [(0, &*batch), (1, self.cut.chunks()), (2, &words.hits)];
            let list = [&list[..], &[(3, &words.paint), (4, &words.none)]].concat();
            self.list.dispatch(&mut pass, &self.list.bind(gpu, &list), groups_of(points.into()));
            let fetched = WinningPoints {
                uniform: &uniform,
                size: [points, 1],
                hits: &words.hits,
                draws: self.cut.draws(),
                chunks: self.cut.chunks(),
                pages: &pages,
                counts: &words.none,
            };
            let to = [&*words.geometry, &*words.paint];
            self.lookup.fetch(gpu, &mut pass, &fetched, plan, to)?;
            let groups = [(chunks - first).min(BATCH_CHUNKS), 1, 1];
            let bound = [(0, &*uniform), (0, &*batch), (8, eye)];
            self.write(gpu, &mut pass, plan, (&words, made), &bound, groups)?;
            drop(pass);
            gpu.queue.submit([encoder.finish()]);
        }
        Ok(())
    }

    /// Encodes the kernels that count and write the splats of a batch.
    fn write(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        (words, made): (&Words, &SplatBuffer),
        &[frame, batch, eye]: &[(u32, &wgpu::Buffer); 3],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        let hides = u32::from(plan.hides_points);
        let bound: [(u32, &wgpu::Buffer); 5] = [
            frame,
            (2, self.cut.draws()),
            (3, &words.geometry),
            (4, &words.paint),
            (5, &words.counts),
        ];
        let count = self.count.get(gpu, [hides])?;
        count.dispatch(pass, &count.bind(gpu, &bound), groups);
        let scan = [batch, (1, &words.counts), (2, &made.number)];
        self.scan.dispatch(pass, &self.scan.bind(gpu, &scan), [1, 1, 1]);
        let [_, colour] = plan.colour_constants().map(|(_, value)| value);
        let make = self.make.get(gpu, [hides, colour])?;
        let more = [(6, self.lookup.uniform()), (7, self.lookup.octree()), eye, (9, &*made.splats)];
        make.dispatch(pass, &make.bind(gpu, &[&bound[..], &more].concat()), groups);
        Ok(())
    }
}

impl Words {
    fn new(gpu: &Gpu, chunks: u32) -> Result<Self, GpuError> {
        let points = u64::from(chunks) * u64::from(CHUNK_POINTS);
        let of = |label, bytes| gpu.buffer(label, bytes, BufferUsages::STORAGE);
        Ok(Self {
            hits: of("points of a batch", points * 8)?,
            geometry: of("places of a batch", points * 16)?,
            paint: of("colours of a batch", points * 16)?,
            counts: of("splats of chunks", u64::from(chunks) * 4)?,
            none: of("no tiles", 16)?,
        })
    }
}
