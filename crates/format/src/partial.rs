//! A node table of which only a part is known: the top when a file is opened, and parts of the rest
//! as views want what is below. In: indices of nodes whose children are wanted; out: tables in
//! which nodes keep their indices and others come behind them. `docs/design/format.md`.

use crate::error::{Fault, FormatError, io_error};
use crate::footer::Footer;
use crate::layout::PageLayout;
use crate::table::{check_cells, check_node};
use crate::table_index::TableIndex;
use esker_points::node::{NONE, Sides};
use esker_points::read_at::ReadAt;
use esker_points::{Node, NodeTable};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

/// A node table that is read in parts. Reading takes `&self`, from any thread.
pub(crate) struct PartialTable {
    path: PathBuf,
    source: Arc<dyn ReadAt>,
    footer: Footer,
    layout: Arc<PageLayout>,
    index: Arc<TableIndex>,
    state: RwLock<State>,
}

/// What is known.
struct State {
    table: Arc<NodeTable>,
    /// Number of changes.
    version: u64,
    /// Nodes of the table that lack their children, by the index of the first one in the file.
    open: BTreeMap<u32, u32>,
}

/// Consecutive parts that were read.
struct Run {
    /// Index of the first node in the file.
    first: u32,
    nodes: Vec<Node>,
    sides: Vec<Sides>,
}

impl PartialTable {
    /// A table of which `top` is known, the table of the top of `index`.
    pub(crate) fn new(
        path: &Path,
        source: Arc<dyn ReadAt>,
        footer: Footer,
        layout: Arc<PageLayout>,
        index: Arc<TableIndex>,
        top: NodeTable,
    ) -> Self {
        let both = (0u32..).zip(top.nodes.iter().zip(&index.top.nodes));
        let lacking = both.filter(|(_, (node, _))| node.lacks_children());
        let open = lacking.map(|(place, (_, in_file))| (in_file.first_child, place)).collect();
        let state = RwLock::new(State { table: Arc::new(top), version: 0, open });
        Self { path: path.into(), source, footer, layout, index, state }
    }

    /// The table and the number of its version, if that is not `known`.
    pub(crate) fn table(&self, known: Option<u64>) -> Option<(u64, Arc<NodeTable>)> {
        let state = self.state();
        (known != Some(state.version)).then(|| (state.version, Arc::clone(&state.table)))
    }

    fn state(&self) -> RwLockReadGuard<'_, State> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the parts that have the children of nodes which lack them, and adds all nodes in these
    /// parts whose parents are known.
    pub(crate) fn complete(&self, nodes: &[u32]) -> Result<(), FormatError> {
        let damaged = |fault: Fault| fault.damaged(&self.path);
        let runs = self.runs(nodes);
        let place = |parts: &Range<u32>| self.places_of(&self.index.parts.nodes_of(parts));
        let places = runs.iter().map(place).collect::<Result<Vec<_>, Fault>>().map_err(damaged)?;
        let all: Vec<_> =
            places.iter().flat_map(|(r, s)| [Some(r), s.as_ref()]).flatten().collect();
        self.source.will_read(&all.into_iter().cloned().collect::<Vec<_>>());
        for (parts, (records, sides)) in runs.iter().zip(places) {
            let run = self.read(parts, records, sides)?;
            self.add(&run).map_err(damaged)?;
        }
        let state = self.state();
        let lacks =
            |&&node: &&u32| state.table.nodes.get(node as usize).is_some_and(Node::lacks_children);
        match nodes.iter().find(lacks) {
            None => Ok(()),
            Some(&node) => {
                let index = state.table.index_in_file(node);
                let what = format!("node {index}: its children name another parent");
                Err(damaged(Fault::new("node table", what)))
            }
        }
    }

