//! A pass of the LOD thread (kanzok2015, section 3.2.2): choose the cut of the newest view, publish it,
//! then ask for the best of what it misses, in the slots of what it does not want. The order matters,
//! see [`crate::shared`].

use crate::batch::Batch;
use crate::cache::Cache;
use crate::cut::{Cut, CutNode};
use crate::error::StreamError;
use crate::options::{Needs, Options};
use crate::planes::{Planes, Request};
use crate::queue::Queue;
use crate::retries::Retries;
use crate::shared::Shared;
use esker_format::PlaneKind;
use esker_lod::{
    CompactOctree, DepthFeedback, Drawn, Frustum, Occlusion, OrientedBox, Residency, Selection,
    SoftwareDepth, View, needs_residual, select,
};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Instant;

/// The share of drawing memory that is at first kept for holes between slots of different lengths.
const SPARE: u64 = 16;

/// What the LOD thread owns.
pub(crate) struct Chooser {
    pub(crate) options: Options,
    pub(crate) planes: Planes,
    pub(crate) shared: Arc<Shared>,
    pub(crate) cache: Cache,
    pub(crate) retries: Retries,
    pub(crate) run_bytes: usize,
    pub(crate) queue: Arc<Queue<Batch>>,
    /// Requests under way, by id.
    pub(crate) asked: HashMap<u64, Request>,
    pub(crate) last_id: u64,
    pub(crate) epoch: u64,
    pub(crate) view: Option<View>,
    /// What cuts are drawn with.
    pub(crate) shown: Needs,
    /// What was asked for last; shown once the roots have it.
    pub(crate) needs: Needs,
    pub(crate) feedback: Option<Arc<DepthFeedback>>,
    /// What the front cut draws.
    pub(crate) drawn: Vec<Drawn>,
    /// Whether wishes were left over because the queue was full.
    pub(crate) has_more: bool,
    /// Bytes that are not planned with, because holes between slots take them.
    pub(crate) spare_bytes: u64,
}

/// What a pass chose.
pub(crate) struct Choice {
    pub(crate) view: View,
    /// The planes without which nothing is drawn.
    pub(crate) base: Vec<PlaneKind>,
    pub(crate) selection: Selection,
    /// Which of the nodes with points that are drawn, or will be once they are there, need their residual.
    pub(crate) residuals: HashSet<u32>,
}

/// What [`select`] is told of the cache. Roots count nothing: they have their places.
struct Known<'a> {
    chooser: &'a Chooser,
    base: &'a [PlaneKind],
    view: &'a View,
}

impl Residency for Known<'_> {
    fn is_resident(&self, node: u32) -> bool {
        self.chooser.cache.is_resident(node, self.base)
    }

    fn slot_bytes(&self, node: u32) -> u64 {
        if self.chooser.planes.is_root(node) {
            return 0;
        }
        self.chooser.node_bytes(node, self.base, self.view)
    }

    fn points_max(&self, node: u32) -> usize {
        self.chooser.planes.shown.points_max(node)
    }

    fn is_barren(&self, node: u32) -> bool {
        self.chooser.planes.shown.is_barren(node)
    }
}

impl Chooser {
    /// One pass; whether another one should follow, though nothing happens until then: it may find more
    /// hidden. Never where one may not follow.
    pub(crate) fn pass(&mut self, may_follow: bool) -> bool {
        self.cache.begin_pass();
        self.show_needs();
        let Some(view) = self.view else {
            self.show_roots();
            self.ask_for_roots();
            return false;
        };
        let began = Instant::now();
        let choice = self.choose(view);
        let cut = self.cut(&choice, began);
        let is_complete = cut.complete;
        let front = Arc::new(cut);
        self.shared.front.store(Arc::clone(&front));
        self.touch(&choice);
        let finds_place = self.ask(&choice);
        let drawn = choice.selection.drawn;
        let same = self.drawn.iter().map(|d| d.node).eq(drawn.iter().map(|d| d.node));
        self.drawn = drawn;
        let follows = may_follow && self.options.occlusion && !same;
        let follows = follows || (!finds_place && self.spare_more());
        let waits = !is_complete && self.retries.is_waiting(began);
        if self.asked.is_empty() && !self.has_more && !waits && !follows {
            self.epoch += 1;
            let cut = Cut { epoch: self.epoch, settled: true, ..Cut::clone(&front) };
            self.shared.front.store(Arc::new(cut));
        }
        follows
    }

