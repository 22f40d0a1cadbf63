//! The compact octree of a cut: the drawn cells with their effective spacings. For each covered
//! pixel, the renderer looks up how densely the surroundings of its point are drawn, and sizes the
//! point's splat by that (kanzok2015, section 3.2).

use crate::selection::Drawn;
use esker_points::{Cell, Node, NodeTable};
use std::collections::HashMap;

/// Marks the absence of an entry.
const NONE: u32 = u32::MAX;

/// The drawn cells. Entry `i` belongs to `drawn[i]`. Entries behind them are undrawn nodes between
/// drawn ones; they lead to their children and have the spacing of the drawn ancestor.
///
/// A table of several trees makes several octrees. A point is looked up from its own node's entry,
/// so in its own tree: the points of a tree are an even sample of its own surfaces, which they
/// close by themselves. Another tree may be denser in the same cell without any point on that
/// surface.
#[derive(Clone, Debug, Default)]
pub struct CompactOctree {
    entries: Vec<Entry>,
    roots: Vec<u32>,
    /// Number of drawn cells, which come first.
    drawn: u32,
}

/// Spacing of a cell over that of the cells below it, at most, where these refine it evenly.
const EVEN_SPACINGS: f32 = 4.0;

/// One cell in one cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
struct Entry {
    corner: [u32; 3],
    log2: u32,
    spacing: f32,
    /// The cell below in each octant, which may be smaller than the octant (chains are skipped).
    children: [u32; 8],
}

const _: () = assert!(size_of::<Entry>() == 64);

impl Entry {
    fn of(node: &Node, spacing: f32) -> Self {
        Self { corner: node.corner, log2: u32::from(node.cell_log2), spacing, children: [NONE; 8] }
    }

    /// [`Cell::contains`] computed in `u64`, so that the shift for the whole lattice is valid too.
    fn contains(&self, p: [u32; 3]) -> bool {
        let [x, y, z] = self.steps_within(p);
        u64::from(x | y | z) >> self.log2 == 0
    }

    /// [`Cell::octant`] for cells larger than a single lattice point.
    fn octant(&self, p: [u32; 3]) -> usize {
        let (bit, [x, y, z]) = (self.log2 - 1, self.steps_within(p));
        ((x >> bit & 1) | (y >> bit & 1) << 1 | (z >> bit & 1) << 2) as usize
    }

    fn steps_within(&self, p: [u32; 3]) -> [u32; 3] {
        [0, 1, 2].map(|axis| p[axis].wrapping_sub(self.corner[axis]))
    }
}

impl CompactOctree {
    /// The octree of what is drawn; `drawn` names nodes of `table`, each at most once.
    ///
    /// # Panics
    /// If `drawn` names a node that is not in the table.
    pub fn new(table: &NodeTable, drawn: &[Drawn]) -> Self {
        Self::with_hidden(table, drawn, &[])
    }

    /// The octree of drawn nodes, and of nodes that are not drawn because all of their points are
    /// hidden ([`crate::Selection::hidden`]). With their cells, the splats drawn in their place do
    /// not change size with what is hidden behind them.
    ///
    /// # Panics
    /// If `drawn` or `hidden` names a node that is not in the table.
    pub fn with_hidden(table: &NodeTable, drawn: &[Drawn], hidden: &[Drawn]) -> Self {
        let cells = || drawn.iter().chain(hidden);
        let mut entries: Vec<_> = cells()
            .map(|d| Entry::of(&table.nodes[d.node as usize], d.effective_spacing))
            .collect();
        let mut entry_of: HashMap<u32, u32> =
            cells().zip(0u32..).map(|(d, i)| (d.node, i)).collect();
        let mut roots = Vec::new();
        // Continuations: index of the node, its entry, and the entry that it continues.
        let mut continued = Vec::new();
        for d in cells() {
            let (mut index, mut node) = (d.node, &table.nodes[d.node as usize]);
            // Links the node to its parent, and undrawn parents to theirs.
            loop {
                let entry = entry_of[&index];
                let Some(parent) =
                    table.nodes.get(node.parent as usize).filter(|_| node.parent < index)
                else {
                    roots.push(entry);
                    break;
                };
                let existing = entry_of.get(&node.parent).copied();
                let above = existing.unwrap_or(entries.len() as u32);
                if existing.is_none() {
                    entries.push(Entry::of(parent, f32::NAN));
                    entry_of.insert(node.parent, above);
                }
                if node.is_continuation() {
                    continued.push((index, entry, above));
                } else if let Some(octant) = octant_below(parent, &node.cell()) {
                    entries[above as usize].children[usize::from(octant)] = entry;
                }
                if existing.is_some() {
                    break;
                }
                (index, node) = (node.parent, parent);
            }
        }
        let mut octree = Self { entries, roots, drawn: drawn.len() as u32 };
        octree.inherit(&continued);
        octree.continue_cells(continued);
        octree
    }

