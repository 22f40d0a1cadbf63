//! Order in which missing planes are requested: nearest first (kanzok2015, section 3.2.2), or by
//! the error that their absence causes, a byte. Parents come before their children in either case,
//! since children are not drawn without them.

use crate::choose::Choice;
use crate::options::Priority;
use crate::planes::Planes;
use esker_format::PlaneKind;
use esker_lod::{Missing, OrientedBox, Projection, View};
use glam::DVec2;

/// Missing planes of a node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LoadCandidate {
    pub(crate) node: u32,
    pub(crate) kinds: Vec<PlaneKind>,
    /// Whether the node's own points are wanted; otherwise the node is wanted for its children.
    pub(crate) is_seen: bool,
    /// Whether only the surroundings of the picture want the node.
    pub(crate) is_around: bool,
    /// Higher is loaded first.
    score: f64,
}

/// Scores missing planes by the distance of the eye or by the error a byte.
pub(crate) struct Scorer<'a> {
    planes: &'a Planes,
    view: &'a View,
    projection: Projection,
    priority: Priority,
}

impl<'a> Scorer<'a> {
    pub(crate) fn new(planes: &'a Planes, view: &'a View, priority: Priority) -> Self {
        Self { planes, view, projection: Projection::of(view), priority }
    }

    /// Score of planes without which the drawn picture is off by `error_px` pixels on the node's
    /// whole area.
    fn score(&self, node: u32, kinds: &[PlaneKind], error_px: f64) -> f64 {
        let lattice = self.planes.lattice();
        let contour = OrientedBox::of_contour(self.planes.node(node), lattice);
        match self.priority {
            Priority::Distance => -contour.distance(self.view.eye),
            Priority::ErrorPerByte => {
                let bytes: u64 = kinds.iter().map(|&k| self.planes.bytes(node, k)).sum();
                let silhouette = self.projection.silhouette(&contour);
                let clipped =
                    silhouette.map(|s| s.clipped(DVec2::ZERO, self.projection.size_px()).area_px());
                // Nothing is drawn smaller than a pixel.
                let area_px = clipped.unwrap_or(0.0).max(1.0);
                error_px * area_px / bytes.max(1) as f64
            }
        }
    }

    /// Score of planes of the surroundings, regardless of what is seen of them.
    fn score_around(&self, kinds: &[PlaneKind], miss: &Missing) -> f64 {
        match self.priority {
            Priority::Distance => -miss.distance,
            Priority::ErrorPerByte => {
                let bytes: u64 = kinds.iter().map(|&k| self.planes.bytes(miss.node, k)).sum();
                miss.spacing_px / bytes.max(1) as f64
            }
        }
    }

    /// Error of points while a node's residual is missing, pixels.
    fn hot_error_px(&self, node: u32) -> f64 {
        let (record, lattice) = (self.planes.node(node), self.planes.lattice());
        let half_steps = f64::from((1u32 << record.hot_shift.min(31)) - 1) * 0.5;
        let off = half_steps * glam::DVec3::from_array(lattice.scale).length();
        let distance = OrientedBox::of_contour(record, lattice).distance(self.view.eye);
        off * self.view.focal_px() / distance.max(self.view.near)
    }
}

/// Missing planes of a choice, best first, those of the picture before those of its surroundings:
/// base planes of missing nodes, and residuals where hot positions are not exact enough.
/// `missing_of` selects those of some planes of a node that have
/// not been requested yet.
pub(crate) fn load_candidates(
    choice: &Choice,
    scorer: &Scorer<'_>,
    missing_of: impl Fn(u32, &[PlaneKind]) -> Vec<PlaneKind>,
) -> Vec<LoadCandidate> {
    let (mut candidates, mut around) = (Vec::new(), Vec::new());
    let selection = &choice.selection;
    let mut missing = selection.missing.iter().peekable();
    for (i, &node) in selection.wanted.iter().enumerate() {
        let miss = missing.next_if(|m| m.node == node);
        let is_seen = miss.is_none_or(|m| m.prefix > 0);
        if let Some(miss) = miss {
            let kinds = missing_of(node, &choice.base);
            let is_around = i >= selection.wanted_in_picture;
            if !kinds.is_empty() && is_around {
                let score = scorer.score_around(&kinds, miss);
                around.push(LoadCandidate { node, kinds, is_seen, is_around, score });
            } else if !kinds.is_empty() {
                let score = scorer.score(node, &kinds, miss.spacing_px);
                candidates.push(LoadCandidate { node, kinds, is_seen, is_around, score });
            }
        }
        if is_seen && choice.residuals.contains(&node) {
            let kinds = missing_of(node, &[PlaneKind::Residual]);
            if !kinds.is_empty() {
                let score = scorer.score(node, &kinds, scorer.hot_error_px(node));
                let is_around = false;
                candidates.push(LoadCandidate { node, kinds, is_seen, is_around, score });
            }
        }
    }
    let mut candidates = in_order(candidates, scorer.planes);
    candidates.extend(in_order(around, scorer.planes));
    candidates
}

/// Sorts by score. An entry's ancestors get at least its score and come before it.
fn in_order(mut candidates: Vec<LoadCandidate>, planes: &Planes) -> Vec<LoadCandidate> {
    let first_of: std::collections::HashMap<u32, usize> =
        candidates.iter().enumerate().rev().map(|(i, c)| (c.node, i)).collect();
    // Parents come before their children in the list, so going backwards meets children first.
    for i in (0..candidates.len()).rev() {
        let (node, score) = (candidates[i].node, candidates[i].score);
        let own = first_of.get(&node).copied().filter(|&first| first < i);
        let above = own.or_else(|| first_of.get(&planes.node(node).parent).copied());
        if let Some(above) = above.filter(|&above| above < i) {
            candidates[above].score = candidates[above].score.max(score);
        }
    }
    // The sort is stable: of equal scores, ancestors stay first.
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    candidates
}
