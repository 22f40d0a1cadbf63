//! Chunks that follow each other, and the cells above them. A chunk is loaded, sorted and chosen
//! from; a cell above is chosen from as soon as those that it is made of have been. Then the nodes
//! below each are finished, which any thread can do in any order. Only at last what is built of
//! each is put in its place, in the order of steps, and written. No step waits for another: whoever
//! has done one spawns what follows from it.

use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::page::histograms::Counts;
use crate::rows::borders::Borders;
use crate::rows::journal_record::Record;
use crate::rows::partition::Bucket;
use crate::rows::row::Rows;
use crate::rows::scratch::Extent;
use crate::rows::store::{Store, Stored};
use crate::sample::cell::Context;
use crate::sample::pending::{Below, PendingCell};
use crate::tree::finishing::Unfinished;
use crate::tree::levels::{Raiser, Step};
use crate::tree::subtree::Children;
use crate::tree::waiting::{Built, Held, Pages, join};
use esker_points::task::Silent;
use esker_points::{Cell, Task};
use rayon::Scope;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Chunks under way, for each thread: one whose nodes are finished while one is chosen from, and
/// one that waits for those before it.
const CHUNKS_A_THREAD: usize = 3;

/// Where a chunk or a cell above is put once its nodes are finished.
type Slot = Arc<Mutex<Option<Finished>>>;

/// What a cell offers, on its way to the one above.
#[derive(Default)]
enum Offer {
    /// It has not chosen yet, nor does any wait for it; or it has been handed over.
    #[default]
    Open,
    /// It has chosen, and none waits for it yet.
    Made(Box<Held>),
    /// The cell above waits for it, of which it is the first, second or so.
    Wanted(Arc<Above>, usize),
}

/// Where a cell's offer is left, or who waits for it told.
type Desk = Arc<Mutex<Offer>>;

/// A cell above, which waits for offers.
struct Above {
    cell: Cell,
    offers: Mutex<Vec<Option<Held>>>,
    desk: Desk,
    slot: Slot,
}

/// A chunk or a cell above that has chosen; so have all cells below it.
struct Chosen {
    rows: Vec<u8>,
    unfinished: Unfinished,
    /// What coincides with what it offers.
    coincident: Option<(Cell, Range<u32>)>,
    /// Of a chunk.
    chunk: Option<Chunk>,
    slot: Slot,
}

/// What only chunks have.
struct Chunk {
    counts: Counts,
    extents: Vec<Extent>,
    /// What it offers, where the journal wants to know.
    offer: Option<Record>,
}

/// A chunk or a cell above all of whose nodes but the root are finished.
struct Finished {
    children: Children,
    /// Of each child, where what is below it was finished by itself: of which cell.
    elsewhere: Vec<Option<usize>>,
    pages: Pages,
    chunk: Option<Chunk>,
}

/// A chunk or a cell above under way.
struct UnderWay {
    /// Of a chunk.
    rows: u64,
    /// How many of those before it a cell above is made of.
    made_of: usize,
    slot: Slot,
}

