//! The blocks of a file that are in memory or on their way, and which are forgotten when there are
//! too many.

use crate::fetch::Fault;
use bytes::Bytes;
use std::collections::HashMap;
use std::ops::Range;

/// Bytes of a block, but for the last one of a file: few, since planes begin and end anywhere, and
/// what is fetched beside them takes as long as they do.
pub const BLOCK: u64 = 16 << 10;
/// Blocks between two that are wanted which are fetched along, 64 KiB: fewer bytes than a line has
/// on its way in the time of another request.
const GAP: u64 = 4;

/// A block.
#[derive(Clone, Debug)]
enum State {
    /// It is being fetched.
    Coming,
    /// Its bytes, and when they were used last.
    Here(Bytes, u64),
    /// Why it could not be fetched.
    Failed(Fault),
}

/// What a reader gets of a block.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// It is neither here nor on its way.
    Absent,
    /// It is being fetched.
    Coming,
    /// Its bytes.
    Here(Bytes),
    /// Why it could not be fetched; it is absent then.
    Failed(Fault),
}

/// Blocks by their numbers.
#[derive(Debug)]
pub struct Blocks {
    states: HashMap<u64, State>,
    /// Number of blocks with bytes.
    here: usize,
    clock: u64,
}

impl Blocks {
    /// No blocks.
    pub fn new() -> Self {
        Self { states: HashMap::new(), here: 0, clock: 0 }
    }

    /// Number of blocks with bytes.
    pub fn count(&self) -> u64 {
        self.here as u64
    }

    /// What there is of a block. A failed one can be requested again.
    pub fn take(&mut self, number: u64) -> Block {
        self.clock += 1;
        match self.states.get_mut(&number) {
            None => Block::Absent,
            Some(State::Coming) => Block::Coming,
            Some(State::Here(bytes, used)) => {
                *used = self.clock;
                Block::Here(bytes.clone())
            }
            Some(State::Failed(why)) => {
                let why = why.clone();
                self.states.remove(&number);
                Block::Failed(why)
            }
        }
    }

    /// Marks the absent and failed ones of some blocks, in rising order, as coming, and returns
    /// runs of them to fetch: of at most `most` blocks, over gaps of at most [`GAP`].
    pub fn request(&mut self, numbers: impl Iterator<Item = u64>, most: u64) -> Vec<Range<u64>> {
        let mut runs: Vec<Range<u64>> = Vec::new();
        for number in numbers {
            if matches!(self.states.get(&number), Some(State::Coming | State::Here(..))) {
                continue;
            }
            self.states.insert(number, State::Coming);
            match runs.last_mut() {
                Some(run) if number <= run.end + GAP && number - run.start < most => {
                    // The blocks between them come along.
                    for between in run.end..number {
                        self.states.entry(between).or_insert(State::Coming);
                    }
                    run.end = number + 1;
                }
                _ => runs.push(number..number + 1),
            }
        }
        runs
    }

    /// Takes the bytes of a block that was coming, and forgets those that were not used for longest
    /// where there are more than about `most_bytes`.
    pub fn put(&mut self, number: u64, bytes: Bytes, most_bytes: u64) {
        let most = usize::try_from(most_bytes / BLOCK).unwrap_or(usize::MAX).max(1);
        self.clock += 1;
        let before = self.states.insert(number, State::Here(bytes, self.clock));
        self.here += usize::from(!matches!(before, Some(State::Here(..))));
        if self.here <= most {
            return;
        }
        // An eighth at a time, so that few searches are made.
        let mut used: Vec<(u64, u64)> = Vec::with_capacity(self.here);
        used.extend(self.states.iter().filter_map(|(number, state)| match state {
            State::Here(_, used) => Some((*used, *number)),
            _ => None,
        }));
        let leave = (self.here - most).max(most / 8);
        let leave = leave.min(used.len().saturating_sub(1));
        used.sort_unstable();
        for (_, number) in &used[..leave] {
            self.states.remove(number);
            self.here -= 1;
        }
    }

    /// Notes why a block that was coming could not be fetched.
    pub fn fail(&mut self, number: u64, why: &Fault) {
        if let Some(state @ State::Coming) = self.states.get_mut(&number) {
            *state = State::Failed(why.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gone() -> Fault {
        Fault::Passing("gone".into())
    }

    fn bytes() -> Bytes {
        Bytes::from_static(&[7])
    }

    #[test]
    fn runs_join_neighbours_and_pass_over_small_gaps_and_no_block_is_requested_twice() {
        let mut blocks = Blocks::new();
        assert_eq!(blocks.request([1, 2, 4, 9, 15, 16].into_iter(), 64), [1..10, 15..17]);
        assert_eq!(blocks.take(3), Block::Coming, "it comes along");
        assert_eq!(blocks.request([0, 1, 10].into_iter(), 64), [0..1, 10..11]);
        assert_eq!(blocks.request(20..30, 4), [20..24, 24..28, 28..30]);
        blocks.put(0, bytes(), 100 * BLOCK);
        assert_eq!(blocks.take(0), Block::Here(bytes()));
        blocks.fail(1, &gone());
        assert_eq!(blocks.take(1), Block::Failed(gone()));
        assert_eq!(blocks.take(1), Block::Absent, "it may be tried again");
        blocks.fail(2, &gone());
        let again = blocks.request([2, 3].into_iter(), 64);
        assert_eq!((again.len(), again[0].clone()), (1, 2..3), "one that nobody waited for too");
        // What is here already stays although a run over it fails.
        blocks.fail(0, &gone());
        assert_eq!(blocks.take(0), Block::Here(bytes()));
    }

    #[test]
    fn the_blocks_that_were_used_last_stay() {
        let mut blocks = Blocks::new();
        for number in 0..1000 {
            blocks.request(std::iter::once(number), 1);
            blocks.put(number, bytes(), 16 * BLOCK);
            assert_eq!(blocks.take(0), Block::Here(bytes()), "{number}");
            assert!(blocks.here <= 16 && blocks.states.len() <= 16);
            assert_eq!(blocks.take(number), Block::Here(bytes()));
        }
        let mut one = Blocks::new();
        for number in 0..3 {
            one.put(number, bytes(), 1);
            assert_eq!(one.take(number), Block::Here(bytes()));
        }
        assert_eq!(one.count(), 1);
    }
}
