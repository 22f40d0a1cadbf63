//! The files of a build: scratch, from which rows are read; the output, to which pages are written;
//! and the journal, which records pages when they are written, and rows before they are freed.

use crate::attributes::density::Distances;
use crate::error::BuildError;
use crate::rows::borders::{self, Borders, cell_of};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Record, RecordReader};
use crate::rows::partition::{Bucket, Spilled};
use crate::rows::row::{RowLayout, position};
use crate::rows::scratch::{Extent, Map, Scratch, take_first};
use crate::rows::sort::sort;
use esker_format::FileWriter;
use esker_points::Cell;
use rayon::prelude::*;

/// The files of a build.
pub struct Store {
    /// The output.
    pub writer: FileWriter,
    /// Rows that do not fit memory.
    pub scratch: Scratch,
    /// The finished steps.
    pub journal: Journal,
    /// Positions near the borders of chunks, if normals are estimated.
    pub borders: Option<Borders>,
}

/// Pages and a journal record that wait to be written.
#[derive(Default)]
pub struct Outgoing {
    /// Pages, in the order of the file.
    pub pages: Vec<Vec<u8>>,
    /// Record of a chunk, the last of whose pages is among these.
    pub record: Option<Record>,
    /// Rows of the chunk, which are freed after the record is written.
    pub extents: Vec<Extent>,
}

impl Store {
    /// Sets whether the unfinished files stay when the store is dropped.
    pub fn keep(&mut self, is_kept: bool) {
        self.writer.keep(is_kept);
        self.scratch.keep(is_kept);
        self.journal.keep(is_kept);
    }

