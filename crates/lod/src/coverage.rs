//! The share of a picture that the contours of nodes cover: what a frame will cost is estimated
//! from it before anything is drawn.

use crate::oriented_box::OrientedBox;
use crate::project::Projection;
use crate::raster::Rows;
use crate::selection::Drawn;
use crate::view::View;
use esker_points::{Lattice, Node};
use glam::DVec2;
use std::collections::HashSet;

/// Squares along a side of the picture.
const SIDE: usize = 64;

/// Estimates the share of the picture of `view`, 0 to 1, that drawn nodes cover, from the contours
/// of those of which no child is drawn. Contours include gaps between points, so scans with many
/// gaps cover less.
pub fn covered_share(nodes: &[Node], lattice: &Lattice, view: &View, drawn: &[Drawn]) -> f64 {
    let (projection, set): (_, HashSet<u32>) =
        (Projection::of(view), drawn.iter().map(|drawn| drawn.node).collect());
    let scale = DVec2::splat(SIDE as f64) / projection.size_px();
    let mut covered = [[false; SIDE]; SIDE];
    let mut rows = Rows::<SIDE>::new();
    for node in drawn.iter().filter_map(|drawn| nodes.get(drawn.node as usize)) {
        let children = node.first_child..node.first_child + u32::from(node.child_count);
        if children.into_iter().any(|child| set.contains(&child)) {
            continue;
        }
        let contour = OrientedBox::of_contour(node, lattice);
        let Some(silhouette) = projection.silhouette(&contour) else { continue };
        rows.cover(silhouette.corners(), scale);
        rows.covered().for_each(|(row, squares)| covered[row][squares].fill(true));
    }
    let count = covered.iter().flatten().filter(|covered| **covered).count();
    count as f64 / (SIDE * SIDE) as f64
}
