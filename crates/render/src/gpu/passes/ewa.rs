//! EWA splatting on the GPU: turns the points into splats batch by batch, so that memory is
//! bounded, sorts the splats of a batch into tiles of 16 x 16 pixels, and blends them: a workgroup
//! a tile, a thread a pixel, sums in registers. In the first sweep over the batches each pixel
//! finds its front surface, in the second it sums attributes; a frame of one batch makes its splats
//! once.
//!
//! Tiles are used, not instanced quads, because blending into 32-bit targets is an optional feature
//! of devices and 16-bit targets overflow. Twin: [`crate::ewa`]. Paper: `zwicker2004`, sections 4
//! to 6.

use crate::ewa::{Options, Passes};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::sources;
use crate::gpu::device::shader::sources::constants::common_splats::TILE;
use crate::gpu::device::shader::sources::constants::ewa_blend::{ATTRIBUTES, SINGLE, VISIBILITY};
use crate::gpu::device::shader::{same_layout, same_values, without_twin};
use crate::gpu::device::timing::Timing;
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::frame::FrameUniform;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::pyramid::GpuPyramid;
use crate::gpu::memory::table::CHUNK_POINTS;
use crate::inputs::camera::Camera;
use crate::pass::Pass;
use crate::plan::FramePlan;
use bytemuck::{Pod, Zeroable};
use esker_points::Grain;
use wgpu::{BufferUsages, CommandEncoder, ComputePass};

same_values!(
    ewa_place
        == crate::ewa::splat {
            REACH_MAX,
            CONDITION_MAX,
            EXACT_REACH,
            BACK,
            AMPLITUDE_MIN,
            MARGIN,
            HALF,
        }
);
same_values!(ewa_place == crate::passes::gather { DOT_RADIUS_PX });
same_values!(ewa_place == crate::ewa { SINE_MIN = mapping::SINE_MIN, AXIS_SINE_MIN = shape::SINE_MIN });
same_values!(ewa_place == crate::ewa::mapping { EXPONENT, TWICE_ONE });
same_values!(ewa_place == crate::ewa::clip {
    CLIP_SHIFT_MAX = esker_points::clip::SHIFT_MAX,
    CLIP_FLAT = FLAT,
    CLIP_WIDER = WIDER,
    CLIP_STROKE = STROKE,
    CLIP_PAST = PAST,
});
same_values!(ewa_place == esker_points::tangents {
    SHAPE_ROOM = ROOM,
    SHAPE_LEAST = LEAST,
    SHAPE_COARSER = COARSER,
});
same_values!(common_splats == crate::ewa::clip {
    KEPT_WHOLE = WHOLE,
    KEPT_ONE = ONE,
    KEPT_BOTH = BOTH,
    KEPT_EITHER = EITHER,
});
same_values!(common_splats == crate::ewa::splat { WIDENED });
same_values!(ewa_blend == crate::ewa::clip { EDGE_PX, EDGE_GROWTH });
without_twin!(common_splats { DROPPED, NOTHING });
without_twin!(ewa_place { NOT_DRAWN });
without_twin!(ewa_sort { THREADS });
without_twin!(ewa_blend { THREADS, BLOCKS, BATCH, NO_EDGE_PX });

/// Capacity of a batch. More chunks make more batches; if the entries do not fit, tiles look at all
/// splats of the batch instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchCapacity {
    /// Chunks of points at most.
    pub chunks: u32,
    /// Entries of tiles at most: a splat has one in each tile that it touches.
    pub entries: u32,
}

impl Default for BatchCapacity {
    /// 1,048,576 points with 16 entries each: at most 180 MB for their words, splats and entries.
    fn default() -> Self {
        Self::of(256)
    }
}

impl BatchCapacity {
    /// Capacity for `chunks` chunks, with 16 entries a point.
    const fn of(chunks: u32) -> Self {
        Self { chunks, entries: chunks * CHUNK_POINTS * 16 }
    }

