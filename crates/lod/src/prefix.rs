//! How many points of a node a view needs, in whole strata, and their resulting distance. The first
//! `prefix` of a node's `count` points are an even sample of it, so that their distance grows with
//! the root, of the order of the dimension, of the share that is left out (kanzok2015, section
//! 3.1).

use esker_points::Node;
use esker_points::strata::{STRATA, prefix_at_least, stratum_len};

/// Least share of the points for the target spacing that a node seen edge-on still gets.
pub(crate) const FACING_LEAST: f64 = 1.0 / 16.0;

/// A node's spacing, the file's unit; 0 if the value is not a length.
pub(crate) fn spacing(node: &Node) -> f64 {
    let spacing = f64::from(node.spacing);
    if spacing.is_finite() { spacing.max(0.0) } else { 0.0 }
}

/// Typical distance of points, the file's unit, when the first `prefix` (at least 1) of the node's
/// `count` points and all of its ancestors' are drawn. Never less than the node's spacing.
///
/// If the node shows only a share of its greatest face (`facing`, 0 to 1), the result is the
/// distance that fills the picture as well face-on: foreshortening brings points together, so
/// splats need not grow by the points that it saves. `above` is [`share_continued`].
pub(crate) fn effective_spacing(
    node: &Node,
    count: usize,
    prefix: usize,
    facing: f64,
    above: f64,
) -> f64 {
    let own = prefix.max(1) as f64 / count as f64;
    let left = (above + (1.0 - above) * own).recip();
    let apart = left.powf(1.0 / f64::from(dimension(node)));
    spacing(node) * (apart * facing.sqrt()).max(1.0)
}

/// Share of the density in a node's cell, 0 to 1, that the points of its ancestors have: both are
/// even samples, which thin out as their spacings tell.
pub fn share_above(node: &Node, parent: Option<&Node>) -> f64 {
    match parent.map(spacing) {
        Some(above) if above > 0.0 => {
            (spacing(node) / above).powi(dimension(node) as i32).clamp(0.0, 1.0)
        }
        _ => 0.0,
    }
}

/// [`share_above`] for the parents of continuations, which have all of their points in that cell. 0
/// for other nodes, whose parents have few.
pub(crate) fn share_continued(node: &Node, parent: Option<&Node>) -> f64 {
    share_above(node, parent.filter(|_| node.is_continuation()))
}

/// A node as the picture shows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProjectedNode {
    /// Distance of its points in the picture, pixels, if all are drawn, seen face-on at its nearest
    /// place.
    pub spacing_px: f64,
    /// Share (0 to 1) of its greatest face that its silhouette has: fewer points fill that.
    pub facing: f64,
    /// Squares of the target spacing that its silhouette covers; infinite if that is unknown.
    pub squares: f64,
    /// [`share_continued`].
    pub above: f64,
}

/// The smallest prefix of whole strata, at least one point, that is dense enough: its points are at
/// most `target_spacing_px` apart, or as many as the silhouette has squares of that side, since
/// only the front one of several surfaces is seen. All points if no prefix is dense enough or the
/// target is 0.
pub(crate) fn wanted(
    node: &Node,
    count: usize,
    projected: &ProjectedNode,
    target_spacing_px: f64,
) -> usize {
    if target_spacing_px <= 0.0 {
        return count;
    }
    let share = (projected.spacing_px / target_spacing_px).powi(dimension(node) as i32);
    // The parent's points count towards the density.
    let share = if projected.above < 1.0 {
        (share - projected.above) / (1.0 - projected.above)
    } else {
        share
    };
    let by_spacing = count as f64 * share * projected.facing.clamp(0.0, 1.0);
    // A rounding error above a whole number must not cost a stratum.
    let points = by_spacing.min(projected.squares) - 1e-6;
    prefix_at_least(node.levels(), (points.ceil() as usize).clamp(1, count.max(1)))
}

/// The largest prefix of whole strata with at most `limit` points.
pub(crate) fn prefix_at_most(levels: impl IntoIterator<Item = usize>, limit: u64) -> usize {
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

/// Dimension by which a node's points thin out: at least 1, and at most 2, since laser scans sample
/// surfaces, also where these wind through a volume.
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
            assert!((effective_spacing(&node, 256, 16, 1.0, 0.0) - 0.5 * factor).abs() < 1e-9);
            assert_eq!(effective_spacing(&node, 256, 256, 1.0, 0.0), 0.5);
        }
    }

    #[test]
    fn a_continuation_makes_its_parent_s_sample_finer_point_by_point() {
        // As many points again as the parent has in the same cell: in a plane 1 / sqrt(2) of its
        // spacing.
        let parent = node(&[256], 2, 1.0);
        let mut node = node(&[16, 240], 2, 0.5f32.sqrt());
        assert_eq!(share_continued(&node, Some(&parent)), 0.0);
        node.shape |= esker_points::node::SHAPE_CONTINUATION;
        let above = share_continued(&node, Some(&parent));
        assert!((above - 0.5).abs() < 1e-6);
        for prefix in [0usize, 16, 31, 136, 256] {
            let expect = ((256.0 + prefix.max(1) as f64) / 256.0).sqrt().recip();
            let spacing = effective_spacing(&node, 256, prefix, 1.0, above);
            assert!((spacing - expect).abs() < 1e-6, "{prefix}: {spacing} {expect}");
            let projected = ProjectedNode {
                spacing_px: 0.5f64.sqrt(),
                facing: 1.0,
                squares: f64::INFINITY,
                above,
            };
            let least = boundaries(&[16, 240]).into_iter().find(|&b| b >= prefix.max(1));
            assert_eq!(
                Some(wanted(&node, 256, &projected, expect * (1.0 + 1e-7))),
                least,
                "{prefix}"
            );
        }
        // A parent that is as fine by itself, or of no usable spacing.
        assert_eq!(share_continued(&node, Some(&self::node(&[1], 2, 0.1))), 1.0);
        assert_eq!(effective_spacing(&node, 256, 1, 1.0, 1.0), spacing(&node));
        assert_eq!(share_continued(&node, Some(&self::node(&[1], 2, 0.0))), 0.0);
    }

    #[test]
    fn damaged_spacings_count_as_zero() {
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
            let face_on = ProjectedNode { spacing_px, facing: 1.0, squares: f64::INFINITY, above: 0.0 };
            let prefix = wanted(&node, count, &face_on, target);
            let distance_px = |prefix| spacing_px * effective_spacing(&node, count, prefix, 1.0, 0.0);
            let at = boundaries(&levels);
            prop_assert!(at.contains(&prefix) && prefix > 0);
            prop_assert!(prefix == count || distance_px(prefix) <= target * (1.0 + 1e-5));
            let smaller = at.iter().copied().rfind(|&b| b < prefix).unwrap_or(0);
            prop_assert!(smaller == 0 || distance_px(smaller) > target);
            let edge_on = wanted(&node, count, &ProjectedNode { facing: 0.0, ..face_on }, target);
            prop_assert!(edge_on <= prefix && at.contains(&edge_on) && edge_on > 0);
            // A silhouette of half as many squares as there are wanted points.
            let squares = prefix as f64 * 0.5;
            let small = ProjectedNode { squares, ..face_on };
            let few = wanted(&node, count, &small, target);
            prop_assert!(at.contains(&few) && few as f64 >= squares - 1e-3 && few <= prefix);
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
