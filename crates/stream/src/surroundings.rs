//! The light cut of a pass: adds the surroundings of the picture to its choice
//! ([`esker_lod::surround`]) and publishes them in the same cut, so that their slots follow the
//! same rule ([`crate::shared`]). The picture comes first: its choice and its share of drawing
//! memory do not depend on its surroundings, which take at most a share of what it leaves.

use crate::choose::{CacheResidency, Choice, Chooser};
use crate::cut::{CutNode, CutSurroundings};
use esker_format::PlaneKind;
use esker_lod::{Residency, Selection, Surroundings, View, light_octree, surround};
use std::sync::Arc;

/// Surroundings take at most one of this many shares of drawing memory, and no more than the
/// picture leaves: most of it stays for views to come, whose nodes would be read again.
const SHARE: u64 = 4;

/// The cache as [`surround`] sees it: surroundings have no residuals, because half a hot step is
/// far less than the distance of their points.
struct Around<'a>(CacheResidency<'a>);

impl Residency for Around<'_> {
    fn is_resident(&self, node: u32) -> bool {
        self.0.is_resident(node)
    }

    fn slot_bytes(&self, node: u32) -> u64 {
        let CacheResidency { chooser: Chooser { planes, .. }, base, .. } = self.0;
        let of_base = || base.iter().map(|&kind| planes.taken(node, kind)).sum();
        if planes.is_root(node) { 0 } else { of_base() }
    }

    fn points_max(&self, node: u32) -> usize {
        self.0.points_max(node)
    }

    fn rejects_subtree(&self, node: u32) -> bool {
        self.0.rejects_subtree(node)
    }
}

impl Chooser {
    /// Adds the surroundings of a picture to its selection, if they are switched on.
    pub(crate) fn surround(&self, view: &View, base: &[PlaneKind], selection: &mut Selection) {
        let Some(wanted) = &self.surroundings else { return };
        let share = (self.options.drawing_bytes / SHARE).saturating_sub(self.spare_around_bytes);
        let wanted = Surroundings { bytes_budget: wanted.bytes_budget.min(share), ..*wanted };
        let options = self.lod_options(base, view);
        let residency = Around(CacheResidency { chooser: self, base, view });
        let (table, lattice) = (self.planes.forest.table(), self.planes.lattice());
        surround(table, lattice, view, &options, &wanted, &residency, selection);
        self.keep_to_nodes_max(selection);
    }

    /// The surroundings of a cut, if they are switched on.
    pub(crate) fn cut_surroundings(&self, choice: &Choice) -> Option<Arc<CutSurroundings>> {
        self.surroundings.as_ref()?;
        let Choice { base, selection, .. } = choice;
        let nodes = selection.surroundings.iter().map(|d| {
            let slot = |k| self.cache.resident(d.node, self.planes.form(d.node, k));
            let planes = base.iter().filter_map(|&k| Some((k, slot(k)?)));
            CutNode {
                node: d.node,
                prefix: d.prefix,
                effective_spacing: d.effective_spacing,
                planes: planes.collect(),
            }
        });
        let nodes = nodes.collect();
        let octree = light_octree(self.planes.forest.table(), selection);
        Some(Arc::new(CutSurroundings { nodes, octree }))
    }

    /// Reserves more memory that surroundings leave free, if holes prevent a request of the picture
    /// from getting slots while there are `surroundings`. Returns whether that may help.
    pub(crate) fn spare_around(&mut self, surroundings: &[u32], step: u64) -> bool {
        let may_help = self.requests.is_empty() && !surroundings.is_empty() && step > 0;
        self.spare_around_bytes += if may_help { step } else { 0 };
        may_help
    }
}
