//! The cut of a view as the render thread draws it: nodes, prefixes, and the slots of their planes
//! in drawing memory. A published cut is immutable; a newer one replaces it.

use crate::landing::Slot;
use crate::options::Shown;
use esker_format::{Forest, PlaneKind};
use esker_lod::{CompactOctree, Counters, View};
use glam::DVec3;
use std::sync::Arc;

/// The nodes to draw for a view.
#[derive(Clone, Debug)]
pub struct Cut {
    /// Number of the published cut, from 1; 0 for the empty cut before the first.
    pub epoch: u64,
    /// View that the cut was chosen for.
    pub view: View,
    /// The forest whose table has the nodes: the newest one of a tree that grows.
    pub forest: Arc<Forest>,
    /// What the cut shows. All nodes have the planes that it needs, as far as their files have
    /// them. It is what `Streamer::show` set last, once the nodes of the picture have its planes,
    /// or the roots have them and there is no memory for the other ones.
    pub shown: Arc<Shown>,
    /// Nodes, parents before their children. The octree's entries are in this order.
    pub nodes: Vec<CutNode>,
    /// Drawn cells with their effective spacings.
    pub octree: CompactOctree,
    /// What lies around the picture, for light; `None` if that is switched off
    /// ([`crate::Streamer::surround`]).
    pub surroundings: Option<Arc<CutSurroundings>>,
    /// Counters of the choice.
    pub counters: Counters,
    /// Bytes of drawing memory from the first one on within which the slots of this cut and of all
    /// bytes yet to land lie, unless a later cut has more.
    pub drawing_bytes: u64,
    /// Whether the cut has everything that the view and its surroundings want within the budgets.
    pub complete: bool,
    /// Whether no newer cut comes until the view, the needs, what is hidden or the state of the
    /// file changes: the cut is `complete`, or its missing planes cannot be read or find no slot.
    /// Inputs that arrived later may still change it, see [`crate::Streamer::has_taken_in`].
    pub settled: bool,
    /// Time of the choice, milliseconds.
    pub lod_ms: f64,
}

/// Nodes around the picture of a cut: beside, behind and hidden from the eye. None of them is in
/// the picture. Their slots may be read as long as those of the cut's nodes.
#[derive(Clone, Debug, Default)]
pub struct CutSurroundings {
    /// Nodes, parents before their children, with all of their points that the filter leaves.
    pub nodes: Vec<CutNode>,
    /// Effective spacings for light: the entries of the nodes of the picture, then those of the
    /// surroundings ([`esker_lod::light_octree`]).
    pub octree: CompactOctree,
}

/// One node of a cut.
#[derive(Clone, Debug, PartialEq)]
pub struct CutNode {
    /// Index in the node table.
    pub node: u32,
    /// Number of points to draw, from the first one on.
    pub prefix: usize,
    /// Typical distance of points in the node's cell, the file's unit.
    pub effective_spacing: f32,
    /// Resident planes with their slots.
    pub planes: Vec<(PlaneKind, Slot)>,
}

impl CutNode {
    /// Slot of a plane; `None` if the plane is not resident.
    pub fn slot(&self, kind: PlaneKind) -> Option<Slot> {
        self.planes.iter().find(|(k, _)| *k == kind).map(|&(_, slot)| slot)
    }
}

impl Cut {
    /// Nodes whose points light meets: those of the picture, then those of the surroundings. This
    /// is the order of the entries of [`CutSurroundings::octree`].
    pub fn lit_nodes(&self) -> impl Iterator<Item = &CutNode> {
        self.nodes.iter().chain(self.surroundings.iter().flat_map(|around| &around.nodes))
    }

    /// The empty cut before the first choice.
    pub(crate) fn empty(forest: Arc<Forest>, shown: Arc<Shown>) -> Self {
        Self {
            epoch: 0,
            view: View::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, 1.0, 1, 1),
            forest,
            shown,
            nodes: Vec::new(),
            octree: CompactOctree::default(),
            surroundings: None,
            counters: Counters::default(),
            drawing_bytes: u64::MAX,
            complete: false,
            settled: false,
            lod_ms: 0.0,
        }
    }
}
