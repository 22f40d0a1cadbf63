//! A binary tree of boxes, split at the median.

use crate::accel::bounds::Bounds;
use crate::ray::Ray;

/// Tree over boxes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    /// Box, and the range of the order (leaf) or the index of the right child (left is next).
    nodes: Vec<(Bounds, u32, u32)>,
    order: Vec<u32>,
}

impl Tree {
    pub(crate) fn new(boxes: Vec<Bounds>) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
        let mut order = std::mem::take(&mut tree.order);
        if !boxes.is_empty() {
            tree.split(&boxes, &mut order, 0);
        }
        tree.order = order;
        tree
    }

    pub(crate) fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |n| n.0)
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.order)
    }

    fn split(&mut self, boxes: &[Bounds], order: &mut [u32], first: u32) {
        let all = order.iter().fold(Bounds::EMPTY, |b, &i| b.union(&boxes[i as usize]));
        let at = self.nodes.len();
        self.nodes.push((all, first, order.len() as u32));
        if order.len() <= 4 {
            return;
        }
        let size = all.max - all.min;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let mid = order.len() / 2;
        let key = |i: u32| boxes[i as usize].centre()[axis];
        order.select_nth_unstable_by(mid, |&a, &b| key(a).total_cmp(&key(b)));
        let (left, right) = order.split_at_mut(mid);
        self.split(boxes, left, first);
        self.nodes[at].1 = self.nodes.len() as u32;
        self.nodes[at].2 = 0;
        self.split(boxes, right, first + mid as u32);
    }

    /// Calls `visit` for all boxes that the ray meets before the limit, which `visit` returns.
    pub(crate) fn walk(&self, ray: &Ray, mut visit: impl FnMut(u32) -> f32) {
        if self.nodes.is_empty() {
            return;
        }
        let inverse = ray.direction.map(|d| 1.0 / if d.abs() < 1e-20 { 1e-20 } else { d });
        let mut limit = ray.reach;
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            let (b, first, count) = self.nodes[at as usize];
            let (x, y) = ((b.min - ray.origin) * inverse, (b.max - ray.origin) * inverse);
            let near = x.min(y).max_element().max(0.0);
            let far = x.max(y).min_element();
            if near * 0.99999 > far * 1.00001 || near * 0.99999 > limit {
                continue;
            }
            if count > 0 {
                for &i in &self.order[first as usize..(first + count) as usize] {
                    limit = visit(i);
                }
            } else {
                stack.extend([first, at + 1]);
            }
        }
    }
}
