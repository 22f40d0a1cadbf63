//! The hierarchical cache (kanzok2015, section 3.2.1, item 5): which planes of which nodes have a
//! slot, and which of them is least recently used. The unit is a plane of a node. The cache is
//! closed under parent: a node enters only below a node that is cached, and its base planes are
//! evicted before those of its parent.

use crate::landing::Slot;
use crate::planes::Planes;
use crate::pool::Pool;
use esker_format::PlaneKind;
use std::cmp::Reverse;
use std::collections::HashMap;

/// A plane with a slot.
#[derive(Clone, Copy, Debug)]
struct CachedPlane {
    kind: PlaneKind,
    slot: Slot,
    /// Last pass that used the plane.
    stamp: u64,
    /// Whether its bytes have been uploaded; until then the plane is requested and cannot be
    /// evicted.
    is_resident: bool,
}

/// A node with slots, or with children that have slots.
#[derive(Debug, Default)]
struct Entry {
    planes: Vec<CachedPlane>,
    /// Number of child nodes with an entry.
    children: u32,
}

/// The cache.
#[derive(Debug)]
pub(crate) struct Cache {
    planes: Planes,
    pool: Pool,
    entries: HashMap<u32, Entry>,
    nodes_max: usize,
    /// Number of the pass; planes stamped with it are in use.
    pass: u64,
    /// Planes that may be evicted in this pass, the first to leave last. Made on first use.
    leaving: Option<Vec<(u64, Reverse<u32>, PlaneKind)>>,
    resident: usize,
    evicted: u64,
}

impl Cache {
    pub(crate) fn new(planes: Planes, pool: Pool, nodes_max: usize) -> Self {
        let roots = planes.roots().count();
        Self {
            planes,
            pool,
            entries: HashMap::new(),
            nodes_max: nodes_max.max(roots),
            pass: 0,
            leaving: None,
            resident: 0,
            evicted: 0,
        }
    }

    pub(crate) fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Number of nodes whose positions are uploaded.
    pub(crate) fn resident_nodes(&self) -> usize {
        self.resident
    }

    /// Number of nodes evicted so far.
    pub(crate) fn evicted(&self) -> u64 {
        self.evicted
    }

    pub(crate) fn has_node(&self, node: u32) -> bool {
        self.entries.contains_key(&node)
    }

    fn plane(&self, node: u32, kind: PlaneKind) -> Option<&CachedPlane> {
        self.entries.get(&node)?.planes.iter().find(|p| p.kind == kind)
    }

    /// Whether a plane has a slot, uploaded or not.
    pub(crate) fn has(&self, node: u32, kind: PlaneKind) -> bool {
        self.plane(node, kind).is_some()
    }

    /// Slot of a plane that is uploaded.
    pub(crate) fn resident(&self, node: u32, kind: PlaneKind) -> Option<Slot> {
        self.plane(node, kind).filter(|p| p.is_resident).map(|p| p.slot)
    }

    /// Whether all of `kinds` that the node has are uploaded.
    pub(crate) fn is_resident(&self, node: u32, kinds: &[PlaneKind]) -> bool {
        kinds.iter().all(|&k| self.resident(node, k).is_some() || !self.planes.has(node, k))
    }

    /// Begins a pass: planes that are not touched from here on may be evicted.
    pub(crate) fn begin_pass(&mut self) {
        self.pass += 1;
        self.leaving = None;
    }

    /// Keeps a plane through this pass, if it is cached.
    pub(crate) fn touch(&mut self, node: u32, kind: PlaneKind) {
        let pass = self.pass;
        let entry = self.entries.get_mut(&node);
        if let Some(plane) = entry.and_then(|e| e.planes.iter_mut().find(|p| p.kind == kind)) {
            plane.stamp = pass;
        }
    }

    /// Finds slots for planes of a node that have none, evicting the least recently used planes for
    /// them. `base` are the base planes of nodes. Returns `None` and takes no slot if there is no
    /// room or the parent is not cached.
    pub(crate) fn reserve(
        &mut self,
        node: u32,
        kinds: &[PlaneKind],
        base: &[PlaneKind],
    ) -> Option<Vec<(PlaneKind, Slot)>> {
        let parent = self.planes.node(node).parent;
        let is_root = self.planes.is_root(node);
        if !is_root && !self.has_node(parent) {
            return None;
        }
        while !self.has_node(node) && self.entries.len() >= self.nodes_max {
            self.evict_one(base).then_some(())?;
        }
        let mut slots = Vec::with_capacity(kinds.len());
        for &kind in kinds {
            let bytes = self.planes.bytes(node, kind);
            let slot = loop {
                let slot = self.pool.take(bytes);
                if slot.is_some() || !self.evict_one(base) {
                    break slot;
                }
            };
            let Some(slot) = slot else {
                slots.drain(..).for_each(|(_, slot)| self.pool.give(slot));
                return None;
            };
            slots.push((kind, slot));
        }
        if !self.has_node(node) {
            self.entries.insert(node, Entry::default());
            if let Some(above) = self.entries.get_mut(&parent).filter(|_| !is_root) {
                above.children += 1;
            }
        }
        let (entry, stamp) = (self.entries.entry(node).or_default(), self.pass);
        let requested = |&(kind, slot)| CachedPlane { kind, slot, stamp, is_resident: false };
        entry.planes.extend(slots.iter().map(requested));
        Some(slots)
    }

    /// Marks a plane as uploaded.
    pub(crate) fn arrive(&mut self, node: u32, kind: PlaneKind) {
        let entry = self.entries.get_mut(&node);
        if let Some(plane) = entry.and_then(|e| e.planes.iter_mut().find(|p| p.kind == kind)) {
            self.resident += usize::from(kind.has_positions() && !plane.is_resident);
            plane.is_resident = true;
        }
    }