    /// Whether the roots can be drawn with these planes, beside those that they are drawn with.
    pub(crate) fn check_roots(&self, needs: &Needs) -> Result<(), StreamError> {
        let mut kinds = self.planes.base(&self.shown);
        kinds.extend(self.planes.base(needs));
        kinds.sort_unstable();
        kinds.dedup();
        let (planes, kinds) = (&self.planes, &kinds);
        let of = |root| kinds.iter().map(move |&kind| planes.taken(root, kind));
        let lengths = planes.roots().flat_map(of);
        let bytes = lengths.clone().sum();
        let Options { drawing_bytes, page_bytes, .. } = self.options;
        if bytes > drawing_bytes || lengths.max() > Some(page_bytes) {
            let (path, roots) = (planes.forest.path().to_path_buf(), planes.roots().count());
            return Err(StreamError::RootsTooLarge {
                path,
                roots,
                bytes,
                drawing_bytes,
                page_bytes,
            });
        }
        Ok(())
    }

    /// Bytes of a node's slots for a view.
    fn node_bytes(&self, node: u32, base: &[PlaneKind], view: &View) -> u64 {
        let base: u64 = base.iter().map(|&kind| self.planes.taken(node, kind)).sum();
        let residual = self.needs_residual(node, view).then_some(PlaneKind::Residual);
        base + residual.map_or(0, |kind| self.planes.taken(node, kind))
    }

    fn needs_residual(&self, node: u32, view: &View) -> bool {
        needs_residual(self.planes.node(node), self.planes.lattice(), view)
    }

    /// A new view; it may find fewer holes than the last.
    pub(crate) fn look(&mut self, view: View) {
        self.view = Some(view);
        let least = self.options.drawing_bytes / SPARE;
        self.spare_bytes = (self.spare_bytes - self.spare_bytes / 16).max(least);
    }

    /// Plans with less, where holes keep something from its place though nothing else can leave and
    /// nothing is under way: then what is wanted least leaves. Whether that may help.
    fn spare_more(&mut self) -> bool {
        let step = self.options.drawing_bytes / (4 * SPARE);
        let may_help = self.asked.is_empty() && self.spare_bytes < self.options.drawing_bytes / 2;
        self.spare_bytes += if may_help { step } else { 0 };
        may_help && step > 0
    }

    /// Bytes that a cut may take: all but the spare ones, and the roots'.
    fn bytes_budget(&self, base: &[PlaneKind], view: &View) -> u64 {
        let coming = self.planes.base(&self.needs);
        let coming: Vec<_> = coming.into_iter().filter(|kind| !base.contains(kind)).collect();
        let of = |root| {
            let coming = coming.iter().map(|&kind| self.planes.taken(root, kind));
            coming.sum::<u64>() + self.node_bytes(root, base, view)
        };
        let roots = self.planes.roots().map(of).sum();
        let bytes = self.options.drawing_bytes;
        bytes.saturating_sub(self.spare_bytes).saturating_sub(roots)
    }

    fn choose(&self, view: View) -> Choice {
        let base = self.planes.base(&self.shown);
        // Software depth is of nodes, not of the points that a filter leaves of them.
        let hides = self.feedback.is_some() || !self.planes.shown.is_filtered();
        let mut selection = if self.options.occlusion && hides {
            let occlusion = self.occlusion(&view, &self.drawn);
            let selection = self.select(&view, &base, Some(&*occlusion));
            if self.feedback.is_none() && self.hides_by_what_is_gone(&view, &selection, &*occlusion)
            {
                let occlusion = self.occlusion(&view, &selection.drawn);
                self.select(&view, &base, Some(&*occlusion))
            } else {
                selection
            }
        } else {
            self.select(&view, &base, None)
        };
        if self.options.occlusion && selection.drawn.is_empty() {
            // What hides everything would have to be drawn.
            selection = self.select(&view, &base, None);
        }
        self.keep_to_nodes_max(&mut selection);
        // What is wanted for its children's sake alone draws no point, and loaders would drop what is asked for it.
        let drawn = selection.drawn.iter().map(|d| d.node);
        let coming = selection.missing.iter().filter(|m| m.prefix > 0).map(|m| m.node);
        let residuals =
            drawn.chain(coming).filter(|&node| self.needs_residual(node, &view)).collect();
        Choice { view, base, selection, residuals }
    }

    /// What the last finished frame hides; before there is one, what these nodes do. In rooms the frame's
    /// depth alone left out all that both did, and the other's takes 2 ms to make for 1,000 nodes.
    fn occlusion(&self, view: &View, hiding: &[Drawn]) -> Box<dyn Occlusion> {
        if let Some(feedback) = &self.feedback {
            return Box::new(feedback.seen_from(view));
        }
        let (table, lattice) = (self.planes.forest.table(), self.planes.lattice());
        Box::new(SoftwareDepth::new(table, lattice, view, hiding))
    }

    /// Whether something of the last cut, which this choice took to hide what is behind it, is in view
    /// and not drawn any more, because less detail is enough: there may be nothing in its place.
    fn hides_by_what_is_gone(
        &self,
        view: &View,
        selection: &Selection,
        occlusion: &dyn Occlusion,
    ) -> bool {
        let drawn: HashSet<u32> = selection.drawn.iter().map(|d| d.node).collect();
        let (frustum, lattice) = (Frustum::of(view), self.planes.lattice());
        self.drawn.iter().filter(|d| !drawn.contains(&d.node)).any(|d| {
            let contour = OrientedBox::of_contour(self.planes.node(d.node), lattice);
            frustum.touches(&contour) && !occlusion.hides(&contour)
        })
    }

