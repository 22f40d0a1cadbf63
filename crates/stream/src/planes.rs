//! Which planes of a node are needed, how long they are, and where they lie in the files.

use crate::landing::Slot;
use crate::options::Needs;
use crate::pool::Pool;
use esker_format::{Forest, PlaneKind, Shown};
use esker_points::node::NONE;
use esker_points::{Lattice, Node};
use std::ops::Range;
use std::sync::Arc;

/// The planes of all files, as they are shown.
#[derive(Clone, Debug)]
pub(crate) struct Planes {
    pub(crate) forest: Arc<Forest>,
    pub(crate) shown: Arc<Shown>,
}

impl Planes {
    /// All of a forest, as it lies in the files.
    #[cfg(test)]
    pub(crate) fn of(forest: Arc<Forest>) -> Self {
        Self { forest, shown: Arc::default() }
    }

    /// The planes without which a node is not drawn, as far as it has them. Those that no file has are left
    /// out.
    pub(crate) fn base(&self, needs: &Needs) -> Vec<PlaneKind> {
        // A compact plane has positions and colours at once.
        let compact = needs.colour.filter(|kind| kind.has_positions());
        let mut base = vec![compact.unwrap_or(PlaneKind::Position)];
        let normals = needs.normals.then_some(PlaneKind::Normal);
        let clip_lines = needs.clip_lines.then_some(PlaneKind::ClipLines);
        let tangents = needs.tangents.then_some(PlaneKind::Tangents);
        let kinds = needs.colour.into_iter().chain(normals).chain(clip_lines).chain(tangents);
        for kind in kinds {
            // The residual is asked for node by node.
            let counts = kind.is_written() && kind != PlaneKind::Residual;
            if counts && self.forest.has(kind) && !base.contains(&kind) {
                base.push(kind);
            }
        }
        base
    }

    pub(crate) fn lattice(&self) -> &Lattice {
        self.forest.lattice()
    }

    pub(crate) fn node(&self, node: u32) -> &Node {
        self.forest.record(node)
    }

    /// The nodes that are always wanted.
    pub(crate) fn roots(&self) -> impl Iterator<Item = u32> + Clone + '_ {
        self.forest.table().roots()
    }

    pub(crate) fn is_root(&self, node: u32) -> bool {
        self.node(node).parent == NONE
    }

    /// Whether a node has a plane: trees of other scans may not.
    pub(crate) fn has(&self, node: u32, kind: PlaneKind) -> bool {
        self.forest.has_plane(node, kind)
    }

    /// Bytes of a node's plane.
    pub(crate) fn bytes(&self, node: u32, kind: PlaneKind) -> u64 {
        let points = self.node(node).points() as u64;
        if let Some(bytes) = self.shown.value_bytes(kind).filter(|_| self.has(node, kind)) {
            return bytes * points;
        }
        if let Some(range) = self.in_page(node, kind) {
            return range.end - range.start;
        }
        self.forest.value_bytes(node, kind) * points
    }

    /// Bytes that a node's plane takes in drawing memory.
    pub(crate) fn taken(&self, node: u32, kind: PlaneKind) -> u64 {
        Pool::taken(self.bytes(node, kind))
    }

    /// Where a plane lies, for [`Forest::read_exact_at`]; `None` for a cold one, which only its page's directory knows,
    /// and for one that is shown otherwise than it lies there.
    pub(crate) fn in_file(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        if self.shown.changes(node, kind) {
            return None;
        }
        let page = self.node(node).page_offset;
        self.in_page(node, kind).map(|r| page + r.start..page + r.end)
    }

    fn in_page(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        self.forest.plane_range(node, kind)
    }
}

/// What a loader is asked to read: planes of one node, and where they go.
#[derive(Clone, Debug)]
pub(crate) struct Request {
    /// Its name, never used twice.
    pub(crate) id: u64,
    pub(crate) node: u32,
    pub(crate) planes: Vec<(PlaneKind, Slot)>,
    /// How it is told whether it is still in view.
    pub(crate) sight: Sight,
    /// Whether it is read by itself: reading it failed before, and shall not fail its neighbours.
    pub(crate) alone: bool,
}

/// What of a node must be in view for it to be loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sight {
    /// It is always wanted: a root.
    Always,
    /// Its own points.
    Contour,
    /// Anything in its cell: it is wanted for its children's sake.
    Cell,
}
