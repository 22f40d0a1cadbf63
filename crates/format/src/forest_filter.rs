//! Filter of a forest, and values mapped to codes of one byte while they are read. Nodes are judged
//! by the node table and the statistics alone, so that unwanted nodes are not read. Points of nodes
//! that cross a border are tested while their positions are read; unwanted ones are marked in the
//! byte that files leave zero.

use crate::error::FormatError;
use crate::forest::Forest;
use crate::layout::PlaneKind;
use crate::node_values::{NodeColumns, StatisticSides, kinds_of};
use crate::reader::Planes;
use esker_points::attribute::names;
use esker_points::filter::{LatticeFilter, Side};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, read_residual};
use esker_points::{AttrType, Codes, Node};
use std::ops::Range;

/// Filter and mapped planes of a forest. By default everything is read as it is in the files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ForestFilter {
    filter: Option<NodeFilters>,
    /// Nodes of clouds that are left out.
    left_out: Vec<Range<u32>>,
    codes: Option<(PlaneKind, Codes)>,
    scans: Option<(PlaneKind, Codes)>,
}

/// A filter with its result for each node.
#[derive(Clone, Debug, PartialEq)]
struct NodeFilters {
    filter: LatticeFilter,
    /// In the order of the forest's table.
    by_node: Vec<NodeFilter>,
}

/// Result of a filter for a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct NodeFilter {
    /// Number of its own points that are wanted at most, from the first one on.
    points: u32,
    /// Whether its points must be tested one by one.
    is_partial: bool,
    /// Whether no point of it and of its subtree is wanted.
    rejects_subtree: bool,
}

/// A rule by which planes are changed while they are read. Planes that were read by equal rules are
/// equal.
#[derive(Clone, Debug, PartialEq)]
pub enum ReadRule {
    /// Unwanted points are marked in positions.
    Hide(LatticeFilter),
    /// Codes of scans are written to colours.
    Scans(PlaneKind, Codes),
    /// Values are replaced by codes.
    Codes(PlaneKind, Codes),
}

impl ForestFilter {
    /// A filter of a forest, and a plane mapped to codes.
    ///
    /// # Errors
    /// If statistics that the filter needs cannot be read.
    pub fn of(
        forest: &Forest,
        filter: Option<LatticeFilter>,
        codes: Option<(PlaneKind, Codes)>,
    ) -> Result<Self, FormatError> {
        let filter = filter.map(|filter| NodeFilters::new(forest, filter)).transpose()?;
        Ok(Self { filter, left_out: Vec::new(), codes, scans: None })
    }

    /// The same filter for a forest that has grown ([`Forest::newer`]); `None` if it knows all
    /// nodes.
    ///
    /// # Errors
    /// As for [`ForestFilter::of`].
    pub fn grown(&self, forest: &Forest) -> Result<Option<Self>, FormatError> {
        let nodes = forest.table().nodes.len();
        let knows = |by_node: &[NodeFilter]| by_node.len() == nodes;
        let is_known = self.filter.as_ref().is_none_or(|f| knows(&f.by_node))
            && self
                .left_out
                .last()
                .is_none_or(|range| !forest.grows() || range.end as usize == nodes);
        if is_known {
            return Ok(None);
        }
        self.of_other(forest).map(Some)
    }

    /// The same filter for another state of a forest of one tree, in which nodes may have other
    /// indices.
    ///
    /// # Errors
    /// As for [`ForestFilter::of`].
    pub fn of_other(&self, forest: &Forest) -> Result<Self, FormatError> {
        let nodes = forest.table().nodes.len() as u32;
        let filter = self.filter.as_ref().map(|f| NodeFilters::new(forest, f.filter.clone()));
        // Only forests of one tree grow.
        let left_out = self.left_out.iter().map(|range| range.start..nodes).collect();
        Ok(Self { filter: filter.transpose()?, left_out, ..self.clone() })
    }

    /// Leaves out all points of these clouds of the forest.
    pub fn without_clouds(self, forest: &Forest, clouds: &[usize]) -> Self {
        let left_out = clouds.iter().map(|&cloud| forest.nodes_of_cloud(cloud));
        Self { left_out: left_out.filter(|nodes| !nodes.is_empty()).collect(), ..self }
    }

    /// Whether a node is one of a cloud that is left out.
    pub fn leaves_out(&self, node: u32) -> bool {
        self.left_out.iter().any(|nodes| nodes.contains(&node))
    }

    /// Sets the plane that is mapped to codes.
    pub fn coded(self, codes: Option<(PlaneKind, Codes)>) -> Self {
        Self { codes, ..self }
    }

    /// Sets the plane whose codes go to the spare bytes of colours, which distinguish scans.
    pub fn with_scans(self, scans: Option<(PlaneKind, Codes)>) -> Self {
        Self { scans, ..self }
    }

