//! Writes LAS and LAZ: header and VLRs, points in the order in which they come, EVLRs; bounds and
//! counts are filled in at the end (LAS 1.4 R15, tables 3 to 5). Decisions before the first point
//! are made in [`plan`], records are encoded in [`records`].
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

mod order;
mod plan;
mod records;

use crate::error::ScanError;
use crate::las::vlr::Vlr;
use crate::write::encode::{Encode, Encoded, Export, Origins, Outline, Output};
use crate::write::partial::Partial;
use esker_points::Grid;
use laz::{LazVlr, ParLasZipCompressor};
use order::Ordered;
use plan::{LasPlan, is_1_4, minor};
use records::raw;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

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
    let plan = plan::plan(path, outline, origins, is_compressed)?;
    let LasPlan { header, vlrs, tail, records, laszip, notes } = plan;
    let format = format!(
        "{} 1.{}, point format {}",
        if is_compressed { "LAZ" } else { "LAS" },
        minor(&header),
        records.point_format
    );
    let fields = records.fields();
    let lattice = &outline.lattice;
    let moved = |i: usize| lattice.shift[i] as f64 * lattice.scale[i] + lattice.offset[i];
    let offset =
        [0, 1, 2].map(|i| if lattice.shift[i] == 0 { lattice.offset[i] } else { moved(i) });
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
    let output = LasOutput {
        points,
        is_legacy: records.point_format < 6,
        filled: records.filled.clone(),
        negative_zeros: Arc::default(),
        grid: Grid { scale: lattice.scale, offset },
        header,
        points_start: head.len() as u32,
        vlrs: before.len() as u32,
        evlrs: behind,
        count: 0,
        by_return: [0; 15],
        bounds: None,
    };
    let encode: Arc<dyn Encode> = if is_compressed {
        Arc::new(Ordered { records, negative_zeros: output.negative_zeros.clone() })
    } else {
        Arc::new(records)
    };
    Ok(Export { encode, output: Box::new(output), format, fields, notes })
}

enum Points {
    Plain(Partial),
    Compressed(Compressor),
}

/// A file whose header and points are being written.
struct LasOutput {
    points: Points,
    is_legacy: bool,
    filled: Option<Arc<AtomicU64>>,
    negative_zeros: Arc<AtomicU64>,
    grid: Grid,
    header: Vec<u8>,
    points_start: u32,
    vlrs: u32,
    evlrs: Vec<Vlr>,
    count: u64,
    by_return: [u64; 15],
    bounds: Option<[[u32; 3]; 2]>,
}

impl Output for LasOutput {
    fn put(&mut self, points: Encoded) -> Result<(), ScanError> {
        self.count += points.points;
        for (sum, n) in self.by_return.iter_mut().zip(points.by_return) {
            *sum += n;
        }
        self.bounds = self.bounds.into_iter().chain(points.bounds).reduce(|a, b| {
            [[0, 1, 2].map(|i| a[0][i].min(b[0][i])), [0, 1, 2].map(|i| a[1][i].max(b[1][i]))]
        });
        match &mut self.points {
            Points::Plain(file) => file.write_all(&points.bytes).map_err(|e| file.error(e)),
            Points::Compressed(compressor) => compressor.put(&points.bytes),
        }
    }

    fn remarks(&self) -> Vec<String> {
        let filled = self.filled.as_ref().map_or(0, |n| n.load(Ordering::Relaxed));
        let zeros = self.negative_zeros.load(Ordering::Relaxed);
        let notes = [
            (filled, "points without a return number are written as return 1"),
            (zeros, "GPS times of -0 are written as 0"),
        ];
        notes.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect()
    }

    fn finish(mut self: Box<Self>) -> Result<u64, ScanError> {
        self.fill();
        let mut file = match self.points {
            Points::Plain(file) => file,
            Points::Compressed(compressor) => compressor.finish()?,
        };
        if !self.evlrs.is_empty() && is_1_4(&self.header) {
            let start = file.seek(SeekFrom::End(0)).map_err(|e| file.error(e))?;
            self.header[235..243].copy_from_slice(&start.to_le_bytes());
            self.header[243..247].copy_from_slice(&(self.evlrs.len() as u32).to_le_bytes());
            for v in &self.evlrs {
                let written = file.write_all(&v.head).and_then(|()| file.write_all(&v.data));
                written.map_err(|e| file.error(e))?;
            }
        }
        file.finish(&self.header)
    }
}

impl LasOutput {
    /// Fills in the header's fields that are known when all points are written.
    fn fill(&mut self) {
        let is_1_4 = is_1_4(&self.header);
        let has_waveforms = minor(&self.header) >= 3 && self.header.len() >= 235;
        let header = &mut self.header;
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(96, &self.points_start.to_le_bytes());
        put(100, &self.vlrs.to_le_bytes());
        // Formats 6 to 10 have no counts of 32 bits.
        let legacy = |n: u64| {
            let fits = self.is_legacy && self.count <= u64::from(u32::MAX);
            if fits || !is_1_4 { n.min(u64::from(u32::MAX)) as u32 } else { 0 }
        };
        put(107, &legacy(self.count).to_le_bytes());
        for i in 0..5 {
            put(111 + 4 * i, &legacy(self.by_return[i]).to_le_bytes());
        }
        for axis in 0..3 {
            let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
            put(131 + 8 * axis, &scale.to_le_bytes());
            put(155 + 8 * axis, &offset.to_le_bytes());
            let bound = |end: usize| match self.bounds {
                None => offset,
                Some(bounds) => f64::from(raw(bounds[end][axis])) * scale + offset,
            };
            put(179 + 16 * axis, &bound(1).to_le_bytes());
            put(187 + 16 * axis, &bound(0).to_le_bytes());
        }
        if has_waveforms {
            // Waveform packets are not kept.
            put(227, &0u64.to_le_bytes());
        }
        if is_1_4 {
            put(235, &[0; 12]);
            put(247, &self.count.to_le_bytes());
            for (i, n) in self.by_return.iter().enumerate() {
                put(255 + 8 * i, &n.to_le_bytes());
            }
        }
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
