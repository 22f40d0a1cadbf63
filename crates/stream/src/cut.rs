//! The cut of a view as the render thread draws it: nodes, prefixes, and where their planes lie in
//! drawing memory. Immutable once published; a newer one replaces it.

use crate::landing::Slot;
use crate::options::Needs;
use esker_format::PlaneKind;
use esker_lod::{CompactOctree, Counters, View};
use glam::DVec3;

/// What to draw.
#[derive(Clone, Debug)]
pub struct Cut {
    /// Counts published cuts, from 1; 0 for the empty one before the first.
    pub epoch: u64,
    /// The view that it was chosen for.
    pub view: View,
    /// The planes that all of its nodes have, as far as their files have them. What was asked for last by
    /// `Streamer::need`, once the roots have it.
    pub needs: Needs,
    /// The nodes, parents before their children. The octree's entries are in this order.
    pub nodes: Vec<CutNode>,
    /// The drawn cells with their effective spacings.
    pub octree: CompactOctree,
    /// How the choice came about.
    pub counters: Counters,
    /// Whether all that the view wants (within the budgets) is in it.
    pub complete: bool,
    /// Whether nothing more comes until the view, the needs, what is hidden or the file's state change: `complete`, or
    /// what is missing cannot be read, or finds no place. What was told meanwhile may be about to change it, see
    /// [`crate::Streamer::has_taken_in`].
    pub settled: bool,
    /// Milliseconds that the choice took.
    pub lod_ms: f64,
}

/// One node of a cut.
#[derive(Clone, Debug, PartialEq)]
pub struct CutNode {
    /// Index in the node table.
    pub node: u32,
    /// Its first points that are drawn.
    pub prefix: usize,
    /// Typical distance of points in its cell, the file's unit.
    pub effective_spacing: f32,
    /// Its resident planes.
    pub planes: Vec<(PlaneKind, Slot)>,
}

impl CutNode {
    /// Where a plane lies; `None` where it is not resident.
    pub fn slot(&self, kind: PlaneKind) -> Option<Slot> {
        self.planes.iter().find(|(k, _)| *k == kind).map(|&(_, slot)| slot)
    }
}

impl Cut {
    /// What there is before the first choice: nothing.
    pub(crate) fn empty(needs: Needs) -> Self {
        Self {
            epoch: 0,
            view: View::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, 1.0, 1, 1),
            needs,
            nodes: Vec::new(),
            octree: CompactOctree::default(),
            counters: Counters::default(),
            complete: false,
            settled: false,
            lod_ms: 0.0,
        }
    }
}
