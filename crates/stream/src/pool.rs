//! Allocator of slots in drawing memory: best fit over the holes, which join again when slots are
//! freed. No slot crosses a page boundary, none overlaps another, and the sum of their lengths,
//! rounded up to [`Slot::ALIGNMENT`], never exceeds the budget. The budget may change: slots beyond
//! a lower one stay until they are freed, and no new ones are allocated there.

use crate::landing::Slot;
use std::collections::{BTreeMap, BTreeSet};

/// Free and used bytes of the budget.
#[derive(Debug)]
pub(crate) struct Pool {
    /// End of the range of addresses in which slots are allocated.
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
        let fits = |&&(_, offset): &&(u64, u64)| {
            offset.checked_add(taken).is_some_and(|end| end <= self.bytes)
        };
        let found = self.by_length.range((taken, 0)..).find(fits).copied();
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

    /// Changes the budget. Slots beyond a lower one remain.
    pub(crate) fn resize(&mut self, bytes: u64) {
        self.bytes = bytes - bytes % Slot::ALIGNMENT;
        // The rest of a page that a lower budget has cut short.
        let page_end = self.untouched.checked_next_multiple_of(self.page_bytes);
        let end = page_end.map_or(self.bytes, |end| end.min(self.bytes));
        if self.untouched < end {
            let start = std::mem::replace(&mut self.untouched, end);
            self.free(start, end);
        }
    }

    /// Whether a slot lies beyond the budget.
    pub(crate) fn is_beyond(&self, slot: Slot) -> bool {
        slot.offset + Self::taken(slot.bytes) > self.bytes
    }

    /// Frees a slot of [`Pool::take`].
    pub(crate) fn give(&mut self, slot: Slot) {
        let taken = Self::taken(slot.bytes);
        self.used -= taken;
        self.free(slot.offset, slot.offset + taken);
    }

    /// Makes a hole of a range, joined with the holes next to it.
    fn free(&mut self, mut start: u64, mut end: u64) {
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
        let length = self.page_bytes.min(self.bytes.saturating_sub(self.untouched));
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

    #[test]
    fn a_lower_budget_keeps_slots_until_they_are_freed_and_a_higher_one_has_no_gap() {
        let mut pool = Pool::new(4096, 1024);
        let slots: Vec<_> = (0..16).map(|_| pool.take(256).expect("there is room")).collect();
        pool.resize(1536);
        assert_eq!(slots.iter().filter(|s| pool.is_beyond(**s)).count(), 10);
        slots[6..].iter().for_each(|s| pool.give(*s));
        assert_eq!((pool.take(256), pool.used()), (None, 1536), "what is freed lies beyond");
        pool.resize(4096);
        assert!((0..10).all(|_| pool.take(256).is_some()) && pool.take(1).is_none());
        // Pages that a budget cuts short are whole after it has grown.
        let mut pool = Pool::new(512, 1024);
        assert!(pool.take(512).is_some() && pool.take(1).is_none());
        pool.resize(1536);
        assert!(pool.take(512).is_some_and(|s| s.offset == 512));
        assert!(pool.take(512).is_some_and(|s| s.offset == 1024) && pool.take(1).is_none());
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