/// What is done in the order of steps.
struct Front<'a> {
    steps: &'a mut Vec<Step>,
    store: &'a mut Store,
    built: &'a mut Built,
    /// What is under way, in order.
    under_way: VecDeque<UnderWay>,
    /// How many chunks that are, and their rows.
    chunks: usize,
    rows: u64,
    /// Where the offers are of cells that are under way, or built, and that no cell above is made
    /// of yet.
    open: Vec<Desk>,
    /// The nodes below each cell that is built and that none above is made of yet.
    below: Vec<Children>,
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
    /// Whether the journal wants to know of chunks.
    is_told: bool,
    front: Mutex<Front<'a>>,
    /// Whether something went wrong.
    is_faulty: AtomicBool,
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
        // Each thread has a node or a sample in hand, which takes about as much as the rows of a
        // node in a chunk.
        let in_hand = (threads * self.context.capacity) as u64;
        let (joined_max, single_max) = self.chunk_rows_max;
        let rows_max = single_max.saturating_sub(in_hand);
        let borders = self.store.borders.take();
        let top = steps.iter().rev();
        let top = top.take_while(|step| matches!(step, Step::Chunk(_) | Step::Combine(..)));
        let left = top.filter(|step| matches!(step, Step::Chunk(_))).count();
        let (mut open, mut below) = (Vec::new(), Vec::new());
        for mut held in built.held.drain(..) {
            below.push(held.pending.below.put_elsewhere());
            open.push(Arc::new(Mutex::new(Offer::Made(Box::new(held)))));
        }
        let pipeline = Pipeline {
            context: self.context,
            task: self.task,
            peak: self.peak,
            borders: borders.as_ref(),
            threads,
            // One at a time where memory has not even room for another.
            rows_max: if rows_max < joined_max { 0 } else { 2 * rows_max },
            is_told: self.store.journal.is_live(),
            front: Mutex::new(Front {
                steps,
                store: &mut *self.store,
                built: &mut *built,
                under_way: VecDeque::new(),
                chunks: 0,
                rows: 0,
                open,
                below,
                fault: None,
            }),
            is_faulty: AtomicBool::new(false),
            asked: AtomicUsize::new(0),
            choosing: AtomicUsize::new(0),
            left: AtomicUsize::new(left),
            spare: Mutex::default(),
        };
        rayon::scope(|scope| pipeline.go_on(scope));
        let front = pipeline.front.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Front { under_way, open, below, fault, .. } = front;
        self.store.borders = borders;
        if let Some(fault) = fault {
            return Err(fault);
        }
        for (desk, children) in open.iter().zip(below) {
            let Offer::Made(mut held) = std::mem::take(&mut *lock(desk)) else { break };
            held.pending.below = Below::Finished(children);
            built.held.push(*held);
        }
        if !under_way.is_empty() || built.held.len() < open.len() {
            self.task.check()?;
            return Err(BuildError::Proof("a chunk was not built".into()));
        }
        Ok(())
    }
}

