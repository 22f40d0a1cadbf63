//! Silhouette on the GPU ([`crate::passes::silhouette`] is the twin): the rims, waves inwards from them in turns, pixels left alone, and the
//! depth image that they leave. Only the tiles of the picture that waves can reach are worked on. Attributes stay where they are: a plane of sources says whose each pixel shows.

use crate::gpu::device::dispatch::{Dispatch, Groups, fixed_uniform};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Beside, Kernel};
use crate::gpu::device::shader::sources;
use crate::gpu::device::shader::sources::constants;
use crate::gpu::device::shader::{same_layout, same_values, without_twin};
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::surface::Target;
use bytemuck::{Pod, Zeroable};
use std::thread;
use wgpu::{BindingResource, BufferBinding, BufferSize, BufferUsages};

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

/// Turns, and waves of half a turn: all together as many as the twin's at most.
const TURNS: u32 = constants::common_turns::TURNS;
const HALF_WAVES: u32 = constants::silhouette_waves::HALO;
const _: () = assert!(TURNS * 2 * HALF_WAVES == crate::passes::silhouette::WAVES);
/// Pixels on a side of a tile.
const TILE: u32 = constants::common_turns::TILE;
/// Bytes from one uniform in a buffer to the next: what WebGPU promises.
const UNIFORM_STRIDE: usize = 256;

/// Half a turn, as the shader reads it (`shaders/silhouette/waves.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Half {
    turn: u32,
    waves: u32,
}

same_layout!(Half { turn, waves });

/// What the turns keep, as `shaders/silhouette/start.wgsl` says.
pub struct Turns {
    turns: Counted,
    groups: Counted,
    gone: Counted,
    tiles: Counted,
}

impl Turns {
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let [across, down] = size.map(|n| u64::from(n.div_ceil(TILE)));
        let buffer = |words: u64, usage| {
            gpu.buffer("turns of silhouette", words * 4, BufferUsages::STORAGE | usage)
        };
        Ok(Self {
            turns: buffer(u64::from(TURNS) * 2, BufferUsages::empty())?,
            groups: buffer(u64::from(TURNS) * 4, BufferUsages::INDIRECT)?,
            gone: buffer(across * down, BufferUsages::empty())?,
            tiles: buffer(across * down, BufferUsages::empty())?,
        })
    }
}

/// The pass.
pub struct Silhouette {
    start: Kernel,
    rims: Kernel,
    tiles: Kernel,
    waves: Kernel,
    settle: Kernel,
    /// All halves of turns.
    halves: Counted,
}

impl Silhouette {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where a shader or memory is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let normals = f64::from(has_normals);
        thread::scope(|scope| {
            let [rims, waves] = [
                Beside::begin(scope, || {
                    Kernel::new(gpu, sources::SILHOUETTE_RIMS, "main", &[("NORMALS", normals)])
                })?,
                Beside::begin(scope, || {
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
                rims: rims.get()?,
                waves: waves.get()?,
                halves: halves(gpu)?,
            })
        })
    }

    /// What fills [`Target::sources`], and the picture's depth from [`Target::depth`].
    pub fn dispatches(&self, gpu: &Gpu, target: &Target<'_>) -> Vec<Dispatch> {
        let base = target.base();
        let &Target { depth, marks, sources, spare, turns, .. } = target;
        let start = [&turns.turns, &turns.groups, &turns.gone, sources];
        let rims = [marks, depth, &base.front, &base.tint, spare, &turns.gone];
        let mut all = vec![
            target.dispatch(gpu, &self.start, &start),
            target.dispatch(gpu, &self.rims, &rims),
        ];
        for turn in 0..TURNS {
            all.push(self.tiles(gpu, target, turn));
            // There and back, so that the sources lie in one place after any number of turns.
            all.push(self.half(gpu, target, turn * 2, [spare, sources]));
            all.push(self.half(gpu, target, turn * 2 + 1, [sources, spare]));
        }
        let settle = [spare, depth, &base.tint, sources, &target.picture.depth];
        all.push(target.dispatch(gpu, &self.settle, &settle));
        all
    }

    fn tiles(&self, gpu: &Gpu, target: &Target<'_>, turn: u32) -> Dispatch {
        let Turns { turns, groups, gone, tiles } = target.turns;
        let size = [target.picture.width, target.picture.height].map(|n| n.div_ceil(TILE));
        let resources = self.resources(target, turn * 2, &[turns, groups, gone, tiles]);
        Dispatch::over(gpu, &self.tiles, size, &resources)
    }

    fn half(
        &self,
        gpu: &Gpu,
        target: &Target<'_>,
        half: u32,
        [before, after]: [&Counted; 2],
    ) -> Dispatch {
        let (base, turns) = (target.base(), target.turns);
        let surface = [target.depth, &base.front, &base.tint, before, after];
        let buffers = [&surface[..], &[&turns.turns, &turns.gone, &turns.tiles]].concat();
        let resources = self.resources(target, half, &buffers);
        let groups = Groups::Told((*turns.groups).clone(), u64::from(half / 2) * 16);
        Dispatch::new(gpu, &self.waves, groups, &resources)
    }

    /// The uniform, half a turn, and these after them.
    fn resources<'b>(
        &'b self,
        target: &'b Target<'_>,
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
