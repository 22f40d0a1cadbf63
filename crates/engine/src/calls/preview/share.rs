//! Sources that give a share of the points of others: while those are read, or again afterwards.

use esker_points::lattice::Placement;
use esker_points::{AttrType, Batch, Schema, Spread, Task};
use esker_scan::source::Sink;
use esker_scan::{Guess, ReadReport, ScanError, Source, SourceInfo};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One in `every` points of a batch whose first point is number `first` of its source. Points that
/// the lattice does not hold are left out.
fn share_of(batch: &Batch, first: u64, every: u64) -> Batch {
    let skipped = (every - first % every) % every;
    let mut outside = batch.outside.iter().map(|(i, _)| *i).peekable();
    let is_inside = |i: &usize| {
        while outside.next_if(|&other| other < *i).is_some() {}
        outside.peek() != Some(i)
    };
    let chosen = (skipped as usize..batch.len()).step_by(every as usize).filter(is_inside);
    let chosen: Vec<usize> = chosen.collect();
    let mut share = Batch::with_capacity(Arc::clone(&batch.schema), chosen.len());
    share.positions.extend(chosen.iter().map(|&i| batch.positions[i]));
    let sizes = batch.schema.attributes.iter().map(|attribute| attribute.ty.size());
    for ((column, of_share), size) in batch.columns.iter().zip(&mut share.columns).zip(sizes) {
        chosen.iter().for_each(|&i| of_share.extend_from_slice(&column[i * size..][..size]));
    }
    share
}

/// Points that were kept of a source.
#[derive(Default)]
struct Kept {
    placement: Option<Placement>,
    /// Attributes, whose types may have become wider since the source was opened.
    schema: Option<Arc<Schema>>,
    batches: Vec<Batch>,
}

/// Points that are kept while a source is read.
#[derive(Clone)]
pub struct Share {
    info: SourceInfo,
    kept: Arc<Mutex<Kept>>,
}

impl Share {
    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets what was read so far.
    fn begin(&self, placement: Placement, schema: &Arc<Schema>) {
        let (placement, schema) = (Some(placement), Some(Arc::clone(schema)));
        *self.lock() = Kept { placement, schema, batches: Vec::new() };
    }

    /// The share as a source, once all points were read.
    pub fn into_source(mut self) -> Box<dyn Source> {
        let schema = self.lock().schema.clone();
        schema.into_iter().for_each(|schema| self.info.schema = schema);
        Box::new(self)
    }
}

/// A source of the points that were kept of another one. The lattice must be the same.
impl Source for Share {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let kept = std::mem::take(&mut *self.lock());
        if kept.placement != Some(*placement) {
            let what = "what was kept of it lies on another lattice";
            return Err(ScanError::unsupported(&self.info.path, what));
        }
        let mut report = ReadReport::default();
        for batch in kept.batches {
            task.check()?;
            report.points += batch.len() as u64;
            sink(batch)?;
        }
        Ok(report)
    }

    fn survey(&self, _task: &dyn Task) -> Result<Spread, ScanError> {
        Err(ScanError::unsupported(&self.info.path, "what was kept of it has no bounds"))
    }
}

/// A source whose points are all passed on while a share of them is kept.
pub struct Watched {
    source: Box<dyn Source>,
    every: u64,
    share: Share,
}

impl Watched {
    /// Watches a source, and keeps one in `every` points.
    pub fn new(source: Box<dyn Source>, every: u64) -> Self {
        let mut info = source.info().clone();
        info.points_hint /= every;
        Self { source, every, share: Share { info, kept: Arc::default() } }
    }

    /// Where the points are kept.
    pub fn share(&self) -> Share {
        self.share.clone()
    }
}

impl Source for Watched {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        // A source is read again if the lattice was wrong.
        self.share.begin(*placement, &self.source.info().schema);
        let mut first = 0;
        self.source.read(placement, task, &mut |batch| {
            let share = share_of(&batch, first, self.every);
            first += batch.len() as u64;
            self.share.lock().batches.push(share);
            sink(batch)
        })
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.source.survey(task)
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }

    fn typed_by_values(&self) -> Vec<usize> {
        self.source.typed_by_values()
    }

    fn widen(&mut self, attribute: usize, ty: AttrType) {
        self.source.widen(attribute, ty);
    }

    fn guess(&self) -> Option<&Guess> {
        self.source.guess()
    }
}

/// A source of one in `every` points of another one.
pub struct Thinned {
    source: Box<dyn Source>,
    every: u64,
    info: SourceInfo,
}

impl Thinned {
    /// Thins a source.
    pub fn new(source: Box<dyn Source>, every: u64) -> Self {
        let mut info = source.info().clone();
        info.points_hint /= every;
        Self { source, every, info }
    }
}

impl Source for Thinned {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let (mut first, mut points) = (0, 0);
        let report = self.source.read(placement, task, &mut |batch| {
            let share = share_of(&batch, first, self.every);
            first += batch.len() as u64;
            points += share.len() as u64;
            if share.is_empty() { Ok(()) } else { sink(share) }
        })?;
        Ok(ReadReport { points, ..report })
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.source.survey(task)
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::Attribute;

    #[test]
    fn one_in_three_points_are_taken_across_batches_without_those_outside() {
        let schema = Arc::new(Schema::new(vec![Attribute::new("n", AttrType::U16)]));
        let mut taken = Vec::new();
        let mut first = 0;
        for length in [1u32, 4, 2, 10] {
            let mut batch = Batch::with_capacity(Arc::clone(&schema), 10);
            for n in first..first + length {
                batch.positions.push([n, 0, 0]);
                batch.columns[0].extend_from_slice(&(n as u16).to_le_bytes());
            }
            batch.outside = (0..length as usize)
                .filter(|i| first as usize + i == 9)
                .map(|i| (i, [0.0; 3]))
                .collect();
            let share = share_of(&batch, first.into(), 3);
            assert!(share.is_consistent() && share.outside.is_empty());
            let values = share.columns[0].chunks(2).map(|v| u32::from(v[0]));
            assert!(values.eq(share.positions.iter().map(|p| p[0])));
            taken.extend(share.positions.iter().map(|p| p[0]));
            first += length;
        }
        assert_eq!(taken, [0, 3, 6, 12, 15]);
    }
}
