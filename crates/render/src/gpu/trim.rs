//! Trim on the GPU ([`crate::trim`] is the twin): the rims, waves inwards from them in turns, and the depth image
//! that they leave. Attributes stay where they are: a plane of sources says whose each pixel shows.

use super::device::{Counted, Gpu};
use super::dispatch::{Dispatch, fixed_uniform};
use super::error::GpuError;
use super::kernel::Kernel;
use super::shader::sources;
use super::surface::Target;
use crate::same_layout;
use bytemuck::{Pod, Zeroable};
use wgpu::{BindingResource, BufferBinding, BufferSize};

/// Turns, and waves of half a turn: all together as many as the twin's at most.
const TURNS: u32 = 16;
const HALF_WAVES: u32 = 8;
const _: () = assert!(TURNS * 2 * HALF_WAVES == crate::trim::WAVES);
/// Pixels on a side of a tile of a group.
const TILE: u32 = 16;
/// Bytes from one uniform in a buffer to the next: what WebGPU promises.
const UNIFORM_STRIDE: usize = 256;

/// Half a turn, as the shader reads it (`shaders/trim/waves.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Half {
    turn: u32,
    waves: u32,
}

same_layout!(Half { turn, waves });

/// The pass.
pub struct Trim {
    rims: Kernel,
    waves: Kernel,
    settle: Kernel,
    /// All halves of turns.
    halves: Counted,
}

impl Trim {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where a shader or memory is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(has_normals))];
        Ok(Self {
            rims: Kernel::new(gpu, sources::TRIM_RIMS, "main", &constants)?,
            waves: Kernel::unzeroed(gpu, sources::TRIM_WAVES, "main", &constants)?,
            settle: Kernel::new(gpu, sources::TRIM_SETTLE, "main", &[])?,
            halves: halves(gpu)?,
        })
    }

    /// What fills [`Target::sources`], and the picture's depth from [`Target::depth`].
    pub fn dispatches(&self, gpu: &Gpu, target: &Target<'_>) -> Vec<Dispatch> {
        let base = target.base();
        let &Target { depth, marks, sources, spare, turns, .. } = target;
        let rims = [marks, depth, &base.front, &base.tint, sources, turns];
        let mut all = vec![target.dispatch(gpu, &self.rims, &rims)];
        for half in 0..TURNS * 2 {
            // There and back, so that the sources lie in one place after any number of turns.
            let [before, after] = if half % 2 == 0 { [sources, spare] } else { [spare, sources] };
            all.push(self.half(gpu, target, half, before, after));
        }
        let settle = [sources, depth, &target.picture.depth];
        all.push(target.dispatch(gpu, &self.settle, &settle));
        all
    }

    fn half(
        &self,
        gpu: &Gpu,
        target: &Target<'_>,
        half: u32,
        before: &Counted,
        after: &Counted,
    ) -> Dispatch {
        let (base, picture) = (target.base(), target.picture);
        let half = BindingResource::Buffer(BufferBinding {
            buffer: &self.halves,
            offset: (half as usize * UNIFORM_STRIDE) as u64,
            size: BufferSize::new(size_of::<Half>() as u64),
        });
        let planes = [target.depth, &base.front, &base.tint, before, after, target.turns];
        let mut resources = vec![(0, target.uniform.as_entire_binding()), (1, half)];
        resources.extend((2..).zip(planes.map(|p| p.as_entire_binding())));
        let groups = [picture.width, picture.height].map(|n| n.div_ceil(TILE));
        Dispatch::new(gpu, &self.waves, groups, &resources)
    }

    pub(super) fn kernels(&mut self) -> Vec<&mut Kernel> {
        vec![&mut self.rims, &mut self.waves, &mut self.settle]
    }
}

fn halves(gpu: &Gpu) -> Result<Counted, GpuError> {
    let mut bytes = vec![0; (TURNS * 2) as usize * UNIFORM_STRIDE];
    for (i, place) in (0..).zip(bytes.chunks_mut(UNIFORM_STRIDE)) {
        let half = Half { turn: i / 2, waves: i * HALF_WAVES };
        place[..size_of::<Half>()].copy_from_slice(bytemuck::bytes_of(&half));
    }
    fixed_uniform(gpu, "turns of trim", &bytes)
}
