//! The cut of a view as the render thread draws it: nodes, prefixes, and where their planes lie in
//! drawing memory. Immutable once published; a newer one replaces it.

use crate::landing::Slot;
use esker_format::PlaneKind;
use esker_lod::{CompactOctree, Counters, View};

/// What to draw.
#[derive(Clone, Debug)]
pub struct Cut {
    /// Counts published cuts, from 1.
    pub epoch: u64,
    /// The view that it was chosen for.
    pub view: View,
    /// The nodes, parents before their children. The octree's entries are in this order.
    pub nodes: Vec<CutNode>,
    /// The drawn cells with their effective spacings.
    pub octree: CompactOctree,
    /// How the choice came about.
    pub counters: Counters,
    /// Whether all that the view wants (within the budgets) is in it.
    pub complete: bool,
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
