//! Builds consecutive chunks and the cells above them in parallel. A chunk is loaded, sorted and
//! sampled; a cell above is sampled as soon as its children are. Then the nodes below each are
//! finished, by any thread in any order. Only placing and writing the results follows the order of
//! steps. No step waits for another: the thread that completes a step spawns the one that follows
//! (`docs/design/building.md`).

use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::page::histograms::Counts;
use crate::rows::borders::Borders;
use crate::rows::journal_record::Record;
use crate::rows::partition::Bucket;
use crate::rows::row::Rows;
use crate::rows::scratch::Extent;
use crate::rows::store::{ChunkRows, Store};
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell};
use crate::tree::finishing::Unfinished;
use crate::tree::levels::{Step, TreeBuilder};
use crate::tree::pages::Pages;
use crate::tree::subtree::Children;
use crate::tree::waiting::{PartialTree, SampledCell, join};
use esker_points::task::Silent;
use esker_points::{Cell, Task};
use rayon::Scope;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Chunks in progress, for each thread: one that is being sampled, one whose nodes are being
/// finished, and one that waits for earlier ones.
const CHUNKS_A_THREAD: usize = 3;

/// The result of a step, `None` until its nodes are finished.
type SharedResult = Arc<Mutex<Option<FinishedStep>>>;

/// State of what a cell offers to the cell above.
#[derive(Default)]
enum Offer {
    /// The cell is not sampled yet, and no cell above waits for it; or its offer was passed on.
    #[default]
    Open,
    /// The cell is sampled, and no cell above waits for it yet.
    Ready(Box<SampledCell>),
    /// The cell above waits for it, as its child of this index.
    Awaited(Arc<ParentCell>, usize),
}

/// The offer of a cell, shared with the thread that samples the cell above.
type SharedOffer = Arc<Mutex<Offer>>;

/// A cell above chunks, which waits for the offers of its children.
struct ParentCell {
    cell: Cell,
    offers: Mutex<Vec<Option<SampledCell>>>,
    /// Its own offer, once it is sampled.
    offer: SharedOffer,
    result: SharedResult,
}

/// A sampled chunk or cell above chunks while the nodes below it are finished.
struct FinishJob {
    rows: Vec<u8>,
    unfinished: Unfinished,
    /// Rows that coincide with those that the cell offers.
    coincident: Option<(Cell, Range<u32>)>,
    /// `None` for a cell above chunks.
    chunk: Option<Chunk>,
    result: SharedResult,
}

/// Data that chunks have and cells above them do not.
struct Chunk {
    counts: Counts,
    extents: Vec<Extent>,
    /// Journal record of what the chunk offers, if chunks are recorded.
    offer: Option<Record>,
}

/// A chunk or cell above chunks all of whose nodes but the root are finished.
struct FinishedStep {
    children: Children,
    /// For each child, the index of the cell whose result has the nodes below
    /// it, if they are not here.
    elsewhere: Vec<Option<usize>>,
    pages: Pages,
    chunk: Option<Chunk>,
}

/// A chunk or cell above chunks in progress.
struct StepInProgress {
    /// Rows of a chunk; 0 for a cell above chunks.
    rows: u64,
    /// Number of children of a cell above chunks.
    child_count: usize,
    result: SharedResult,
}

/// State that changes in the order of steps; one thread at a time has it.
struct Sequencer<'a> {
    steps: &'a mut Vec<Step>,
    store: &'a mut Store,
    tree: &'a mut PartialTree,
    /// Steps in progress, in order.
    in_progress: VecDeque<StepInProgress>,
    /// Number of chunks in progress, and their rows.
    chunks: usize,
    rows: u64,
    /// Offers of the cells, in progress or built, that have no cell above yet.
    offers: Vec<SharedOffer>,
    /// Nodes below each built cell that has no cell above yet.
    below: Vec<Children>,
    /// The first error; no step is started after it.
    fault: Option<BuildError>,
}

/// State that all threads share.
struct Pipeline<'a> {
    context: &'a Context,
    task: &'a dyn Task,
    peak: &'a Peak,
    borders: Option<&'a Borders>,
    threads: usize,
    /// Most rows of several chunks in progress.
    rows_max: u64,
    /// Whether the journal records chunks.
    is_recorded: bool,
    sequencer: Mutex<Sequencer<'a>>,
    /// Whether there was an error.
    is_faulty: AtomicBool,
    /// Number of calls of [`Pipeline::drive`].
    requests: AtomicUsize,
    /// Chunks that are being loaded or sampled.
    sampling: AtomicUsize,
    /// Chunks that are not started.
    left: AtomicUsize,
    /// Unused buffers of rows, while chunks are left.
    spare: Mutex<Vec<Vec<u8>>>,
}