impl<'a> Pipeline<'a> {
    /// Puts the chunks that are finished among what is built, and begins those for which there is
    /// room; or has it done by the thread that is at it.
    fn go_on<'s>(&'s self, scope: &Scope<'s>) {
        self.asked.fetch_add(1, Ordering::SeqCst);
        loop {
            let Ok(mut front) = self.front.try_lock() else { return };
            let asked = self.asked.load(Ordering::SeqCst);
            if front.fault.is_none() {
                front.fault = self.advance(&mut front, scope).err();
                self.is_faulty.fetch_or(front.fault.is_some(), Ordering::Relaxed);
            }
            drop(front);
            // Who asked meanwhile has found it locked; by a write, which what was asked before
            // comes before.
            if self.asked.fetch_add(0, Ordering::SeqCst) == asked {
                return;
            }
        }
    }

    fn advance<'s>(&'s self, front: &mut Front<'a>, scope: &Scope<'s>) -> Result<(), BuildError> {
        loop {
            self.begin(front, scope)?;
            let finished = front.under_way.front().and_then(|first| lock(&first.slot).take());
            let Some(finished) = finished else { return Ok(()) };
            let Some(UnderWay { rows, made_of, .. }) = front.under_way.pop_front() else {
                return Ok(());
            };
            // On request its nodes were not finished.
            self.task.check()?;
            front.chunks -= usize::from(finished.chunk.is_some());
            front.put(finished, (rows, made_of), self);
            front.store.write(std::mem::take(&mut front.built.outgoing))?;
            front.rows -= rows;
            self.peak.sample();
        }
    }

    /// Begins chunks on top, while there is room for them, and has the cells above them wait.
    fn begin<'s>(&'s self, front: &mut Front<'a>, scope: &Scope<'s>) -> Result<(), BuildError> {
        let chunks_max = CHUNKS_A_THREAD * self.threads;
        while self.choosing.load(Ordering::SeqCst) < self.threads && front.chunks < chunks_max {
            let before = front.rows;
            let has_room = |step: &mut Step| match step {
                Step::Chunk(buckets) => before == 0 || before + rows_of(buckets) <= self.rows_max,
                _ => false,
            };
            let Some(Step::Chunk(buckets)) = front.steps.pop_if(has_room) else { break };
            let (rows, slot, desk) = (rows_of(&buckets), Slot::default(), Desk::default());
            let stored = front.store.stored(buckets, &self.context.rows, self.borders.is_some())?;
            front.chunks += 1;
            front.rows += rows;
            front.under_way.push_back(UnderWay { rows, made_of: 0, slot: slot.clone() });
            front.open.push(desk.clone());
            while let Some(&Step::Combine(cell, made_of)) = front.steps.last() {
                front.steps.pop();
                self.wait_above(front, (cell, made_of), scope);
            }
            self.left.fetch_sub(1, Ordering::SeqCst);
            self.choosing.fetch_add(1, Ordering::SeqCst);
            scope.spawn(move |scope| self.choose(stored, (slot, desk), scope));
        }
        Ok(())
    }

    /// Has a cell wait for the offers of the last so many cells.
    fn wait_above<'s>(
        &'s self,
        front: &mut Front<'a>,
        (cell, made_of): (Cell, usize),
        scope: &Scope<'s>,
    ) {
        let (slot, desk) = (Slot::default(), Desk::default());
        front.under_way.push_back(UnderWay { rows: 0, made_of, slot: slot.clone() });
        let offers = Mutex::new((0..made_of).map(|_| None).collect());
        let above = Arc::new(Above { cell, offers, desk: desk.clone(), slot });
        for (i, below) in front.open.split_off(front.open.len() - made_of).into_iter().enumerate() {
            let wanted = Offer::Wanted(Arc::clone(&above), i);
            if let Offer::Made(held) = std::mem::replace(&mut *lock(&below), wanted) {
                self.bring(&above, i, *held, scope);
            }
        }
        front.open.push(desk);
    }

    /// A cell has chosen what it offers.
    fn offer<'s>(&'s self, desk: &Desk, held: Held, scope: &Scope<'s>) {
        let mut offer = lock(desk);
        match std::mem::take(&mut *offer) {
            Offer::Wanted(above, i) => self.bring(&above, i, held, scope),
            _ => *offer = Offer::Made(Box::new(held)),
        }
    }

    /// Brings an offer to a cell above; the last one has it chosen from.
    fn bring<'s>(&'s self, above: &Arc<Above>, i: usize, held: Held, scope: &Scope<'s>) {
        let mut offers = lock(&above.offers);
        offers[i] = Some(held);
        if offers.iter().all(Option::is_some) {
            let cells = std::mem::take(&mut *offers).into_iter().flatten().collect();
            let above = Arc::clone(above);
            scope.spawn(move |scope| self.combine(&above, cells, scope));
        }
    }

    /// Whether nothing more is to be begun.
    fn is_ended(&self) -> bool {
        self.is_faulty.load(Ordering::Relaxed) || self.task.is_cancelled()
    }

    /// Loads and sorts a chunk, and chooses what each of its cells offers. On request, or after a
    /// fault, it is left as it is.
    fn choose<'s>(&'s self, stored: Stored, (slot, desk): (Slot, Desk), scope: &Scope<'s>) {
        if self.is_ended() {
            return;
        }
        let mut rows = lock(&self.spare).pop().unwrap_or_default();
        let extents = stored.load(&self.context.rows, self.borders, &mut rows);
        let sorted = self.rows(&rows);
        let pending = self.context.build(&sorted, 0..sorted.len() as u32, self.task);
        let chunk = Chunk { counts: self.context.counts.beside(), extents, offer: None };
        self.finish(rows, pending, Some(chunk), (slot, &desk), scope);
        // Spawned last, what this begins is taken up first: nodes are finished where nothing waits
        // to be chosen from.
        self.choosing.fetch_sub(1, Ordering::SeqCst);
        self.go_on(scope);
    }

    /// Chooses what a cell above offers. On request, or after a fault, it is left as it is.
    fn combine<'s>(&'s self, above: &Above, mut cells: Vec<Held>, scope: &Scope<'s>) {
        if self.is_ended() {
            return;
        }
        for (i, held) in cells.iter_mut().enumerate() {
            if let Below::Elsewhere { of, .. } = &mut held.pending.below {
                *of = i;
            }
        }
        let (rows, pending) = join(cells, self.context.rows.bytes());
        let pending = self.context.combine(&self.rows(&rows), above.cell, pending);
        self.finish(rows, pending, None, (above.slot.clone(), &above.desk), scope);
    }

    /// Has the nodes below a cell that has chosen finished, and leaves what it offers.
    fn finish<'s>(
        &'s self,
        rows: Vec<u8>,
        mut pending: PendingCell,
        mut chunk: Option<Chunk>,
        (slot, desk): (Slot, &Desk),
        scope: &Scope<'s>,
    ) {
        let is_any = pending.has_below();
        let unfinished = Unfinished::below(&mut pending);
        let coincident =
            match std::mem::replace(&mut pending.below, Below::Elsewhere { of: 0, is_any }) {
                Below::Coincident(rest) => Some((pending.cell, rest)),
                _ => None,
            };
        let held = Held::new(pending, &self.rows(&rows));
        if let Some(chunk) = chunk.as_mut().filter(|_| self.is_told) {
            chunk.offer = Some(held.offer());
        }
        let chosen = Arc::new(Chosen { rows, unfinished, coincident, chunk, slot });
        for i in 0..chosen.unfinished.len() {
            let chosen = Arc::clone(&chosen);
            scope.spawn(move |scope| {
                let rows = self.rows(&chosen.rows);
                // The points of cells above have been told of.
                let (counts, task): (_, &dyn Task) = match &chosen.chunk {
                    Some(chunk) => (&chunk.counts, self.task),
                    None => (&self.context.counts, &Silent),
                };
                chosen.unfinished.finish(i, self.context, &rows, counts, task);
                self.let_go(chosen, scope);
            });
        }
        self.offer(desk, held, scope);
        self.let_go(chosen, scope);
    }

    /// Lets go of a cell; whoever is the last to do so has finished all below it.
    fn let_go<'s>(&'s self, chosen: Arc<Chosen>, scope: &Scope<'s>) {
        let Some(chosen) = Arc::into_inner(chosen) else { return };
        let Chosen { rows, unfinished, coincident, chunk, slot } = chosen;
        let mut below = Children::default();
        if let Some(Chunk { counts, .. }) = &chunk {
            self.task.advance(unfinished.others());
            if let Some((cell, rest)) = coincident {
                below = self.context.coincident_below(&self.rows(&rows), rest, cell, counts);
            }
        }
        // Where one has panicked, the scope does, too.
        let Some((mut children, elsewhere)) = unfinished.into_children() else { return };
        children.extend(below.take());
        if chunk.is_some() && self.left.load(Ordering::SeqCst) > 0 {
            lock(&self.spare).push(rows);
        } else {
            drop(rows);
        }
        let pages = Pages::take(&mut children, 0, chunk.is_some() && self.is_told);
        *lock(&slot) = Some(Finished { children, elsewhere, pages, chunk });
        self.go_on(scope);
    }

    fn rows<'r>(&self, bytes: &'r [u8]) -> Rows<'r> {
        Rows { bytes, stride: self.context.rows.bytes() }
    }
}

impl Front<'_> {
    /// Puts what is finished in its place: a chunk of so many rows, or a cell made of so many
    /// before it.
    fn put(&mut self, finished: Finished, (rows, made_of): (u64, usize), pipeline: &Pipeline<'_>) {
        let Finished { mut children, elsewhere, pages, chunk } = finished;
        let built = &mut *self.built;
        if let Some(Chunk { counts, extents, offer }) = chunk {
            built.begin(pipeline.is_told);
            built.place_taken(&mut children, pages);
            built.end(pipeline.context, (counts, rows), offer.as_ref(), &children);
            built.outgoing.extents = extents;
        } else {
            built.place_taken(&mut children, pages);
            let mut below = self.below.split_off(self.below.len() - made_of);
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
