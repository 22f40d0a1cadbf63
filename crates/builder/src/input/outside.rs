//! Points of the inputs that the lattice does not hold: strays far from nearly all others are set
//! aside and kept in the metadata; coordinates that stand for no value are refused and counted; so
//! are, on request, points that do not fit the given lattice of a file that is appended to.

use crate::rows::journal_record::{Record, RecordReader};
use esker_format::SetAside;
use esker_points::Batch;
use esker_points::spread::{Corners, NO_VALUE_MIN};
use esker_scan::ReadReport;
use std::collections::BTreeMap;

/// Reason with which points are refused that a given lattice does not hold.
pub const OFF_LATTICE: &str = "coordinate is outside of the lattice of the file appended to";
/// Reason with which points are refused whose coordinates stand for no value.
pub const NO_VALUE: &str = "coordinate stands for no value (1e20 or above)";

/// What becomes of a point outside of the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// A coordinate stands for no value.
    Refused,
    /// It is a stray.
    SetAside,
    /// It is one of the points for which the lattice should have room.
    Misfit,
}

/// The fate of a point at `world` of an input whose points, apart from strays, lie in `bounds`.
pub fn fate(world: [f64; 3], bounds: Option<Corners>) -> Fate {
    let is_within =
        |[low, high]: Corners| (0..3).all(|i| low[i] <= world[i] && world[i] <= high[i]);
    if world.iter().any(|c| c.abs() >= NO_VALUE_MIN) {
        Fate::Refused
    } else if bounds.is_some_and(is_within) {
        Fate::Misfit
    } else {
        Fate::SetAside
    }
}

/// The points outside of the lattice that were found so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outside {
    /// Strays, in the order of the inputs.
    pub aside: Vec<SetAside>,
    /// For each source, the number of points refused: without value, and misfits.
    refused: BTreeMap<u32, [u64; 2]>,
}

impl Outside {
    /// Takes the points outside of the lattice out of a batch of `source`; `bounds` as in [`fate`].
    pub fn of(batch: &mut Batch, source: usize, bounds: Option<Corners>) -> Self {
        let (mut found, source) = (Self::default(), source as u32);
        for (place, values) in batch.take_outside() {
            let mut refuse = |why: usize| found.refused.entry(source).or_default()[why] += 1;
            match fate(place, bounds) {
                Fate::Refused => refuse(0),
                Fate::Misfit => refuse(1),
                Fate::SetAside => found.aside.push(SetAside { source, place, values }),
            }
        }
        found
    }

    /// Strays alone.
    pub fn of_aside(aside: Vec<SetAside>) -> Self {
        Self { aside, ..Self::default() }
    }

    /// Adds the points of a later batch.
    pub fn merge(&mut self, later: Self) {
        self.aside.extend(later.aside);
        for (source, counts) in later.refused {
            let sum = self.refused.entry(source).or_default();
            *sum = [sum[0] + counts[0], sum[1] + counts[1]];
        }
    }

    /// Number of points.
    pub fn len(&self) -> u64 {
        self.aside.len() as u64 + self.refused.values().flatten().sum::<u64>()
    }

    /// Takes the points out of the reports of the readers, which count them among the others.
    pub fn correct(&self, reports: &mut [ReadReport]) {
        for point in &self.aside {
            if let Some(report) = reports.get_mut(point.source as usize) {
                report.points -= 1;
            }
        }
        for (&source, counts) in &self.refused {
            let Some(report) = reports.get_mut(source as usize) else { continue };
            for (why, &points) in [NO_VALUE, OFF_LATTICE].into_iter().zip(counts) {
                report.points -= points;
                if points > 0 {
                    *report.refused.entry(why.into()).or_default() += points;
                }
            }
        }
    }

    /// Adds to a record of the journal the points set aside from the `recorded`-th on, and the
    /// counts.
    pub fn put(&self, recorded: usize, record: &mut Record) {
        let aside = &self.aside[recorded..];
        record.put(aside.len() as u64);
        for point in aside {
            record.put(u64::from(point.source));
            record.put(point.place);
            record.put_all(&point.values);
        }
        record.put(self.refused.len() as u64);
        for (&source, &counts) in &self.refused {
            record.put(u64::from(source));
            record.put(counts);
        }
    }

    /// Restores what a record of the journal adds; `None` if it is damaged.
    pub fn restore(&mut self, from: &mut RecordReader<'_>) -> Option<()> {
        for _ in 0..from.get::<u64>()? {
            let source = u32::try_from(from.get::<u64>()?).ok()?;
            self.aside.push(SetAside { source, place: from.get()?, values: from.get_all()? });
        }
        self.refused.clear();
        for _ in 0..from.get::<u64>()? {
            let source = u32::try_from(from.get::<u64>()?).ok()?;
            self.refused.insert(source, from.get()?);
        }
        Some(())
    }
}
