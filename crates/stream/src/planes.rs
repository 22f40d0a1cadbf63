//! The planes of a node: which of them are needed, how long they are, and where they lie in the
//! files. Also the requests for planes that go to the loaders.

use crate::landing::Slot;
use crate::options::Needs;
use crate::pool::Pool;
use esker_format::{Forest, ForestFilter, PlaneKind, ReadRule};
use esker_points::node::NONE;
use esker_points::{Lattice, Node};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

/// Planes of all files of a forest, as they are loaded.
#[derive(Clone, Debug)]
pub(crate) struct Planes {
    pub(crate) forest: Arc<Forest>,
    pub(crate) filter: Arc<ForestFilter>,
    pub(crate) rules: RuleNumbers,
}

/// Numbers of the rules by which a filter changes planes while they are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RuleNumbers {
    positions: u32,
    colours: u32,
    codes: u32,
}

/// A plane of a node in one of the forms in which it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlaneForm {
    pub(crate) kind: PlaneKind,
    /// Number of the rule by which it is changed while it is read; 0 for bytes of the file.
    pub(crate) rule: u32,
}

/// Numbers rules, so that planes that were read by an equal rule are used again.
#[derive(Debug, Default)]
pub(crate) struct Rules {
    /// The newest rules, the last one last.
    known: VecDeque<(ReadRule, u32)>,
    last: u32,
}

/// Greatest number of rules that are known.
const RULES_MAX: usize = 32;

impl Rules {
    /// Numbers of the rules of a filter.
    pub(crate) fn of(&mut self, filter: &ForestFilter) -> RuleNumbers {
        let mut number = |rule: Option<ReadRule>| rule.map_or(0, |rule| self.number(rule));
        RuleNumbers {
            positions: number(filter.position_rule()),
            colours: number(filter.colour_rule()),
            codes: number(filter.code_rule()),
        }
    }

    /// Number of a rule. A number is never used for another one.
    fn number(&mut self, rule: ReadRule) -> u32 {
        let at = self.known.iter().position(|(known, _)| *known == rule);
        let entry = at.and_then(|at| self.known.remove(at)).unwrap_or_else(|| {
            self.last += 1;
            (rule, self.last)
        });
        let number = entry.1;
        self.known.push_back(entry);
        if self.known.len() > RULES_MAX {
            self.known.pop_front();
        }
        number
    }
}

impl Planes {
    /// All planes of a forest, as they lie in the files.
    #[cfg(test)]
    pub(crate) fn of(forest: Arc<Forest>) -> Self {
        Self::read_by(forest, Arc::default())
    }

    /// Planes as a loader reads them by `filter`: it needs no numbers of rules.
    pub(crate) fn read_by(forest: Arc<Forest>, filter: Arc<ForestFilter>) -> Self {
        Self { forest, filter, rules: RuleNumbers::default() }
    }

    /// Base planes: a node is drawn only if it has all of them, as far as its file has them. Planes
    /// that no file has are left out.
    pub(crate) fn base(&self, needs: &Needs) -> Vec<PlaneKind> {
        // A compact plane has positions and colours.
        let compact = needs.colour.filter(|kind| kind.has_positions());
        let mut base = vec![compact.unwrap_or(PlaneKind::Position)];
        let normals = needs.normals.then_some(PlaneKind::Normal);
        let clip_lines = needs.clip_lines.then_some(PlaneKind::ClipLines);
        let tangents = needs.tangents.then_some(PlaneKind::Tangents);
        let shapes = clip_lines.into_iter().chain(tangents);
        let kinds = needs.colour.into_iter().chain(normals).chain(shapes).chain(needs.classes);
        for kind in kinds {
            // The residual is requested for single nodes.
            let counts = kind.is_written() && kind != PlaneKind::Residual;
            if counts && self.forest.has(kind) && !base.contains(&kind) {
                base.push(kind);
            }
        }
        base
    }

    /// The metric lattice: views and contours are in lengths.
    pub(crate) fn lattice(&self) -> &Lattice {
        self.forest.metric()
    }

    pub(crate) fn node(&self, node: u32) -> &Node {
        self.forest.record(node)
    }

    /// Whether a node stands for more of a tree that grows ([`Forest::newer`]).
    pub(crate) fn is_link(&self, node: u32) -> bool {
        let record = self.node(node);
        record.points() == 0 && record.child_count == 0 && self.forest.is_growing()
    }

    /// The roots, which are always wanted.
    pub(crate) fn roots(&self) -> impl Iterator<Item = u32> + Clone + '_ {
        self.forest.table().roots()
    }

    pub(crate) fn is_root(&self, node: u32) -> bool {
        self.node(node).parent == NONE
    }

    /// Whether a node has a plane: trees of other scans may lack it.
    pub(crate) fn has(&self, node: u32, kind: PlaneKind) -> bool {
        self.forest.has_plane(node, kind)
    }

    /// Form in which a node's plane is read.
    pub(crate) fn form(&self, node: u32, kind: PlaneKind) -> PlaneForm {
        let RuleNumbers { positions, colours, codes } = self.rules;
        let rule = if !self.filter.changes(node, kind) {
            0
        } else if self.filter.value_bytes(kind).is_some() {
            codes
        } else if kind == PlaneKind::Position {
            positions
        } else {
            colours
        };
        PlaneForm { kind, rule }
    }

    /// Bytes of a node's plane.
    pub(crate) fn bytes(&self, node: u32, kind: PlaneKind) -> u64 {
        let points = self.node(node).points() as u64;
        if let Some(bytes) = self.filter.value_bytes(kind).filter(|_| self.has(node, kind)) {
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

    /// Byte range of a plane, for [`Forest::read_exact_at`]. `None` for a cold plane, whose range
    /// only the directory of the page has, and for a plane that is mapped or filtered while it is
    /// read.
    pub(crate) fn in_file(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        if self.filter.changes(node, kind) {
            return None;
        }
        let page = self.node(node).page_offset;
        self.in_page(node, kind).map(|r| page + r.start..page + r.end)
    }

    fn in_page(&self, node: u32, kind: PlaneKind) -> Option<Range<u64>> {
        self.forest.plane_range(node, kind)
    }
}

/// Request to a loader: planes of one node, and their slots.
#[derive(Clone, Debug)]
pub(crate) struct LoadRequest {
    /// Id, never used twice.
    pub(crate) id: u64,
    pub(crate) node: u32,
    /// None to make what is below a node that stands for more of its tree.
    pub(crate) planes: Vec<(PlaneKind, Slot)>,
    /// Forest whose table names the node.
    pub(crate) forest: Arc<Forest>,
    /// Filter by which they are read; all requests of a batch have the same.
    pub(crate) filter: Arc<ForestFilter>,
    /// Test by which a loader decides whether the request is still in view.
    pub(crate) test: VisibilityTest,
    /// Whether the request is read alone: reading it failed before, and must not make its
    /// neighbours fail.
    pub(crate) alone: bool,
}

/// Part of a node that must be in view for the node to be loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VisibilityTest {
    /// None: roots are always wanted, and surroundings out of view too.
    Always,
    /// The node's own points.
    Contour,
    /// Anything in the node's cell: it is wanted for its children.
    Cell,
}
