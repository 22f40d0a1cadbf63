//! Chunks that follow each other. Each is loaded, sorted and chosen from, then its nodes are finished, which any thread can
//! do in any order; then, in their order, chunks are put among what is built, cells above chosen from and pages written.
//! No step waits for another: whoever has done one spawns what follows from it.

use crate::borders::Borders;
use crate::built::{Built, Held};
use crate::counts::Counts;
use crate::error::BuildError;
use crate::finishing::Unfinished;
use crate::levels::{Raiser, Step};
use crate::memory::Peak;
use crate::partition::Bucket;
use crate::pending::{Below, Pending};
use crate::row::Rows;
use crate::scratch::Extent;
use crate::store::{Store, Stored};
use crate::tree::Context;
use esker_points::{Cell, Task};
use rayon::Scope;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Chunks under way, for each thread: one whose nodes are finished while one is chosen from, and one that waits for those
/// before it.
const CHUNKS_A_THREAD: usize = 3;

/// The cells above that wait for a chunk, and how many they are made of.
type Above = Vec<(Cell, usize)>;

/// Where a chunk is put once its nodes are finished.
type Slot = Arc<Mutex<Option<Finished>>>;

/// A chunk all of whose cells have chosen.
struct Chosen {
    rows: Vec<u8>,
    pending: Pending,
    unfinished: Unfinished,
    counts: Counts,
    extents: Vec<Extent>,
    slot: Slot,
}

/// A chunk all of whose nodes but the root are finished.
struct Finished {
    held: Held,
    counts: Counts,
    extents: Vec<Extent>,
}

/// A chunk under way.
struct UnderWay {
    rows: u64,
    above: Above,
    slot: Slot,
}

/// What is done in the order of chunks.
struct Front<'a> {
    steps: &'a mut Vec<Step>,
    store: &'a mut Store,
    built: &'a mut Built,
    /// Chunks under way, in order.
    under_way: VecDeque<UnderWay>,
    /// Rows of these, and of the one that waits to be written.
    rows: u64,
    /// Rows of the one that waits to be written.
    rows_outgoing: u64,
    /// What went wrong first; nothing is begun after it.
    fault: Option<BuildError>,
}

/// What all threads share.
struct Pipeline<'a> {
    context: &'a Context,
    task: &'a dyn Task,
    peak: &'a Peak,
    borders: Option<&'a Borders>,
    threads: usize,
    /// Rows at most of several chunks under way.
    rows_max: u64,
    front: Mutex<Front<'a>>,
    /// How often the front was asked to go on.
    asked: AtomicUsize,
    /// Chunks that are loaded or chosen from.
    choosing: AtomicUsize,
    /// Chunks that are not begun.
    left: AtomicUsize,
    /// Memory for rows that is in no use, while chunks are left.
    spare: Mutex<Vec<Vec<u8>>>,
}

impl Raiser<'_> {
    /// Builds chunks, and the cells above that wait for them, until another step is on top.
    ///
    /// # Errors
    /// Where scratch or the file fail, or on request.
    pub(crate) fn chunks(
        &mut self,
        steps: &mut Vec<Step>,
        built: &mut Built,
    ) -> Result<(), BuildError> {
        self.store.write(std::mem::take(&mut built.outgoing))?;
        let threads = rayon::current_num_threads();
        // Each thread has a node or a sample in hand, which takes about as much as the rows of a node in a chunk.
        let in_hand = (threads * self.context.capacity) as u64;
        let (joined_max, single_max) = self.chunk_rows_max;
        let rows_max = single_max.saturating_sub(in_hand);
        let borders = self.store.borders.take();
        let top = steps.iter().rev();
        let top = top.take_while(|step| matches!(step, Step::Chunk(_) | Step::Combine(..)));
        let left = top.filter(|step| matches!(step, Step::Chunk(_))).count();
        let pipeline = Pipeline {
            context: self.context,
            task: self.task,
            peak: self.peak,
            borders: borders.as_ref(),
            threads,
            // One at a time where memory has not even room for another.
            rows_max: if rows_max < joined_max { 0 } else { 2 * rows_max },
            front: Mutex::new(Front {
                steps,
                store: &mut *self.store,
                built,
                under_way: VecDeque::new(),
                rows: 0,
                rows_outgoing: 0,
                fault: None,
            }),
            asked: AtomicUsize::new(0),
            choosing: AtomicUsize::new(0),
            left: AtomicUsize::new(left),
            spare: Mutex::default(),
        };
        rayon::scope(|scope| pipeline.go_on(scope));
        let front = pipeline.front.into_inner().unwrap_or_else(PoisonError::into_inner);
        let (fault, is_left) = (front.fault, !front.under_way.is_empty());
        self.store.borders = borders;
        if let Some(fault) = fault {
            return Err(fault);
        }
        if is_left {
            self.task.check()?;
            return Err(BuildError::Proof("a chunk was not built".into()));
        }
        Ok(())
    }
}

