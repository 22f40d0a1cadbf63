//! Thinning of points that are drawn alone: which points of a node the picture needs at a depth. A
//! node's prefix is chosen for its nearest place, so that its far points, and those of its
//! ancestors, would be closer together than asked, in steps at the borders of nodes. A point is
//! therefore drawn up to the depth at which the points before it in its node, and those of the
//! ancestors, are as far apart on the picture as the target (`schuetz2019`).
//! Twin: `shaders/common/thinning.wgsl`.

use crate::frame::{DrawNode, Frame};
use crate::gpu::device::shader::same_values;
use esker_points::Node;
use esker_points::node::LEVELS_MAX;
use esker_points::strata::STRATA;

same_values!(common_thinning == crate::inputs::thinning {
    LEVELS = LEVELS_MAX as u32,
    STRATA = STRATA as u32,
    GOLDEN,
    PER_FRACTION = PER_FRACTION as f64,
});

/// The golden ratio's fraction, times 2^32: its multiples are evenly spread.
pub(crate) const GOLDEN: u32 = 0x9e37_79b9;
/// Steps of a fraction of a stratum.
const PER_FRACTION: f32 = 1.0 / (1 << 24) as f32;

/// Values from which a node's points are thinned.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Thinning {
    /// 1 over the depth, the file's unit, up to which all of the points are drawn.
    pub per_reach: f32,
    /// Share of the density that the ancestors' points have.
    pub above: f32,
    /// Share of the density of each point of the node.
    pub per_point: f32,
    /// Whether points thin out along a line; else as a surface.
    pub is_line: bool,
    /// Number of points up to the end of each level.
    pub ends: [u32; LEVELS_MAX],
}

impl Thinning {
    /// How `frame` thins the points of `draw`; `None` if it draws all.
    pub(crate) fn of<P>(frame: &Frame<'_, P>, draw: &DrawNode<'_, P>) -> Option<Self> {
        if !frame.thins_points() {
            return None;
        }
        let per_reach = Self::per_reach(draw.node, frame.view.focal_px(), frame.target_spacing_px)?;
        Some(Self::of_node(draw.node, draw.above, per_reach))
    }

    fn of_node(node: &Node, above: f32, per_reach: f32) -> Self {
        let mut ends = [0; LEVELS_MAX];
        let mut count = 0;
        for (k, end) in ends.iter_mut().enumerate() {
            count += node.levels().nth(k).unwrap_or(0) as u32;
            *end = count;
        }
        let above = if above > 0.0 { above.min(1.0) } else { 0.0 };
        Self {
            per_reach,
            above,
            per_point: (1.0 - above) / count.max(1) as f32,
            is_line: node.dimension() < 2,
            ends,
        }
    }

    /// [`Thinning::per_reach`] for a target spacing; `None` if the node's spacing is not known.
    fn per_reach(node: &Node, focal_px: f64, target_spacing_px: f64) -> Option<f32> {
        let per_reach = target_spacing_px / (focal_px * f64::from(node.spacing));
        let is_known = per_reach > 0.0 && per_reach < f64::from(f32::MAX);
        is_known.then_some(per_reach as f32)
    }

    /// First point of the level of point `index`, and the number of its points.
    fn level(&self, index: u32) -> [u32; 2] {
        let mut start = 0;
        for &end in &self.ends {
            if index < end {
                return [start, end - start];
            }
            start = end;
        }
        [start, 1]
    }

    /// Share of the density that the ancestors and the points before point `index` have. Within a
    /// stratum points are in the order of a curve; multiples of the golden ratio take them evenly.
    #[inline]
    pub(crate) fn share(&self, index: u32) -> f32 {
        let [start, count] = self.level(index);
        let at = index - start;
        let stratum = at.wrapping_mul(STRATA as u32) / count;
        let fraction = (at.wrapping_mul(GOLDEN) >> 8) as f32 * PER_FRACTION;
        let before = (stratum as f32 + fraction) * (count as f32 / STRATA as f32);
        let share = self.above + self.per_point * (start as f32 + before);
        if self.is_line { share * share } else { share }
    }

