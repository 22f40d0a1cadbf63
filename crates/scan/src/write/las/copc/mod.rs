//! Writes COPC 1.0: LAZ 1.4 of point formats 6 to 8 whose chunks are voxels of an octree
//! (<https://copc.io>). Chunks come in any order, each compressed by a [`ChunkWriter`] on any
//! thread; where they lie is written behind them ([`hierarchy`]). Header, VLRs and records are
//! those of a LAZ export ([`super::plan`]), with the record of the octree before all others.
//!
//! Faces of the cube lie half a step beside the lattice, so that no point lies on the face of a
//! voxel that is a step or larger, whatever a reader makes of faces.

mod chunk;
mod hierarchy;

use super::plan::{self, LasPlan, Variant};
use super::totals::{self, Totals};
use super::{Changes, write_records};
use crate::error::ScanError;
use crate::las::vlr::Vlr;
use crate::write::encode::{Encode, Origins, Outline};
use crate::write::las::order::Ordered;
use crate::write::partial::Partial;
use esker_points::lattice::ORIGIN;
use esker_points::{Cell, Grid, Lattice};
use laz::LazVlr;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

pub use chunk::{Chunk, ChunkWriter, Compression};
pub use hierarchy::VoxelKey;

/// End of the names of COPC files.
const ENDING: &str = ".copc.laz";
/// Size of the header, which the octree's record follows.
const HEADER_BYTES: u16 = 375;
/// Size of the data of the octree's record.
const INFO_BYTES: usize = 160;
/// User of the records of COPC.
const USER: &str = "copc";
const INFO_RECORD: u16 = 1;
const HIERARCHY_RECORD: u16 = 1000;
/// Size of the head of an EVLR.
const EVLR_HEAD_BYTES: usize = 60;

/// Whether the name of a file is that of COPC.
pub fn is_named(path: &Path) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase());
    name.is_some_and(|name| name.ends_with(ENDING))
}

/// The cube of an octree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Octree {
    /// The cell of the root, in lattice coordinates.
    pub root: Cell,
    /// Typical distance of the points of the root, in the unit of the coordinates. That of a voxel
    /// is half that of its parent.
    pub spacing: f64,
}

impl Octree {
    /// The cell of a voxel.
    pub fn cell(&self, key: VoxelKey) -> Cell {
        let log2 = u32::from(self.root.log2).saturating_sub(key.level);
        let place = |axis: usize| {
            let steps = u64::from(key.place[axis]) << log2;
            self.root.corner[axis].wrapping_add(steps as u32)
        };
        Cell { corner: [0, 1, 2].map(place), log2: log2 as u8 }
    }

    /// Centre of the cube and half its edge.
    fn cube(&self, grid: &Grid) -> ([f64; 3], f64) {
        // Whole and half steps below 2^33 are exact.
        let half = self.root.edge() as f64 / 2.0;
        let centre = |axis: usize| {
            let steps = f64::from(self.root.corner[axis]) - ORIGIN as f64 + half - 0.5;
            steps * grid.scale[axis] + grid.offset[axis]
        };
        ([0, 1, 2].map(centre), half * grid.scale[0])
    }
}

/// A COPC file that is being written.
pub struct CopcExport {
    /// Encodes batches of points to records.
    pub encode: Arc<dyn Encode>,
    /// Compresses them.
    pub compression: Compression,
    /// Writes the chunks.
    pub output: CopcOutput,
    /// The format, version and variant.
    pub format: String,
    /// For each attribute, the index of its field, as in [`crate::write::Export`].
    pub fields: Vec<usize>,
    /// Differences from the sources, a line each.
    pub notes: Vec<String>,
}

/// Begins a COPC file. `crs` is the coordinate reference system to state in place of the sources',
/// in WKT.
///
/// # Errors
/// If the axes of the lattice have different scales, the sources' coordinate reference system is
/// not WKT, the file cannot be written or LAS cannot hold the attributes.
pub fn create(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
    octree: Octree,
    crs: Option<&str>,
) -> Result<CopcExport, ScanError> {
    check_cubes(path, &outline.lattice)?;
    let plan = plan::plan(path, outline, origins, Variant::Copc(crs))?;
    let LasPlan { mut header, vlrs, records, laszip, notes, .. } = plan;
    let laszip = laszip.ok_or_else(|| ScanError::unsupported(path, "is not compressed"))?;
    header.resize(usize::from(HEADER_BYTES), 0);
    header[25] = 4;
    header[94..96].copy_from_slice(&HEADER_BYTES.to_le_bytes());
    let (behind, mut before): (Vec<Vlr>, Vec<Vlr>) = vlrs.into_iter().partition(Vlr::is_extended);
    before.insert(0, Vlr::new(USER, INFO_RECORD, "COPC info", vec![0; INFO_BYTES]));
    let mut file = Partial::create(path)?;
    let vlr_bytes: usize = before.iter().map(|v| v.head.len() + v.data.len()).sum();
    let points_start = header.len() + vlr_bytes;
    let written = file.write_all(&header);
    written.map_err(|e| file.error(e))?;
    write_records(&mut file, &before)?;
    // Filled in at the end: the place of the chunk table.
    file.write_all(&[0; 8]).map_err(|e| file.error(e))?;
    header.extend_from_slice(&before[0].head);
    let changes = Changes::of(&records);
    let format = format!("COPC 1.0 (LAZ 1.4), point format {}", records.point_format);
    let fields = records.fields();
    let grid = totals::grid(&outline.lattice);
    let compression = Compression::new(&laszip, records.record_bytes, path);
    let output = CopcOutput {
        file,
        changes: changes.clone(),
        octree,
        grid,
        head: header,
        points_start: points_start as u32,
        vlrs: before.len() as u32,
        evlrs: behind,
        laszip,
        end: points_start as u64 + 8,
        table: ChunkTable::default(),
        entries: BTreeMap::new(),
        totals: Totals::new(grid),
        times: None,
    };
    let encode = Arc::new(Ordered { records, negative_zeros: changes.negative_zeros });
    Ok(CopcExport { encode, compression, output, format, fields, notes })
}

