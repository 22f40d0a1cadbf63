//! Trees: nodes over leaves of eight primitives. The implicit tree takes runs of eight along the
//! Hilbert curve as leaves, runs of eight leaves as nodes, and so on; it is made within
//! milliseconds, whenever the cut changes. The places of primitives in the leaves are its slots.

use crate::accel::WIDTH;
use crate::accel::bounds::Bounds;
use crate::accel::hilbert;
use crate::accel::node::{Node, fit, levels, slack};
use bytemuck::Pod;
use glam::Vec3;
use rayon::prelude::*;

/// Number of an unused slot.
pub(crate) const NONE: u32 = u32::MAX;
/// Leaves between the one that is filled and the one whose primitives are prefetched.
const AHEAD: usize = 2;
/// Primitives of a task.
const TASK: usize = 1 << 12;

/// How a tree was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Along the Hilbert curve.
    #[default]
    Implicit,
    /// By clustering, which takes longer and makes rays faster.
    Refined,
}

/// A shape that rays meet.
pub trait Primitive: Copy + Send + Sync {
    /// Eight of them.
    type Leaf: Leaf<Primitive = Self>;

    /// Box of the shape.
    fn bounds(&self) -> Bounds;
    /// Place of the shape on the curve.
    fn centre(&self) -> Vec3;
}

/// Eight primitives; all zero, it is unused.
pub trait Leaf: Pod + Send + Sync {
    /// One of them.
    type Primitive: Primitive<Leaf = Self>;

    /// Sets primitive `k`.
    fn set(&mut self, k: usize, primitive: &Self::Primitive);
    /// Box of the first `count` primitives.
    fn bounds(&self, count: usize) -> Bounds;
    /// Primitive `k`.
    fn get(&self, k: usize) -> Self::Primitive;
}

/// A tree with leaves of one kind.
#[derive(Clone, Debug)]
pub struct Tree<L> {
    /// Nodes, the root first, each one after its parent.
    pub nodes: Vec<Node>,
    /// Leaves.
    pub leaves: Vec<L>,
    /// Box of all primitives.
    pub bounds: Bounds,
    /// How it was built.
    pub kind: Kind,
}

impl<L> Default for Tree<L> {
    fn default() -> Self {
        let (bounds, kind) = (Bounds::EMPTY, Kind::Implicit);
        Self { nodes: Vec::new(), leaves: Vec::new(), bounds, kind }
    }
}

impl<L> Tree<L> {
    /// Bytes of nodes and leaves.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.leaves)
    }
}

impl<L: Leaf> Tree<L> {
    /// Builds the implicit tree of `count` primitives from their centres and the box of these.
    /// Returns the primitive of each slot, too. `fetch` prefetches a primitive, if that pays.
    pub(crate) fn implicit(
        count: usize,
        centres: &Bounds,
        centre: impl Fn(usize) -> Vec3 + Sync,
        primitive: impl Fn(usize) -> L::Primitive + Sync,
        fetch: impl Fn(usize) + Sync,
    ) -> (Self, Vec<u32>) {
        let mut slots = hilbert::order(count, centres, centre);
        slots.resize(count.next_multiple_of(WIDTH), NONE);
        let (leaves, boxes) = leaves(&slots, primitive, fetch);
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(b));
        let nodes = levels(&boxes, slack(&bounds));
        (Self { nodes, leaves, bounds, kind: Kind::Implicit }, slots)
    }

    /// Places primitives that have moved, and fits the boxes to them. Which primitives lie together
    /// stays.
    pub(crate) fn refit(
        &mut self,
        slots: &[u32],
        primitive: impl Fn(usize) -> L::Primitive + Sync,
    ) {
        let (leaves, boxes) = leaves(slots, primitive, |_| ());
        self.leaves = leaves;
        self.bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(b));
        fit(&mut self.nodes, &boxes, slack(&self.bounds));
    }
}

/// Leaves with the primitives of `slots`, and their boxes. `fetch` prefetches a primitive.
pub(crate) fn leaves<L: Leaf>(
    slots: &[u32],
    primitive: impl Fn(usize) -> L::Primitive + Sync,
    fetch: impl Fn(usize) + Sync,
) -> (Vec<L>, Vec<Bounds>) {
    let (mut leaves, mut boxes) = (Vec::new(), Vec::new());
    let fill = |slots: &[u32]| {
        let mut leaf = L::zeroed();
        let mut count = 0;
        for &index in slots.iter().filter(|&&s| s != NONE) {
            leaf.set(count, &primitive(index as usize));
            count += 1;
        }
        (leaf, leaf.bounds(count))
    };
    let fill_ahead = |first: usize| {
        let ahead = first + AHEAD * WIDTH;
        for &index in slots.get(ahead..ahead + WIDTH).unwrap_or_default() {
            fetch(index as usize);
        }
        fill(&slots[first..(first + WIDTH).min(slots.len())])
    };
    (0..slots.len().div_ceil(WIDTH))
        .into_par_iter()
        .with_min_len(TASK / WIDTH)
        .map(|leaf| fill_ahead(leaf * WIDTH))
        .unzip_into_vecs(&mut leaves, &mut boxes);
    (leaves, boxes)
}
