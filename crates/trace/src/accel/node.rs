//! Nodes of a tree: the boxes of eight children, axis by axis, and where the children are. A GPU
//! reads the same bytes.

use crate::accel::WIDTH;
use crate::accel::bounds::Bounds;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

/// Bit of a child that is a leaf; the bits below are its number.
pub const LEAF: u32 = 1 << 31;
/// Child of an unused place.
pub const EMPTY: u32 = u32::MAX;
/// Edge of the box of an unused place, least above greatest. Finite, since WGSL has no infinity.
const NOWHERE: f32 = 1e30;
/// Share of the greatest coordinate by which boxes grow: some roundings of `f32`, so that the
/// boxes of flat surfaces are met by the rays that meet the surface.
const SLACK: f32 = 1e-6;

/// A node with eight children.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct Node {
    /// Least corners of the boxes of the children, then their greatest ones, axis by axis.
    pub edges: [[[f32; WIDTH]; 3]; 2],
    /// Numbers of the children: nodes, leaves ([`LEAF`]), or [`EMPTY`].
    pub child: [u32; WIDTH],
}

impl Default for Node {
    fn default() -> Self {
        let edges = [[[NOWHERE; WIDTH]; 3], [[-NOWHERE; WIDTH]; 3]];
        Self { edges, child: [EMPTY; WIDTH] }
    }
}

/// Width by which boxes within `all` are to grow.
pub(crate) fn slack(all: &Bounds) -> f32 {
    if all.is_empty() { 0.0 } else { SLACK * all.min.abs().max(all.max.abs()).max_element() }
}

impl Node {
    /// Sets the box of a child, grown by `slack`; an empty one is never met.
    pub(crate) fn set_box(&mut self, k: usize, bounds: &Bounds, slack: f32) {
        let is_empty = bounds.is_empty();
        for axis in 0..3 {
            self.edges[0][axis][k] = if is_empty { NOWHERE } else { bounds.min[axis] - slack };
            self.edges[1][axis][k] = if is_empty { -NOWHERE } else { bounds.max[axis] + slack };
        }
    }

    /// Box of all children, grown as theirs are; empty if the node has none.
    pub(crate) fn bounds(&self) -> Bounds {
        let edge = |side: usize, pick: fn(f32, f32) -> f32| {
            Vec3::from_array([0, 1, 2].map(|axis| {
                self.edges[side][axis].iter().copied().fold(self.edges[side][axis][0], pick)
            }))
        };
        let all = Bounds { min: edge(0, f32::min), max: edge(1, f32::max) };
        if all.is_empty() { Bounds::EMPTY } else { all }
    }
}

/// Nodes of the implicit tree over leaves with these boxes, the root first, level by level.
/// Child `k` of the node `i` of a level is the node `8 i + k` of the next.
pub(crate) fn levels(boxes: &[Bounds], slack: f32) -> Vec<Node> {
    let mut sizes = Vec::new();
    let mut size = boxes.len();
    while size > 0 && (size > 1 || sizes.is_empty()) {
        size = size.div_ceil(WIDTH);
        sizes.push(size);
    }
    let mut nodes = vec![Node::default(); sizes.iter().sum()];
    let mut first = nodes.len();
    for (level, &size) in sizes.iter().enumerate() {
        first -= size;
        let (above, below) = nodes.split_at_mut(first + size);
        let own = &mut above[first..];
        let fill = |(i, node): (usize, &mut Node)| {
            let children = if level == 0 { boxes.len() } else { sizes[level - 1] };
            for (k, child) in (i * WIDTH..children.min((i + 1) * WIDTH)).enumerate() {
                if level == 0 {
                    node.set_box(k, &boxes[child], slack);
                    node.child[k] = LEAF | child as u32;
                } else {
                    node.set_box(k, &below[child].bounds(), 0.0);
                    node.child[k] = (first + size + child) as u32;
                }
            }
        };
        own.par_iter_mut().with_min_len(1 << 9).enumerate().for_each(fill);
    }
    nodes
}

/// Fits the boxes of all nodes to those of the leaves. Each node comes after its parent.
pub(crate) fn fit(nodes: &mut [Node], boxes: &[Bounds], slack: f32) {
    for at in (0..nodes.len()).rev() {
        let (above, below) = nodes.split_at_mut(at + 1);
        let node = &mut above[at];
        for k in 0..WIDTH {
            let child = node.child[k];
            if child == EMPTY {
                continue;
            } else if child & LEAF != 0 {
                node.set_box(k, &boxes[(child & !LEAF) as usize], slack);
            } else {
                node.set_box(k, &below[child as usize - at - 1].bounds(), 0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_leaf_hangs_in_boxes_that_hold_it() {
        for count in [0, 1, 8, 9, 64, 65, 1000] {
            let at = |i: usize| Vec3::new(i as f32, (i * i % 17) as f32, 0.0);
            let boxes: Vec<Bounds> =
                (0..count).map(|i| Bounds { min: at(i), max: at(i) + 1.0 }).collect();
            let nodes = levels(&boxes, 0.0);
            let mut met = vec![0; count];
            let mut stack: Vec<u32> = if count > 0 { vec![0] } else { vec![] };
            while let Some(at) = stack.pop() {
                for (k, &child) in nodes[at as usize].child.iter().enumerate() {
                    let edge = |s: usize| {
                        Vec3::from_array([0, 1, 2].map(|a| nodes[at as usize].edges[s][a][k]))
                    };
                    let own = if child == EMPTY {
                        continue;
                    } else if child & LEAF != 0 {
                        met[(child & !LEAF) as usize] += 1;
                        boxes[(child & !LEAF) as usize]
                    } else {
                        stack.push(child);
                        nodes[child as usize].bounds()
                    };
                    assert_eq!([edge(0), edge(1)], [own.min, own.max]);
                }
            }
            assert!(met.iter().all(|&m| m == 1));
        }
    }
}
