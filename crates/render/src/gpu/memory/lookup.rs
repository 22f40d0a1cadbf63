//! Tables of a frame by which points are looked up on the GPU (the octree of the cut, colours,
//! radii), and the pass that fetches the words of the winning points (`shaders/gather/fetch.wgsl`)
//! for gather, resolve and EWA splatting. Twin: [`crate::inputs::lookup::Lookup`].

use crate::frame::Frame;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::groups_of;
use crate::gpu::device::shader::sources;
use crate::gpu::device::shader::{same_layout, same_values, without_twin};
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::colour::ColourRuns;
use crate::gpu::memory::octree::GpuOctree;
use crate::inputs::colour::{ColourBy, PLAIN, linear};
use crate::plan::FramePlan;
use bytemuck::{Pod, Zeroable};
use esker_points::Lattice;
use esker_points::quant::radius_factor;
use glam::Vec3;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use wgpu::{Buffer, BufferUsages, ComputePass};

same_values!(common_normal == crate::passes::project { NO_NORMAL = NO_NORMAL_BITS });
same_values!(gather_fetch == crate::gpu::memory::lookup { ELSEWHERE = PAGES_AT_ONCE });
without_twin!(common_lookup { HAS_COLOUR });

/// Pages that one dispatch reads: with the tables, as many buffers as WebGPU's default limits
/// allow.
pub const PAGES_AT_ONCE: usize = 3;
/// Uniforms of page numbers that are kept for the next frames: there are few, but they vary.
const PAGES_KEPT: usize = 256;
/// Number of no page.
const NO_SUCH_PAGE: u32 = u32::MAX - 1;

/// Winning points of the pixels, and the pages of their planes.
#[derive(Clone, Copy, Debug)]
pub struct WinningPoints<'a> {
    /// The frame's uniform.
    pub uniform: &'a Buffer,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Point number and bits of the depth of each pixel ([`crate::gpu::memory::hits`]).
    pub hits: &'a Buffer,
    /// Table of [`crate::gpu::memory::table::Draw`]; not empty.
    pub draws: &'a Buffer,
    /// Table of [`crate::gpu::memory::table::Chunk`]; not empty.
    pub chunks: &'a Buffer,
    /// Numbers and buffers of the pages to read; planes in other pages are ignored.
    pub pages: &'a [(u32, &'a Buffer)],
    /// Two words, cleared by the caller: pixels with a winning point, pixels that show a surface.
    pub counts: &'a Buffer,
}

impl WinningPoints<'_> {
    /// Workgroups of 256 pixels.
    pub(crate) fn groups(&self) -> [u32; 3] {
        groups_of(u64::from(self.size[0]) * u64::from(self.size[1]))
    }
}

/// The uniform of the tables (`shaders/common/lookup.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Pod, Zeroable)]
struct Lookup {
    starts: [[[u32; 2]; 2]; 128],
    colours: [[f32; 4]; 256],
    linear: [f32; 256],
    radius_factors: [f32; 256],
    plain: [f32; 4],
    no_number: [f32; 4],
    cells: u32,
    unused: [u32; 3],
}

same_layout!(Lookup { starts, colours, linear, radius_factors, plain, no_number, cells });

/// The uniform of a fetch (`shaders/gather/fetch.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Pod, Zeroable)]
struct Pages {
    numbers: [u32; 3],
    is_first: u32,
}

same_layout!(Pages { numbers, is_first });

/// Tables, octree and fetch pass of a frame.
pub struct GpuLookup {
    tables: Box<Lookup>,
    uniform: Counted,
    octree: GpuOctree,
    colour: ColourBy,
    lattice: Option<Lattice>,
    kernels: Variants<5>,
    pages: HashMap<Pages, Counted>,
    /// Bound in place of pages that are not needed.
    nothing: Counted,
}