    /// Whether there is a filter.
    pub fn is_filtered(&self) -> bool {
        self.filter.is_some() || !self.left_out.is_empty()
    }

    /// Whether a node's points must be tested one by one.
    pub fn hides_points(&self, node: u32) -> bool {
        self.node_filter(node).is_some_and(|v| v.is_partial)
    }

    /// Greatest number of a node's own points that are wanted, from the first one on.
    pub fn points_max(&self, node: u32) -> usize {
        self.node_filter(node).map_or(usize::MAX, |v| v.points as usize)
    }

    /// Whether points of a class may be wanted.
    pub fn wants_class(&self, class: u8) -> bool {
        self.filter.as_ref().is_none_or(|f| f.filter.wants_class(class))
    }

    /// Whether any node's points must be tested one by one.
    pub fn hides_any(&self) -> bool {
        self.filter.as_ref().is_some_and(|f| f.by_node.iter().any(|v| v.is_partial))
    }

    /// Whether no point of a node and of its subtree is wanted.
    pub fn rejects_subtree(&self, node: u32) -> bool {
        self.node_filter(node).is_some_and(|v| v.rejects_subtree)
    }

    /// Whether a node's plane is read otherwise than it is in the file.
    pub fn changes(&self, node: u32, kind: PlaneKind) -> bool {
        self.codes.is_some_and(|(coded, _)| coded == kind)
            || (kind == PlaneKind::Position && self.hides_points(node))
            || (kind == PlaneKind::Colour && self.scans.is_some())
    }

    /// Rule for positions of nodes whose points are tested one by one.
    pub fn position_rule(&self) -> Option<ReadRule> {
        self.filter.as_ref().map(|f| ReadRule::Hide(f.filter.clone()))
    }

    /// Rule for colours.
    pub fn colour_rule(&self) -> Option<ReadRule> {
        self.scans.map(|(kind, codes)| ReadRule::Scans(kind, codes))
    }

    /// Rule for the plane that is mapped to codes.
    pub fn code_rule(&self) -> Option<ReadRule> {
        self.codes.map(|(kind, codes)| ReadRule::Codes(kind, codes))
    }

    /// Whether two filters want the same points of all nodes.
    pub fn shows_as(&self, other: &Self) -> bool {
        self.filter == other.filter && self.left_out == other.left_out
    }

    /// Bytes of one value of a mapped plane; `None` for planes whose values keep their size.
    pub fn value_bytes(&self, kind: PlaneKind) -> Option<u64> {
        self.codes.is_some_and(|(coded, _)| coded == kind).then_some(1)
    }

    /// Reads planes of a node, filtered and mapped. Planes that it does not have are left out.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn read(
        &self,
        forest: &Forest,
        node: u32,
        kinds: &[PlaneKind],
    ) -> Result<Planes, FormatError> {
        let tests = self.hides_points(node) && kinds.contains(&PlaneKind::Position);
        let test = self.filter.as_ref().filter(|_| tests);
        let mut wanted = kinds.to_vec();
        for kind in test.iter().flat_map(|f| f.needed(forest, node)) {
            if !wanted.contains(&kind) {
                wanted.push(kind);
            }
        }
        let scans = self.scans.filter(|_| kinds.contains(&PlaneKind::Colour));
        if let Some((kind, _)) = scans.filter(|(kind, _)| !wanted.contains(kind)) {
            wanted.push(kind);
        }
        let mut planes = forest.read_planes(node, &wanted)?;
        if let Some(test) = test {
            test.hide(forest, node, &mut planes);
        }
        if let Some((kind, codes)) = scans {
            let scans = codes.of(planes.get(kind).unwrap_or_default());
            mark_scans(&mut planes, &scans);
        }
        if let Some((kind, codes)) = self.codes
            && let Some(values) = planes.get_mut(kind)
        {
            *values = codes.of(values);
        }
        planes.retain(|kind| kinds.contains(&kind));
        Ok(planes)
    }

    fn node_filter(&self, node: u32) -> Option<&NodeFilter> {
        if self.left_out.iter().any(|nodes| nodes.contains(&node)) {
            return Some(&NodeFilter::NONE);
        }
        self.filter.as_ref()?.by_node.get(node as usize)
    }
}

impl NodeFilter {
    /// No point of the node and of its subtree is wanted.
    const NONE: Self = Self { points: 0, is_partial: false, rejects_subtree: true };
}

impl NodeFilters {
    fn new(forest: &Forest, filter: LatticeFilter) -> Result<Self, FormatError> {
        let nodes = &forest.table().nodes;
        let mut by_node = Vec::with_capacity(nodes.len());
        for file in forest.files() {
            let sides = StatisticSides::new(file, &filter)?;
            let first = by_node.len();
            for (index, node) in (0u32..).zip(&nodes[first..][..file.table().nodes.len()]) {
                let (own, below) = (sides.own(index), sides.subtree(index));
                by_node.push(node_filter(&filter, nodes, node, own, below));
            }
        }
        Ok(Self { filter, by_node })
    }

