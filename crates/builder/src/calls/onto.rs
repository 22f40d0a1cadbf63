//! Building onto what there is: points are placed on a lattice that was chosen before. What lies
//! between its steps is rounded, as everywhere; what lies outside of it is refused, and counted
//! with the reason.

use esker_format::{SourceRecord, TreeRef};
use esker_points::lattice::{Placement, REFUSED};
use esker_points::palette::Palette;
use esker_points::{Batch, Lattice, MultisetHash, Task};
use esker_scan::source::Sink;
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use std::path::PathBuf;

/// Why points are refused that lie outside of a given lattice.
pub const OFF_LATTICE: &str = "coordinate is outside of the lattice of the file appended to";

/// What a build takes from files that are there already; nothing, for most builds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Onto {
    /// The lattice, in place of one chosen for the inputs.
    pub lattice: Option<Lattice>,
    /// The palette of a compact plane, in place of one trained on the inputs.
    pub palette: Option<Palette>,
    /// The files that the new one names.
    pub forest: Vec<TreeRef>,
    /// What is known of points that are merged out of files.
    pub merged: Option<Merged>,
}

/// What files say of the points that are merged out of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Where they came from, each with the path of the input that brings them now.
    pub records: Vec<(PathBuf, SourceRecord)>,
    /// How many they are.
    pub points: u64,
    /// The sum of the files' hashes.
    pub hash: MultisetHash,
}

/// An input whose points outside of the lattice are refused.
pub struct Within(pub Box<dyn Source>);

impl Within {
    /// The same for all inputs.
    pub fn all(sources: Vec<Box<dyn Source>>) -> Vec<Box<dyn Source>> {
        sources.into_iter().map(|source| Box::new(Self(source)) as Box<dyn Source>).collect()
    }
}

impl Source for Within {
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

/// A batch without the points that were refused, and how many those were.
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
