//! Builds the implicit tree of discs on the GPU: keys along a Hilbert curve, a radix sort, discs in
//! the order of their keys, and boxes from the leaves up. In: discs in any order. Out: discs and
//! boxes as the kernels traverse them (`shaders/common/tree.wgsl`).

use crate::gpu::{same_layout, same_values, sources, without_twin};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::wgpu::{Buffer, BufferUsages, ComputePass};
use esker_render::gpu::{Gpu, GpuError, Kernel};
use glam::Vec3;
use sources::constants::common_sort_shape::{DIGITS, PAIRS, THREADS};
use sources::constants::trace_keys::BITS;

/// Children of a node, and discs of a leaf.
const WIDTH: u32 = 8;
/// Bits of a key that a round sorts by.
const DIGIT_BITS: u32 = 4;
/// Most levels of nodes: each leaves seven entries on a stack of 64.
const LEVELS_MAX: u32 = 9;
/// Bytes of a node: boxes of eight children.
const NODE_BYTES: u64 = 192;

same_values!(common_tree == crate::gpu::tree { WIDTH, STACK = WIDTH * 8 });
without_twin!(common_tree { LEVEL_SHIFT, WIDENED, DIRECTION_MIN, FRONT, BLEND, ANY, FACING });
without_twin!(common_tree { DEPTH, WEIGHT_MIN, FACING_COSINE, FACING_FROM, FACING_SHARE });
without_twin!(common_normal { NO_NORMAL });
without_twin!(trace_sort_scan { LANES });
without_twin!(trace_boxes { BEYOND });
const _: () = assert!(1 << DIGIT_BITS == DIGITS && LEVELS_MAX * (WIDTH - 1) < WIDTH * 8);

/// The uniform of a tree (`shaders/common/tree.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Tree {
    discs: u32,
    levels: u32,
    culls: u32,
    unused: u32,
    first: [[u32; 4]; 3],
}

same_layout!(Tree { discs, levels, culls, first });

/// The uniform of the keys.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Cube {
    corner: [f32; 4],
    scale: f32,
    count: u32,
    unused: [u32; 2],
}

same_layout!(Cube { corner, scale, count });

/// The uniform of a round of the sort.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Sort {
    count: u32,
    groups: u32,
    shift: u32,
    unused: u32,
}

same_layout!(Sort { count, groups, shift });

/// The uniform of the boxes of a level.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Level {
    first: u32,
    below: u32,
    children: u32,
    nodes: u32,
    discs: u32,
    has_leaves: u32,
    unused: [u32; 2],
}

same_layout!(Level { first, below, children, nodes, discs, has_leaves });

/// A tree in GPU memory.
#[derive(Debug)]
pub(crate) struct GpuTree {
    pub(crate) uniform: Counted,
    pub(crate) boxes: Counted,
    pub(crate) discs: Counted,
}

/// Kernels that build trees.
pub(crate) struct TreeBuilder {
    keys: Kernel,
    count: Kernel,
    scan: Kernel,
    place: Kernel,
    order: Kernel,
    boxes: Kernel,
}

impl Tree {
    /// The tree of a number of discs, its levels' first nodes and numbers of nodes, leaves' first.
    fn new(discs: u32) -> (Self, Vec<Level>) {
        let mut tree = Self { discs, ..Self::zeroed() };
        let mut levels: Vec<Level> = Vec::new();
        let (mut first, mut below, mut children) = (0, 0, discs.div_ceil(WIDTH));
        while discs > 0 && levels.last().is_none_or(|level| level.nodes > 1) {
            let nodes = children.div_ceil(WIDTH);
            let has_leaves = u32::from(levels.is_empty());
            tree.first[levels.len() / 4][levels.len() % 4] = first;
            levels.push(Level { first, below, children, nodes, discs, has_leaves, unused: [0; 2] });
            (below, children) = (first, nodes);
            first += nodes;
        }
        tree.levels = levels.len() as u32;
        (tree, levels)
    }
}

