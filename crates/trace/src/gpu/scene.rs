//! Splats of a scene in GPU memory, as discs of an implicit tree, and rays traced against them. In:
//! the splats that the CPU's scene takes. Out: buffers for the kernels, or hits of a list of rays.

use crate::accel::Bounds;
use crate::accel::disc::Disc;
use crate::accel::tree::Primitive;
use crate::gpu::sources;
use crate::gpu::tree::{DISC_BYTES, GpuTree, TreeBuilder};
use crate::ray::Ray;
use crate::scene::SplatInput;
use crate::scene::splats::{disc_of, is_fine};
use bytemuck::{Pod, Zeroable, cast_slice};
use esker_points::quant::oct_encode;
use esker_render::gpu::device::{BINDING_BYTES_MAX, readback};
use esker_render::gpu::wgpu::{Buffer, BufferUsages};
use esker_render::gpu::{Gpu, GpuError, Kernel};
use glam::Vec3;
use rayon::prelude::*;

/// Most splats of a lit scene on a GPU: those whose discs fit in a storage binding.
pub const SPLATS_MAX: usize = (BINDING_BYTES_MAX / DISC_BYTES) as usize;

/// A disc (`shaders/common/discs.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct GpuDisc {
    pub(crate) centre: [f32; 3],
    pub(crate) radius: f32,
    /// Octahedral code.
    pub(crate) normal: [i16; 2],
    /// Albedo and emitter.
    pub(crate) tint: [u16; 4],
    unused: u32,
}

const _: () = assert!(size_of::<GpuDisc>() as u64 == DISC_BYTES);

/// Splats of a task that makes discs.
const TASK: usize = 1 << 13;

impl GpuDisc {
    pub(crate) fn new(disc: &Disc) -> Self {
        Self {
            centre: disc.centre.to_array(),
            radius: disc.radius,
            normal: oct_encode(disc.normal.to_array()),
            tint: disc.tint,
            unused: 0,
        }
    }
}

/// Where a ray meets a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuHit {
    /// Distance of the frontmost disc.
    pub distance: f32,
    /// Blended normal against the ray.
    pub normal: Vec3,
    /// Blended albedo.
    pub albedo: Vec3,
    /// Distance along the normal at which rays that leave the surface start.
    pub lift: f32,
}

/// Kernels that build scenes and trace lists of rays.
pub struct SceneKernels {
    builder: TreeBuilder,
    nearest: Kernel,
    blocked: Kernel,
}

/// Splats in GPU memory.
#[derive(Debug)]
pub struct GpuScene {
    pub(crate) tree: GpuTree,
    /// Splats that it was made of.
    pub(crate) given: usize,
    pub(crate) splats: usize,
    pub(crate) left_out: usize,
    /// Diagonal of the box of all discs.
    pub(crate) diagonal: f32,
    /// Whether some splats emit light.
    pub(crate) emits: bool,
}

impl SceneKernels {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let rays = |shadow| Kernel::new(gpu, sources::TRACE_RAYS, "main", &[("SHADOW", shadow)]);
        Ok(Self { builder: TreeBuilder::new(gpu)?, nearest: rays(0.0)?, blocked: rays(1.0)? })
    }

    /// Uploads splats and builds their tree. Splats beyond [`SPLATS_MAX`] are left out.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn scene(&self, gpu: &Gpu, input: &SplatInput<'_>) -> Result<GpuScene, GpuError> {
        let rule = input.albedo_rule();
        let made = input.splats.par_iter().with_min_len(TASK).enumerate();
        let made = made.filter(|(_, splat)| is_fine(splat));
        let made = made.map(|(index, splat)| disc_of(splat, input.tint(index, rule)));
        let mut discs: Vec<Disc> = made.collect();
        let left_out = discs.len().saturating_sub(SPLATS_MAX);
        discs.truncate(SPLATS_MAX);
        let (mut bounds, mut centres) = (Bounds::EMPTY, Bounds::EMPTY);
        for disc in &discs {
            bounds = bounds.union(&disc.bounds());
            centres = centres.union(&Bounds { min: disc.centre, max: disc.centre });
        }
        let emits = discs.iter().any(|disc| disc.tint[3] > 0);
        let packed: Vec<GpuDisc> = discs.par_iter().with_min_len(TASK).map(GpuDisc::new).collect();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let unordered = gpu.buffer("unordered discs", packed.len() as u64 * DISC_BYTES, usage)?;
        gpu.queue.write_buffer(&unordered, 0, cast_slice(&packed));
        let corners = [centres.min, centres.max];
        let (count, culls) = (packed.len() as u32, input.cull_back_faces);
        let tree = self.builder.build(gpu, &unordered, count, corners, culls)?;
        let (given, splats) = (input.splats.len(), packed.len());
        Ok(GpuScene { tree, given, splats, left_out, diagonal: diagonal_of(&bounds), emits })
    }

    /// The surface that each ray meets first, and waits for them.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn hits(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        rays: &[Ray],
    ) -> Result<Vec<Option<GpuHit>>, GpuError> {
        let met = trace(gpu, &self.nearest, scene, rays)?;
        let hit = |v: &[f32; 8]| {
            v[0].is_finite().then(|| GpuHit {
                distance: v[0],
                normal: Vec3::new(v[1], v[2], v[3]),
                albedo: Vec3::new(v[4], v[5], v[6]),
                lift: v[7],
            })
        };
        Ok(met.iter().map(hit).collect())
    }

    /// Whether anything lies on each ray before its reach, and waits for them.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn blocked(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        rays: &[Ray],
    ) -> Result<Vec<bool>, GpuError> {
        let met = trace(gpu, &self.blocked, scene, rays)?;
        Ok(met.iter().map(|v| v[0].is_finite()).collect())
    }
}