impl<'a> Pipeline<'a> {
    /// Puts the chunks that are finished among what is built, and begins those for which there is room; or has it done
    /// by the thread that is at it.
    fn go_on<'s>(&'s self, scope: &Scope<'s>) {
        self.asked.fetch_add(1, Ordering::SeqCst);
        loop {
            let Ok(mut front) = self.front.try_lock() else { return };
            let asked = self.asked.load(Ordering::SeqCst);
            if front.fault.is_none() {
                front.fault = self.advance(&mut front, scope).err();
            }
            drop(front);
            // Who asked meanwhile has found it locked; by a write, which what was asked before comes before.
            if self.asked.fetch_add(0, Ordering::SeqCst) == asked {
                return;
            }
        }
    }

    fn advance<'s>(&'s self, front: &mut Front<'a>, scope: &Scope<'s>) -> Result<(), BuildError> {
        loop {
            self.begin(front, scope)?;
            let finished = front.under_way.front().and_then(|first| lock(&first.slot).take());
            let outgoing = std::mem::take(&mut front.built.outgoing);
            let rows_written = std::mem::take(&mut front.rows_outgoing);
            if let Some(finished) = finished
                && let Some(UnderWay { rows, above, .. }) = front.under_way.pop_front()
            {
                // On request its nodes were not finished.
                self.task.check()?;
                let is_told = front.store.journal.is_live();
                let put = || finished.put(self.context, front.built, (rows, above), is_told);
                let ((), is_written) = rayon::join(put, || front.store.write(outgoing));
                is_written?;
                front.rows_outgoing = rows;
                self.peak.sample();
            } else if rows_written > 0 {
                front.store.write(outgoing)?;
            } else {
                return Ok(());
            }
            front.rows -= rows_written;
        }
    }

    /// Begins chunks on top, while there is room for them.
    fn begin<'s>(&'s self, front: &mut Front<'a>, scope: &Scope<'s>) -> Result<(), BuildError> {
        let chunks_max = CHUNKS_A_THREAD * self.threads;
        while self.choosing.load(Ordering::SeqCst) < self.threads
            && front.under_way.len() < chunks_max
        {
            let before = front.rows;
            let has_room = |step: &mut Step| match step {
                Step::Chunk(buckets) => before == 0 || before + rows_of(buckets) <= self.rows_max,
                _ => false,
            };
            let Some(Step::Chunk(buckets)) = front.steps.pop_if(has_room) else { break };
            let mut above = Vec::new();
            while let Some(&Step::Combine(cell, children)) = front.steps.last() {
                front.steps.pop();
                above.push((cell, children));
            }
            let (rows, slot) = (rows_of(&buckets), Slot::default());
            let stored = front.store.stored(buckets, &self.context.rows, self.borders.is_some())?;
            front.rows += rows;
            front.under_way.push_back(UnderWay { rows, above, slot: slot.clone() });
            self.left.fetch_sub(1, Ordering::SeqCst);
            self.choosing.fetch_add(1, Ordering::SeqCst);
            scope.spawn(move |scope| self.choose(stored, slot, scope));
        }
        Ok(())
    }

    /// Loads and sorts a chunk, and chooses what each of its cells offers. On request it is left as it is.
    fn choose<'s>(&'s self, stored: Stored, slot: Slot, scope: &Scope<'s>) {
        if self.task.is_cancelled() {
            return;
        }
        let mut rows = lock(&self.spare).pop().unwrap_or_default();
        let extents = stored.load(&self.context.rows, self.borders, &mut rows);
        let sorted = self.rows(&rows);
        let mut pending = self.context.build(&sorted, 0..sorted.len() as u32, self.task);
        let unfinished = Unfinished::below(&mut pending);
        let counts = self.context.counts.beside();
        let chosen = Arc::new(Chosen { rows, pending, unfinished, counts, extents, slot });
        for i in 0..chosen.unfinished.len() {
            let chosen = Arc::clone(&chosen);
            scope.spawn(move |scope| {
                let Chosen { rows, unfinished, counts, .. } = &*chosen;
                unfinished.finish(i, self.context, &self.rows(rows), counts, self.task);
                self.let_go(chosen, scope);
            });
        }
        self.let_go(chosen, scope);
        // Spawned last, what this begins is taken up first: nodes are finished where nothing waits to be chosen from.
        self.choosing.fetch_sub(1, Ordering::SeqCst);
        self.go_on(scope);
    }

    /// Lets go of a chunk; whoever is the last to do so has finished it.
    fn let_go<'s>(&'s self, chosen: Arc<Chosen>, scope: &Scope<'s>) {
        let Some(chosen) = Arc::into_inner(chosen) else { return };
        let Chosen { rows, mut pending, unfinished, counts, extents, slot } = chosen;
        let sorted = self.rows(&rows);
        self.task.advance(unfinished.others());
        let mut children = self.context.nodes_below(&sorted, &mut pending, &counts);
        // Where one has panicked, the scope does, too.
        let Some(mut others) = unfinished.into_children() else { return };
        children.extend(others.take());
        pending.below = Below::Finished(children);
        let held = Held::new(pending, &sorted);
        if self.left.load(Ordering::SeqCst) > 0 {
            lock(&self.spare).push(rows);
        } else {
            drop(rows);
        }
        *lock(&slot) = Some(Finished { held, counts, extents });
        self.go_on(scope);
    }

    fn rows<'r>(&self, bytes: &'r [u8]) -> Rows<'r> {
        Rows { bytes, stride: self.context.rows.bytes() }
    }
}

impl Finished {
    /// Puts the chunk among what is built, and joins the cells above that waited for it.
    fn put(self, context: &Context, built: &mut Built, (rows, above): (u64, Above), is_told: bool) {
        built.begin(is_told);
        built.hold(self.held);
        built.end(context, self.counts, rows);
        built.outgoing.extents = self.extents;
        for (cell, children) in above {
            built.combine(context, cell, children);
        }
    }
}

fn rows_of(buckets: &[Bucket]) -> u64 {
    buckets.iter().map(|bucket| bucket.rows).sum()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
