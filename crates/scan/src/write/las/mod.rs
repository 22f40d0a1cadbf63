//! Writes LAS and LAZ: header and VLRs, points in the order in which they come, EVLRs; bounds and
//! counts are filled in at the end (LAS 1.4 R15, tables 3 to 5). Decisions before the first point
//! are made in [`plan`], records are encoded in [`records`]. [`copc`] writes LAZ with an octree.
//!
//! - Sources with the same record layout keep it, and with it version, point format and extra
//!   bytes. The header and the global encoding are those of the first source, in byte order of
//!   paths; the bit of GPS times is that of the first source with GPS times; scale and offset are
//!   the lattice's.
//! - VLRs and EVLRs are those of the first source, then those of others that it lacks; those of a
//!   coordinate reference system are of one source only. Indices into the order of points (COPC,
//!   LAX) are left out, since the order changes; so are waveform packets, which Esker does not
//!   keep.
//! - Other sources get the least point format with a field for every attribute, and version 1.4,
//!   unless all are LAS of formats 0 to 5. Attributes without a field become extra bytes; colours
//!   of 8 bits are multiplied by 256, as the specification asks. Points without the number of a
//!   return are return 1.

pub mod copc;
mod order;
mod plan;
mod records;
mod system;
mod totals;

use crate::error::ScanError;
use crate::las::vlr::Vlr;
use crate::write::encode::{Encode, Encoded, Export, Origin, Origins, Outline, Output};
use crate::write::partial::Partial;
use esker_points::Grid;
use laz::{LazVlr, ParLasZipCompressor};
use order::Ordered;
use plan::{LasPlan, is_1_4, minor};
use records::Records;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use totals::Totals;

pub use plan::Variant;

/// Points in a chunk of LAZ.
const CHUNK_POINTS: usize = 50_000;
/// Chunks that a thread compresses in one call.
const CHUNKS_A_THREAD: usize = 2;

/// Begins a file.
///
/// # Errors
/// If it cannot be written or LAS cannot hold the attributes.
pub fn create(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
    is_compressed: bool,
) -> Result<Export, ScanError> {
    let variant = if is_compressed { Variant::Laz } else { Variant::Las };
    let plan = plan::plan(path, outline, origins, variant)?;
    let LasPlan { header, vlrs, tail, records, laszip, notes } = plan;
    let format = format!(
        "{} 1.{}, point format {}",
        if is_compressed { "LAZ" } else { "LAS" },
        minor(&header),
        records.point_format
    );
    let fields = records.fields();
    let (behind, before): (Vec<Vlr>, Vec<Vlr>) = vlrs.into_iter().partition(Vlr::is_extended);
    let mut file = Partial::create(path)?;
    let mut head = header.clone();
    for v in &before {
        head.extend_from_slice(&v.head);
        head.extend_from_slice(&v.data);
    }
    head.extend_from_slice(&tail);
    file.write_all(&head).map_err(|e| file.error(e))?;
    let points = match laszip {
        None => Points::Plain(file),
        Some(laszip) => Points::Compressed(Compressor::new(file, laszip, path)?),
    };
    let changes = Changes::of(&records);
    let output = LasOutput {
        points,
        is_legacy: records.point_format < 6,
        changes: changes.clone(),
        header,
        points_start: head.len() as u32,
        vlrs: before.len() as u32,
        evlrs: behind,
        totals: Totals::new(totals::grid(&outline.lattice)),
    };
    let encode: Arc<dyn Encode> = if is_compressed {
        Arc::new(Ordered { records, negative_zeros: changes.negative_zeros })
    } else {
        Arc::new(records)
    };
    Ok(Export { encode, output: Box::new(output), format, fields, notes })
}

/// Encoder of the records that an export has, and what decides their layout.
pub struct RecordEncoder {
    /// Encodes batches of the outline's attributes to records, which are not compressed.
    pub encode: Arc<dyn Encode>,
    /// Point format, 0 to 10.
    pub point_format: u8,
    /// Size of a record, in bytes.
    pub record_bytes: usize,
    /// Scale and offset of the coordinates.
    pub grid: Grid,
    /// Descriptions of the extra bytes.
    pub extra_bytes: Vec<u8>,
}

/// The encoder of an export in a variant of LAS that would be at `path`; nothing is written.
///
/// # Errors
/// If a source cannot be read or LAS cannot hold the attributes.
pub fn record_encoder(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
    variant: Variant<'_>,
) -> Result<RecordEncoder, ScanError> {
    let LasPlan { vlrs, records, .. } = plan::plan(path, outline, origins, variant)?;
    let described = vlrs.iter().find(|v| v.user == "LASF_Spec" && v.record == 4);
    let changes = Changes::of(&records);
    let (point_format, record_bytes) = (records.point_format, records.record_bytes);
    let encode: Arc<dyn Encode> = match variant {
        Variant::Las => Arc::new(records),
        _ => Arc::new(Ordered { records, negative_zeros: changes.negative_zeros }),
    };
    Ok(RecordEncoder {
        encode,
        point_format,
        record_bytes,
        grid: totals::grid(&outline.lattice),
        extra_bytes: described.map_or_else(Vec::new, |v| v.data.clone()),
    })
}