    /// Largest capacity within `bytes` bytes: at least a chunk, at most the default.
    pub fn within(bytes: u64) -> Self {
        let chunks = (bytes / Self::of(1).bytes()) as u32;
        Self::of(chunks.clamp(1, Self::default().chunks))
    }

    /// The part that a frame of `chunks` chunks needs, rounded up to a power of two, so that a few
    /// more chunks allocate nothing. Even few splats can be large and have many entries.
    fn needed(self, chunks: u32) -> Self {
        let chunks = chunks.clamp(1, self.chunks).next_power_of_two().min(self.chunks);
        Self { chunks, entries: self.entries.min(Self::of(chunks.max(ENTRIES_CHUNKS)).entries) }
    }

    /// Bytes of a batch, with the lines of clipped splats.
    pub fn bytes(self) -> u64 {
        // Positions, colours and numbers of the points; splats, lines and boxes.
        let point = 16 + 16 + 8 + SPLAT_BYTES + LINES_BYTES + 8;
        u64::from(self.points()) * point + u64::from(self.entries) * 4
    }

    /// Points of a batch.
    fn points(self) -> u32 {
        self.chunks * CHUNK_POINTS
    }
}

/// Chunks whose entries a batch has room for at least.
const ENTRIES_CHUNKS: u32 = 32;
/// Bytes of a splat.
const SPLAT_BYTES: u64 = size_of::<crate::ewa::splat::Splat>() as u64;

/// The uniform of a batch (`shaders/common/splats.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Batch {
    lowpass: f32,
    half_cutoff: f32,
    radius_factor: f32,
    first_chunk: u32,
    chunks: u32,
    points: u32,
    entries: u32,
    is_first: u32,
    tiles: [u32; 2],
    unused: [u32; 2],
    anchor_high: [i32; 3],
    unused_a: u32,
    anchor_low: [i32; 3],
    unused_b: u32,
    anchor_rest: [f32; 3],
    unused_c: u32,
    grain: [u32; 3],
    unused_d: u32,
}

same_layout!(Batch {
    lowpass,
    half_cutoff,
    radius_factor,
    first_chunk,
    chunks,
    points,
    entries,
    is_first,
    tiles,
    anchor_high,
    anchor_low,
    anchor_rest,
    grain
});

impl Batch {
    /// A batch of a frame of `chunks` chunks that has room for `points` points, of which only the
    /// words are fetched.
    pub(crate) fn of_points(first_chunk: u32, chunks: u32, points: u32) -> Self {
        let is_first = u32::from(first_chunk == 0);
        Self { first_chunk, chunks, points, is_first, ..Self::zeroed() }
    }
}

/// The passes, and the memory that they keep from frame to frame.
pub struct GpuEwa {
    /// Options of splatting.
    pub options: Options,
    capacity: BatchCapacity,
    list: Kernel,
    /// Variants: whether there are normals, the source of colours, whether a filter hides points,
    /// whether splats are clipped, whether they have shapes, and whether planes are fitted.
    place: Variants<6>,
    begin: Kernel,
    fill: Kernel,
    /// Variants: pass, whether there are normals, and whether splats are clipped.
    blend: Variants<3>,
    normalise: Variants<1>,
    memory: Option<Memory>,
}

struct Memory {
    size: [u32; 2],
    capacity: BatchCapacity,
    /// Chunks of a batch of this frame.
    chunks: u32,
    /// The frame's uniform as if the picture were one row, a pixel for each point of a batch.
    uniform: Counted,
    batches: Vec<Counted>,
    hits: Counted,
    geometry: Counted,
    paint: Counted,
    splats: Counted,
    boxes: Counted,
    cursors: Counted,
    starts: Counted,
    entries: Counted,
    /// Two rows a point if splats are clipped or have shapes, else two rows in all.
    clips: Counted,
    /// Receives the counts of splats that were counted before.
    uncounted: Counted,
}

/// Bytes of the clip lines of a splat.
const LINES_BYTES: u64 = size_of::<crate::ewa::clip::Lines>() as u64;

