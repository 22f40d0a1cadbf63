//! Reads COPC files by voxels: the cube of the octree, pages of its hierarchy, and chunks of points
//! (<https://copc.io>). The chunk table is not needed, so that opening takes a few reads whatever
//! the size of the file.

use super::about::{FORMAT_NAME, HEAD_BYTES, extra_attributes, source_info};
use super::decode::{Points, WINDOW_BYTES_MAX};
use super::header::Header;
use super::laszip::{self, Chunk, Compression};
use super::points::{Layout, raw_position};
use super::vlr::{Kept, Records};
use crate::error::ScanError;
use crate::las::header::{f64_at, u64_at};
use crate::source::{OpenOptions, SourceInfo};
use crate::write::las::copc::VoxelKey;
use esker_points::read_at::{Input, ReadAt};
use esker_points::{ColourDepth, Column};
use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::Arc;

/// User of the records of COPC, and the number of that of the octree.
const USER: &str = "copc";
const INFO_RECORD: u16 = 1;
/// Bytes of the octree's record.
const INFO_BYTES: usize = 160;
/// Bytes of an entry of the hierarchy.
const ENTRY_BYTES: usize = 32;
/// Greatest size of a page, bytes: a million voxels. Writers make pages of a few thousand.
const PAGE_BYTES_MAX: u64 = (ENTRY_BYTES as u64) << 20;
/// Greatest number of points of a chunk, and greatest size of its records. Writers keep to a
/// hundred thousand points.
const CHUNK_POINTS_MAX: i32 = 1 << 24;
const RAW_BYTES_MAX: u64 = 1 << 30;

/// A range of bytes of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// First byte.
    pub offset: u64,
    /// Length, bytes.
    pub bytes: u64,
}

/// What an entry of the hierarchy says of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// Its chunk, and the number of points in it: none for voxels that only have others below.
    Chunk(Place, u32),
    /// The page that has its entry and those below it.
    Page(Place),
}

/// Points of a chunk, in the file's order.
#[derive(Clone, Debug)]
pub struct ChunkPoints {
    /// Integers of the file.
    pub positions: Vec<[i32; 3]>,
    /// Values of each attribute of the schema.
    pub columns: Vec<Column>,
    /// Greatest value of red, green and blue; 0 without colours.
    pub colour_max: u16,
}

/// An opened COPC file.
pub struct CopcFile {
    source: Arc<dyn ReadAt>,
    points: Points,
    compression: Compression,
    layout: Layout,
    info: SourceInfo,
    centre: [f64; 3],
    half_edge: f64,
    spacing: f64,
    root_page: Place,
    /// Size of the file.
    bytes: u64,
    /// Its first bytes.
    head: Vec<u8>,
}

/// Whether a file that begins with these bytes is COPC.
pub fn recognises(head: &[u8]) -> bool {
    // The octree's record is the first one, right behind the header of LAS 1.4.
    head.starts_with(b"LASF") && head.get(377..381) == Some(b"copc") && head.get(393) == Some(&1)
}

