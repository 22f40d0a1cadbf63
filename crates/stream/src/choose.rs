//! A pass of the LOD thread (kanzok2015, section 3.2.2): chooses the cut of the newest view,
//! publishes it, then requests the best missing planes in the slots of planes that the cut does not
//! want. This order is required, see [`crate::shared`].

use crate::batch::Batch;
use crate::cache::Cache;
use crate::cut::{Cut, CutNode};
use crate::error::StreamError;
use crate::options::{Limits, Needs, Options, Shown};
use crate::planes::{LoadRequest, Planes, Rules};
use crate::queue::Queue;
use crate::retries::Retries;
use crate::shared::Shared;
use esker_format::{Forest, PlaneKind};
use esker_lod::{
    CompactOctree, DepthFeedback, Drawn, Frustum, Occlusion, OrientedBox, Residency, Selection,
    SoftwareDepth, Surroundings, View, needs_residual, select,
};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Instant;

/// The share of drawing memory, one over this, that is initially reserved for holes between slots
/// of different lengths.
const SPARE: u64 = 16;

/// State of the LOD thread.
pub(crate) struct Chooser {
    pub(crate) options: Options,
    /// Planes as cuts are drawn with them.
    pub(crate) planes: Planes,
    /// Planes as they are shown next.
    pub(crate) newest_planes: Planes,
    pub(crate) rules: Rules,
    pub(crate) shared: Arc<Shared>,
    pub(crate) cache: Cache,
    pub(crate) retries: Retries,
    pub(crate) run_bytes: usize,
    pub(crate) queue: Arc<Queue<Batch>>,
    /// Requests in progress, by id.
    pub(crate) requests: HashMap<u64, LoadRequest>,
    pub(crate) last_id: u64,
    pub(crate) epoch: u64,
    pub(crate) view: Option<View>,
    /// What cuts show.
    pub(crate) shown: Arc<Shown>,
    /// What is to be shown, once the nodes of the front cut have its planes, or the roots have them
    /// and memory is full.
    pub(crate) newest: Arc<Shown>,
    /// Whether there is no memory for planes of the front cut in both forms.
    pub(crate) is_full: bool,
    /// Bytes of drawing memory from the first one on within which all slots lie.
    pub(crate) extent_bytes: u64,
    pub(crate) feedback: Option<Arc<DepthFeedback>>,
    /// Nodes of the front cut.
    pub(crate) drawn: Vec<Drawn>,
    /// Whether missing planes were not requested because the queue was full.
    pub(crate) has_more: bool,
    /// Bytes left out of the budget because holes between slots take them.
    pub(crate) spare_bytes: u64,
    /// Detail and budgets of the surroundings; `None` if they are switched off.
    pub(crate) surroundings: Option<Surroundings>,
    /// Bytes left out of the share of the surroundings for the same reason.
    pub(crate) spare_around_bytes: u64,
}

/// Result of the choice of a pass.
pub(crate) struct Choice {
    pub(crate) view: View,
    /// Base planes: a node is drawn only if it has all of them.
    pub(crate) base: Vec<PlaneKind>,
    pub(crate) selection: Selection,
    /// Nodes that need their residual plane, among those whose points are drawn or will be once
    /// loaded.
    pub(crate) residuals: HashSet<u32>,
}

/// The cache as [`select`] sees it. Roots cost nothing, since their slots are reserved.
pub(crate) struct CacheResidency<'a> {
    pub(crate) chooser: &'a Chooser,
    pub(crate) base: &'a [PlaneKind],
    pub(crate) view: &'a View,
}

impl Residency for CacheResidency<'_> {
    fn is_resident(&self, node: u32) -> bool {
        self.chooser.cache.is_resident(&self.chooser.planes, node, self.base)
    }

    fn slot_bytes(&self, node: u32) -> u64 {
        if self.chooser.planes.is_root(node) {
            return 0;
        }
        self.chooser.node_bytes(node, self.base, self.view)
    }

    fn points_max(&self, node: u32) -> usize {
        self.chooser.planes.filter.points_max(node)
    }

    fn rejects_subtree(&self, node: u32) -> bool {
        self.chooser.planes.filter.rejects_subtree(node)
    }
}