    /// Planes that the test of points needs.
    fn needed(&self, forest: &Forest, node: u32) -> Vec<PlaneKind> {
        let mut kinds = vec![PlaneKind::Residual];
        if self.filter.needs_classes() {
            kinds.push(PlaneKind::Class);
            kinds.extend(plane(forest, names::CLASSIFICATION));
        }
        if self.filter.needs_flags() {
            kinds.extend(plane(forest, names::FLAGS));
        }
        let file = forest.file_of(node);
        let tests = self.filter.value_tests(file.layout().schema());
        kinds.extend(kinds_of(forest, file, &tests.attributes()));
        kinds.retain(|&kind| forest.has_plane(node, kind));
        kinds
    }

    /// Marks the unwanted points of a node.
    fn hide(&self, forest: &Forest, node: u32, planes: &mut Planes) {
        let record = forest.record(node);
        let [min, max] = record.own_box();
        let test = self.filter.in_box(min, max);
        let copy = |kind| planes.get(kind).unwrap_or_default().to_vec();
        let (residual, of_source) = (copy(PlaneKind::Residual), copy(PlaneKind::Class));
        let values = |name: &str, is_needed: bool| {
            plane(forest, name).filter(|_| is_needed).map(copy).unwrap_or_default()
        };
        let classes = values(names::CLASSIFICATION, self.filter.needs_classes());
        let flags = values(names::FLAGS, self.filter.needs_flags());
        let file = forest.file_of(node);
        let own = |name: &str| file.metadata().schema.find_typed(name, AttrType::U8);
        let (own_classes, own_flags) = (own(names::CLASSIFICATION), own(names::FLAGS));
        let has = |attribute: Option<usize>, point: usize| {
            let source =
                of_source.as_chunks::<2>().0.get(point).map_or(0, |c| u16::from_le_bytes(*c));
            attribute.is_some_and(|a| file.layout().has_attribute(usize::from(source), a))
        };
        let tests = self.filter.value_tests(file.layout().schema());
        let columns = NodeColumns::of(forest, file, &tests.attributes(), planes);
        let Some(positions) = planes.get_mut(PlaneKind::Position) else { return };
        let shift = record.hot_shift;
        let points = positions.as_chunks_mut::<HOT_POSITION_BYTES>().0;
        for (i, point) in points.iter_mut().enumerate() {
            let low = read_residual(&residual, i, shift);
            let p = [0, 1, 2].map(|axis| {
                let hot = u16::from_le_bytes([point[axis * 2], point[axis * 2 + 1]]);
                exact(hot, low[axis], min[axis], shift)
            });
            let class = classes.get(i).copied().filter(|_| has(own_classes, i));
            let flags = flags.get(i).copied().filter(|_| has(own_flags, i));
            let value = |a: usize| columns.value(a, i).filter(|_| has(Some(a), i));
            let keeps = test.keeps(p, class, flags) && tests.keep(value);
            point[HIDDEN_AT] = u8::from(!keeps);
        }
    }
}

/// Writes codes of scans to the spare bytes of colours; zero if there are no codes.
fn mark_scans(planes: &mut Planes, scans: &[u8]) {
    let colours = planes.get_mut(PlaneKind::Colour).map(Vec::as_mut_slice).unwrap_or_default();
    let scans = scans.iter().copied().chain(std::iter::repeat(0));
    for (colour, scan) in colours.as_chunks_mut::<4>().0.iter_mut().zip(scans) {
        colour[3] = scan;
    }
}

/// Result of a filter for a node, given the sides by the statistics of its own points and of those
/// of its subtree.
fn node_filter(
    filter: &LatticeFilter,
    nodes: &[Node],
    node: &Node,
    own: Side,
    subtree: Side,
) -> NodeFilter {
    let none = NodeFilter::NONE;
    let prefix = filter.prefix(node, nodes.get(node.parent as usize));
    let cell = node.cell();
    if prefix == 0
        || subtree == Side::Outside
        || filter.side_of_box(cell.first(), cell.last()) == Side::Outside
    {
        return none;
    }
    let [min, max] = node.own_box();
    let by_box = filter.side_of_box(min, max);
    if by_box == Side::Outside || own == Side::Outside {
        return NodeFilter { rejects_subtree: false, ..none };
    }
    NodeFilter {
        points: u32::try_from(prefix).unwrap_or(u32::MAX),
        is_partial: by_box == Side::Across || own == Side::Across,
        rejects_subtree: false,
    }
}

/// The plane of an attribute of bytes.
fn plane(forest: &Forest, name: &str) -> Option<PlaneKind> {
    let index = forest.schema().find_typed(name, AttrType::U8)?;
    Some(PlaneKind::Attribute(u16::try_from(index).ok()?))
}
