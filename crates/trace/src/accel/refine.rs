//! Builds a better tree than the implicit one from the same primitives: clustering of neighbours
//! (PLOC, `meister2018`) by the crate `obvhs`, whose binary tree is collapsed to nodes of eight.

use crate::accel::WIDTH;
use crate::accel::bounds::Bounds;
use crate::accel::node::{LEAF, Node, fit, slack};
use crate::accel::tree::{Kind, Leaf, NONE, Primitive, Tree, leaves};
use crate::accel::walk::STACK;
use esker_points::fetch::fetch;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

/// Share of its size by which a box is moved at random before clustering. Where many pairs cost the
/// same (points on a grid, or at one place), each round would join one pair only.
const JITTER: f32 = 0.05;

/// Builds the tree of `primitives` by clustering, and returns the primitive of each slot. `None`
/// where clusters would not help: few primitives, or a tree too deep for the traversal.
pub(crate) fn refined<L: Leaf>(primitives: &[L::Primitive]) -> Option<(Tree<L>, Vec<u32>)> {
    if primitives.len() <= WIDTH {
        return None;
    }
    let boxes = jittered(primitives);
    let binary = cluster(&boxes);
    let mut shape = Shape { binary: &binary, nodes: Vec::new(), slots: Vec::new() };
    shape.collapse()?;
    let Shape { mut nodes, slots, .. } = shape;
    let (leaves, boxes) = leaves(&slots, |i| primitives[i], |i| fetch(primitives, i));
    let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(b));
    fit(&mut nodes, &boxes, slack(&bounds));
    Some((Tree { nodes, leaves, bounds, kind: Kind::Refined }, slots))
}

/// Boxes of primitives, grown at random but the same in each run.
fn jittered<P: Primitive>(primitives: &[P]) -> Vec<Aabb> {
    let all = primitives.iter().fold(Bounds::EMPTY, |all, p| all.union(&p.bounds()));
    // The least distance of points on a line; those on a surface are farther apart.
    let apart = (all.max - all.min) / primitives.len() as f32;
    let grow = |(i, primitive): (usize, &P)| {
        let Bounds { min, max } = primitive.bounds();
        let most = (max - min + apart) * JITTER;
        let share = |salt: u32| {
            let h = (i as u32 ^ salt).wrapping_mul(0x9e37_79b1);
            let h = (h ^ h >> 15).wrapping_mul(0x85eb_ca6b);
            (h >> 8) as f32 / (1 << 24) as f32
        };
        Aabb::new((min - most * share(0)).into(), (max + most * share(1 << 31)).into())
    };
    primitives.par_iter().enumerate().map(grow).collect()
}

/// The binary tree of clusters, with up to eight primitives a leaf.
pub(crate) fn cluster(boxes: &[Aabb]) -> Bvh2 {
    let how = BvhBuildParams::fast_build();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        how.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        how.sort_precision,
        how.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut tree, how.reinsertion_batch_ratio, None);
    collapse(&mut tree, WIDTH as u32, how.collapse_traversal_cost);
    tree
}

/// Nodes of eight, made from a binary tree.
struct Shape<'a> {
    binary: &'a Bvh2,
    nodes: Vec<Node>,
    slots: Vec<u32>,
}

impl Shape<'_> {
    /// Makes a node of each binary node that is left when the largest children are replaced by
    /// their own, up to eight.
    fn collapse(&mut self) -> Option<()> {
        self.nodes.push(Node::default());
        let mut stack = vec![(0, 0, 1)];
        while let Some((at, from, waiting)) = stack.pop() {
            let (children, count) = self.children(from);
            // Entries that wait on the stack of a traversal below this node.
            let waiting = waiting + count - 1;
            if waiting > STACK {
                return None;
            }
            for (k, &child) in children[..count].iter().enumerate() {
                let binary = &self.binary.nodes[child];
                self.nodes[at].child[k] = if binary.is_leaf() {
                    LEAF | self.leaf(binary)?
                } else {
                    let node = self.nodes.len();
                    self.nodes.push(Node::default());
                    stack.push((node, child, waiting));
                    node as u32
                };
            }
        }
        Some(())
    }

    /// Up to eight binary nodes below one.
    fn children(&self, from: usize) -> ([usize; WIDTH], usize) {
        let nodes = &self.binary.nodes;
        let mut children = [from; WIDTH];
        let mut count = 1;
        while count < WIDTH {
            let inner = (0..count).filter(|&k| !nodes[children[k]].is_leaf());
            let area = |k: &usize| nodes[children[*k]].aabb().half_area();
            let Some(k) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
            let first = nodes[children[k]].first_index as usize;
            children[k] = first;
            children[count] = first + 1;
            count += 1;
        }
        (children, count)
    }

    /// Appends a leaf and returns its number; `None` if the primitives are too many for one.
    fn leaf(&mut self, node: &Bvh2Node) -> Option<u32> {
        let number = self.slots.len() / WIDTH;
        let (first, count) = (node.first_index as usize, node.prim_count as usize);
        if count > WIDTH {
            return None;
        }
        self.slots.extend_from_slice(&self.binary.primitive_indices[first..first + count]);
        self.slots.resize((number + 1) * WIDTH, NONE);
        Some(number as u32)
    }
}