impl TreeBuilder {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |source| Kernel::new(gpu, source, "main", &[]);
        Ok(Self {
            keys: kernel(sources::TRACE_KEYS)?,
            count: kernel(sources::TRACE_SORT_COUNT)?,
            scan: kernel(sources::TRACE_SORT_SCAN)?,
            place: kernel(sources::TRACE_SORT_MOVE)?,
            order: kernel(sources::TRACE_ORDER)?,
            boxes: kernel(sources::TRACE_BOXES)?,
        })
    }

    /// Builds the tree of `count` discs in a buffer; `bounds` are the least and the greatest corner
    /// of their centres. `culls`: whether rays from the eye pass through the backs of discs.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn build(
        &self,
        gpu: &Gpu,
        discs: &Buffer,
        count: u32,
        bounds: [Vec3; 2],
        culls: bool,
    ) -> Result<GpuTree, GpuError> {
        let (tree, levels) = Tree::new(count);
        let tree = Tree { culls: culls.into(), ..tree };
        let nodes = levels.last().map_or(0, |level| u64::from(level.first + level.nodes));
        let made = GpuTree {
            uniform: fixed_uniform(gpu, "tree", bytes_of(&tree))?,
            boxes: gpu.buffer("boxes", nodes * NODE_BYTES, STORED)?,
            discs: gpu.buffer("discs", u64::from(count) * DISC_BYTES, STORED)?,
        };
        if count == 0 {
            return Ok(made);
        }
        let pairs = || gpu.buffer("keys", u64::from(count) * 8, STORED);
        let (mut from, mut to) = (pairs()?, pairs()?);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            let groups = groups_of(count.into());
            let cube = fixed_uniform(gpu, "cube", bytes_of(&Cube::new(count, bounds)))?;
            let bind = self.keys.bind(gpu, &[(0, &cube), (1, discs), (2, &from)]);
            self.keys.dispatch(&mut pass, &bind, groups);
            self.sort(gpu, &mut pass, count, &mut from, &mut to)?;
            let bind = self.order.bind(gpu, &[(0, &from), (1, discs), (2, &made.discs)]);
            self.order.dispatch(&mut pass, &bind, groups);
            for level in &levels {
                let uniform = fixed_uniform(gpu, "level", bytes_of(level))?;
                let bound = [(0, &*uniform), (1, &*made.discs), (2, &*made.boxes)];
                let bind = self.boxes.bind(gpu, &bound);
                let groups = groups_of(u64::from(level.nodes) * u64::from(WIDTH));
                self.boxes.dispatch(&mut pass, &bind, groups);
            }
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(made)
    }

    /// Sorts pairs by their keys, from one buffer to the other and back.
    fn sort<'a>(
        &self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        count: u32,
        from: &'a mut Counted,
        to: &'a mut Counted,
    ) -> Result<(), GpuError> {
        let groups = count.div_ceil(THREADS * PAIRS);
        let counts = gpu.buffer("counts", u64::from(groups * DIGITS) * 4, STORED)?;
        for shift in (0..3 * BITS).step_by(DIGIT_BITS as usize) {
            let shape = Sort { count, groups, shift, unused: 0 };
            let uniform = fixed_uniform(gpu, "sort", bytes_of(&shape))?;
            let bind = self.count.bind(gpu, &[(0, &uniform), (1, from), (2, &counts)]);
            self.count.dispatch(pass, &bind, [groups, 1, 1]);
            let bind = self.scan.bind(gpu, &[(0, &uniform), (1, &counts)]);
            self.scan.dispatch(pass, &bind, [1, 1, 1]);
            let bound = [(0, &*uniform), (1, &**from), (2, &*counts), (3, &**to)];
            let bind = self.place.bind(gpu, &bound);
            self.place.dispatch(pass, &bind, [groups, 1, 1]);
            std::mem::swap(from, to);
        }
        Ok(())
    }
}

/// Bytes of a disc.
pub(crate) const DISC_BYTES: u64 = 32;

const STORED: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);

impl Cube {
    /// Cells of the curve for the cube around a box; one cell if the box has no extent.
    fn new(count: u32, [low, high]: [Vec3; 2]) -> Self {
        let side = (high - low).max_element();
        let cells = (1 << BITS) as f32;
        let scale = if side > 0.0 && side.is_finite() { cells / side } else { 0.0 };
        let corner = if low.is_finite() { low } else { Vec3::ZERO };
        Self { corner: corner.extend(0.0).to_array(), scale, count, unused: [0; 2] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_their_width_thrice_until_one_node_is_left() {
        for discs in [0, 1, 8, 9, 64, 65, 4_000_000] {
            let (tree, levels) = Tree::new(discs);
            assert_eq!(tree.levels, levels.len() as u32);
            assert!(tree.levels <= LEVELS_MAX);
            let mut children = discs.div_ceil(8);
            let mut first = 0;
            for level in &levels {
                assert_eq!((level.first, level.children), (first, children));
                children = children.div_ceil(8);
                assert_eq!(level.nodes, children);
                first += children;
            }
            assert_eq!(levels.last().map_or(0, |l| l.nodes), u32::from(discs > 0));
        }
    }
}
