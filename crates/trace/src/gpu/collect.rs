//! The scene of a frame whose points lie in GPU memory: splats are made there, measured, turned
//! into discs in place and put into a tree, so that no point passes through main memory. Only their
//! number, their bounds and the luminances that albedo follows from are read back. Twins:
//! [`crate::scene::splats`] and [`crate::gpu::SceneKernels::scene`].

use crate::accel::Bounds;
use crate::gpu::scene::{GpuScene, diagonal_of};
use crate::gpu::tree::TreeBuilder;
use crate::gpu::{same_layout, same_values, sources, without_twin};
use crate::scene::Albedo;
use crate::scene::splats::SAMPLES;
use bytemuck::{Pod, Zeroable, bytes_of, pod_collect_to_vec};
use esker_render::Frame;
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::device::readback;
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError, GpuSplats, Kernel, NodePool, PlaneAt, SplatBuffer};
use glam::{DVec3, Vec3};

same_values!(common_fine == crate::scene::splats { RADIUS_FACTOR, COORDINATE_MAX });
same_values!(trace_measure == crate::scene::splats { SAMPLES, LUMINANCE[..] });
without_twin!(trace_measure { WORDS });

/// Words of the totals (`shaders/trace/measure.wgsl`).
const TOTALS: usize = 13;

/// The uniform of the discs (`shaders/trace/tint.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Rule {
    corner: [f32; 4],
    plain: [f32; 4],
    factor: f32,
    least: f32,
    most: f32,
    is_plain: u32,
    count: u32,
    unused: [u32; 3],
}

same_layout!(Rule { corner, plain, factor, least, most, is_plain, count });

/// Builds scenes of frames in GPU memory.
pub struct SceneCollector {
    splats: GpuSplats,
    measure: Kernel,
    tint: Kernel,
    builder: TreeBuilder,
}

/// What is read back of splats.
struct Measures {
    /// Splats that were made, those without room among them.
    given: usize,
    /// Splats in memory.
    count: u32,
    /// Splats that a ray can meet.
    fine: usize,
    /// Boxes of their centres and of their discs.
    centres: Bounds,
    discs: Bounds,
    /// Luminances of some splats.
    luminances: Vec<f32>,
}

impl SceneCollector {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |source| Kernel::new(gpu, source, "main", &[]);
        Ok(Self {
            splats: GpuSplats::new(gpu)?,
            measure: kernel(sources::TRACE_MEASURE)?,
            tint: kernel(sources::TRACE_TINT)?,
            builder: TreeBuilder::new(gpu)?,
        })
    }

    /// Builds the scene of a frame whose planes are in `pool`, relative to `origin`, and waits for
    /// the number of its splats. All planes are read before it returns. Splats beyond
    /// [`crate::gpu::SPLATS_MAX`] are left out.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn collect(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_, PlaneAt>,
        pool: &NodePool,
        origin: DVec3,
        albedo: Albedo,
    ) -> Result<GpuScene, GpuError> {
        let made = self.splats.make(gpu, frame, pool, origin)?;
        let measures = self.measure(gpu, &made)?;
        self.tint(gpu, &made, &measures, albedo)?;
        let corners = [measures.centres.min, measures.centres.max];
        let (count, culls) = (measures.count, frame.cull_back_faces);
        let tree = self.builder.build(gpu, &made.splats, count, corners, culls)?;
        Ok(GpuScene {
            tree,
            given: measures.given,
            splats: measures.fine,
            left_out: measures.given - measures.count as usize,
            diagonal: diagonal_of(&measures.discs),
            emits: false,
        })
    }

    /// Measures splats and waits for the result.
    fn measure(&self, gpu: &Gpu, made: &SplatBuffer) -> Result<Measures, GpuError> {
        let stored = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let samples_bytes = u64::from(made.room).min(SAMPLES as u64) * 4;
        let totals = gpu.buffer("measures of splats", TOTALS as u64 * 4, stored)?;
        let samples = gpu.buffer("luminances of splats", samples_bytes, stored)?;
        let bound = [(0, &*made.splats), (1, &*made.number), (2, &*totals), (3, &*samples)];
        let bind = self.measure.bind(gpu, &bound);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        self.measure.dispatch(&mut pass, &bind, groups_of(made.room.into()));
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        let sources =
            [(&*made.number, 4), (&*totals, TOTALS as u64 * 4), (&*samples, samples_bytes)];
        let wanted = if samples_bytes > 0 { &sources[..] } else { &sources[..2] };
        let read = readback::read(gpu, wanted)?;
        let words = |i: usize| read.get(i).map_or(Vec::new(), |b| pod_collect_to_vec::<u8, u32>(b));
        Ok(Measures::of(words(0).first().copied().unwrap_or(0), made.room, &words(1), &words(2)))
    }

    /// Turns splats into discs.
    fn tint(
        &self,
        gpu: &Gpu,
        made: &SplatBuffer,
        measures: &Measures,
        albedo: Albedo,
    ) -> Result<(), GpuError> {
        let (factor, [least, most]) = albedo.rule(measures.luminances.iter().copied());
        let plain = if let Albedo::Plain(plain) = albedo { Some(plain) } else { None };
        let low = measures.centres.min;
        let corner = if low.is_finite() { low } else { Vec3::ZERO };
        let rule = Rule {
            corner: corner.extend(0.0).to_array(),
            plain: Vec3::from_array(plain.unwrap_or_default()).extend(0.0).to_array(),
            factor,
            least,
            most,
            is_plain: u32::from(plain.is_some()),
            count: measures.count,
            unused: [0; 3],
        };
        let uniform = fixed_uniform(gpu, "rule of albedo", bytes_of(&rule))?;
        let bind = self.tint.bind(gpu, &[(0, &uniform), (1, &made.splats)]);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        self.tint.dispatch(&mut pass, &bind, groups_of(measures.count.into()));
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}

impl Measures {
    /// Measures of the words that the kernel writes.
    fn of(given: u32, room: u32, totals: &[u32], samples: &[u32]) -> Self {
        let count = given.min(room);
        let fine = totals.first().map_or(0, |&fine| fine as usize);
        let number = |at: usize| totals.get(at).map_or(f32::NAN, |&word| number_of(word));
        let three = |at: usize| Vec3::new(number(at), number(at + 1), number(at + 2));
        let bounds = |at: usize| Bounds { min: -three(at + 3), max: three(at) };
        let [centres, discs] = if fine > 0 { [bounds(1), bounds(7)] } else { [Bounds::EMPTY; 2] };
        let sampled = (count as usize).div_ceil(count as usize / SAMPLES + 1);
        let luminances = samples.iter().take(sampled).map(|&bits| f32::from_bits(bits)).collect();
        Self { given: given as usize, count, fine, centres, discs, luminances }
    }
}

/// The number that a word of the totals stands for: words compare like the numbers.
fn number_of(word: u32) -> f32 {
    f32::from_bits(if word >> 31 == 1 { word & !(1 << 31) } else { !word })
}

#[cfg(test)]
mod tests;