    /// Frees the slot of a plane.
    pub(crate) fn release(&mut self, node: u32, kind: PlaneKind) {
        let Some(entry) = self.entries.get_mut(&node) else { return };
        if let Some(at) = entry.planes.iter().position(|p| p.kind == kind) {
            let plane = entry.planes.swap_remove(at);
            self.resident -= usize::from(kind.has_positions() && plane.is_resident);
            self.pool.give(plane.slot);
        }
        self.drop_empty(node);
    }

    /// Removes the entry of a node without slots and children, and then of ancestors that become
    /// empty.
    fn drop_empty(&mut self, mut node: u32) {
        while self.entries.get(&node).is_some_and(|e| e.planes.is_empty() && e.children == 0) {
            self.entries.remove(&node);
            node = self.planes.node(node).parent;
            let Some(above) = self.entries.get_mut(&node) else { break };
            above.children -= 1;
        }
    }

    /// Evicts one plane; false if none may be evicted.
    fn evict_one(&mut self, base: &[PlaneKind]) -> bool {
        let mut leaving = self.leaving.take().unwrap_or_else(|| self.unused());
        let next = loop {
            let Some((_, Reverse(node), kind)) = leaving.pop() else { break None };
            let is_leaf = self.entries.get(&node).is_some_and(|e| e.children == 0);
            // A parent with a child in progress stays until that child has arrived and left.
            if is_leaf || !base.contains(&kind) {
                break Some((node, kind));
            }
        };
        self.leaving = Some(leaving);
        let Some((node, kind)) = next else { return false };
        self.release(node, kind);
        self.evicted += u64::from(!self.has_node(node));
        true
    }

    /// Uploaded planes that this pass did not use. Of equal age, children are evicted first: their
    /// index is greater than their parent's, and they are never used without it.
    fn unused(&self) -> Vec<(u64, Reverse<u32>, PlaneKind)> {
        let mut unused = Vec::new();
        for (&node, entry) in &self.entries {
            let old = entry.planes.iter().filter(|p| p.is_resident && p.stamp < self.pass);
            unused.extend(old.map(|p| (p.stamp, Reverse(node), p.kind)));
        }
        unused.sort_unstable_by(|a, b| b.cmp(a));
        unused
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::hills;
    use proptest::prelude::*;

    const BASE: [PlaneKind; 2] = [PlaneKind::Position, PlaneKind::Colour];

    impl Cache {
        /// Asserts the invariants.
        fn check(&self) -> Result<(), TestCaseError> {
            let mut children: HashMap<u32, u32> = HashMap::new();
            for &node in self.entries.keys().filter(|&&n| !self.planes.is_root(n)) {
                let parent = self.planes.node(node).parent;
                prop_assert!(self.has_node(parent), "{} is without {}", node, parent);
                *children.entry(parent).or_default() += 1;
            }
            let mut used = 0;
            for (node, entry) in &self.entries {
                prop_assert_eq!(entry.children, children.get(node).copied().unwrap_or(0));
                prop_assert!(entry.children > 0 || !entry.planes.is_empty());
                used += entry.planes.iter().map(|p| Pool::taken(p.slot.bytes)).sum::<u64>();
            }
            prop_assert_eq!(used, self.pool.used());
            let resident = self.entries.keys().filter(|&&n| self.is_resident(n, &BASE[..1]));
            prop_assert_eq!(resident.count(), self.resident);
            Ok(())
        }
    }

    /// A path from the root: each number chooses a child.
    fn path(planes: &Planes, turns: &[u8]) -> Vec<u32> {
        let mut path = vec![0];
        for &turn in turns {
            let children = planes.node(path[path.len() - 1]).children();
            let Some(child) = children.clone().nth(usize::from(turn) % children.len().max(1))
            else {
                break;
            };
            path.push(child);
        }
        path
    }

    proptest! {
        #[test]
        fn it_stays_closed_under_parent_and_keeps_what_is_in_use(
            pages in 2u64..6, nodes_max in 3usize..40,
            passes in prop::collection::vec(
                (prop::collection::vec(any::<u8>(), 1..5), any::<bool>(), 0u8..4), 1..60),
        ) {
            let planes = Planes::of(hills());
            let mut cache =
                Cache::new(planes.clone(), Pool::new(pages * (64 << 10), 64 << 10), nodes_max);
            let mut requested: Vec<(u32, PlaneKind)> = Vec::new();
            for (turns, with_residual, fate) in passes {
                cache.begin_pass();
                let path = path(&planes, &turns);
                for &node in &path {
                    BASE.iter().for_each(|&kind| cache.touch(node, kind));
                }
                for &node in &path {
                    let mut kinds = BASE.to_vec();
                    kinds.extend(with_residual.then_some(PlaneKind::Residual));
                    kinds.retain(|&kind| !cache.has(node, kind));
                    let kept = path.iter().filter(|&&n| cache.is_resident(n, &BASE)).count();
                    let slots = cache.reserve(node, &kinds, &BASE);
                    requested.extend(slots.into_iter().flatten().map(|(kind, _)| (node, kind)));
                    let still = path.iter().filter(|&&n| cache.is_resident(n, &BASE)).count();
                    prop_assert_eq!(kept, still, "what is in use stays");
                    cache.check()?;
                }
                // Some arrive, some fail, some are still in progress.
                let ends = requested.len() * usize::from(fate) / 3;
                for (i, (node, kind)) in requested.drain(..ends.min(requested.len())).enumerate() {
                    if i % 5 == 4 { cache.release(node, kind) } else { cache.arrive(node, kind) }
                }
                cache.check()?;
                prop_assert!(cache.entries.len() <= nodes_max);
            }
        }
    }
}