impl Chooser {
    /// Makes one pass. Returns whether another pass should follow at once because it may find more
    /// hidden nodes; never if `may_follow` is false.
    pub(crate) fn pass(&mut self, may_follow: bool) -> bool {
        self.cache.begin_pass();
        self.grow();
        self.show_newest();
        let Some(view) = self.view else {
            self.show_roots();
            self.request_roots();
            return false;
        };
        let began = Instant::now();
        let choice = self.choose(view);
        let cut = self.cut(&choice, began);
        let is_complete = cut.complete;
        let front = Arc::new(cut);
        self.shared.front.store(Arc::clone(&front));
        self.touch(&choice);
        let is_within = self.extent_bytes == self.options.drawing_bytes || self.cache.vacate();
        if is_within {
            self.extent_bytes = self.options.drawing_bytes;
        }
        let all_placed = self.request_missing(&choice);
        let Selection { drawn, wanted, wanted_in_picture, .. } = choice.selection;
        let same = self.drawn.iter().map(|d| d.node).eq(drawn.iter().map(|d| d.node));
        self.drawn = drawn;
        let follows = may_follow && self.options.occlusion && !same;
        let follows = follows || (!all_placed && self.spare_more(&wanted[wanted_in_picture..]));
        let follows = follows || (!self.shows_newest() && self.can_show_newest());
        let waits = !is_complete && self.retries.is_waiting(began);
        if self.requests.is_empty() && !self.has_more && !waits && !follows {
            self.epoch += 1;
            let drawing_bytes = self.extent_bytes;
            let cut = Cut { epoch: self.epoch, settled: true, drawing_bytes, ..Cut::clone(&front) };
            self.shared.front.store(Arc::new(cut));
        }
        follows
    }

    /// Takes the newest table of a tree that grows. Nodes keep their indices, cells and planes.
    fn grow(&mut self) {
        let Some(newer) = self.planes.forest.newer() else { return };
        let forest = Arc::new(newer);
        let is_same = self.shows_newest();
        self.cache.grow(Arc::clone(&forest));
        self.shown = grown(&self.shown, &forest);
        self.newest = if is_same { Arc::clone(&self.shown) } else { grown(&self.newest, &forest) };
        let planes = |shown: &Shown, rules| {
            let (forest, filter) = (Arc::clone(&forest), Arc::clone(&shown.filter));
            Planes { forest, filter, rules }
        };
        self.planes = planes(&self.shown, self.planes.rules);
        self.newest_planes = planes(&self.newest, self.newest_planes.rules);
    }

    /// Whether cuts show what is to be shown.
    pub(crate) fn shows_newest(&self) -> bool {
        Arc::ptr_eq(&self.shown, &self.newest)
    }

    /// Sets what is to be shown.
    ///
    /// # Errors
    /// If the planes of the roots do not fit drawing memory beside those that they are drawn with.
    /// Nothing changes then.
    pub(crate) fn show(&mut self, shown: Arc<Shown>) -> Result<(), StreamError> {
        let forest = Arc::clone(&self.planes.forest);
        let shown = grown(&shown, &forest);
        let filter = Arc::clone(&shown.filter);
        let rules = self.rules.of(&filter);
        let planes = Planes { forest, filter, rules };
        let drawn = (&self.planes, &self.shown.needs);
        check_roots(&[drawn, (&planes, &shown.needs)], &self.options)?;
        (self.newest, self.newest_planes, self.is_full) = (shown, planes, false);
        Ok(())
    }