impl TreeBuilder<'_> {
    /// Builds the chunks on top of the stack, and the cells above that wait for them, until another
    /// kind of step is on top.
    ///
    /// # Errors
    /// If scratch or the file fail, or on request.
    pub(crate) fn build_chunks(
        &mut self,
        steps: &mut Vec<Step>,
        tree: &mut PartialTree,
    ) -> Result<(), BuildError> {
        self.store.write(std::mem::take(&mut tree.outgoing))?;
        let threads = rayon::current_num_threads();
        // Each thread has a node or a sample in progress, of about as many
        // bytes as the rows of a node.
        let thread_rows = (threads * self.context.capacity) as u64;
        let (joined_max, single_max) = self.chunk_rows_max;
        let rows_max = single_max.saturating_sub(thread_rows);
        let borders = self.store.borders.take();
        let top = steps.iter().rev();
        let top = top.take_while(|step| matches!(step, Step::Chunk(_) | Step::Combine(..)));
        let left = top.filter(|step| matches!(step, Step::Chunk(_))).count();
        let (mut offers, mut below) = (Vec::new(), Vec::new());
        for mut cell in tree.cells.drain(..) {
            below.push(cell.pending.below.put_elsewhere());
            offers.push(Arc::new(Mutex::new(Offer::Ready(Box::new(cell)))));
        }
        let pipeline = Pipeline {
            context: self.context,
            task: self.task,
            peak: self.peak,
            borders: borders.as_ref(),
            threads,
            // One chunk at a time if memory has no room for a second.
            rows_max: if rows_max < joined_max { 0 } else { 2 * rows_max },
            is_recorded: self.store.journal.is_recording(),
            sequencer: Mutex::new(Sequencer {
                steps,
                store: &mut *self.store,
                tree: &mut *tree,
                in_progress: VecDeque::new(),
                chunks: 0,
                rows: 0,
                offers,
                below,
                fault: None,
            }),
            is_faulty: AtomicBool::new(false),
            requests: AtomicUsize::new(0),
            sampling: AtomicUsize::new(0),
            left: AtomicUsize::new(left),
            spare: Mutex::default(),
        };
        rayon::scope(|scope| pipeline.drive(scope));
        let sequencer = pipeline.sequencer.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Sequencer { in_progress, offers, below, fault, .. } = sequencer;
        self.store.borders = borders;
        if let Some(fault) = fault {
            return Err(fault);
        }
        for (offer, children) in offers.iter().zip(below) {
            let Offer::Ready(mut cell) = std::mem::take(&mut *lock(offer)) else { break };
            cell.pending.below = Below::Finished(children);
            tree.cells.push(*cell);
        }
        if !in_progress.is_empty() || tree.cells.len() < offers.len() {
            self.task.check()?;
            return Err(BuildError::Proof("a chunk was not built".into()));
        }
        Ok(())
    }
}