    fn select(
        &self,
        view: &View,
        base: &[PlaneKind],
        occlusion: Option<&dyn Occlusion>,
    ) -> Selection {
        let options = esker_lod::Options {
            points_budget: self.options.points_budget,
            bytes_budget: self.bytes_budget(base, view),
            target_spacing_px: self.options.target_spacing_px,
        };
        let (table, lattice) = (self.planes.forest.table(), self.planes.lattice());
        select(table, lattice, view, &options, &Known { chooser: self, base, view }, occlusion)
    }

    /// Leaves out what is beyond the greatest number of nodes; the beginning of what is wanted is
    /// closed under parent.
    fn keep_to_nodes_max(&self, selection: &mut Selection) {
        if selection.wanted.len() > self.options.nodes_max {
            let nodes_max = self.options.nodes_max.max(self.planes.roots().count());
            selection.wanted.truncate(nodes_max);
            let wanted: HashSet<u32> = selection.wanted.iter().copied().collect();
            selection.drawn.retain(|d| wanted.contains(&d.node));
            selection.missing.retain(|m| wanted.contains(&m.node));
            let counters = &mut selection.counters;
            counters.drawn = selection.drawn.len() as u64;
            counters.points = selection.drawn.iter().map(|d| d.prefix as u64).sum();
        }
    }

    fn cut(&mut self, choice: &Choice, began: Instant) -> Cut {
        let Choice { base, selection, .. } = choice;
        let mut lacks_residual = false;
        let nodes = selection.drawn.iter().map(|d| {
            let residual = choice.residuals.get(&d.node).map(|_| PlaneKind::Residual);
            let kinds = base.iter().copied().chain(residual);
            let planes = kinds.filter_map(|k| Some((k, self.cache.resident(d.node, k)?)));
            let planes: Vec<_> = planes.collect();
            lacks_residual |=
                residual.is_some_and(|residual| planes.iter().all(|p| p.0 != residual));
            CutNode {
                node: d.node,
                prefix: d.prefix,
                effective_spacing: d.effective_spacing,
                planes,
            }
        });
        let nodes = nodes.collect();
        self.epoch += 1;
        Cut {
            epoch: self.epoch,
            view: choice.view,
            needs: self.shown.clone(),
            nodes,
            octree: CompactOctree::with_hidden(
                self.planes.forest.table(),
                &selection.drawn,
                &selection.hidden,
            ),
            counters: selection.counters,
            complete: selection.missing.is_empty() && !lacks_residual && self.shown == self.needs,
            settled: false,
            lod_ms: began.elapsed().as_secs_f64() * 1000.0,
        }
    }

    /// Keeps what the cut wants; everything else may leave.
    fn touch(&mut self, choice: &Choice) {
        for &node in &choice.selection.wanted {
            choice.base.iter().for_each(|&kind| self.cache.touch(node, kind));
        }
        choice.residuals.iter().for_each(|&node| self.cache.touch(node, PlaneKind::Residual));
        let base = self.planes.base(&self.needs);
        for root in self.planes.roots() {
            base.iter().for_each(|&kind| self.cache.touch(root, kind));
        }
    }

    /// Without a view all there is to draw are the roots, once they are there: so the first frame has them.
    fn show_roots(&mut self) {
        let base = self.planes.base(&self.shown);
        let is_there = |&root: &u32| self.cache.is_resident(root, &base);
        let drawn = self.planes.roots().filter(is_there).map(|node| {
            let root = self.planes.node(node);
            Drawn { node, prefix: root.points(), effective_spacing: root.spacing }
        });
        let drawn: Vec<_> = drawn.collect();
        if drawn.len() > self.drawn.len() {
            let choice = Choice {
                view: Cut::empty(Needs::default()).view,
                base,
                selection: Selection { drawn, ..Selection::default() },
                residuals: HashSet::new(),
            };
            let cut = self.cut(&choice, Instant::now());
            self.shared.front.store(Arc::new(Cut { complete: false, ..cut }));
            self.drawn = choice.selection.drawn;
        }
    }

    /// Shows what was asked for last, once all roots have it: from there on there is always something to
    /// draw.
    fn show_needs(&mut self) {
        let base = self.planes.base(&self.needs);
        let are_there = || self.planes.roots().all(|root| self.cache.is_resident(root, &base));
        if self.shown != self.needs && are_there() {
            self.shown = self.needs.clone();
            // What was drawn with the planes before hides nothing of what is drawn with these.
            self.drawn.clear();
        }
    }
}