    /// Changes the budgets.
    ///
    /// # Errors
    /// If the planes of the roots do not fit drawing memory. Nothing changes then.
    pub(crate) fn limit(&mut self, limits: &Limits) -> Result<(), StreamError> {
        let mut options = self.options.clone();
        options.limit(limits);
        let drawn = (&self.planes, &self.shown.needs);
        check_roots(&[drawn, (&self.newest_planes, &self.newest.needs)], &options)?;
        if options.occlusion != self.options.occlusion {
            // Depth from before occlusion was last switched off may be of another view.
            self.feedback = None;
        }
        self.extent_bytes = self.extent_bytes.max(options.drawing_bytes);
        self.cache.resize(options.drawing_bytes);
        self.options = options;
        self.spare_bytes = self.options.drawing_bytes / SPARE;
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

    /// Sets a new view. It may meet fewer holes than the last one, so the spare share shrinks.
    pub(crate) fn look(&mut self, view: View) {
        self.view = Some(view);
        let least = self.options.drawing_bytes / SPARE;
        self.spare_bytes = (self.spare_bytes - self.spare_bytes / 16).max(least);
        self.spare_around_bytes -= self.spare_around_bytes.div_ceil(16);
    }

    /// Reserves more spare bytes if holes prevent a request from getting slots, although no unused
    /// plane is left to evict and no request is in progress: then the least wanted planes are
    /// evicted, those of `surroundings` before any of the picture. Returns whether that may help.
    fn spare_more(&mut self, surroundings: &[u32]) -> bool {
        let step = self.options.drawing_bytes / (4 * SPARE);
        if self.spare_around(surroundings, step) {
            return true;
        }
        let may_help =
            self.requests.is_empty() && self.spare_bytes < self.options.drawing_bytes / 2;
        self.spare_bytes += if may_help { step } else { 0 };
        may_help && step > 0
    }

    /// Bytes that a cut may take: drawing memory without the spare bytes and the roots.
    fn bytes_budget(&self, base: &[PlaneKind], view: &View) -> u64 {
        let coming = self.newest_planes.base(&self.newest.needs);
        let of = |root| {
            let is_new = |kind: &PlaneKind| {
                let same = self.newest_planes.form(root, *kind) == self.planes.form(root, *kind);
                !(same && base.contains(kind))
            };
            let coming = coming.iter().copied().filter(is_new);
            let coming = coming.map(|kind| self.newest_planes.taken(root, kind));
            coming.sum::<u64>() + self.node_bytes(root, base, view)
        };
        let roots = self.planes.roots().map(of).sum();
        let bytes = self.options.drawing_bytes;
        bytes.saturating_sub(self.spare_bytes).saturating_sub(roots)
    }

    /// Chooses the nodes of a view.
    fn choose(&self, view: View) -> Choice {
        let base = self.planes.base(&self.shown.needs);
        // Software depth is computed from nodes, not from the points that a filter leaves of them.
        let hides = self.feedback.is_some() || !self.planes.filter.is_filtered();
        let mut selection = if self.options.occlusion && hides {
            let occlusion = self.occlusion(&view, &self.drawn);
            let selection = self.select(&view, &base, Some(&*occlusion));
            if self.feedback.is_none() && self.is_occluder_gone(&view, &selection, &*occlusion) {
                let occlusion = self.occlusion(&view, &selection.drawn);
                self.select(&view, &base, Some(&*occlusion))
            } else {
                selection
            }
        } else {
            self.select(&view, &base, None)
        };
        if self.options.occlusion && selection.drawn.is_empty() {
            // Whatever hides everything must be drawn itself.
            selection = self.select(&view, &base, None);
        }
        self.keep_to_nodes_max(&mut selection);
        // A node that is wanted only for its children draws no point, and loaders would drop its
        // residual.
        let drawn = selection.drawn.iter().map(|d| d.node);
        let coming = selection.missing.iter().filter(|m| m.prefix > 0).map(|m| m.node);
        let residuals =
            drawn.chain(coming).filter(|&node| self.needs_residual(node, &view)).collect();
        self.surround(&view, &base, &mut selection);
        Choice { view, base, selection, residuals }
    }

    /// Occlusion by the last finished frame, or by the nodes `hiding` as long as there is no
    /// feedback.
    fn occlusion(&self, view: &View, hiding: &[Drawn]) -> Box<dyn Occlusion> {
        if let Some(feedback) = &self.feedback {
            return Box::new(feedback.seen_from(view));
        }
        let (table, lattice) = (self.planes.forest.table(), self.planes.lattice());
        Box::new(SoftwareDepth::new(table, lattice, view, hiding))
    }

    /// Whether a node of the last cut that served as an occluder is in view and not drawn any more,
    /// because less detail is enough: its place may then be empty.
    fn is_occluder_gone(
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

    /// Runs the pure selection with the budgets and the cache of this moment.
    fn select(
        &self,
        view: &View,
        base: &[PlaneKind],
        occlusion: Option<&dyn Occlusion>,
    ) -> Selection {
        let options = self.lod_options(base, view);
        let (table, lattice) = (self.planes.forest.table(), self.planes.lattice());
        select(
            table,
            lattice,
            view,
            &options,
            &CacheResidency { chooser: self, base, view },
            occlusion,
        )
    }

    /// Budgets of this moment.
    pub(crate) fn lod_options(&self, base: &[PlaneKind], view: &View) -> esker_lod::Options {
        esker_lod::Options {
            points_budget: self.options.points_budget,
            bytes_budget: self.bytes_budget(base, view),
            target_spacing_px: self.options.target_spacing_px,
        }
    }

    /// Removes nodes beyond the greatest number of nodes. A prefix of the wanted list is closed
    /// under parent.
    pub(crate) fn keep_to_nodes_max(&self, selection: &mut Selection) {
        if selection.wanted.len() > self.options.nodes_max {
            let nodes_max = self.options.nodes_max.max(self.planes.roots().count());
            selection.wanted.truncate(nodes_max);
            selection.prefixes.truncate(nodes_max);
            selection.wanted_in_picture = selection.wanted_in_picture.min(nodes_max);
            let wanted: HashSet<u32> = selection.wanted.iter().copied().collect();
            selection.drawn.retain(|d| wanted.contains(&d.node));
            selection.surroundings.retain(|d| wanted.contains(&d.node));
            selection.missing.retain(|m| wanted.contains(&m.node));
            let counters = &mut selection.counters;
            counters.drawn = selection.drawn.len() as u64;
            counters.points = selection.drawn.iter().map(|d| d.prefix as u64).sum();
            counters.surroundings = selection.surroundings.len() as u64;
            counters.surroundings_points =
                selection.surroundings.iter().map(|d| d.prefix as u64).sum();
        }
    }

    /// Makes the cut of a choice.
    fn cut(&mut self, choice: &Choice, began: Instant) -> Cut {
        let Choice { base, selection, .. } = choice;
        let mut misses_residual = false;
        let nodes = selection.drawn.iter().map(|d| {
            let residual = choice.residuals.get(&d.node).map(|_| PlaneKind::Residual);
            let kinds = base.iter().copied().chain(residual);
            let slot = |k| self.cache.resident(d.node, self.planes.form(d.node, k));
            let planes = kinds.filter_map(|k| Some((k, slot(k)?)));
            let planes: Vec<_> = planes.collect();
            misses_residual |=
                residual.is_some_and(|residual| planes.iter().all(|p| p.0 != residual));
            CutNode {
                node: d.node,
                prefix: d.prefix,
                effective_spacing: d.effective_spacing,
                planes,
            }
        });
        let nodes = nodes.collect();
        let surroundings = self.cut_surroundings(choice);
        self.epoch += 1;
        Cut {
            epoch: self.epoch,
            view: choice.view,
            forest: Arc::clone(&self.planes.forest),
            shown: Arc::clone(&self.shown),
            nodes,
            octree: CompactOctree::with_hidden(
                self.planes.forest.table(),
                &selection.drawn,
                &selection.hidden,
            ),
            surroundings,
            counters: selection.counters,
            drawing_bytes: self.extent_bytes,
            complete: selection.missing.is_empty()
                && selection.lacking.is_empty()
                && !misses_residual
                && self.shows_newest(),
            settled: false,
            lod_ms: began.elapsed().as_secs_f64() * 1000.0,
        }
    }

    /// Marks the planes that the cut wants as used in this pass; all others may be evicted.
    fn touch(&mut self, choice: &Choice) {
        let Self { cache, planes, newest_planes, .. } = self;
        for &node in &choice.selection.wanted {
            choice.base.iter().for_each(|&kind| cache.touch(node, planes.form(node, kind)));
        }
        for &node in &choice.residuals {
            cache.touch(node, planes.form(node, PlaneKind::Residual));
        }
        let base = newest_planes.base(&self.newest.needs);
        let is_changing = !Arc::ptr_eq(&self.shown, &self.newest);
        let drawn = choice.selection.drawn.iter().filter(|_| is_changing).map(|d| d.node);
        for node in newest_planes.roots().chain(drawn) {
            base.iter().for_each(|&kind| cache.touch(node, newest_planes.form(node, kind)));
        }
    }

    /// Publishes the resident roots while there is no view, so that the first frame has them.
    fn show_roots(&mut self) {
        let base = self.planes.base(&self.shown.needs);
        let is_resident = |&root: &u32| self.cache.is_resident(&self.planes, root, &base);
        let drawn = self.planes.roots().filter(is_resident).map(|node| {
            let root = self.planes.node(node);
            Drawn { node, prefix: root.points(), effective_spacing: root.spacing }
        });
        let drawn: Vec<_> = drawn.collect();
        if drawn.len() > self.drawn.len() {
            let choice = Choice {
                view: Cut::empty(Arc::clone(&self.planes.forest), Arc::default()).view,
                base,
                selection: Selection { drawn, ..Selection::default() },
                residuals: HashSet::new(),
            };
            let cut = self.cut(&choice, Instant::now());
            self.shared.front.store(Arc::new(Cut { complete: false, ..cut }));
            self.drawn = choice.selection.drawn;
        }
    }

    /// Whether the newest choice can be shown as completely as the front cut shows the last one, or
    /// memory is too small for both.
    fn can_show_newest(&self) -> bool {
        let Self { newest_planes: planes, cache, .. } = self;
        let base = planes.base(&self.newest.needs);
        let is_resident = |node: u32| cache.is_resident(planes, node, &base);
        let is_ready = |node: u32| {
            let is_left_out = planes.filter.points_max(node) == 0;
            is_left_out || is_resident(node) || self.retries.has_failed(node)
        };
        // The roots come first: from then on there is always something to draw.
        planes.roots().all(is_resident)
            && (self.is_full || self.drawn.iter().all(|d| is_ready(d.node)))
    }

    /// Shows the newest choice as soon as that is possible.
    fn show_newest(&mut self) {
        if self.shows_newest() || !self.can_show_newest() {
            return;
        }
        if !self.newest.filter.shows_as(&self.shown.filter) {
            // What hid other nodes may be left out.
            self.feedback = None;
        }
        if self.newest.needs != self.shown.needs || self.newest.filter != self.shown.filter {
            // Nodes drawn with the earlier planes hide nothing of nodes drawn with the new ones.
            self.drawn.clear();
        }
        self.shown = Arc::clone(&self.newest);
        self.planes = self.newest_planes.clone();
    }
}

/// What is to be shown, with a filter that knows all nodes of a forest.
fn grown(shown: &Arc<Shown>, forest: &Forest) -> Arc<Shown> {
    // Statistics of trees that grow are in memory, so they can be read.
    match shown.filter.grown(forest) {
        Ok(Some(filter)) => Arc::new(Shown { filter: Arc::new(filter), ..Shown::clone(shown) }),
        _ => Arc::clone(shown),
    }
}

/// Checks that the planes of the roots for all of `shown` fit drawing memory at the same time.
pub(crate) fn check_roots(
    shown: &[(&Planes, &Needs)],
    options: &Options,
) -> Result<(), StreamError> {
    let Options { drawing_bytes, page_bytes, .. } = *options;
    let Some((planes, _)) = shown.first() else { return Ok(()) };
    let (mut bytes, mut longest) = (0, 0);
    for root in planes.roots() {
        let of = |(planes, needs): &(&Planes, &Needs)| {
            let form = |kind| (planes.form(root, kind), planes.taken(root, kind));
            planes.base(needs).into_iter().map(form).collect::<Vec<_>>()
        };
        let mut forms: Vec<_> = shown.iter().flat_map(of).collect();
        forms.sort_unstable();
        forms.dedup();
        bytes += forms.iter().map(|(_, taken)| taken).sum::<u64>();
        longest = forms.iter().map(|(_, taken)| *taken).fold(longest, u64::max);
    }
    if bytes > drawing_bytes || longest > page_bytes {
        let (path, roots) = (planes.forest.path().to_path_buf(), planes.roots().count());
        return Err(StreamError::RootsTooLarge { path, roots, bytes, drawing_bytes, page_bytes });
    }
    Ok(())
}
