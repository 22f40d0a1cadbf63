//! Chunks that follow each other, in rounds: while the nodes of some are finished, which any cores can share, those
//! before are written, and those behind are loaded, sorted, and chosen from, where a cell waits for those in it.

use crate::built::{Built, Held};
use crate::counts::Counts;
use crate::error::BuildError;
use crate::finishing::Unfinished;
use crate::levels::{Raiser, Step};
use crate::memory::Peak;
use crate::pending::{Below, Pending};
use crate::row::Rows;
use crate::scratch::Extent;
use crate::store::{Store, Stored};
use crate::tree::Context;
use esker_points::Cell;
use rayon::Scope;
use std::thread;

/// The cells above that wait for a chunk, and how many they are made of.
type Above = Vec<(Cell, usize)>;

/// A chunk all of whose cells have chosen.
struct Chosen {
    rows: Vec<u8>,
    extents: Vec<Extent>,
    pending: Pending,
    above: Above,
}

/// A chunk all of whose nodes but the root are finished.
struct Finished {
    held: Held,
    counts: Counts,
    rows: u64,
    extents: Vec<Extent>,
    above: Above,
}

impl Raiser<'_> {
    /// Builds chunks, and the cells above that wait for them, until another step is on top.
    pub(crate) fn chunks(
        &mut self,
        steps: &mut Vec<Step>,
        built: &mut Built,
    ) -> Result<(), BuildError> {
        let (context, task, peak) = (self.context, self.task, self.peak);
        let stride = context.rows.bytes();
        self.store.write(std::mem::take(&mut built.outgoing))?;
        let (mut chosen, mut finished) = (Vec::<Chosen>::new(), Vec::<Finished>::new());
        let mut spare: Vec<Vec<u8>> = Vec::new();
        loop {
            let behind = self.round(steps, !chosen.is_empty())?;
            if behind.is_empty() && chosen.is_empty() && finished.is_empty() {
                return Ok(());
            }
            let borders = self.store.borders.take();
            let load = |stored: Stored, mut rows: Vec<u8>, above| {
                let extents = stored.load(&context.rows, borders.as_ref(), &mut rows);
                let sorted = Rows { bytes: &rows, stride };
                let pending = context.build(&sorted, 0..sorted.len() as u32, task);
                Chosen { rows, extents, pending, above }
            };
            let mut loaded = Vec::new();
            loaded.resize_with(behind.len(), || None);
            let work = |chunk: &mut Chosen| {
                (Unfinished::below(&mut chunk.pending), context.counts.beside())
            };
            let works: Vec<_> = chosen.iter_mut().map(work).collect();
            let mut is_written = Ok(());
            let is_spawned = rayon::scope(|scope| {
                let store = &mut *self.store;
                let put = |_: &Scope<'_>| is_written = put(finished, context, store, built, peak);
                spawn_last(scope, |scope| {
                    scope.spawn(put);
                    for ((stored, above), slot) in behind.into_iter().zip(&mut loaded) {
                        let (rows, load) = (spare.pop().unwrap_or_default(), &load);
                        scope.spawn(move |_| *slot = Some(load(stored, rows, above)));
                    }
                    for (chunk, (unfinished, counts)) in chosen.iter().zip(&works) {
                        let rows = Rows { bytes: &chunk.rows, stride };
                        for i in 0..unfinished.len() {
                            let finish = move |_: &Scope<'_>| {
                                unfinished.finish(i, context, &rows, counts, task)
                            };
                            scope.spawn(finish);
                        }
                    }
                })
            });
            self.store.borders = borders;
            peak.sample();
            is_spawned?;
            is_written?;
            task.check()?;
            finished = Vec::with_capacity(chosen.len());
            for (chunk, (unfinished, counts)) in chosen.into_iter().zip(works) {
                task.advance(unfinished.others());
                let Chosen { rows, extents, mut pending, above } = chunk;
                let sorted = Rows { bytes: &rows, stride };
                let mut children = context.nodes_below(&sorted, &mut pending, &counts);
                children.extend(unfinished.into_children().take());
                pending.below = Below::Finished(children);
                let held = Held::new(pending, &sorted);
                finished.push(Finished { held, counts, rows: sorted.len() as u64, extents, above });
                spare.push(rows);
            }
            chosen = loaded.into_iter().flatten().collect();
        }
    }

    /// The next chunks on top: as many as there are threads, while memory has room for them; none beside others
    /// whose nodes are finished where it has not even room for one.
    fn round(
        &mut self,
        steps: &mut Vec<Step>,
        is_beside: bool,
    ) -> Result<Vec<(Stored, Above)>, BuildError> {
        let (mut round, mut rows) = (Vec::new(), 0);
        // Each thread has a node or a sample in hand, which takes about as much as the rows of a node in a chunk.
        let threads = rayon::current_num_threads();
        let in_hand = (threads * self.context.capacity) as u64;
        let (joined_max, single_max) = self.chunk_rows_max;
        let rows_max = single_max.saturating_sub(in_hand);
        if is_beside && rows_max < joined_max {
            return Ok(round);
        }
        while round.len() < threads
            && let Some(step) = steps.pop_if(|step| match step {
                Step::Chunk(buckets) => {
                    rows += buckets.iter().map(|b| b.rows).sum::<u64>();
                    round.is_empty() || rows <= rows_max
                }
                _ => false,
            })
        {
            let Step::Chunk(buckets) = step else { continue };
            let mut above = Vec::new();
            while let Some(&Step::Combine(cell, children)) = steps.last() {
                steps.pop();
                above.push((cell, children));
            }
            round.push((self.store.stored(buckets, &self.context.rows)?, above));
        }
        Ok(round)
    }
}

/// Spawns what the pool's threads take last, in this order: what a thread of the pool spawns stands in its own queue, what
/// another spawns in the pool's, which they look at where no thread has anything to share. So nodes are finished where
/// nothing waits to be chosen from.
///
/// # Errors
/// Where the system has no thread to give; then nothing is spawned.
fn spawn_last<'s>(
    scope: &Scope<'s>,
    spawn: impl FnOnce(&Scope<'s>) + Send,
) -> Result<(), BuildError> {
    thread::scope(|threads| {
        let spawning = thread::Builder::new().spawn_scoped(threads, || spawn(scope));
        spawning.map(drop).map_err(BuildError::no_thread)
    })
}

/// Puts chunks among what is built, and writes each while the cells above the next are chosen from.
fn put(
    chunks: Vec<Finished>,
    context: &Context,
    store: &mut Store,
    built: &mut Built,
    peak: &Peak,
) -> Result<(), BuildError> {
    let is_told = store.journal.is_live();
    for chunk in chunks {
        let before = std::mem::take(&mut built.outgoing);
        let put = || chunk.put(context, built, is_told);
        let ((), is_written) = rayon::join(put, || store.write(before));
        is_written?;
        peak.sample();
    }
    store.write(std::mem::take(&mut built.outgoing))
}

impl Finished {
    /// Puts the chunk among what is built, and joins the cells above that waited for it.
    fn put(self, context: &Context, built: &mut Built, is_told: bool) {
        built.begin(is_told);
        built.hold(self.held);
        built.end(context, self.counts, self.rows);
        built.outgoing.extents = self.extents;
        for (cell, children) in self.above {
            built.combine(context, cell, children);
        }
    }
}