impl GpuLookup {
    /// Creates the tables.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            tables: Box::new(tables()),
            uniform: gpu.buffer("lookup", size_of::<Lookup>() as u64, usage)?,
            octree: GpuOctree::new(gpu)?,
            colour: ColourBy::Plain,
            lattice: None,
            kernels: Variants::new(
                sources::GATHER_FETCH,
                ["GEOMETRY", "COLOURS", "NORMALS", "CLIPS", "TANGENTS"],
            ),
            pages: HashMap::new(),
            nothing: gpu.buffer("nothing", 16, BufferUsages::STORAGE)?,
        })
    }

    /// Takes the octree and the colours of a frame; only what has changed is uploaded.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn set<P>(&mut self, gpu: &Gpu, frame: &Frame<'_, P>) -> Result<(), GpuError> {
        self.octree.set(gpu, frame.octree)?;
        let cells = self.octree.len() as u32;
        let is_known = self.lattice == Some(*frame.lattice) && self.colour == frame.colour;
        if is_known && self.tables.cells == cells {
            return Ok(());
        }
        self.tables.cells = cells;
        if !is_known {
            (self.lattice, self.colour) = (Some(*frame.lattice), frame.colour);
            self.tables.take(ColourRuns::of(&frame.colour, frame.lattice));
        }
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&*self.tables));
        Ok(())
    }

    pub(crate) fn uniform(&self) -> &Buffer {
        &self.uniform
    }

    pub(crate) fn octree(&self) -> &Buffer {
        self.octree.buffer()
    }

    /// Fetches the words of the winning points into two buffers of four words a pixel, `geometry`
    /// and `paint`; the first may be any buffer if the plan fetches no positions.
    pub(crate) fn fetch(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        winners: &WinningPoints<'_>,
        plan: &FramePlan,
        to: [&Buffer; 2],
    ) -> Result<(), GpuError> {
        let [geometry, colours, normals] = plan.fetch_constants().map(|(_, value)| value);
        self.run(gpu, pass, winners, [geometry, colours, normals, 0, 0], to)
    }

    /// Fetches the clip lines of the points into every other row of `clips`; `any` is bound but
    /// unused.
    pub(crate) fn fetch_clips(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        winners: &WinningPoints<'_>,
        [any, clips]: [&Buffer; 2],
    ) -> Result<(), GpuError> {
        self.run(gpu, pass, winners, [0, 0, 0, 1, 0], [any, clips])
    }

    /// Fetches the shapes of the points into the first words of the other rows of `clips`.
    pub(crate) fn fetch_tangents(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        winners: &WinningPoints<'_>,
        [any, clips]: [&Buffer; 2],
    ) -> Result<(), GpuError> {
        self.run(gpu, pass, winners, [0, 0, 0, 0, 1], [any, clips])
    }

    fn run(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        winners: &WinningPoints<'_>,
        constants: [u32; 5],
        [geometry, paint]: [&Buffer; 2],
    ) -> Result<(), GpuError> {
        let kernel = self.kernels.get(gpu, constants)?;
        if self.pages.len() > PAGES_KEPT {
            self.pages.clear();
        }
        // The first dispatch runs even without pages: it fills in defaults.
        let rounds = winners.pages.len().div_ceil(PAGES_AT_ONCE).max(1);
        for round in 0..rounds {
            let at = |slot: usize| winners.pages.get(round * PAGES_AT_ONCE + slot);
            let numbers = [0, 1, 2].map(|slot| at(slot).map_or(NO_SUCH_PAGE, |p| p.0));
            let pages = Pages { numbers, is_first: u32::from(round == 0) };
            let numbers = match self.pages.entry(pages) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(place) => place.insert(pages_uniform(gpu, pages)?),
            };
            let page = |slot: usize| at(slot).map_or(&*self.nothing, |p| p.1);
            let buffers = [
                (0, winners.uniform),
                (1, &**numbers),
                (2, winners.hits),
                (3, winners.chunks),
                (4, winners.draws),
                (5, geometry),
                (6, paint),
                (7, page(0)),
                (8, page(1)),
                (9, page(2)),
            ];
            kernel.dispatch(pass, &kernel.bind(gpu, &buffers), winners.groups());
        }
        Ok(())
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernels.reload(gpu)
    }
}

fn pages_uniform(gpu: &Gpu, pages: Pages) -> Result<Counted, GpuError> {
    let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    let buffer = gpu.buffer("numbers of pages", size_of::<Pages>() as u64, usage)?;
    gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&pages));
    Ok(buffer)
}

fn tables() -> Lookup {
    Lookup {
        linear: std::array::from_fn(|i| linear([i as u8; 3]).x),
        radius_factors: std::array::from_fn(|code| radius_factor(code as u8)),
        plain: wide(linear(PLAIN)),
        ..Lookup::zeroed()
    }
}

impl Lookup {
    fn take(&mut self, runs: Option<ColourRuns>) {
        // Unused runs begin above all values.
        self.starts = [[[u32::MAX; 2]; 2]; 128];
        let Some(runs) = runs else { return };
        for (i, (start, colour)) in runs.runs.into_iter().enumerate() {
            self.starts[i / 2][i % 2] = [(start >> 32) as u32, start as u32];
            self.colours[i] = wide(colour);
        }
        self.no_number = wide(runs.no_number);
    }
}

fn wide(colour: Vec3) -> [f32; 4] {
    colour.extend(1.0).to_array()
}