impl<'a> Pipeline<'a> {
    /// Places and writes finished steps, and starts chunks for which there is room. If another
    /// thread is doing so, that thread does it again.
    fn drive<'s>(&'s self, scope: &Scope<'s>) {
        self.requests.fetch_add(1, Ordering::SeqCst);
        loop {
            let Ok(mut sequencer) = self.sequencer.try_lock() else { return };
            let requests = self.requests.load(Ordering::SeqCst);
            if sequencer.fault.is_none() {
                sequencer.fault = self.advance(&mut sequencer, scope).err();
                self.is_faulty.fetch_or(sequencer.fault.is_some(), Ordering::Relaxed);
            }
            drop(sequencer);
            // A thread that called meanwhile has found the lock taken. A read that writes makes
            // what that thread did before its call visible here.
            if self.requests.fetch_add(0, Ordering::SeqCst) == requests {
                return;
            }
        }
    }

    fn advance<'s>(
        &'s self,
        sequencer: &mut Sequencer<'a>,
        scope: &Scope<'s>,
    ) -> Result<(), BuildError> {
        loop {
            self.start_chunks(sequencer, scope)?;
            let first = sequencer.in_progress.front();
            let finished = first.and_then(|first| lock(&first.result).take());
            let Some(finished) = finished else { return Ok(()) };
            let Some(step) = sequencer.in_progress.pop_front() else { return Ok(()) };
            // After a cancellation its nodes are not finished.
            self.task.check()?;
            sequencer.chunks -= usize::from(finished.chunk.is_some());
            sequencer.place(finished, &step, self);
            sequencer.store.write(std::mem::take(&mut sequencer.tree.outgoing))?;
            sequencer.rows -= step.rows;
            self.peak.sample();
        }
    }

    /// Starts chunks on top of the stack while there is room for them, and lets the cells above
    /// wait for them.
    fn start_chunks<'s>(
        &'s self,
        sequencer: &mut Sequencer<'a>,
        scope: &Scope<'s>,
    ) -> Result<(), BuildError> {
        let chunks_max = CHUNKS_A_THREAD * self.threads;
        while self.sampling.load(Ordering::SeqCst) < self.threads && sequencer.chunks < chunks_max {
            let before = sequencer.rows;
            let has_room = |step: &mut Step| match step {
                Step::Chunk(buckets) => before == 0 || before + rows_of(buckets) <= self.rows_max,
                _ => false,
            };
            let Some(Step::Chunk(buckets)) = sequencer.steps.pop_if(has_room) else { break };
            let (rows, result) = (rows_of(&buckets), SharedResult::default());
            let offer = SharedOffer::default();
            let has_borders = self.borders.is_some();
            let chunk = sequencer.store.chunk_rows(buckets, &self.context.rows, has_borders)?;
            sequencer.chunks += 1;
            sequencer.rows += rows;
            let step = StepInProgress { rows, child_count: 0, result: result.clone() };
            sequencer.in_progress.push_back(step);
            sequencer.offers.push(offer.clone());
            while let Some(&Step::Combine(cell, child_count)) = sequencer.steps.last() {
                sequencer.steps.pop();
                self.await_offers(sequencer, (cell, child_count), scope);
            }
            self.left.fetch_sub(1, Ordering::SeqCst);
            self.sampling.fetch_add(1, Ordering::SeqCst);
            scope.spawn(move |scope| self.build_chunk(chunk, (result, offer), scope));
        }
        Ok(())
    }

    /// Lets a cell wait for the offers of the last `child_count` cells.
    fn await_offers<'s>(
        &'s self,
        sequencer: &mut Sequencer<'a>,
        (cell, child_count): (Cell, usize),
        scope: &Scope<'s>,
    ) {
        let (result, offer) = (SharedResult::default(), SharedOffer::default());
        let step = StepInProgress { rows: 0, child_count, result: result.clone() };
        sequencer.in_progress.push_back(step);
        let offers = Mutex::new((0..child_count).map(|_| None).collect());
        let parent = Arc::new(ParentCell { cell, offers, offer: offer.clone(), result });
        let children = sequencer.offers.split_off(sequencer.offers.len() - child_count);
        for (i, child) in children.into_iter().enumerate() {
            let awaited = Offer::Awaited(Arc::clone(&parent), i);
            if let Offer::Ready(sampled) = std::mem::replace(&mut *lock(&child), awaited) {
                self.deliver(&parent, i, *sampled, scope);
            }
        }
        sequencer.offers.push(offer);
    }

    /// Passes a sampled cell to the cell above, or leaves it until one waits for it.
    fn publish<'s>(&'s self, offer: &SharedOffer, sampled: SampledCell, scope: &Scope<'s>) {
        let mut offer = lock(offer);
        match std::mem::take(&mut *offer) {
            Offer::Awaited(parent, i) => self.deliver(&parent, i, sampled, scope),
            _ => *offer = Offer::Ready(Box::new(sampled)),
        }
    }

    /// Delivers child `i` to a cell above; with the last child, the cell is sampled.
    fn deliver<'s>(
        &'s self,
        parent: &Arc<ParentCell>,
        i: usize,
        sampled: SampledCell,
        scope: &Scope<'s>,
    ) {
        let mut offers = lock(&parent.offers);
        offers[i] = Some(sampled);
        if offers.iter().all(Option::is_some) {
            let children = std::mem::take(&mut *offers).into_iter().flatten().collect();
            let parent = Arc::clone(parent);
            scope.spawn(move |scope| self.build_parent(&parent, children, scope));
        }
    }

    /// Whether the build was cancelled or has failed; then nothing more is started.
    fn is_stopped(&self) -> bool {
        self.is_faulty.load(Ordering::Relaxed) || self.task.is_cancelled()
    }

    /// Loads and sorts a chunk, and samples its cells. Does nothing if the build is stopped.
    fn build_chunk<'s>(
        &'s self,
        chunk: ChunkRows,
        (result, offer): (SharedResult, SharedOffer),
        scope: &Scope<'s>,
    ) {
        if self.is_stopped() {
            return;
        }
        let mut rows = lock(&self.spare).pop().unwrap_or_default();
        let extents = chunk.load(&self.context.rows, self.borders, &mut rows);
        let sorted = self.rows(&rows);
        let pending = self.context.build(&sorted, 0..sorted.len() as u32, self.task);
        let chunk = Chunk { counts: self.context.counts.beside(), extents, offer: None };
        self.spawn_finishing(rows, pending, Some(chunk), (result, &offer), scope);
        // Chunks that this starts are spawned last and thus taken first: nodes are finished by
        // threads that find no chunk to sample.
        self.sampling.fetch_sub(1, Ordering::SeqCst);
        self.drive(scope);
    }

    /// Samples a cell above chunks. Does nothing if the build is stopped.
    fn build_parent<'s>(
        &'s self,
        parent: &ParentCell,
        mut children: Vec<SampledCell>,
        scope: &Scope<'s>,
    ) {
        if self.is_stopped() {
            return;
        }
        for (i, child) in children.iter_mut().enumerate() {
            if let Below::Elsewhere { of, .. } = &mut child.pending.below {
                *of = i;
            }
        }
        let (rows, pending) = join(children, self.context.rows.bytes());
        let pending = self.context.combine(&self.rows(&rows), parent.cell, pending);
        let shared = (parent.result.clone(), &parent.offer);
        self.spawn_finishing(rows, pending, None, shared, scope);
    }

    /// Spawns a task for each node below a sampled cell, and publishes what the cell offers.
    fn spawn_finishing<'s>(
        &'s self,
        rows: Vec<u8>,
        mut pending: PendingCell,
        mut chunk: Option<Chunk>,
        (result, offer): (SharedResult, &SharedOffer),
        scope: &Scope<'s>,
    ) {
        let is_any = pending.has_below();
        let unfinished = Unfinished::below(&mut pending);
        let coincident =
            match std::mem::replace(&mut pending.below, Below::Elsewhere { of: 0, is_any }) {
                Below::Coincident(rest) => Some((pending.cell, rest)),
                _ => None,
            };
        let sampled = SampledCell::new(pending, &self.rows(&rows));
        if let Some(chunk) = chunk.as_mut().filter(|_| self.is_recorded) {
            chunk.offer = Some(sampled.record());
        }
        let job = Arc::new(FinishJob { rows, unfinished, coincident, chunk, result });
        for i in 0..job.unfinished.len() {
            let job = Arc::clone(&job);
            scope.spawn(move |scope| {
                let rows = self.rows(&job.rows);
                // The points of a cell above were reported with those of its chunks.
                let (counts, task): (_, &dyn Task) = match &job.chunk {
                    Some(chunk) => (&chunk.counts, self.task),
                    None => (&self.context.counts, &Silent),
                };
                job.unfinished.finish(i, self.context, &rows, counts, task);
                self.complete(job, scope);
            });
        }
        self.publish(offer, sampled, scope);
        self.complete(job, scope);
    }

    /// Drops a reference to a job. With the last one, all nodes are finished, and the result is
    /// left for the sequencer.
    fn complete<'s>(&'s self, job: Arc<FinishJob>, scope: &Scope<'s>) {
        let Some(job) = Arc::into_inner(job) else { return };
        let FinishJob { rows, unfinished, coincident, chunk, result } = job;
        let mut below = Children::default();
        let mut pages = Pages::new(0, chunk.is_some() && self.is_recorded);
        if let Some(Chunk { counts, .. }) = &chunk {
            self.task.advance(unfinished.other_points());
            if let Some((cell, rest)) = coincident {
                below = self.context.coincident_below(&self.rows(&rows), rest, cell, counts);
                pages.take(&mut below);
            }
        }
        // If a task has panicked, the scope does too.
        let Some((mut children, elsewhere)) = unfinished.into_children(&mut pages) else { return };
        children.extend(below.take());
        if chunk.is_some() && self.left.load(Ordering::SeqCst) > 0 {
            lock(&self.spare).push(rows);
        } else {
            drop(rows);
        }
        *lock(&result) = Some(FinishedStep { children, elsewhere, pages, chunk });
        self.drive(scope);
    }

    fn rows<'r>(&self, bytes: &'r [u8]) -> Rows<'r> {
        Rows { bytes, stride: self.context.rows.bytes() }
    }
}

impl Sequencer<'_> {
    /// Adds a finished step to the tree and gives its pages their places.
    fn place(&mut self, finished: FinishedStep, step: &StepInProgress, pipeline: &Pipeline<'_>) {
        let FinishedStep { mut children, elsewhere, pages, chunk } = finished;
        let tree = &mut *self.tree;
        if let Some(Chunk { counts, extents, offer }) = chunk {
            tree.begin_chunk(pipeline.is_recorded);
            tree.place_taken(&mut children, pages);
            tree.end_chunk(pipeline.context, (counts, step.rows), offer.as_ref(), &children);
            tree.outgoing.extents = extents;
        } else {
            tree.place_taken(&mut children, pages);
            let mut below = self.below.split_off(self.below.len() - step.child_count);
            for (child, of) in children.iter_mut().zip(elsewhere) {
                if let Some(below) = of.and_then(|of| below.get_mut(of)) {
                    child.last_mut().children.extend(below.take());
                }
            }
        }
        self.below.push(children);
    }
}

fn rows_of(buckets: &[Bucket]) -> u64 {
    buckets.iter().map(|bucket| bucket.rows).sum()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