impl CopcFile {
    /// Opens `source`, which `path` names.
    ///
    /// # Errors
    /// If it is no COPC file, is damaged or cannot be read.
    pub fn open(
        path: &Path,
        source: Arc<dyn ReadAt>,
        options: &OpenOptions,
    ) -> Result<Self, ScanError> {
        let io = |e| ScanError::io(path, e);
        let mut file = Input::new(source.clone()).map_err(io)?;
        let bytes = file.end();
        let mut head = Vec::new();
        file.by_ref().take(HEAD_BYTES).read_to_end(&mut head).map_err(io)?;
        let header = Header::parse(&head, bytes, path)?;
        let mut notes = Vec::new();
        let kept = Kept::WithoutHierarchy;
        let records = Records::read_kept(&mut file, &header, bytes, path, &mut notes, kept)?;
        let damaged = |what: &str| ScanError::damaged(path, what);
        let info = records.find(USER, INFO_RECORD).filter(|v| v.data.len() >= INFO_BYTES);
        let octree = info.ok_or_else(|| damaged("has no whole record of a COPC octree"))?;
        let number = |i: usize| f64_at(&octree.data, i * 8);
        let (centre, half_edge, spacing) = ([0, 1, 2].map(number), number(3), number(4));
        let is_cube = centre.iter().all(|c| c.is_finite()) && half_edge.is_finite();
        if !is_cube || half_edge <= 0.0 {
            return Err(damaged("the cube of its COPC octree is no cube: build it instead"));
        }
        let root_page = Place { offset: u64_at(&octree.data, 40), bytes: u64_at(&octree.data, 48) };
        let vlr = laszip::record(&records).filter(|_| header.is_compressed);
        let vlr = vlr.ok_or_else(|| damaged("is COPC, but its points are not compressed"))?;
        let compression = Compression::without_table(vlr, &header, bytes, path)?;
        let points = Points {
            path: path.to_owned(),
            start: header.points_start + 8,
            count: header.points,
            record_bytes: header.record_bytes,
            compression: None,
            window_bytes_max: WINDOW_BYTES_MAX,
            one_in: 1,
        };
        let extra = extra_attributes(&header, &records, path, &mut notes)?;
        let layout = Layout::new(header.point_format, header.record_bytes, extra);
        let colour_depth =
            layout.rgb_offset.map(|_| options.colour_depth.unwrap_or(ColourDepth::Sixteen));
        let format =
            format!("{FORMAT_NAME} 1.{}, point format {}", header.minor, header.point_format);
        let info = source_info(path, format, &header, &layout, bytes, (records, notes));
        let info = SourceInfo { points_hint: header.points, colour_depth, ..info };
        let opened = Self {
            source,
            points,
            compression,
            layout,
            info,
            centre,
            half_edge,
            spacing,
            root_page,
            bytes,
            head,
        };
        opened.check_page(root_page)?;
        Ok(opened)
    }

    /// What is known of it. Colours of 16 bits are taken to be such, unless options say otherwise.
    pub fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// Number of points of all voxels.
    pub fn points(&self) -> u64 {
        self.points.count
    }

