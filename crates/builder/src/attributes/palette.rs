//! Palette of the compact plane, trained on the colours of all rows once they are partitioned,
//! before any page is made. It is a function of the rows alone and is kept in the journal. A given
//! palette, such as that of the file that scans are appended to, is only compared with the colours.

use crate::error::BuildError;
use crate::options::Options;
use crate::rows::journal_record::{Kind, Record, RecordReader};
use crate::rows::partition::Bucket;
use crate::rows::row::RowLayout;
use crate::rows::scratch::Scratch;
use crate::rows::store::Store;
use esker_format::PageLayout;
use esker_points::Task;
use esker_points::palette::{Histogram, Misfit, Palette};
use rayon::prelude::*;

/// Bytes of a row that hold the drawn colour, for a class; `None` if the class has no colour.
type ColourBytes = Option<[usize; 3]>;

/// A palette, and the distances of colours from it.
pub type Trained = Option<(Palette, Misfit)>;

impl Store {
    /// Returns the palette for the rows of `buckets` if one is requested: the given one, or one
    /// trained on the rows. `None` if the rows have no colours, or only black.
    ///
    /// # Errors
    /// If scratch fails, or the journal is damaged.
    pub fn palette(
        &mut self,
        buckets: &[Bucket],
        rows: &RowLayout,
        pages: &PageLayout,
        options: &Options,
        task: &dyn Task,
    ) -> Result<Trained, BuildError> {
        if !options.compact || buckets.is_empty() {
            return Ok(None);
        }
        let trained = self.trained(buckets, rows, pages, options.inherited.palette.as_ref())?;
        if trained.is_none() {
            task.note("--compact has no effect: the inputs have no colours");
        }
        Ok(trained)
    }

    fn trained(
        &mut self,
        buckets: &[Bucket],
        rows: &RowLayout,
        pages: &PageLayout,
        given: Option<&Palette>,
    ) -> Result<Trained, BuildError> {
        if let Some(record) = self.journal.next(Kind::Palette)? {
            let restored = restored(&mut RecordReader(&record));
            return restored.ok_or_else(|| self.journal.damaged("its palette"));
        }
        let histogram = colours(buckets, rows, pages, &mut self.scratch)?;
        let trained = histogram.and_then(|histogram| trained(&histogram, given));
        self.journal.append(palette_record(trained.as_ref()))?;
        Ok(trained)
    }
}

/// The given palette, or one trained on counted colours, and the distances of these from it. `None`
/// if there is only black.
pub fn trained(histogram: &Histogram, given: Option<&Palette>) -> Trained {
    let palette = histogram.palette().map(|own| given.cloned().unwrap_or(own))?;
    let misfit = histogram.misfit(&palette);
    Some((palette, misfit))
}

/// Counts the drawn colours of rows. `None` if no class has colours.
///
/// # Errors
/// If scratch fails.
pub fn colours(
    buckets: &[Bucket],
    rows: &RowLayout,
    pages: &PageLayout,
    scratch: &mut Scratch,
) -> Result<Option<Histogram>, BuildError> {
    let place = |class| {
        let (rgb, byte) = pages.drawn_colour(class)?;
        Some(rgb.map(|attribute| rows.attribute(attribute).start + byte))
    };
    let places: Vec<ColourBytes> = (0..pages.classes().len()).map(place).collect();
    if places.iter().all(Option::is_none) {
        return Ok(None);
    }
    let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
    let map = if is_stored { Some(scratch.map()?) } else { None };
    let histogram = Histogram::default();
    buckets.par_iter().for_each(|bucket| {
        let runs = bucket.runs(map.as_ref(), rows.bytes());
        for row in runs.into_iter().flat_map(|run| run.chunks_exact(rows.bytes())) {
            let class = if rows.has_class() { usize::from(rows.class(row)) } else { 0 };
            // Rows of an interrupted build may be damaged, which is detected when pages are made of
            // them.
            if let Some(&Some(places)) = places.get(class) {
                histogram.add(places.map(|at| row[at]));
            }
        }
    });
    Ok(Some(histogram))
}

/// Journal record of a palette; empty if there is none.
pub fn palette_record(trained: Option<&(Palette, Misfit)>) -> Record {
    let mut record = Record::new(Kind::Palette);
    if let Some((palette, misfit)) = trained {
        record.put_all(palette.colours());
        record.put([misfit.mean, misfit.most, misfit.worst]);
    }
    record
}

/// Restores a palette from a record; `None` if the record is damaged.
pub fn restored(from: &mut RecordReader<'_>) -> Option<Trained> {
    if from.0.is_empty() {
        return Some(None);
    }
    let palette = Palette::new(from.get_all()?)?;
    let [mean, most, worst] = from.get()?;
    Some(Some((palette, Misfit { mean, most, worst })))
}
