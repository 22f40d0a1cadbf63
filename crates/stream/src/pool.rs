//! Allocator of slots in drawing memory: best fit over the holes, which join again when slots are
//! freed. No slot crosses a page boundary, none overlaps another, and the sum of their lengths,
//! rounded up to [`Slot::ALIGNMENT`], never exceeds the budget.

use crate::landing::Slot;
use std::collections::{BTreeMap, BTreeSet};

/// Free and used bytes of the budget.
#[derive(Debug)]
pub(crate) struct Pool {
    bytes: u64,
    page_bytes: u64,
    /// Offset from which pages were never used: holes of used pages are tried first.
    untouched: u64,
    /// Holes: length by offset.
    holes: BTreeMap<u64, u64>,
    /// The same holes as (length, offset).
    by_length: BTreeSet<(u64, u64)>,
    used: u64,
    peak: u64,
}

impl Pool {
    /// An empty pool. Sizes are rounded down to multiples of [`Slot::ALIGNMENT`].
    pub(crate) fn new(bytes: u64, page_bytes: u64) -> Self {
        let whole = |b: u64| b - b % Slot::ALIGNMENT;
        Self {
            bytes: whole(bytes),
            page_bytes: whole(page_bytes).max(Slot::ALIGNMENT),
            untouched: 0,
            holes: BTreeMap::new(),
            by_length: BTreeSet::new(),
            used: 0,
            peak: 0,
        }
    }

    /// Bytes that a slot for `bytes` takes.
    pub(crate) fn taken(bytes: u64) -> u64 {
        bytes.max(1).checked_next_multiple_of(Slot::ALIGNMENT).unwrap_or(u64::MAX)
    }

    /// Bytes in use.
    pub(crate) fn used(&self) -> u64 {
        self.used
    }

    /// Greatest number of bytes in use at once.
    pub(crate) fn peak(&self) -> u64 {
        self.peak
    }

    /// Allocates a slot; `None` if no hole is long enough.
    pub(crate) fn take(&mut self, bytes: u64) -> Option<Slot> {
        let taken = Self::taken(bytes);
        let found = self.by_length.range((taken, 0)..).next().copied();
        let (length, offset) = match found {
            Some(hole) => hole,
            None => self.open_page(taken)?,
        };
        self.remove(offset, length);
        self.insert(offset + taken, length - taken);
        self.used += taken;
        self.peak = self.peak.max(self.used);
        Some(Slot { offset, bytes })
    }

    /// Frees a slot of [`Pool::take`].
    pub(crate) fn give(&mut self, slot: Slot) {
        let taken = Self::taken(slot.bytes);
        self.used -= taken;
        let (mut start, mut end) = (slot.offset, slot.offset + taken);
        if let Some((&offset, &length)) = self.holes.range(..start).next_back()
            && offset + length == start
            && !start.is_multiple_of(self.page_bytes)
        {
            self.remove(offset, length);
            start = offset;
        }
        if let Some(&length) = self.holes.get(&end)
            && !end.is_multiple_of(self.page_bytes)
        {
            self.remove(end, length);
            end += length;
        }
        self.insert(start, end - start);
    }

    /// Makes a hole of the next page that was never used, if a slot fits it. Returns length and
    /// offset.
    fn open_page(&mut self, taken: u64) -> Option<(u64, u64)> {
        let length = self.page_bytes.min(self.bytes - self.untouched);
        (taken <= length).then(|| {
            let offset = self.untouched;
            self.untouched += length;
            self.insert(offset, length);
            (length, offset)
        })
    }

    fn insert(&mut self, offset: u64, length: u64) {
        if length > 0 {
            self.holes.insert(offset, length);
            self.by_length.insert((length, offset));
        }
    }

    fn remove(&mut self, offset: u64, length: u64) {
        self.holes.remove(&offset);
        self.by_length.remove(&(length, offset));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_emptied_pool_gives_whole_pages_again() {
        let mut pool = Pool::new(4096, 1024);
        let slots: Vec<_> = (0..16).map(|_| pool.take(200).expect("there is room")).collect();
        assert_eq!(pool.take(1), None);
        slots.into_iter().rev().for_each(|s| pool.give(s));
        assert_eq!((pool.used(), pool.peak()), (0, 4096));
        assert_eq!(pool.take(1025), None, "longer than a page");
        assert!((0..4).all(|_| pool.take(1024).is_some()));
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let mut pool = Pool::new(u64::MAX, 1 << 20);
        assert_eq!(pool.take(u64::MAX), None);
        assert_eq!(Pool::new(100, 0).take(1), None);
    }

    proptest! {
        #[test]
        fn slots_never_overlap_straddle_or_pass_the_budget(
            bytes in 0u64..40_000, page_bytes in 256u64..9000,
            steps in prop::collection::vec((any::<bool>(), 0u64..5000, any::<prop::sample::Index>()), 1..200),
        ) {
            let mut pool = Pool::new(bytes, page_bytes);
            let mut held: Vec<Slot> = Vec::new();
            let page_bytes = page_bytes - page_bytes % Slot::ALIGNMENT;
            for (takes, bytes_wanted, which) in steps {
                if takes || held.is_empty() {
                    held.extend(pool.take(bytes_wanted));
                } else {
                    pool.give(held.swap_remove(which.index(held.len())));
                }
                let mut ranges: Vec<_> =
                    held.iter().map(|s| (s.offset, s.offset + Pool::taken(s.bytes))).collect();
                ranges.sort_unstable();
                prop_assert!(ranges.windows(2).all(|w| w[0].1 <= w[1].0));
                for &(start, end) in &ranges {
                    prop_assert!(start % Slot::ALIGNMENT == 0 && end <= bytes);
                    prop_assert_eq!(start / page_bytes, (end - 1) / page_bytes);
                }
                let used: u64 = ranges.iter().map(|r| r.1 - r.0).sum();
                prop_assert_eq!(used, pool.used());
                prop_assert!(pool.used() <= pool.peak() && pool.peak() <= bytes);
            }
            held.drain(..).for_each(|s| pool.give(s));
            // No hole stays fragmented: every page that was opened is one hole.
            prop_assert!(pool.holes.keys().all(|&offset| offset % page_bytes == 0));
        }
    }
}
