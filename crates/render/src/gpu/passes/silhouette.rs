//! Silhouette on the GPU: finds the rims of surfaces that discs drew beyond their samples, removes
//! pixels from there inwards in waves, and writes the depth image that remains. Waves run in turns
//! over the tiles of the picture that they can reach. Attributes stay in place: a plane of sources
//! gives the pixel whose attributes each pixel shows. Twin: [`crate::passes::silhouette`].

use crate::gpu::device::dispatch::{Dispatch, Groups, fixed_uniform};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Compilation, Kernel};
use crate::gpu::device::shader::sources;
use crate::gpu::device::shader::sources::constants::common_turns::{TILE, TURNS};
use crate::gpu::device::shader::sources::constants::silhouette_waves::HALO as HALF_WAVES;
use crate::gpu::device::shader::{same_layout, same_values, without_twin};
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::target::{SurfaceTarget, Turns};
use bytemuck::{Pod, Zeroable};
use std::thread;
use wgpu::{BindingResource, BufferBinding, BufferSize};

same_values!(silhouette_rims == crate::passes::silhouette::rim {
    OPEN_PX[..] = [OPEN_PX.0, OPEN_PX.1],
    SLOPE_RADII[..],
    STEEPER,
    SLOPE_REACH_MIN,
    WIDTH_RADII,
    LINE_WIDTH[..] = [LINE_WIDTH.0, LINE_WIDTH.1],
    LINE_SIDE,
    LINE_RADIUS_MAX_PX,
});
same_values!(common_overhang == crate::passes::silhouette::rim {
    OVERHANG[..] = [OVERHANG[1], OVERHANG[0]],
    OVERHANG_MIN_PX[..] = [OVERHANG_MIN_PX[1], OVERHANG_MIN_PX[0]],
    LINE_OVERHANG_PX,
});
same_values!(
    silhouette_settle
        == crate::passes::silhouette { ALONE, ALONE_RADIUS_PX, STEEPEST, MIRRORED_PX, RISE_MAX }
);
same_values!(common_source == crate::passes::silhouette { PIXEL_BITS, PIXEL_MASK });
without_twin!(common_turns { ROW_TILES });
without_twin!(silhouette_waves { SIDE, LANES });

const _: () = assert!(TURNS * 2 * HALF_WAVES == crate::passes::silhouette::WAVES);
/// Bytes between the uniforms in a buffer: the alignment of offsets that WebGPU guarantees.
const UNIFORM_STRIDE: usize = 256;

/// Half a turn of waves (`shaders/silhouette/waves.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Half {
    turn: u32,
    waves: u32,
}

same_layout!(Half { turn, waves });

/// The pass.
pub struct Silhouette {
    start: Kernel,
    rims: Kernel,
    tiles: Kernel,
    waves: Kernel,
    settle: Kernel,
    /// The structures [`Half`] of all turns.
    halves: Counted,
}

impl Silhouette {
    /// Builds the kernels for pyramids with or without normals.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let normals = f64::from(has_normals);
        thread::scope(|scope| {
            let [rims, waves] = [
                Compilation::start(scope, || {
                    Kernel::new(gpu, sources::SILHOUETTE_RIMS, "main", &[("NORMALS", normals)])
                })?,
                Compilation::start(scope, || {
                    Kernel::unzeroed(
                        gpu,
                        sources::SILHOUETTE_WAVES,
                        "main",
                        &[("NORMALS", normals)],
                    )
                })?,
            ];
            Ok(Self {
                start: Kernel::new(gpu, sources::SILHOUETTE_START, "main", &[])?,
                tiles: Kernel::new(gpu, sources::SILHOUETTE_TILES, "main", &[])?,
                settle: Kernel::new(gpu, sources::SILHOUETTE_SETTLE, "main", &[])?,
                rims: rims.finish()?,
                waves: waves.finish()?,
                halves: halves(gpu)?,
            })
        })
    }

    /// Dispatches that fill [`SurfaceTarget::sources`], and the picture's depth from
    /// [`SurfaceTarget::depth`].
    pub fn dispatches(&self, gpu: &Gpu, target: &SurfaceTarget<'_>) -> Vec<Dispatch> {
        let base = target.base();
        let &SurfaceTarget { depth, marks, sources, spare, turns, .. } = target;
        let start = [&turns.turns, &turns.groups, &turns.gone, sources];
        let rims = [marks, depth, &base.front, &base.tint, spare, &turns.gone];
        let mut all = vec![
            target.dispatch(gpu, &self.start, &start),
            target.dispatch(gpu, &self.rims, &rims),
        ];
        for turn in 0..TURNS {
            all.push(self.tiles(gpu, target, turn));
            // Two halves, so that the sources are in the same buffer after any number of turns.
            all.push(self.half(gpu, target, turn * 2, [spare, sources]));
            all.push(self.half(gpu, target, turn * 2 + 1, [sources, spare]));
        }
        let settle = [spare, depth, &base.tint, sources, &target.picture.depth];
        all.push(target.dispatch(gpu, &self.settle, &settle));
        all
    }

    fn tiles(&self, gpu: &Gpu, target: &SurfaceTarget<'_>, turn: u32) -> Dispatch {
        let Turns { turns, groups, gone, tiles } = target.turns;
        let size = [target.picture.width, target.picture.height].map(|n| n.div_ceil(TILE));
        let resources = self.resources(target, turn * 2, &[turns, groups, gone, tiles]);
        Dispatch::over(gpu, &self.tiles, size, &resources)
    }

    fn half(
        &self,
        gpu: &Gpu,
        target: &SurfaceTarget<'_>,
        half: u32,
        [before, after]: [&Counted; 2],
    ) -> Dispatch {
        let (base, turns) = (target.base(), target.turns);
        let surface = [target.depth, &base.front, &base.tint, before, after];
        let buffers = [&surface[..], &[&turns.turns, &turns.gone, &turns.tiles]].concat();
        let resources = self.resources(target, half, &buffers);
        let groups = Groups::Indirect((*turns.groups).clone(), u64::from(half / 2) * 16);
        Dispatch::new(gpu, &self.waves, groups, &resources)
    }

    /// Bindings of the uniform, half a turn, and `buffers`.
    fn resources<'b>(
        &'b self,
        target: &'b SurfaceTarget<'_>,
        half: u32,
        buffers: &[&'b Counted],
    ) -> Vec<(u32, BindingResource<'b>)> {
        let half = BindingResource::Buffer(BufferBinding {
            buffer: &self.halves,
            offset: (half as usize * UNIFORM_STRIDE) as u64,
            size: BufferSize::new(size_of::<Half>() as u64),
        });
        let buffers = buffers.iter().map(|b| b.as_entire_binding());
        let first = [target.uniform.as_entire_binding(), half];
        (0..).zip(first.into_iter().chain(buffers)).collect()
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        let Self { start, rims, tiles, waves, settle, .. } = self;
        vec![start, rims, tiles, waves, settle]
    }
}

fn halves(gpu: &Gpu) -> Result<Counted, GpuError> {
    let mut bytes = vec![0; (TURNS * 2) as usize * UNIFORM_STRIDE];
    for (i, place) in (0..).zip(bytes.chunks_mut(UNIFORM_STRIDE)) {
        let half = Half { turn: i / 2, waves: i * HALF_WAVES };
        place[..size_of::<Half>()].copy_from_slice(bytemuck::bytes_of(&half));
    }
    fixed_uniform(gpu, "turns of silhouette", &bytes)
}
