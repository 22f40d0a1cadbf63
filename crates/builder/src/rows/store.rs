//! The files that a tree is built between: scratch, where rows come from; the file, where pages go;
//! and the journal, which is told of pages when they are written, and of rows before they are given
//! back.

use crate::error::BuildError;
use crate::rows::borders::{self, Borders, cell_of};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Reading, Record};
use crate::rows::partition::{Bucket, Spilled};
use crate::rows::row::{RowLayout, position};
use crate::rows::scratch::{Extent, Map, Scratch, take_first};
use crate::rows::sort::sort;
use esker_format::FileWriter;
use esker_points::Cell;
use rayon::prelude::*;

/// The files.
pub struct Store {
    /// The file.
    pub writer: FileWriter,
    /// Where rows lie that do not fit memory.
    pub scratch: Scratch,
    /// What is done.
    pub journal: Journal,
    /// What chunks know of each other, where normals are estimated.
    pub borders: Option<Borders>,
}

/// What waits to be written.
#[derive(Default)]
pub struct Outgoing {
    /// Pages that have their places.
    pub pages: Vec<Vec<u8>>,
    /// That a part is built, whose pages are among these.
    pub record: Option<Record>,
    /// Its rows, which then are of no more use.
    pub extents: Vec<Extent>,
}

impl Store {
    /// Whether all stays as it is when it is dropped before the build's end.
    pub fn keep(&mut self, is_kept: bool) {
        self.writer.keep(is_kept);
        self.scratch.keep(is_kept);
        self.journal.keep(is_kept);
    }