    /// Whether its first bytes are not those that it was opened with.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn is_changed(&self) -> std::io::Result<bool> {
        let mut head = vec![0; self.head.len()];
        self.source.read_exact_at(&mut head, 0)?;
        Ok(head != self.head)
    }

    /// Centre of the cube and half its edge, in the file's unit.
    pub fn cube(&self) -> ([f64; 3], f64) {
        (self.centre, self.half_edge)
    }

    /// Typical distance of the points of the root, in the file's unit: that of each level is half
    /// that of the one above. Zero or less if the writer did not know.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The page of the hierarchy that has the root.
    pub fn root_page(&self) -> Place {
        self.root_page
    }

    /// Reads a page of the hierarchy.
    ///
    /// # Errors
    /// If it cannot be read, or names places that are none.
    pub fn page(&self, place: Place) -> Result<Vec<(VoxelKey, Entry)>, ScanError> {
        self.check_page(place)?;
        let mut bytes = vec![0; place.bytes as usize];
        self.source.read_exact_at(&mut bytes, place.offset).map_err(|e| self.points.io(e))?;
        bytes.as_chunks::<ENTRY_BYTES>().0.iter().map(|entry| self.entry(entry)).collect()
    }

    fn check_page(&self, place: Place) -> Result<(), ScanError> {
        let is_inside = place.offset.checked_add(place.bytes).is_some_and(|end| end <= self.bytes);
        let is_whole = place.bytes.is_multiple_of(ENTRY_BYTES as u64) && place.bytes > 0;
        if is_inside && is_whole && place.bytes <= PAGE_BYTES_MAX {
            return Ok(());
        }
        let Place { offset, bytes } = place;
        Err(self.damaged(format!("it has no page of its hierarchy of {bytes} bytes at {offset}")))
    }

    fn entry(&self, bytes: &[u8; ENTRY_BYTES]) -> Result<(VoxelKey, Entry), ScanError> {
        let number = |i: usize| {
            let word = bytes[i * 4..].first_chunk().copied().unwrap_or_default();
            i32::from_le_bytes(word)
        };
        let key = [0, 1, 2, 3].map(number);
        let [level, x, y, z] = key.map(i32::cast_unsigned);
        let is_key = (0..=VoxelKey::LEVEL_MAX as i32).contains(&key[0])
            && key[1..].iter().all(|&at| at >= 0 && i64::from(at) < 1 << key[0]);
        let (offset, size, points) = (u64_at(bytes, 16), number(6), number(7));
        let place = Place { offset, bytes: size.max(0) as u64 };
        let key = VoxelKey { level, place: [x, y, z] };
        let what = format!("{points} points in {size} bytes at {offset}");
        let wrong = |why: &str| {
            let VoxelKey { level, place: [x, y, z] } = key;
            Err(self
                .damaged(format!("the voxel {level}-{x}-{y}-{z} of its hierarchy, {what}: {why}")))
        };
        if !is_key {
            return wrong("it is no voxel");
        }
        match points {
            -1 if size > 0 => Ok((key, Entry::Page(place))),
            0 => Ok((key, Entry::Chunk(Place { offset: 0, bytes: 0 }, 0))),
            1..=CHUNK_POINTS_MAX if size > 0 => {
                let end = place.offset.checked_add(place.bytes);
                let raw_bytes = points as u64 * self.points.record_bytes as u64;
                match end.filter(|&end| place.offset >= self.points.start && end <= self.bytes) {
                    None => wrong("the file has no such bytes; it is cut short or damaged"),
                    Some(_) if raw_bytes > RAW_BYTES_MAX => {
                        wrong("too large to be read as a whole; build it instead")
                    }
                    Some(_) => Ok((key, Entry::Chunk(place, points as u32))),
                }
            }
            1.. => wrong("too many points to be read as a whole, or no bytes"),
            _ => wrong("no number of points"),
        }
    }

    /// Reads the compressed bytes of a chunk.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn chunk(&self, place: Place) -> Result<Vec<u8>, ScanError> {
        let mut bytes = vec![0; place.bytes as usize];
        self.source.read_exact_at(&mut bytes, place.offset).map_err(|e| self.points.io(e))?;
        Ok(bytes)
    }

    /// Says which chunks are read next.
    pub fn will_read(&self, places: &[Place]) {
        let ranges = places.iter().map(|p| p.offset..p.offset.saturating_add(p.bytes));
        self.source.will_read(&ranges.collect::<Vec<_>>());
    }

    /// Ends the reads that wait now ([`ReadAt::interrupt`]).
    pub fn interrupt(&self) {
        self.source.interrupt();
    }

    /// Requests made and bytes received so far, if it is at an address ([`ReadAt::traffic`]).
    pub fn traffic(&self) -> Option<[u64; 2]> {
        self.source.traffic()
    }

    /// Number of threads that should read at the same time, if the place of the file tells.
    pub fn readers(&self) -> Option<usize> {
        self.source.readers()
    }

    /// Decodes the compressed bytes of a chunk of `points` points.
    ///
    /// # Errors
    /// If they are damaged.
    pub fn decode(&self, compressed: &[u8], points: u32) -> Result<ChunkPoints, ScanError> {
        let bytes = compressed.len() as u64;
        let layers = self.compression.layers.unwrap_or(0);
        self.points.check_layers(compressed, bytes, layers, points.into())?;
        let head = laszip::layered_chunk(compressed, self.points.record_bytes, layers);
        if head.is_some_and(|Chunk { points: claimed, .. }| claimed != points) {
            return Err(self.damaged(format!("a chunk has more than its {points} points")));
        }
        let mut decoder = self.points.decoder(&self.compression, Cursor::new(compressed), 0)?;
        let mut records = vec![0; points as usize * self.points.record_bytes];
        self.points.guarded(0, || decoder.decompress_many(&mut records))?;
        let positions = records.chunks_exact(self.points.record_bytes).map(raw_position);
        Ok(ChunkPoints {
            positions: positions.collect(),
            columns: self.layout.columns(&records),
            colour_max: self.layout.colour_max(&records),
        })
    }

    fn damaged(&self, what: String) -> ScanError {
        self.points.damaged(what)
    }
}