/// Inputs and outputs of the passes in a frame.
pub struct EwaTarget<'a> {
    /// The frame's uniform.
    pub uniform: &'a wgpu::Buffer,
    /// Values of the frame's uniform.
    pub frame: FrameUniform,
    /// The frame's plan.
    pub plan: &'a FramePlan,
    /// Nodes and chunks of the frame.
    pub cut: &'a GpuCut,
    /// Planes of the nodes.
    pub pool: &'a NodePool,
    /// The pyramid, whose level 0 is filled.
    pub pyramid: &'a GpuPyramid,
    /// Planes fitted to the frame buffer ([`crate::gpu::passes::fit_planes`]).
    pub planes: Option<&'a wgpu::Buffer>,
    /// The picture, whose depth is filled.
    pub picture: &'a GpuPicture,
    /// Counts of pixels and splats, four words.
    pub counts: &'a wgpu::Buffer,
    /// The camera.
    pub camera: &'a Camera,
    /// Grain of clip lines.
    pub grain: Grain,
}

impl GpuEwa {
    /// Builds the kernels that all variants share.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, capacity: BatchCapacity) -> Result<Self, GpuError> {
        Ok(Self {
            options: Options::default(),
            capacity,
            list: Kernel::new(gpu, sources::EWA_LIST, "main", &[])?,
            place: Variants::new(
                sources::EWA_PLACE,
                ["NORMALS", "COLOUR", "HIDES_POINTS", "CLIPS", "TANGENTS", "FITTED"],
            ),
            begin: Kernel::new(gpu, sources::EWA_SORT, "begin", &[])?,
            fill: Kernel::new(gpu, sources::EWA_SORT, "fill", &[])?,
            blend: Variants::new(sources::EWA_BLEND, ["PASS", "NORMALS", "CLIPS"]),
            normalise: Variants::new(sources::EWA_NORMALISE, ["NORMALS"]),
            memory: None,
        })
    }

    /// Releases the memory of the last frame.
    pub fn release(&mut self) {
        self.memory = None;
    }

    /// Adds the passes to the commands of a frame.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        lookup: &mut GpuLookup,
        target: &EwaTarget<'_>,
        timing: &mut Timing,
    ) -> Result<(), GpuError> {
        let size = [target.picture.width, target.picture.height];
        let chunks = target.cut.chunk_count();
        let capacity = self.capacity.needed(chunks);
        if self
            .memory
            .as_ref()
            .is_none_or(|m| m.size != size || m.capacity.chunks < capacity.chunks)
        {
            self.memory = None;
            self.memory = Some(Memory::new(gpu, size, capacity)?);
        }
        if let Some(memory) = &mut self.memory {
            memory.chunks = capacity.chunks;
            memory.fit_clips(gpu, target.plan.clips || target.plan.tangents)?;
        }
        let batches = chunks.div_ceil(capacity.chunks).max(1);
        self.write_uniforms(gpu, target, chunks, batches)?;
        let sweeps: &[u32] = match self.options.passes {
            Passes::Three => &[VISIBILITY, ATTRIBUTES],
            Passes::One => &[SINGLE],
        };
        for &sweep in sweeps {
            let is_placed = sweep == ATTRIBUTES && batches == 1;
            for batch in 0..batches {
                if !is_placed {
                    let mut pass = timing.compute(encoder, Pass::Place);
                    // Splats are counted in the first sweep only.
                    let counts = sweep == sweeps[0];
                    self.place(gpu, &mut pass, lookup, target, (batch, counts))?;
                }
                let mut pass = timing.compute(encoder, Pass::Blend);
                self.blend(gpu, &mut pass, target, batch, sweep)?;
            }
        }
        self.normalise(gpu, &mut timing.compute(encoder, Pass::Blend), target)
    }

    /// Fills the uniforms.
    fn write_uniforms(
        &mut self,
        gpu: &Gpu,
        target: &EwaTarget<'_>,
        chunks: u32,
        batches: u32,
    ) -> Result<(), GpuError> {
        let Some(memory) = &mut self.memory else { return Ok(()) };
        let options = self.options.within_bounds();
        let squared = options.cutoff * options.cutoff;
        // The points of a batch are fetched as if they were the pixels of a row.
        let row = target.frame.with_size([memory.points(), 1]);
        gpu.queue.write_buffer(&memory.uniform, 0, bytemuck::bytes_of(&row));
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        for number in 0..batches {
            let batch = Batch {
                lowpass: if options.lowpass { squared } else { 0.0 },
                half_cutoff: 0.5 * squared,
                radius_factor: options.radius_factor,
                first_chunk: number * memory.chunks,
                chunks,
                points: memory.points(),
                entries: memory.capacity.entries,
                is_first: u32::from(number == 0),
                tiles: tiles(memory.size),
                anchor_high: target.camera.anchor_high,
                anchor_low: target.camera.anchor_low,
                anchor_rest: target.camera.anchor_rest.to_array(),
                grain: target.grain.0.map(u32::from),
                ..Batch::zeroed()
            };
            if memory.batches.len() <= number as usize {
                let bytes = size_of::<Batch>() as u64;
                memory.batches.push(gpu.buffer("batch of splats", bytes, usage)?);
            }
            let buffer = &memory.batches[number as usize];
            gpu.queue.write_buffer(buffer, 0, bytemuck::bytes_of(&batch));
        }
        Ok(())
    }

    /// Makes the splats of a batch and sorts them into tiles; counts them if `counts`.
    fn place(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        lookup: &mut GpuLookup,
        target: &EwaTarget<'_>,
        (batch, counts): (u32, bool),
    ) -> Result<(), GpuError> {
        let Some(m) = &self.memory else { return Ok(()) };
        let batch = &m.batches[batch as usize];
        let points = u64::from(m.points());
        let [columns, rows] = tiles(m.size).map(u64::from);
        let list = [(0, &**batch), (1, target.cut.chunks()), (2, &m.hits), (3, &m.paint)];
        let list = self.list.bind(gpu, &[&list[..], &[(4, &m.cursors)]].concat());
        self.list.dispatch(pass, &list, groups_of(points.max(columns * rows)));

        let pages = target.cut.pages(target.pool, target.plan.fetches);
        let won = WinningPoints {
            uniform: &m.uniform,
            size: [m.points(), 1],
            hits: &m.hits,
            draws: target.cut.draws(),
            chunks: target.cut.chunks(),
            pages: &pages,
            counts: target.counts,
        };
        lookup.fetch(gpu, pass, &won, target.plan, [&m.geometry, &m.paint])?;
        if target.plan.clips {
            let won = WinningPoints { pages: &target.cut.clip_pages(target.pool), ..won };
            lookup.fetch_clips(gpu, pass, &won, [&m.geometry, &m.clips])?;
        }
        if target.plan.tangents {
            let won = WinningPoints { pages: &target.cut.tangent_pages(target.pool), ..won };
            lookup.fetch_tangents(gpu, pass, &won, [&m.geometry, &m.clips])?;
        }

        let [normals, colour] = target.plan.colour_constants().map(|(_, value)| value);
        let hides = u32::from(target.plan.hides_points);
        let clips = u32::from(target.plan.clips);
        let tangents = u32::from(target.plan.tangents);
        let fitted = u32::from(target.plan.fits_planes());
        let kernel = self.place.get(gpu, [normals, colour, hides, clips, tangents, fitted])?;
        // Clip lines and shapes need normals, planes are fitted without: they share a binding.
        let clips = target.planes.unwrap_or(&m.clips);
        let buffers = [
            (0, target.uniform),
            (1, lookup.uniform()),
            (2, batch),
            (3, target.cut.draws()),
            (4, lookup.octree()),
            (5, &m.geometry),
            (6, &m.paint),
            (7, &m.splats),
            (8, &m.boxes),
            (9, &m.cursors),
            (10, clips),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), groups_of(points));

        let starts: [(u32, &wgpu::Buffer); 3] = [(0, batch), (1, &m.cursors), (2, &m.starts)];
        self.begin.dispatch(pass, &self.begin.bind(gpu, &starts), [1, 1, 1]);
        let counts = if counts { target.counts } else { &m.uncounted };
        let entries = [(0, &**batch), (1, &m.cursors), (3, &m.boxes), (4, &m.entries), (5, counts)];
        self.fill.dispatch(pass, &self.fill.bind(gpu, &entries), groups_of(points));
        Ok(())
    }

    /// Blends the splats of a batch: the pass `sweep` of `shaders/ewa/blend.wgsl`.
    fn blend(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        target: &EwaTarget<'_>,
        batch: u32,
        sweep: u32,
    ) -> Result<(), GpuError> {
        let (Some(m), Some(base)) = (&self.memory, target.pyramid.levels.first()) else {
            return Ok(());
        };
        let normals = u32::from(target.plan.carries_normals);
        let clips = u32::from(target.plan.clips);
        let kernel = self.blend.get(gpu, [sweep, normals, clips])?;
        let buffers = [
            (0, target.uniform),
            (1, &*m.batches[batch as usize]),
            (2, &m.splats),
            (3, &m.boxes),
            (4, &m.starts),
            (5, &m.entries),
            (6, &base.depth),
            (7, &base.tint),
            (8, &base.front),
            (9, &m.clips),
        ];
        let [columns, rows] = tiles(m.size);
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), [columns, rows, 1]);
        Ok(())
    }

    fn normalise(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        target: &EwaTarget<'_>,
    ) -> Result<(), GpuError> {
        let Some(base) = target.pyramid.levels.first() else { return Ok(()) };
        let kernel = self.normalise.get(gpu, [u32::from(target.plan.carries_normals)])?;
        let buffers = [
            (0, target.uniform),
            (1, &base.front),
            (2, &base.tint),
            (3, &base.depth),
            (4, &base.plane),
            (5, &target.picture.depth),
            (6, target.counts),
        ];
        let groups = [base.width.div_ceil(8), base.height.div_ceil(8), 1];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), groups);
        Ok(())
    }

    /// Rebuilds the kernels whose shaders have changed on disk. Whether any has.
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let sort = self.list.reload(gpu)? | self.begin.reload(gpu)? | self.fill.reload(gpu)?;
        let rest = self.place.reload(gpu)? | self.blend.reload(gpu)?;
        Ok(sort | rest | self.normalise.reload(gpu)?)
    }
}