    /// Numbers of the parts that have the children of nodes, those that adjoin together.
    fn runs(&self, nodes: &[u32]) -> Vec<Range<u32>> {
        let state = self.state();
        let wanted: std::collections::HashSet<u32> = nodes.iter().copied().collect();
        let open = state.open.iter().filter(|(_, node)| wanted.contains(node));
        let mut runs: Vec<Range<u32>> = Vec::new();
        for (&first, &node) in open {
            let count = u32::from(state.table.nodes[node as usize].child_count);
            let parts = self.index.parts.parts_of(&(first..first + count));
            match runs.last_mut() {
                Some(last) if parts.start <= last.end => last.end = last.end.max(parts.end),
                _ => runs.push(parts),
            }
        }
        runs
    }

    /// Places of the records and of the sides of nodes in the file.
    fn places_of(&self, nodes: &Range<u32>) -> Result<(Range<u64>, Option<Range<u64>>), Fault> {
        let at = |node: u32| self.footer.table.offset + u64::from(node) * size_of::<Node>() as u64;
        Ok((at(nodes.start)..at(nodes.end), self.index.places.sides_of(nodes)?))
    }

    fn read(
        &self,
        parts: &Range<u32>,
        records: Range<u64>,
        sides: Option<Range<u64>>,
    ) -> Result<Run, FormatError> {
        let of = self.index.parts.nodes_of(parts);
        let mut nodes = vec![bytemuck::Zeroable::zeroed(); of.len()];
        let unread = |what| io_error(&self.path, what);
        self.source
            .read_exact_at(bytemuck::cast_slice_mut::<Node, u8>(&mut nodes), records.start)
            .map_err(unread("read its table"))?;
        let mut stored = vec![[0; 2]; if sides.is_some() { of.len() } else { 0 }];
        if let Some(sides) = sides {
            self.source
                .read_exact_at(bytemuck::cast_slice_mut::<Sides, u8>(&mut stored), sides.start)
                .map_err(unread("read its statistics"))?;
        }
        let check = || {
            self.index.parts.check(parts, &nodes, &stored)?;
            for (index, node) in of.clone().zip(&nodes) {
                let (all, end) = (self.footer.nodes as u32, self.footer.table.offset);
                check_node(node, index, all, &self.layout, end)
                    .map_err(|what| Fault::new("node table", format!("node {index}: {what}")))?;
            }
            Ok(())
        };
        check().map_err(|fault: Fault| fault.damaged(&self.path))?;
        Ok(Run { first: of.start, nodes, sides: stored })
    }

    /// Adds the nodes of a run whose parents are known, or become so. What is added before a fault
    /// is sound.
    fn add(&self, run: &Run) -> Result<(), Fault> {
        let mut state = self.state.write().unwrap_or_else(PoisonError::into_inner);
        let State { table, version, open } = &mut *state;
        let end = run.first + run.nodes.len() as u32;
        let mut next = run.first;
        while let Some((&first, &above)) = open.range(next..end).next() {
            next = first + 1;
            let parent = table.nodes[above as usize];
            let at = (first - run.first) as usize;
            let Some(children) = run.nodes.get(at..at + usize::from(parent.child_count)) else {
                continue;
            };
            let index = table.index_in_file(above);
            let fault = |what: &str| Fault::new("node table", format!("node {index}: {what}"));
            if children.iter().any(|child| child.parent != index) {
                return Err(fault("its children name another parent"));
            }
            check_cells(&parent, children).map_err(fault)?;
            // No more nodes than the file has: each is the child of one parent.
            let base = table.nodes.len() as u32;
            let table = Arc::make_mut(table);
            for (index, child) in (first..).zip(children) {
                if child.child_count > 0 {
                    open.insert(child.first_child, table.nodes.len() as u32);
                }
                let first_child = if child.child_count > 0 { NONE } else { 0 };
                table.nodes.push(Node { parent: above, first_child, ..*child });
                table.in_file.push(index);
            }
            let sides = run.sides.get(at..at + children.len()).unwrap_or_default();
            table.sides.extend_from_slice(sides);
            table.nodes[above as usize].first_child = base;
            open.remove(&first);
            *version += 1;
        }
        Ok(())
    }
}