    /// Shares of consecutive points from point `first` on.
    #[inline(always)]
    pub(crate) fn shares<const N: usize>(&self, first: u32, shares: &mut [f32; N]) {
        let [start, count] = self.level(first);
        let [at, last] = [first - start, first - start + N as u32 - 1];
        let stratum = |at: u32| at.wrapping_mul(STRATA as u32) / count;
        if last >= count || stratum(at) != stratum(last) {
            (first..).zip(shares).for_each(|(index, share)| *share = self.share(index));
            return;
        }
        // Within one stratum the loop is vectorised.
        let (width, stratum) = (count as f32 / STRATA as f32, stratum(at) as f32);
        for (k, share) in (0..).zip(shares) {
            let fraction = (at.wrapping_add(k).wrapping_mul(GOLDEN) >> 8) as i32 as f32;
            let before = (stratum + fraction * PER_FRACTION) * width;
            let linear = self.above + self.per_point * (start as f32 + before);
            *share = if self.is_line { linear * linear } else { linear };
        }
    }

    /// Whether a point of this share at `depth` is left out.
    #[inline(always)]
    pub(crate) fn leaves_out(&self, share: f32, depth: f32) -> bool {
        let depth = depth * self.per_reach;
        share * (depth * depth) > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn thinning(levels: &[usize], shape: u8, above: f32) -> Thinning {
        let mut node = Node::zeroed();
        node.set_levels(levels);
        node.shape = shape;
        Thinning::of_node(&node, above, 1.0 / 250.0)
    }

    proptest! {
        #[test]
        fn any_part_of_a_node_has_as_many_points_as_its_share_of_the_density(
            levels in prop::collection::vec(600usize..5000, 1..4),
            (above, shape) in (0f32..0.9, 1u8..4),
            (from, wanted) in (0f32..1.0, 0.05f32..1.0),
        ) {
            let thinning = thinning(&levels, shape, above);
            let count = levels.iter().sum::<usize>();
            let limit = above + (1.0 - above) * wanted;
            let limit = if shape == 1 { limit * limit } else { limit };
            // The same part of the curve in each stratum.
            let (mut drawn, mut all, mut start) = (0usize, 0usize, 0usize);
            for n in levels {
                let width = n as f32 / STRATA as f32;
                for at in 0..n {
                    let within = (at as f32 / width).fract();
                    if (from..from + 0.25).contains(&within) {
                        all += 1;
                        let share = thinning.share((start + at) as u32);
                        drawn += usize::from(share <= limit);
                    }
                }
                start += n;
            }
            prop_assume!(all * 10 > count);
            let (share, off) = (drawn as f32 / all as f32, 64.0 / all as f32);
            prop_assert!((share - wanted).abs() <= off, "{share} of {wanted}");
        }

        #[test]
        fn blocks_have_the_shares_of_their_points(
            levels in prop::collection::vec(1usize..900, 0..18), shape in 0u8..4, above in -1f32..2.0,
            first in 0u32..9000,
        ) {
            let levels = &levels[..levels.len().min(LEVELS_MAX)];
            let thinning = thinning(levels, shape, above);
            let mut shares = [0.0; 64];
            thinning.shares(first, &mut shares);
            for (index, share) in (first..).zip(shares) {
                prop_assert_eq!(share.to_bits(), thinning.share(index).to_bits());
                prop_assert!(share >= 0.0);
            }
        }
    }

    #[test]
    fn all_points_are_drawn_up_to_the_reach_and_the_first_farther() {
        let thinning = thinning(&[100, 900], 2, 0.0);
        let drawn = |depth: f32| {
            let left_out = |i: &u32| thinning.leaves_out(thinning.share(*i), depth);
            (0..1000u32).filter(|i| !left_out(i)).count()
        };
        assert_eq!(drawn(249.9), 1000);
        assert!(drawn(500.0).abs_diff(250) < 20 && drawn(1000.0).abs_diff(63) < 10);
    }

    #[test]
    fn nodes_without_a_usable_spacing_are_not_thinned() {
        let mut node = Node::zeroed();
        node.set_levels(&[10]);
        for spacing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            node.spacing = spacing;
            let per_reach = Thinning::per_reach(&node, 1000.0, 2.0);
            assert_eq!(per_reach, None, "{spacing}");
        }
    }
}