    /// Writes pages and record, then frees rows.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn write(&mut self, outgoing: Outgoing) -> Result<(), BuildError> {
        for page in outgoing.pages {
            self.writer.write_page(&page)?;
        }
        self.scratch.set_output_bytes(self.writer.offset());
        if let Some(record) = outgoing.record {
            self.writer.flush()?;
            self.journal.append(record)?;
        }
        self.scratch.release(outgoing.extents);
        Ok(())
    }

    /// Maps scratch if `bucket` has rows in it.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn map(&mut self, bucket: &Bucket) -> Result<Option<Map>, BuildError> {
        if bucket.extents.is_empty() { Ok(None) } else { self.scratch.map().map(Some) }
    }

    /// In a resumed build, checks that the rows of a bucket in scratch are within its cell: a power
    /// loss may have destroyed them.
    ///
    /// # Errors
    /// If they are not.
    pub fn check_rows(
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

    /// Opens the rows of a chunk for loading; with `has_borders`, scratch is
    /// mapped also for its halo.
    ///
    /// # Errors
    /// If scratch space fails, or rows of an earlier build are damaged.
    pub fn chunk_rows(
        &mut self,
        buckets: Vec<Bucket>,
        layout: &RowLayout,
        has_borders: bool,
    ) -> Result<ChunkRows, BuildError> {
        let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
        let is_needed = is_stored || has_borders;
        let map = if is_needed { Some(self.scratch.map()?) } else { None };
        if self.journal.is_resumed() {
            buckets.par_iter().try_for_each(|bucket| {
                self.check_rows(bucket, &bucket.runs(map.as_ref(), layout.bytes()), layout)
            })?;
        }
        Ok(ChunkRows { buckets, map })
    }

    /// How far points are apart on a lattice with these steps; estimated, or read from the journal.
    ///
    /// # Errors
    /// If scratch space fails, or the journal is damaged.
    pub fn distances(
        &mut self,
        buckets: &[Bucket],
        stride: usize,
        scale: [f64; 3],
    ) -> Result<Distances, BuildError> {
        if let Some(record) = self.journal.next(Kind::Distances)? {
            let mut record = RecordReader(&record);
            let read = record.get().zip(record.get());
            let of = |(spacing, steps_max)| Distances { spacing, steps_max };
            return read.map(of).ok_or_else(|| self.journal.damaged("the distance of its points"));
        }
        let distances = borders::distances(buckets, stride, scale, &mut self.scratch)?;
        let mut record = Record::new(Kind::Distances);
        record.put(distances.spacing);
        record.put(distances.steps_max);
        self.journal.append(record)?;
        Ok(distances)
    }

    /// Cells of chunks, and the places of the positions near their faces.
    pub fn border_cells(&self) -> &[(Cell, Vec<Extent>)] {
        self.borders.as_ref().map_or(&[], Borders::cells)
    }

    /// Stores the positions near the faces of the cell of a chunk.
    ///
    /// # Errors
    /// If scratch space fails, or rows of an earlier build are damaged.
    pub fn add_border(&mut self, buckets: &[Bucket], layout: &RowLayout) -> Result<(), BuildError> {
        if self.journal.is_resumed() && buckets.iter().any(|b| !b.extents.is_empty()) {
            let map = self.scratch.map()?;
            let check =
                |b: &Bucket| self.check_rows(b, &b.runs(Some(&map), layout.bytes()), layout);
            buckets.par_iter().try_for_each(check)?;
        }
        match &mut self.borders {
            Some(borders) => borders.add(buckets, &mut self.scratch),
            None => Ok(()),
        }
    }

    /// Frees the border of a cell that was split: the borders of its parts include it.
    pub fn release_border(&mut self, cell: &Cell) {
        let extents = self.borders.as_mut().map(|borders| borders.remove(cell));
        self.scratch.release(extents.unwrap_or_default());
    }

    /// Records the borders after the first `known` cells.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn record_borders(&mut self, known: usize) -> Result<(), BuildError> {
        if !self.journal.keeps_rows() {
            return Ok(());
        }
        self.scratch.flush()?;
        let mut record = Record::new(Kind::Borders);
        let cells = &self.border_cells()[known..];
        record.put(cells.len() as u64);
        for (cell, extents) in cells {
            record.put(cell.corner);
            record.put(cell.log2);
            put_extents(extents, &mut record);
        }
        self.journal.append(record)
    }

    /// Restores the next borders from the journal; returns whether it has them.
    ///
    /// # Errors
    /// If the record or scratch is damaged.
    pub fn resume_borders(&mut self) -> Result<bool, BuildError> {
        let Some(record) = self.next_of_rows(Kind::Borders)? else { return Ok(false) };
        let mut from = RecordReader(&record);
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

    /// The next record of the earlier build, if it kept rows in scratch.
    fn next_of_rows(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
        if self.journal.rows().is_some() { self.journal.next(kind) } else { Ok(None) }
    }

    /// Rows of `bucket`, of `stride` bytes, that an earlier build has split, by the next record of
    /// the journal. They are removed from the bucket.
    ///
    /// # Errors
    /// If the record or scratch is damaged.
    pub fn resume_split(
        &mut self,
        bucket: &mut Bucket,
        stride: usize,
    ) -> Result<Option<Spilled>, BuildError> {
        if bucket.extents.is_empty() {
            return Ok(None);
        }
        let Some(record) = self.next_of_rows(Kind::Split)? else { return Ok(None) };
        let stride_bytes = stride as u64;
        let is_own = |spilled: &Spilled| {
            let bytes = spilled.bytes();
            bytes.is_multiple_of(stride_bytes)
                && (1..=bucket.rows).contains(&(bytes / stride_bytes))
        };
        let spilled = Spilled::get(&mut RecordReader(&record)).filter(is_own);
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
pub struct ChunkRows {
    buckets: Vec<Bucket>,
    /// Mapping of scratch, if rows or the halo need it.
    map: Option<Map>,
}

impl ChunkRows {
    /// Sorts the rows into `rows`, and estimates their normals if there are borders. Returns the
    /// places of the rows in scratch.
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

fn extents(from: &mut RecordReader<'_>) -> Option<Vec<Extent>> {
    (0..from.get::<u64>()?).map(|_| Extent::get(from)).collect()
}
