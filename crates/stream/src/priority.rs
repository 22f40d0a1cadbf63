//! In what order missing planes are asked for: the nearest first (kanzok2015, section 3.2.2), or those
//! first whose absence shows most for their bytes. Parents come before their children in either case,
//! since without them children are not drawn.

use crate::choose::Choice;
use crate::options::Priority;
use crate::planes::Planes;
use esker_format::PlaneKind;
use esker_lod::{OrientedBox, Projection, View};
use glam::DVec2;

/// Planes of a node to be asked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wish {
    pub(crate) node: u32,
    pub(crate) kinds: Vec<PlaneKind>,
    /// Whether its own points are wanted; else it is for its children's sake.
    pub(crate) is_seen: bool,
    /// Higher comes first.
    worth: f64,
}

/// Distance of the eye to a node's points, or what its points are worth a byte.
pub(crate) struct Worth<'a> {
    planes: &'a Planes,
    view: &'a View,
    projection: Projection,
    priority: Priority,
}

impl<'a> Worth<'a> {
    pub(crate) fn new(planes: &'a Planes, view: &'a View, priority: Priority) -> Self {
        Self { planes, view, projection: Projection::of(view), priority }
    }

    /// Of planes without which what is drawn is off by `error_px` pixels on all of the node's area.
    fn of(&self, node: u32, kinds: &[PlaneKind], error_px: f64) -> f64 {
        let lattice = self.planes.lattice();
        let contour = OrientedBox::of_contour(self.planes.node(node), lattice);
        match self.priority {
            Priority::Distance => -contour.distance(self.view.eye),
            Priority::ErrorPerByte => {
                let bytes: u64 = kinds.iter().map(|&k| self.planes.bytes(node, k)).sum();
                let silhouette = self.projection.silhouette(&contour);
                let clipped =
                    silhouette.map(|s| s.clipped(DVec2::ZERO, self.projection.size_px()).area_px());
                // Nothing is drawn finer than a pixel.
                let area_px = clipped.unwrap_or(0.0).max(1.0);
                error_px * area_px / bytes.max(1) as f64
            }
        }
    }

    /// Pixels by which points may be off while a node's residual is missing.
    fn hot_error_px(&self, node: u32) -> f64 {
        let (record, lattice) = (self.planes.node(node), self.planes.lattice());
        let half_steps = f64::from((1u32 << record.hot_shift.min(31)) - 1) * 0.5;
        let off = half_steps * glam::DVec3::from_array(lattice.scale).length();
        let distance = OrientedBox::of_contour(record, lattice).distance(self.view.eye);
        off * self.view.focal_px() / distance.max(self.view.near)
    }
}

/// What a choice misses, best first: base planes of missing nodes, and residuals where hot positions
/// are not exact enough. `lacks` tells which of some planes of a node have not been asked for yet.
pub(crate) fn wishes(
    choice: &Choice,
    worth: &Worth<'_>,
    lacks: impl Fn(u32, &[PlaneKind]) -> Vec<PlaneKind>,
) -> Vec<Wish> {
    let mut wishes: Vec<Wish> = Vec::new();
    let selection = &choice.selection;
    let mut missing = selection.missing.iter().peekable();
    for &node in &selection.wanted {
        let miss = missing.next_if(|m| m.node == node);
        let is_seen = miss.is_none_or(|m| m.prefix > 0);
        if let Some(miss) = miss {
            let kinds = lacks(node, &choice.base);
            if !kinds.is_empty() {
                let worth = worth.of(node, &kinds, miss.spacing_px);
                wishes.push(Wish { node, kinds, is_seen, worth });
            }
        }
        if is_seen && choice.residuals.contains(&node) {
            let kinds = lacks(node, &[PlaneKind::Residual]);
            if !kinds.is_empty() {
                let worth = worth.of(node, &kinds, worth.hot_error_px(node));
                wishes.push(Wish { node, kinds, is_seen, worth });
            }
        }
    }
    in_order(wishes, worth.planes)
}

/// Sorts by worth; what is above a wish in the tree is worth as much as that, and stands before it.
fn in_order(mut wishes: Vec<Wish>, planes: &Planes) -> Vec<Wish> {
    let first_of: std::collections::HashMap<u32, usize> =
        wishes.iter().enumerate().rev().map(|(i, w)| (w.node, i)).collect();
    // Parents stand before their children, so going backwards meets children first.
    for i in (0..wishes.len()).rev() {
        let (node, worth) = (wishes[i].node, wishes[i].worth);
        let own = first_of.get(&node).copied().filter(|&first| first < i);
        let above = own.or_else(|| first_of.get(&planes.node(node).parent).copied());
        if let Some(above) = above.filter(|&above| above < i) {
            wishes[above].worth = wishes[above].worth.max(worth);
        }
    }
    // Stable: of equal worth, those above stay first.
    wishes.sort_by(|a, b| b.worth.total_cmp(&a.worth));
    wishes
}