/// Refuses a lattice whose cells are no cubes.
///
/// # Errors
/// If the scales of its axes differ.
fn check_cubes(path: &Path, lattice: &Lattice) -> Result<(), ScanError> {
    let [x, y, z] = lattice.scale;
    if lattice.scale.iter().all(|s| s.to_bits() == x.to_bits()) {
        return Ok(());
    }
    let what = format!(
        "voxels of COPC are cubes, but the steps of these coordinates are {x}, {y} and {z}: \
         transform the scans to one step on all axes (and out of degrees, if they are) and build \
         them again, or export as .laz"
    );
    Err(ScanError::unsupported(path, what))
}

/// Writes chunks, and at the end what says where they lie. If it is dropped before
/// [`CopcOutput::finish`], no file is left.
pub struct CopcOutput {
    file: Partial,
    changes: Changes,
    octree: Octree,
    grid: Grid,
    /// Header, and head of the octree's record.
    head: Vec<u8>,
    points_start: u32,
    vlrs: u32,
    evlrs: Vec<Vlr>,
    laszip: LazVlr,
    /// Offset behind the last chunk.
    end: u64,
    table: ChunkTable,
    entries: BTreeMap<VoxelKey, hierarchy::Entry>,
    totals: Totals,
    /// Least and greatest GPS time.
    times: Option<[f64; 2]>,
}

impl CopcOutput {
    /// Writes the chunk of a voxel. Chunks without points take no place.
    ///
    /// # Errors
    /// If the file cannot be written, or the voxel has a chunk already.
    pub fn put(&mut self, key: VoxelKey, chunk: &Chunk) -> Result<(), ScanError> {
        if chunk.points == 0 {
            return Ok(());
        }
        let entry = hierarchy::Entry {
            offset: self.end,
            bytes: chunk.bytes.len() as i32,
            points: chunk.points as i32,
        };
        if self.entries.insert(key, entry).is_some() {
            let twice = std::io::Error::other("a voxel has two chunks");
            return Err(self.file.error(twice));
        }
        self.file.write_all(&chunk.bytes).map_err(|e| self.file.error(e))?;
        let bytes = chunk.bytes.len() as u64;
        self.end += bytes;
        self.table.push(ChunkTableEntry { point_count: chunk.points, byte_count: bytes });
        self.totals.add(&chunk.summary());
        self.times = self.times.into_iter().chain(chunk.times).reduce(chunk::joined_times);
        Ok(())
    }

    /// What was changed in the points written so far, a line each.
    pub fn remarks(&self) -> Vec<String> {
        self.changes.remarks()
    }

    /// Writes the remaining bytes, flushes them to the disk and renames the file to its final name;
    /// returns its size in bytes.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<u64, ScanError> {
        let written = self.table.write_to(&mut self.file, &self.laszip);
        written.map_err(|e| self.file.error(e))?;
        let records_start = self.file.stream_position().map_err(|e| self.file.error(e))?;
        let pages_start = records_start + EVLR_HEAD_BYTES as u64;
        let pages = hierarchy::pages(std::mem::take(&mut self.entries), pages_start);
        let hierarchy = Vlr {
            user: USER.to_owned(),
            record: HIERARCHY_RECORD,
            head: evlr_head(HIERARCHY_RECORD, "COPC hierarchy", pages.bytes.len() as u64),
            data: pages.bytes,
        };
        write_records(&mut self.file, &[hierarchy])?;
        write_records(&mut self.file, &self.evlrs)?;
        self.file
            .seek(SeekFrom::Start(self.points_start.into()))
            .and_then(|_| self.file.write_all(&self.end.to_le_bytes()))
            .map_err(|e| self.file.error(e))?;
        let header = &mut self.head[..usize::from(HEADER_BYTES)];
        self.totals.fill(header, self.points_start, self.vlrs, false);
        header[235..243].copy_from_slice(&records_start.to_le_bytes());
        header[243..247].copy_from_slice(&(self.evlrs.len() as u32 + 1).to_le_bytes());
        let (centre, halfsize) = self.octree.cube(&self.grid);
        let mut info = Vec::with_capacity(INFO_BYTES);
        for value in centre.into_iter().chain([halfsize, self.octree.spacing]) {
            info.extend_from_slice(&value.to_le_bytes());
        }
        info.extend_from_slice(&pages_start.to_le_bytes());
        info.extend_from_slice(&pages.root_bytes.to_le_bytes());
        for time in self.times.unwrap_or([0.0; 2]) {
            info.extend_from_slice(&time.to_le_bytes());
        }
        info.resize(INFO_BYTES, 0);
        self.head.extend_from_slice(&info);
        self.file.finish(&self.head)
    }
}

/// Head of an EVLR of COPC with `bytes` bytes of data.
fn evlr_head(record: u16, description: &str, bytes: u64) -> Vec<u8> {
    let mut head = vec![0; EVLR_HEAD_BYTES];
    head[2..2 + USER.len()].copy_from_slice(USER.as_bytes());
    head[18..20].copy_from_slice(&record.to_le_bytes());
    head[20..28].copy_from_slice(&bytes.to_le_bytes());
    head[28..28 + description.len()].copy_from_slice(description.as_bytes());
    head
}
