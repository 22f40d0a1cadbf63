//! What a take has found, as the tail of its object behind its rows: the cells with the places of
//! their rows, and what the cut sums up.

use crate::attributes::density::Densities;
use crate::error::BuildError;
use crate::input::outside::Outside;
use crate::input::taking::{put_report, report};
use crate::jobs::place::Place;
use crate::jobs::step::{Record as StepRecord, Step};
use crate::rows::journal_record::{Kind, Record, RecordReader, unsealed};
use esker_format::{CrsRecord, Ranges, SetAside};
use esker_points::{Cell, MultisetHash};
use esker_scan::{ReadReport, SourceInfo};

/// Number by which bytes are recognised that a machine of another byte order wrote.
const ORDER: u32 = 0x0102_0304;

/// Rows of a cell in the object of a take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellRows {
    /// The cell.
    pub cell: Cell,
    /// Offset of the rows, in bytes.
    pub offset: u64,
    /// Number of rows.
    pub rows: u64,
    /// CRC-32 of the rows.
    pub crc: u32,
}

/// What the metadata keep of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceKept {
    /// Format, version and variant.
    pub format: String,
    /// Coordinate reference system, if the source has one.
    pub crs: Option<CrsRecord>,
    /// Notes on data that were left out, one line each.
    pub notes: Vec<String>,
    /// Blocks kept verbatim: name and bytes.
    pub verbatim: Vec<(String, Vec<u8>)>,
}

/// A piece that was decoded.
#[derive(Clone, Debug, PartialEq)]
pub struct TakenPiece {
    /// Index of the source.
    pub source: u32,
    /// Report on its points, without those outside of the lattice.
    pub report: ReadReport,
    /// What the metadata keep of the source; with its first piece alone.
    pub kept: Option<SourceKept>,
}

/// What a take has found.
pub struct Summary {
    /// Bytes of a row.
    pub row_bytes: u64,
    /// Cells, along the Morton curve.
    pub cells: Vec<CellRows>,
    /// Hash of the points.
    pub hash: MultisetHash,
    /// Range of each attribute.
    pub ranges: Ranges,
    /// Whether the position of the scanner is known for all points.
    pub knows_scanners: bool,
    /// Pieces, in order.
    pub pieces: Vec<TakenPiece>,
    /// Strays.
    pub aside: Vec<SetAside>,
    /// Densities, if the build computes attributes.
    pub densities: Option<Densities>,
    /// Colours that occur, as numbers of 24 bits, with the number of their points, if the build has
    /// a palette; none if no class has colours.
    pub colours: Option<Vec<[u32; 2]>>,
}

impl SourceKept {
    /// What the metadata keep of an opened source.
    pub fn of(info: &SourceInfo) -> Self {
        let crs =
            |crs: &esker_scan::Crs| CrsRecord { text: crs.text.clone(), unit: crs.unit.clone() };
        Self {
            format: info.format.clone(),
            crs: info.crs.as_ref().map(crs),
            notes: info.notes.clone(),
            verbatim: info.verbatim.clone(),
        }
    }

    /// Adds it to a record.
    pub fn put(&self, record: &mut Record) {
        record.put_all(self.format.as_bytes());
        record.put(u8::from(self.crs.is_some()));
        if let Some(crs) = &self.crs {
            record.put_all(crs.text.as_bytes());
            record.put(u8::from(crs.unit.is_some()));
            crs.unit.iter().for_each(|unit| record.put_all(unit.as_bytes()));
        }
        record.put(self.notes.len() as u64);
        self.notes.iter().for_each(|note| record.put_all(note.as_bytes()));
        record.put(self.verbatim.len() as u64);
        for (name, bytes) in &self.verbatim {
            record.put_all(name.as_bytes());
            record.put_all(bytes);
        }
    }

    /// Reads it from a record; `None` if the record is damaged.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let format = from.get_text()?;
        let crs = if from.get::<u8>()? > 0 {
            let text = from.get_text()?;
            let unit = if from.get::<u8>()? > 0 { Some(from.get_text()?) } else { None };
            Some(CrsRecord { text, unit })
        } else {
            None
        };
        let notes = from.get::<u64>()?;
        let notes = (0..notes).map(|_| from.get_text()).collect::<Option<_>>()?;
        let blocks = from.get::<u64>()?;
        let block = |_| Some((from.get_text()?, from.get_all()?));
        Some(Self { format, crs, notes, verbatim: (0..blocks).map(block).collect::<Option<_>>()? })
    }
}

impl CellRows {
    fn put(&self, record: &mut Record) {
        record.put(self.cell.corner);
        record.put(self.cell.log2);
        record.put([self.offset, self.rows]);
        record.put(self.crc);
    }

    fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let cell = Cell { corner: from.get()?, log2: from.get()? };
        let [offset, rows] = from.get()?;
        Some(Self { cell, offset, rows, crc: from.get()? }).filter(|own| own.cell.is_valid())
    }
}

/// Adds ranges of attributes to a record.
pub fn put_ranges(ranges: &Ranges, attributes: usize, record: &mut Record) {
    let pairs: Vec<[f64; 2]> = (0..attributes).map(|a| ranges.of(a).into()).collect();
    record.put_all(&pairs);
}

/// Reads ranges of so many attributes from a record; `None` if it is damaged.
pub fn ranges(from: &mut RecordReader<'_>, attributes: usize) -> Option<Ranges> {
    let pairs: Vec<[f64; 2]> = from.get_all()?;
    let is_whole = pairs.len() == attributes;
    is_whole.then(|| Ranges::from_pairs(pairs.into_iter().map(Into::into).collect()))
}

/// Adds strays to a record.
pub fn put_aside(aside: &[SetAside], record: &mut Record) {
    Outside::of_aside(aside.to_vec()).put(0, record);
}

/// Reads strays from a record; `None` if it is damaged.
pub fn aside(from: &mut RecordReader<'_>) -> Option<Vec<SetAside>> {
    let mut outside = Outside::default();
    outside.restore(from)?;
    Some(outside.aside)
}

impl Summary {
    /// Bytes of the tail, for a schema of so many attributes.
    pub fn seal(&self, attributes: usize) -> Vec<u8> {
        let mut record = Record::new(Kind::Take);
        record.put(ORDER);
        record.put([self.row_bytes, self.cells.len() as u64]);
        self.cells.iter().for_each(|cell| cell.put(&mut record));
        record.put(self.hash.0);
        put_ranges(&self.ranges, attributes, &mut record);
        record.put(u8::from(self.knows_scanners));
        record.put(self.pieces.len() as u64);
        for piece in &self.pieces {
            record.put(piece.source);
            put_report(&piece.report, &mut record);
            record.put(u8::from(piece.kept.is_some()));
            piece.kept.iter().for_each(|kept| kept.put(&mut record));
        }
        put_aside(&self.aside, &mut record);
        record.put(u8::from(self.densities.is_some()));
        self.densities.iter().for_each(|densities| densities.put(&mut record));
        record.put(u8::from(self.colours.is_some()));
        self.colours.iter().for_each(|colours| record.put_all(colours));
        record.seal()
    }

    /// Reads the tail; `None` if it is damaged, or of another byte order.
    fn unsealed(tail: &[u8], attributes: usize) -> Option<Self> {
        let mut from = unsealed(tail, Kind::Take)?;
        from.get::<u32>().filter(|&order| order == ORDER)?;
        let [row_bytes, cells] = from.get()?;
        let cells = (0..cells).map(|_| CellRows::get(&mut from)).collect::<Option<_>>()?;
        let hash = MultisetHash(from.get()?);
        let ranges = ranges(&mut from, attributes)?;
        let knows_scanners = from.get::<u8>()? > 0;
        let mut pieces = Vec::new();
        for _ in 0..from.get::<u64>()? {
            let (source, report) = (from.get()?, report(&mut from)?);
            let kept = if from.get::<u8>()? > 0 { Some(SourceKept::get(&mut from)?) } else { None };
            pieces.push(TakenPiece { source, report, kept });
        }
        let aside = aside(&mut from)?;
        let has_densities = from.get::<u8>()? > 0;
        let densities = if has_densities { Some(Densities::get(&mut from)?) } else { None };
        let colours = if from.get::<u8>()? > 0 { Some(from.get_all()?) } else { None };
        Some(Self {
            row_bytes,
            cells,
            hash,
            ranges,
            knows_scanners,
            pieces,
            aside,
            densities,
            colours,
        })
    }

    /// Reads what a take has found.
    ///
    /// # Errors
    /// If its object is missing, cut short or damaged.
    pub fn read(
        record: &StepRecord,
        place: &dyn Place,
        index: u32,
        attributes: usize,
    ) -> Result<Self, BuildError> {
        let step = Step::Take(index);
        let tail = record.tail(place, step)?;
        let summary = Self::unsealed(&tail, attributes);
        // Rows follow each other without gaps, up to the tail.
        let is_sound = |summary: &Self| {
            let mut end = 0u64;
            let follows = summary.cells.iter().all(|cell| {
                let is_next = cell.offset == end;
                end = end.saturating_add(cell.rows.saturating_mul(summary.row_bytes));
                is_next
            });
            let points = summary.pieces.iter().map(|piece| piece.report.points).sum::<u64>();
            follows && end == record.tail && points == summary.rows()
        };
        summary.filter(is_sound).ok_or_else(|| record.damaged(place, step))
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.cells.iter().map(|cell| cell.rows).fold(0, u64::saturating_add)
    }
}