    /// Writes what waits.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn write(&mut self, outgoing: Outgoing) -> Result<(), BuildError> {
        for page in outgoing.pages {
            self.writer.write_page(&page)?;
        }
        self.scratch.set_beside(self.writer.offset());
        if let Some(record) = outgoing.record {
            self.writer.flush()?;
            self.journal.tell(record)?;
        }
        self.scratch.release(outgoing.extents);
        Ok(())
    }

    /// The content of scratch, where a bucket has rows in it.
    ///
    /// # Errors
    /// Where scratch fails.
    pub fn map(&mut self, bucket: &Bucket) -> Result<Option<Map>, BuildError> {
        if bucket.extents.is_empty() { Ok(None) } else { self.scratch.map().map(Some) }
    }

    /// Holds that rows in scratch which an earlier build may have put there are those of a bucket:
    /// a system that went down may have lost them.
    ///
    /// # Errors
    /// Where they are not.
    pub fn check(
        &self,
        bucket: &Bucket,
        runs: &[&[u8]],
        layout: &RowLayout,
    ) -> Result<(), BuildError> {
        if bucket.extents.is_empty() || !self.journal.is_resumed() {
            return Ok(());
        }
        let mut rows = runs.iter().flat_map(|run| run.chunks_exact(layout.bytes()));
        let is_own = |row| bucket.cell.contains(position(row)) && layout.is_possible(row);
        let bytes: usize = runs.iter().map(|run| run.len()).sum();
        if bytes as u64 == bucket.rows * layout.bytes() as u64 && rows.all(is_own) {
            return Ok(());
        }
        Err(self.journal.damaged("its scratch file"))
    }

    /// The rows of a chunk, wherever they lie; and what others have put aside for it, where any
    /// has.
    ///
    /// # Errors
    /// Where scratch fails, or rows of an earlier build are damaged.
    pub fn stored(
        &mut self,
        buckets: Vec<Bucket>,
        layout: &RowLayout,
        has_borders: bool,
    ) -> Result<Stored, BuildError> {
        let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
        let is_needed = is_stored || has_borders;
        let map = if is_needed { Some(self.scratch.map()?) } else { None };
        if self.journal.is_resumed() {
            buckets.par_iter().try_for_each(|bucket| {
                self.check(bucket, &bucket.runs(map.as_ref(), layout.bytes()), layout)
            })?;
        }
        Ok(Stored { buckets, map })
    }

    /// The typical distance of points in steps.
    ///
    /// # Errors
    /// Where scratch fails.
    pub fn spacing(&mut self, buckets: &[Bucket], stride: usize) -> Result<f64, BuildError> {
        if let Some(record) = self.journal.ask(Kind::Spaced)? {
            let spacing = Reading(&record).get();
            return spacing.ok_or_else(|| self.journal.damaged("the distance of its points"));
        }
        let spacing = borders::spacing(buckets, stride, &mut self.scratch)?;
        let mut record = Record::new(Kind::Spaced);
        record.put(spacing);
        self.journal.tell(record)?;
        Ok(spacing)
    }

    /// What chunks have put aside for each other.
    pub fn aside(&self) -> &[(Cell, Vec<Extent>)] {
        self.borders.as_ref().map_or(&[], Borders::cells)
    }

    /// Puts aside what other chunks may need of this one's buckets.
    ///
    /// # Errors
    /// Where scratch fails, or rows of an earlier build are damaged.
    pub fn put_aside(&mut self, buckets: &[Bucket], layout: &RowLayout) -> Result<(), BuildError> {
        if self.journal.is_resumed() && buckets.iter().any(|b| !b.extents.is_empty()) {
            let map = self.scratch.map()?;
            let whole = |b: &Bucket| self.check(b, &b.runs(Some(&map), layout.bytes()), layout);
            buckets.par_iter().try_for_each(whole)?;
        }
        match &mut self.borders {
            Some(borders) => borders.add(buckets, &mut self.scratch),
            None => Ok(()),
        }
    }

    /// Gives back what a cell has put aside whose parts are to: that is all of it that others may
    /// need, and more.
    pub fn forget_aside(&mut self, cell: &Cell) {
        let extents = self.borders.as_mut().map(|borders| borders.forget(cell));
        self.scratch.release(extents.unwrap_or_default());
    }

    /// Tells of what was put aside after the first `known` cells.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn tell_aside(&mut self, known: usize) -> Result<(), BuildError> {
        if !self.journal.keeps_rows() {
            return Ok(());
        }
        self.scratch.flush()?;
        let mut record = Record::new(Kind::Aside);
        let cells = &self.aside()[known..];
        record.put(cells.len() as u64);
        for (cell, extents) in cells {
            record.put(cell.corner);
            record.put(cell.log2);
            put_extents(extents, &mut record);
        }
        self.journal.tell(record)
    }

    /// Takes what is put aside next from the journal, where it has it.
    ///
    /// # Errors
    /// Where it is damaged.
    pub fn resume_aside(&mut self) -> Result<bool, BuildError> {
        let Some(record) = self.ask_of_rows(Kind::Aside)? else { return Ok(false) };
        let mut from = Reading(&record);
        let count = from.get::<u64>();
        let cell = |_| {
            let cell = Cell { corner: from.get()?, log2: from.get()? };
            Some((cell, extents(&mut from)?))
        };
        let cells: Option<Vec<_>> = count.and_then(|count| (0..count).map(cell).collect());
        let cells = cells.ok_or_else(|| self.journal.damaged("what it has put aside"))?;
        let extents: Vec<Extent> = cells.iter().flat_map(|(_, e)| e.iter().copied()).collect();
        if !self.scratch.restore(&extents)? {
            return Err(self.journal.damaged("its scratch file"));
        }
        if let Some(borders) = &mut self.borders {
            borders.restore(cells);
        }
        Ok(true)
    }

    /// The next record, where rows in scratch are kept.
    fn ask_of_rows(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
        if self.journal.rows().is_some() { self.journal.ask(kind) } else { Ok(None) }
    }

    /// What the journal has next of the parts of a bucket of rows of `stride` bytes; they then are
    /// the bucket's no more.
    ///
    /// # Errors
    /// Where it is damaged.
    pub fn parted(
        &mut self,
        bucket: &mut Bucket,
        stride: usize,
    ) -> Result<Option<Spilled>, BuildError> {
        if bucket.extents.is_empty() {
            return Ok(None);
        }
        let Some(record) = self.ask_of_rows(Kind::Parted)? else { return Ok(None) };
        let stride_bytes = stride as u64;
        let is_own = |spilled: &Spilled| {
            let bytes = spilled.bytes();
            bytes.is_multiple_of(stride_bytes)
                && (1..=bucket.rows).contains(&(bytes / stride_bytes))
        };
        let spilled = Spilled::get(&mut Reading(&record)).filter(is_own);
        let spilled = spilled.ok_or_else(|| self.journal.damaged("a part of its rows"))?;
        if !self.scratch.restore(&spilled.extents())? {
            return Err(self.journal.damaged("its scratch file"));
        }
        bucket.rows -= spilled.bytes() / stride_bytes;
        self.scratch.release(take_first(&mut bucket.extents, spilled.bytes()));
        Ok(Some(spilled))
    }
}

/// The rows of a chunk, in memory and in scratch.
pub struct Stored {
    buckets: Vec<Bucket>,
    /// The content of scratch, where any need it.
    map: Option<Map>,
}

impl Stored {
    /// Sorts them into `rows`, with their normals where borders are known, and lets go of them;
    /// where in scratch they lie.
    pub fn load(
        self,
        layout: &RowLayout,
        borders: Option<&Borders>,
        rows: &mut Vec<u8>,
    ) -> Vec<Extent> {
        let stride = layout.bytes();
        let runs: Vec<_> = self.buckets.iter().map(|b| b.runs(self.map.as_ref(), stride)).collect();
        sort(&runs, stride, rows);
        drop(runs);
        if let Some((borders, map)) = borders.zip(self.map) {
            borders.estimate(&cell_of(&self.buckets), rows, &map);
        }
        self.buckets.into_iter().flat_map(|b| b.extents).collect()
    }
}

fn put_extents(extents: &[Extent], record: &mut Record) {
    record.put(extents.len() as u64);
    extents.iter().for_each(|extent| extent.put(record));
}

fn extents(from: &mut Reading<'_>) -> Option<Vec<Extent>> {
    (0..from.get::<u64>()?).map(|_| Extent::get(from)).collect()
}