    /// Merges the nodes of a cell: children and spacing of its last node hold for the points of all
    /// of them.
    fn continue_cells(&mut self, mut continued: Vec<(u32, u32, u32)>) {
        // Children come after their parents in the table: from the last to the first.
        continued.sort_unstable_by(|a, b| b.cmp(a));
        for (_, entry, above) in continued {
            let Entry { spacing, children, .. } = self.entries[entry as usize];
            let above = &mut self.entries[above as usize];
            (above.spacing, above.children) = (spacing, children);
        }
    }

    /// Gives undrawn entries the spacing of the entry above them; 0 if there is none.
    fn inherit(&mut self, continued: &[(u32, u32, u32)]) {
        let below: HashMap<u32, u32> =
            continued.iter().map(|&(_, entry, head)| (head, entry)).collect();
        let mut open: Vec<_> = self.roots.iter().map(|&root| (root, 0.0f32)).collect();
        while let Some((index, above)) = open.pop() {
            let Some(entry) = self.entries.get_mut(index as usize) else { continue };
            if entry.spacing.is_nan() {
                entry.spacing = above;
            }
            let spacing = entry.spacing;
            let children = entry.children.iter().copied().filter(|&c| c != NONE);
            open.extend(children.chain(below.get(&index).copied()).map(|c| (c, spacing)));
        }
    }

    /// Number of cells, including those between drawn ones.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing is drawn.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Effective spacing of a cell without drawn cells below it, the file's unit; `None` for other
    /// cells.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn leaf_spacing(&self, index: usize) -> Option<f32> {
        let entry = &self.entries[index];
        entry.children.iter().all(|&child| child == NONE).then_some(entry.spacing)
    }

    /// Effective spacing of a cell where it has points that nothing drawn below refines, the file's
    /// unit; `None` for cells in which drawn cells refine it evenly. Cells that are far finer are
    /// beside points that are sparse in themselves.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn open_spacing(&self, index: usize) -> Option<f32> {
        let own = self.entries[index].spacing;
        let mut open: Vec<u32> = self.entries[index].children.to_vec();
        while let Some(child) = open.pop() {
            let Some(entry) = self.entries.get(child as usize) else { continue };
            if child >= self.drawn {
                open.extend(entry.children);
            } else if entry.spacing * EVEN_SPACINGS >= own {
                return None;
            }
        }
        Some(own)
    }

    /// The cells in the layout of GPU memory: lowest lattice point, log2 of the edge, bits of the
    /// spacing, the eight entries below (absent: beyond all entries), three zeros.
    pub fn words(&self) -> impl Iterator<Item = [u32; 16]> + '_ {
        self.entries.iter().map(|e| {
            let mut words = [0; 16];
            words[..3].copy_from_slice(&e.corner);
            (words[3], words[4]) = (e.log2, e.spacing.to_bits());
            words[5..13].copy_from_slice(&e.children);
            words
        })
    }

    /// Effective spacing, the file's unit, of the finest drawn cell that holds the lattice point
    /// `p`, in the tree that is drawn finest there; 0 if there is none.
    pub fn spacing_at(&self, p: [u32; 3]) -> f32 {
        let roots = self.roots.iter().filter_map(|&root| self.entries.get(root as usize));
        let drawn = roots.filter(|root| root.contains(p)).map(|root| self.descend(root, p));
        drawn.filter(|&spacing| spacing > 0.0).reduce(f32::min).unwrap_or(0.0)
    }

    /// Effective spacing at `p` in the tree of `drawn[index]`, searched from the cell of
    /// `drawn[index]` downwards: the faster way for a point of that node. Returns the spacing of
    /// `drawn[index]` if `p` is outside of its cell (hot positions without residuals can be, by
    /// half a hot step).
    ///
    /// # Panics
    /// If there is no such entry.
    #[inline]
    pub fn spacing_from(&self, index: usize, p: [u32; 3]) -> f32 {
        let entry = &self.entries[index];
        if entry.contains(p) { self.descend(entry, p) } else { entry.spacing }
    }

    #[inline]
    fn descend<'a>(&'a self, mut entry: &'a Entry, p: [u32; 3]) -> f32 {
        while entry.log2 > 0 {
            match self.entries.get(entry.children[entry.octant(p)] as usize) {
                Some(child) if child.contains(p) => entry = child,
                _ => break,
            }
        }
        entry.spacing
    }
}

/// Octant of the parent's cell that holds the child's; `None` if the child's cell is not smaller.
fn octant_below(parent: &Node, child: &Cell) -> Option<u8> {
    let cell = parent.cell();
    (child.log2 < cell.log2 && cell.contains_cell(child)).then(|| cell.octant(child.corner))
}
