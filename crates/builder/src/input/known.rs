//! What is known of the inputs beyond their headers: bounds and colour depths, which decoding
//! corrects where a header was wrong, and which the journal keeps.

use crate::rows::journal_record::{Kind, Record, RecordReader};
use esker_points::lattice::GridKind;
use esker_points::spread::{Corners, join};
use esker_points::{ColourDepth, InputGrid};
use esker_scan::Source;

/// Grids and colour depths of the inputs, in the order of the sources.
pub struct KnownInputs {
    /// Scale, offset and bounds of the coordinates; bounds are corrected if they turn out wrong.
    pub grids: Vec<InputGrid>,
    /// Whether the bounds are those of the points, and not only what a header claims.
    pub measured: Vec<bool>,
    /// Depths of 16-bit colours.
    pub depths: Vec<ColourDepth>,
    /// Bounds of nearly all points, if they were measured for their latitude.
    pub core: Option<Corners>,
}

impl KnownInputs {
    /// Grids and colour depths as the headers of `sources` state them.
    pub fn of(sources: &[Box<dyn Source>]) -> Self {
        let depth = |s: &dyn Source| s.info().colour_depth.unwrap_or(ColourDepth::Sixteen);
        Self {
            grids: sources.iter().map(|s| s.info().grid.clone()).collect(),
            measured: sources.iter().map(|s| s.info().grid.kind != GridKind::Integer).collect(),
            depths: sources.iter().map(|s| depth(s.as_ref())).collect(),
            core: None,
        }
    }

    /// Bounds of all inputs, of nearly all points where these were measured.
    pub fn core(&self) -> Option<Corners> {
        self.core.or_else(|| self.grids.iter().filter_map(|grid| grid.bounds).reduce(join))
    }

    /// Journal record of what is known.
    pub fn record(&self) -> Record {
        let mut record = Record::new(Kind::Inputs);
        record.put(u8::from(self.core.is_some()));
        record.put(self.core.unwrap_or_default());
        let measured = self.measured.iter().copied();
        for ((grid, &depth), is_measured) in self.grids.iter().zip(&self.depths).zip(measured) {
            record.put(u8::from(is_measured));
            record.put(u8::from(grid.bounds.is_some()));
            record.put(grid.bounds.unwrap_or_default());
            record.put(u8::from(depth == ColourDepth::Eight));
        }
        record
    }

    /// Restores what an earlier build knew from its `record`; `None` if the record is damaged.
    pub fn restore(&mut self, record: &[u8]) -> Option<()> {
        let mut from = RecordReader(record);
        let (has_core, core) = (from.get::<u8>()? > 0, from.get()?);
        self.core = has_core.then_some(core);
        let inputs = self.grids.iter_mut().zip(&mut self.depths).zip(&mut self.measured);
        for ((grid, depth), is_measured) in inputs {
            *is_measured = from.get::<u8>()? > 0;
            let (has_bounds, bounds) = (from.get::<u8>()? > 0, from.get()?);
            grid.bounds = has_bounds.then_some(bounds);
            let is_eight = from.get::<u8>()? > 0;
            *depth = if is_eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        }
        Some(())
    }
}
