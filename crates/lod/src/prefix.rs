//! How many points of a node a view needs, in whole strata, and how far apart they then are. The first
//! `prefix` of a node's `count` points are an even sample of it, so that their distance grows with the
//! dimension's root of what is left out (DESIGN, section 8; kanzok2015, section 3.1).

use esker_points::Node;
use esker_points::strata::{STRATA, prefix_at_least, stratum_len};

/// Least share of the points that the spacing asks for which a node seen edge-on still gets. Where no
/// normals are known splats face the viewer: a quarter of the points makes them twice as wide, and no
/// wider than that may a wall's edge become.
const FACING_LEAST: f64 = 0.25;

/// A node's spacing, the file's unit; 0 for what is no length.
pub fn spacing(node: &Node) -> f64 {
    let spacing = f64::from(node.spacing);
    if spacing.is_finite() { spacing.max(0.0) } else { 0.0 }
}

/// Typical distance of points, the file's unit, when the first `prefix` (at least 1) of the node's
/// `count` points and all of its ancestors' are drawn.
pub fn effective_spacing(node: &Node, count: usize, prefix: usize) -> f64 {
    let left = count as f64 / prefix.max(1) as f64;
    spacing(node) * left.powf(1.0 / f64::from(dimension(node)))
}

/// The smallest prefix of whole strata, at least one point, whose points are at most
/// `target_spacing_px` apart, where all `count` points are `spacing_px` apart; all points where none
/// is or the target is 0. `facing` is the share (0 to 1) of the node's greatest face that its silhouette has: fewer points
/// fill that.
pub fn wanted(
    node: &Node,
    count: usize,
    spacing_px: f64,
    target_spacing_px: f64,
    facing: f64,
) -> usize {
    if target_spacing_px <= 0.0 {
        return count;
    }
    let share = (spacing_px / target_spacing_px).powi(dimension(node) as i32);
    // A rounding error above a whole number must not cost a stratum.
    let points = count as f64 * share * facing.clamp(FACING_LEAST, 1.0) - 1e-6;
    prefix_at_least(node.levels(), (points.ceil() as usize).clamp(1, count.max(1)))
}

/// The largest prefix of whole strata with at most `limit` points.
pub fn prefix_at_most(levels: impl IntoIterator<Item = usize>, limit: u64) -> usize {
    let limit = usize::try_from(limit).unwrap_or(usize::MAX);
    let mut have = 0;
    for n in levels {
        if have + n <= limit {
            have += n;
            continue;
        }
        for s in 0..STRATA {
            if have + stratum_len(n, s) > limit {
                return have;
            }
            have += stratum_len(n, s);
        }
    }
    have
}

/// The dimension by which a node's points thin out: at least 1, and at most 2, since what a laser sees are
/// surfaces, also where they wind through a volume. With 3 there, half-drawn walls got radii that left holes.
fn dimension(node: &Node) -> u32 {
    node.dimension().clamp(1, 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn node(levels: &[usize], dimension: u8, spacing: f32) -> Node {
        let mut node = Node::zeroed();
        node.set_levels(levels);
        node.shape = dimension;
        node.spacing = spacing;
        node
    }

    /// All prefixes of whole strata, ascending.
    fn boundaries(levels: &[usize]) -> Vec<usize> {
        let mut at = vec![0];
        for &n in levels {
            for s in 0..STRATA {
                at.push(at[at.len() - 1] + stratum_len(n, s));
            }
        }
        at
    }

    #[test]
    fn spacing_grows_with_the_root_of_what_is_left_out() {
        for (dimension, factor) in [(0, 16.0), (1, 16.0), (2, 4.0), (3, 4.0)] {
            let node = node(&[16, 240], dimension, 0.5);
            assert!((effective_spacing(&node, 256, 16) - 0.5 * factor).abs() < 1e-9);
            assert_eq!(effective_spacing(&node, 256, 256), 0.5);
        }
    }

    #[test]
    fn damaged_spacings_are_no_length() {
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            assert_eq!(spacing(&node(&[1], 2, bad)), 0.0);
        }
    }

    proptest! {
        #[test]
        fn the_wanted_prefix_is_the_smallest_that_is_dense_enough(
            levels in prop::collection::vec(0usize..2000, 1..8), dimension in 0u8..4,
            spacing_px in 0.01f64..10.0, target in 0.1f64..10.0,
        ) {
            let count = levels.iter().sum::<usize>();
            prop_assume!(count > 0);
            let node = node(&levels, dimension, 1.0);
            let prefix = wanted(&node, count, spacing_px, target, 1.0);
            let distance_px = |prefix| spacing_px * effective_spacing(&node, count, prefix);
            let at = boundaries(&levels);
            prop_assert!(at.contains(&prefix) && prefix > 0);
            prop_assert!(prefix == count || distance_px(prefix) <= target * (1.0 + 1e-5));
            let smaller = at.iter().copied().rfind(|&b| b < prefix).unwrap_or(0);
            prop_assert!(smaller == 0 || distance_px(smaller) > target);
            let edge_on = wanted(&node, count, spacing_px, target, 0.0);
            prop_assert!(edge_on <= prefix && at.contains(&edge_on) && edge_on > 0);
        }

        #[test]
        fn the_largest_prefix_within_a_limit_is_whole_strata(
            levels in prop::collection::vec(0usize..500, 0..8), limit in 0u64..3000,
        ) {
            let at = boundaries(&levels);
            let most = at.iter().copied().rfind(|&b| b as u64 <= limit).unwrap_or(0);
            prop_assert_eq!(prefix_at_most(levels, limit), most);
        }
    }
}