impl GpuScene {
    /// Number of splats.
    pub fn splats(&self) -> usize {
        self.splats
    }

    /// Number of splats that it was made of and that no ray can meet: without extent, with values
    /// that are not finite, or beyond [`SPLATS_MAX`].
    pub fn dropped(&self) -> usize {
        self.given - self.splats
    }

    /// Number of splats beyond [`SPLATS_MAX`].
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Bytes of the scene in GPU memory.
    pub fn bytes(&self) -> u64 {
        self.tree.boxes.size() + self.tree.discs.size() + self.tree.uniform.size()
    }

    /// Length of the diagonal of the box around the splats.
    pub(crate) fn diagonal(&self) -> f32 {
        self.diagonal
    }

    /// Whether some splats emit light, which the kernels do not draw.
    pub(crate) fn emits(&self) -> bool {
        self.emits
    }

    /// The bindings of the tree, from 0 on.
    pub(crate) fn bindings(&self) -> [(u32, &Buffer); 3] {
        [(0, &self.tree.uniform), (1, &self.tree.boxes), (2, &self.tree.discs)]
    }
}

/// Diagonal of a box; 0 for an empty one.
pub(crate) fn diagonal_of(bounds: &Bounds) -> f32 {
    let diagonal = (bounds.max - bounds.min).length();
    if diagonal.is_finite() { diagonal } else { 0.0 }
}

/// Traces rays by a kernel of `shaders/trace/rays.wgsl`; eight numbers a ray.
fn trace(
    gpu: &Gpu,
    kernel: &Kernel,
    scene: &GpuScene,
    rays: &[Ray],
) -> Result<Vec<[f32; 8]>, GpuError> {
    if rays.is_empty() {
        return Ok(Vec::new());
    }
    let packed: Vec<[f32; 8]> = rays
        .iter()
        .map(|Ray { origin: o, direction: d, reach }| [o.x, o.y, o.z, *reach, d.x, d.y, d.z, 0.0])
        .collect();
    let bytes = size_of_val(&*packed) as u64;
    let list = gpu.buffer("rays", bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST)?;
    let hits = gpu.buffer("hits", bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)?;
    gpu.queue.write_buffer(&list, 0, cast_slice(&packed));
    let bound: Vec<_> = scene.bindings().into_iter().chain([(3, &*list), (4, &*hits)]).collect();
    let bind = kernel.bind(gpu, &bound);
    let groups = (rays.len() as u64).div_ceil(GROUP);
    let rows = groups.div_ceil(ROW_MAX);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let across = groups.div_ceil(rows);
    let mut pass = encoder.begin_compute_pass(&Default::default());
    kernel.dispatch(&mut pass, &bind, [across as u32, rows as u32, 1]);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let read = readback::read(gpu, &[(&hits, bytes)])?;
    Ok(read.first().map_or(Vec::new(), |bytes| bytemuck::pod_collect_to_vec(bytes)))
}

/// Rays of a workgroup.
const GROUP: u64 = 64;
/// Workgroups of a row that WebGPU guarantees.
const ROW_MAX: u64 = 65_535;
