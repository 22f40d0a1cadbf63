//! Histograms of the values of points, to which any thread adds.

use crate::rows::journal_record::Record;
use esker_format::{Histograms, PageLayout, PagePoints, Ranges};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Histograms of some points of a build.
pub struct Counts {
    ranges: Ranges,
    sum: Mutex<Histograms>,
}

impl Counts {
    /// Makes empty histograms over `ranges`.
    pub fn new(ranges: Ranges) -> Self {
        Self { sum: Mutex::new(Histograms::new(ranges.clone())), ranges }
    }

    /// Makes empty histograms over the same ranges.
    pub fn beside(&self) -> Self {
        Self::new(self.ranges.clone())
    }

    /// Counts the values of `points`.
    pub fn add(&self, pages: &PageLayout, points: &PagePoints) {
        let mut own = Histograms::new(self.ranges.clone());
        own.add(pages, points);
        self.lock().merge(&own);
    }

    /// Adds the counts of `others`.
    pub fn merge(&self, others: &Self) {
        self.lock().merge(&others.lock());
    }

    /// Writes the counts to `record`, attribute by attribute.
    pub fn put(&self, attributes: usize, record: &mut Record) {
        let sum = self.lock();
        (0..attributes).for_each(|a| record.put_all(sum.counts(a).as_slice()));
    }

    /// Adds counts that were written. Returns whether the numbers of attributes and bins match.
    pub fn add_all(&self, counts: &[Vec<u64>]) -> bool {
        let mut sum = self.lock();
        counts.iter().enumerate().all(|(a, counts)| {
            let counts = counts.as_slice().try_into();
            counts.map(|counts| sum.add_counts(a, counts)).is_ok()
        })
    }

    /// Returns the histograms.
    pub fn into_inner(self) -> Histograms {
        self.sum.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, Histograms> {
        self.sum.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
