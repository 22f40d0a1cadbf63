//! How the values of points that are built fall into histograms; any thread adds to them.

use crate::rows::journal_record::Record;
use esker_format::{Histograms, PageLayout, PagePoints, Ranges};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Histograms of some of a build's points.
pub struct Counts {
    ranges: Ranges,
    sum: Mutex<Histograms>,
}

impl Counts {
    /// Empty ones over these ranges.
    pub fn new(ranges: Ranges) -> Self {
        Self { sum: Mutex::new(Histograms::new(ranges.clone())), ranges }
    }

    /// Empty ones over the same ranges.
    pub fn beside(&self) -> Self {
        Self::new(self.ranges.clone())
    }

    /// Counts the values of these points.
    pub fn add(&self, pages: &PageLayout, points: &PagePoints) {
        let mut own = Histograms::new(self.ranges.clone());
        own.add(pages, points);
        self.lock().merge(&own);
    }

    /// Adds what others are.
    pub fn merge(&self, others: &Self) {
        self.lock().merge(&others.lock());
    }

    /// Writes them down, one attribute after the other.
    pub fn put(&self, attributes: usize, record: &mut Record) {
        let sum = self.lock();
        (0..attributes).for_each(|a| record.put_all(sum.counts(a).as_slice()));
    }

    /// Adds those that were written down; whether they are of as many attributes and bins.
    pub fn add_all(&self, counts: &[Vec<u64>]) -> bool {
        let mut sum = self.lock();
        counts.iter().enumerate().all(|(a, counts)| {
            let counts = counts.as_slice().try_into();
            counts.map(|counts| sum.add_counts(a, counts)).is_ok()
        })
    }

    /// The histograms.
    pub fn into_inner(self) -> Histograms {
        self.sum.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, Histograms> {
        self.sum.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