/// The variant of LAS that a source is, if it is LAS.
pub fn variant_of(source: &Origin) -> Option<Variant<'_>> {
    let header = source.block("las header")?;
    // Bytes of the LAS header; upper bits of the point format say that points are compressed.
    let is_compressed = header.get(104)? & 0xc0 != 0;
    let first_user = source.block("las vlrs").and_then(|vlrs| vlrs.get(2..7));
    Some(match (is_compressed, first_user) {
        (true, Some(b"copc\0")) => Variant::Copc(source.crs.as_ref().map(|crs| crs.text.as_str())),
        (true, _) => Variant::Laz,
        (false, _) => Variant::Las,
    })
}

/// Counts of values that were changed for the format.
#[derive(Clone)]
struct Changes {
    filled: Option<Arc<AtomicU64>>,
    negative_zeros: Arc<AtomicU64>,
}

impl Changes {
    fn of(records: &Records) -> Self {
        Self { filled: records.filled.clone(), negative_zeros: Arc::default() }
    }

    /// What was changed so far, a line each.
    fn remarks(&self) -> Vec<String> {
        let filled = self.filled.as_ref().map_or(0, |n| n.load(Ordering::Relaxed));
        let zeros = self.negative_zeros.load(Ordering::Relaxed);
        let notes = [
            (filled, "points without a return number are written as return 1"),
            (zeros, "GPS times of -0 are written as 0"),
        ];
        notes.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect()
    }
}

/// Writes records with their heads.
fn write_records(file: &mut Partial, records: &[Vlr]) -> Result<(), ScanError> {
    for v in records {
        let written = file.write_all(&v.head).and_then(|()| file.write_all(&v.data));
        written.map_err(|e| file.error(e))?;
    }
    Ok(())
}

enum Points {
    Plain(Partial),
    Compressed(Compressor),
}

/// A file whose header and points are being written.
struct LasOutput {
    points: Points,
    is_legacy: bool,
    changes: Changes,
    header: Vec<u8>,
    points_start: u32,
    vlrs: u32,
    evlrs: Vec<Vlr>,
    totals: Totals,
}

impl Output for LasOutput {
    fn put(&mut self, points: Encoded) -> Result<(), ScanError> {
        self.totals.add(&points);
        match &mut self.points {
            Points::Plain(file) => file.write_all(&points.bytes).map_err(|e| file.error(e)),
            Points::Compressed(compressor) => compressor.put(&points.bytes),
        }
    }

    fn remarks(&self) -> Vec<String> {
        self.changes.remarks()
    }

    fn finish(mut self: Box<Self>) -> Result<u64, ScanError> {
        let (start, vlrs, is_legacy) = (self.points_start, self.vlrs, self.is_legacy);
        self.totals.fill(&mut self.header, start, vlrs, is_legacy);
        let mut file = match self.points {
            Points::Plain(file) => file,
            Points::Compressed(compressor) => compressor.finish()?,
        };
        if !self.evlrs.is_empty() && is_1_4(&self.header) {
            let start = file.seek(SeekFrom::End(0)).map_err(|e| file.error(e))?;
            self.header[235..243].copy_from_slice(&start.to_le_bytes());
            self.header[243..247].copy_from_slice(&(self.evlrs.len() as u32).to_le_bytes());
            write_records(&mut file, &self.evlrs)?;
        }
        file.finish(&self.header)
    }
}

/// Compresses records, several chunks in parallel on the current rayon pool.
struct Compressor {
    inner: Box<ParLasZipCompressor<Partial>>,
    gathered: Vec<u8>,
    chunk_bytes: usize,
    path: std::path::PathBuf,
}

impl Compressor {
    fn new(file: Partial, laszip: LazVlr, path: &Path) -> Result<Self, ScanError> {
        let chunk_bytes = CHUNK_POINTS * laszip.items_size() as usize;
        let mut inner = ParLasZipCompressor::new(file, laszip)
            .map_err(|e| ScanError::unsupported(path, e.to_string()))?;
        inner.reserve_offset_to_chunk_table().map_err(|e| ScanError::write(path, e))?;
        let inner = Box::new(inner);
        Ok(Self { inner, gathered: Vec::new(), chunk_bytes, path: path.to_owned() })
    }

    fn put(&mut self, records: &[u8]) -> Result<(), ScanError> {
        self.gathered.extend_from_slice(records);
        let at_once = rayon::current_num_threads() * CHUNKS_A_THREAD * self.chunk_bytes;
        if self.gathered.len() < at_once {
            return Ok(());
        }
        // Whole chunks only: the compressor would process a remainder on one core.
        let whole = self.gathered.len() / at_once * at_once;
        let written = self.inner.compress_many(&self.gathered[..whole]);
        self.gathered.drain(..whole);
        written.map_err(|e| ScanError::write(&self.path, e))
    }

    fn finish(mut self) -> Result<Partial, ScanError> {
        let written = self.inner.compress_many(&self.gathered);
        let written = written.and_then(|()| self.inner.done().map_err(io_error_of));
        written.map_err(|e| ScanError::write(&self.path, e))?;
        Ok(self.inner.into_inner())
    }
}

/// The system's error behind one of the compressor, which hides its kind.
fn io_error_of(error: laz::LasZipError) -> std::io::Error {
    match error {
        laz::LasZipError::IoError(source) => source,
        other => std::io::Error::other(other),
    }
}
