//! Sources for a lattice that was chosen before: points between its steps are rounded, as in every
//! build; points outside of it are refused, and counted with the reason.

use esker_points::lattice::{Placement, REFUSED};
use esker_points::{Batch, Task};
use esker_scan::source::Sink;
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};

/// Reason with which points outside of a given lattice are refused.
pub const OFF_LATTICE: &str = "coordinate is outside of the lattice of the file appended to";

/// A source whose points outside of the lattice are refused.
pub struct WithinLattice(pub Box<dyn Source>);

impl WithinLattice {
    /// Wraps all sources.
    pub fn all(sources: Vec<Box<dyn Source>>) -> Vec<Box<dyn Source>> {
        sources.into_iter().map(|source| Box::new(Self(source)) as Box<dyn Source>).collect()
    }
}

impl Source for WithinLattice {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut refused = 0;
        let mut report = self.0.read(&placement.refusing(), task, &mut |batch| {
            let (kept, gone) = kept(batch);
            refused += gone;
            if kept.is_empty() { Ok(()) } else { sink(kept) }
        })?;
        if refused > 0 {
            report.points -= refused;
            *report.refused.entry(OFF_LATTICE.into()).or_default() += refused;
        }
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Option<[[f64; 3]; 2]>, ScanError> {
        self.0.survey(task)
    }

    fn held_bytes(&self) -> u64 {
        self.0.held_bytes()
    }
}

/// Removes refused points from a batch and counts them.
fn kept(batch: Batch) -> (Batch, u64) {
    let own: Vec<usize> = (0..batch.len()).filter(|&i| batch.positions[i] != REFUSED).collect();
    let gone = (batch.len() - own.len()) as u64;
    if gone == 0 {
        return (batch, 0);
    }
    let mut kept = Batch::with_capacity(batch.schema.clone(), own.len());
    kept.positions.extend(own.iter().map(|&i| batch.positions[i]));
    let columns = kept.columns.iter_mut().zip(&batch.columns).zip(&batch.schema.attributes);
    for ((to, from), attribute) in columns {
        let size = attribute.ty.size();
        own.iter().for_each(|&i| to.extend_from_slice(&from[i * size..][..size]));
    }
    (kept, gone)
}
