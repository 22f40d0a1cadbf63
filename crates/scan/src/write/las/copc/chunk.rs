//! Compresses the points of a voxel to a chunk of LAZ, batch after batch: only the compressed bytes
//! are kept, so that a voxel may have more points than memory holds.

use super::super::totals::joined;
use crate::error::ScanError;
use crate::write::encode::Encoded;
use esker_points::Cell;
use laz::record::{LayeredPointRecordCompressor, RecordCompressor};
use laz::{LazItem, LazVlr};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes of the GPS time in records of point formats 6 to 10.
const TIME: std::ops::Range<usize> = 22..30;
/// Greatest number of points, and of bytes, of a chunk: entries of the hierarchy have 31 bits.
const CHUNK_MAX: u64 = i32::MAX as u64;

/// How records are compressed.
#[derive(Clone, Debug)]
pub struct Compression {
    items: Arc<Vec<LazItem>>,
    record_bytes: usize,
    path: Arc<PathBuf>,
}

/// The compressed points of a voxel.
#[derive(Clone, Debug, Default)]
pub struct Chunk {
    /// Number of points.
    pub points: u64,
    /// Their compressed bytes.
    pub bytes: Vec<u8>,
    /// Least and greatest GPS time that is a number.
    pub(super) times: Option<[f64; 2]>,
    bounds: Option<[[u32; 3]; 2]>,
    by_return: [u64; 15],
}

impl Chunk {
    /// Its counts and bounds, without bytes.
    pub(super) fn summary(&self) -> Encoded {
        Encoded {
            points: self.points,
            bytes: Vec::new(),
            bounds: self.bounds,
            by_return: self.by_return,
        }
    }
}

/// Compresses the points of a voxel.
pub struct ChunkWriter {
    chunk: Chunk,
    compressor: LayeredPointRecordCompressor<'static, Cursor<Vec<u8>>>,
    compression: Compression,
    cell: Cell,
}

impl ChunkWriter {
    /// A chunk without points, of a voxel with this cell.
    ///
    /// # Errors
    /// If records of this layout cannot be compressed.
    pub fn new(compression: &Compression, cell: Cell) -> Result<Self, ScanError> {
        let mut compressor = LayeredPointRecordCompressor::new(Cursor::default());
        let refused = |e: laz::LasZipError| {
            ScanError::unsupported(&compression.path, format!("cannot be compressed: {e}"))
        };
        compressor.set_fields_from(&compression.items).map_err(refused)?;
        Ok(Self { chunk: Chunk::default(), compressor, compression: compression.clone(), cell })
    }

    /// Appends points.
    ///
    /// # Errors
    /// If there are more than a chunk holds, or some lie outside of the voxel.
    pub fn put(&mut self, points: &Encoded) -> Result<(), ScanError> {
        let chunk = &mut self.chunk;
        chunk.points += points.points;
        if chunk.points > CHUNK_MAX {
            return Err(self.compression.too_large());
        }
        if points.bounds.iter().flatten().any(|&corner| !self.cell.contains(corner)) {
            let what = "points lie outside of the cell of their node: the file that is exported is damaged";
            return Err(ScanError::damaged(&self.compression.path, what));
        }
        for (sum, n) in chunk.by_return.iter_mut().zip(points.by_return) {
            *sum += n;
        }
        chunk.bounds = chunk.bounds.into_iter().chain(points.bounds).reduce(joined);
        for record in points.bytes.chunks_exact(self.compression.record_bytes) {
            let time = f64::from_le_bytes(record[TIME].try_into().unwrap_or([0; 8]));
            if time.is_finite() {
                let times = chunk.times.into_iter().chain([[time; 2]]);
                chunk.times = times.reduce(joined_times);
            }
            let done = self.compressor.compress_next(record);
            done.map_err(|e| ScanError::write(&self.compression.path, e))?;
        }
        Ok(())
    }

    /// Ends the chunk.
    ///
    /// # Errors
    /// If it has more bytes than the hierarchy can state.
    pub fn finish(mut self) -> Result<Chunk, ScanError> {
        let done = self.compressor.done();
        done.map_err(|e| ScanError::write(&self.compression.path, e))?;
        self.chunk.bytes = std::mem::take(self.compressor.get_mut()).into_inner();
        if self.chunk.bytes.len() as u64 > CHUNK_MAX {
            return Err(self.compression.too_large());
        }
        Ok(self.chunk)
    }
}

impl Compression {
    /// Compression of records of the file at `path`.
    pub(super) fn new(laszip: &LazVlr, record_bytes: usize, path: &Path) -> Self {
        let items = Arc::new(laszip.items().clone());
        Self { items, record_bytes, path: Arc::new(path.to_owned()) }
    }

    fn too_large(&self) -> ScanError {
        let what = "a voxel has more than 2,147,483,647 points or bytes, which COPC cannot state: export as .laz";
        ScanError::unsupported(&self.path, what)
    }
}

/// The range around two ranges.
pub(super) fn joined_times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}