impl Memory {
    fn new(gpu: &Gpu, size: [u32; 2], capacity: BatchCapacity) -> Result<Self, GpuError> {
        let points = u64::from(capacity.points());
        let [columns, rows] = tiles(size).map(u64::from);
        let plane = |label, bytes| gpu.buffer(label, bytes, BufferUsages::STORAGE);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            size,
            capacity,
            chunks: capacity.chunks,
            uniform: gpu.buffer("frame of a batch", size_of::<FrameUniform>() as u64, usage)?,
            batches: Vec::new(),
            hits: plane("points of a batch", points * 8)?,
            geometry: plane("positions of a batch", points * 16)?,
            paint: plane("colours of a batch", points * 16)?,
            splats: plane("splats", points * SPLAT_BYTES)?,
            boxes: plane("boxes of splats", points * 8)?,
            cursors: plane("counts of tiles", columns * rows * 4)?,
            starts: plane("starts of tiles", (columns * rows + 1) * 4)?,
            entries: plane("entries of tiles", u64::from(capacity.entries) * 4)?,
            clips: plane("no clip lines", LINES_BYTES)?,
            uncounted: plane("counts of splats made again", 16)?,
        })
    }

    /// Points of a batch.
    fn points(&self) -> u32 {
        self.chunks * CHUNK_POINTS
    }

    /// Allocates the lines and shapes of a batch if splats have any (`clips`), else releases them.
    fn fit_clips(&mut self, gpu: &Gpu, clips: bool) -> Result<(), GpuError> {
        let points = if clips { u64::from(self.capacity.points()) } else { 1 };
        if self.clips.size() != points * LINES_BYTES {
            self.clips = gpu.buffer("clip lines", points * LINES_BYTES, BufferUsages::STORAGE)?;
        }
        Ok(())
    }
}

fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|s| s.div_ceil(TILE))
}
