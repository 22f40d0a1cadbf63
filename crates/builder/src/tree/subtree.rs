//! Finished nodes with all nodes below them, and the assembly of the node table and statistics.

use esker_format::NodeStatistics;
use esker_points::{MultisetHash, Node, NodeTable};

/// A finished node and all nodes below it.
pub struct Subtree {
    /// Entry of the node table; its links are set when the table is assembled.
    pub node: Node,
    /// Page of the node, until it is written.
    pub page: Vec<u8>,
    /// Statistics of the node's own points.
    pub statistics: NodeStatistics,
    /// Hash of the node's own points.
    pub hash: MultisetHash,
    /// Smallest and largest lattice coordinates of the node's own points.
    pub bounds: [[u32; 3]; 2],
    /// Children, in Morton order.
    pub children: Children,
}

impl Subtree {
    /// The last node of the chain of continuations of this node; the node itself if there are none.
    pub fn last_mut(&mut self) -> &mut Self {
        let mut last = self;
        while last.children.first().is_some_and(|child| child.node.is_continuation()) {
            last = &mut last.children[0];
        }
        last
    }
}

/// Children of a node. They are dropped without recursion: a chain of continuations can be too long
/// for the stack.
#[derive(Default)]
pub struct Children(Vec<Subtree>);

impl Children {
    /// Takes the children out.
    pub fn take(&mut self) -> Vec<Subtree> {
        std::mem::take(&mut self.0)
    }
}

impl From<Vec<Subtree>> for Children {
    fn from(trees: Vec<Subtree>) -> Self {
        Self(trees)
    }
}

impl std::ops::Deref for Children {
    type Target = Vec<Subtree>;
    fn deref(&self) -> &Vec<Subtree> {
        &self.0
    }
}

impl std::ops::DerefMut for Children {
    fn deref_mut(&mut self) -> &mut Vec<Subtree> {
        &mut self.0
    }
}

impl FromIterator<Subtree> for Children {
    fn from_iter<I: IntoIterator<Item = Subtree>>(trees: I) -> Self {
        Self(trees.into_iter().collect())
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        let mut open = self.take();
        while let Some(mut tree) = open.pop() {
            open.append(&mut tree.children);
        }
    }
}

/// Assembles the node table of a tree, and the statistics of its nodes in the order of the table:
/// siblings together, parents before children.
pub fn assemble(root: Option<Subtree>) -> (NodeTable, Vec<NodeStatistics>) {
    let (mut table, mut statistics) = (NodeTable::default(), Vec::new());
    let mut open = Vec::new();
    if let Some(mut root) = root {
        root.node.parent = esker_points::node::NONE;
        table.nodes.push(root.node);
        statistics.push(root.statistics);
        open.push((0u32, root.children.take()));
    }
    while let Some((parent, children)) = open.pop() {
        if children.is_empty() {
            continue;
        }
        let first = table.nodes.len() as u32;
        table.nodes[parent as usize].first_child = first;
        table.nodes[parent as usize].child_count = children.len() as u8;
        let mut below = Vec::with_capacity(children.len());
        for (i, mut child) in children.into_iter().enumerate() {
            child.node.parent = parent;
            table.nodes.push(child.node);
            statistics.push(child.statistics);
            below.push((first + i as u32, child.children.take()));
        }
        open.extend(below.into_iter().rev());
    }
    (table, statistics)
}
