//! Reads the octree of a COPC file by its specification, and checks what holds of every such file.
#![allow(clippy::unwrap_used, reason = "tests may unwrap")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

use laz::laszip::ChunkTable;
use laz::{LasZipDecompressor, LazVlr};
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, SeekFrom};
use std::path::Path;

/// Level, x, y and z of a voxel.
pub type Key = [i32; 4];

/// Offset, size and number of points of a chunk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    pub offset: u64,
    pub bytes: i32,
    pub points: i32,
}

/// What a COPC file holds.
pub struct Octree {
    pub entries: BTreeMap<Key, Entry>,
    /// Raw coordinates of all points, by the voxel of each chunk.
    pub points: BTreeMap<Key, Vec<[i32; 3]>>,
    pub point_format: u8,
    pub spacing: f64,
    pub halfsize: f64,
    /// Scale and offset.
    pub grid: [[f64; 3]; 2],
    pub pages: usize,
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes[at..at + N].try_into().unwrap()
}

fn double(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(number(bytes, at))
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(number(bytes, at))
}

fn int(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(number(bytes, at))
}

/// Data of the VLRs by user and number; the first must be that of the octree.
fn vlrs(bytes: &[u8]) -> BTreeMap<(String, u16), Vec<u8>> {
    let mut at = 375;
    let mut all = BTreeMap::new();
    for i in 0..int(bytes, 100) {
        let user = String::from_utf8_lossy(&bytes[at + 2..at + 18]);
        let user = user.trim_end_matches('\0').to_owned();
        let record = u16::from_le_bytes(number(bytes, at + 18));
        let size = usize::from(u16::from_le_bytes(number(bytes, at + 20)));
        assert!(i > 0 || (user == "copc" && record == 1 && size == 160), "{user} {record} {size}");
        all.insert((user, record), bytes[at + 54..at + 54 + size].to_vec());
        at += 54 + size;
    }
    assert_eq!(at, int(bytes, 96) as usize, "points follow the VLRs");
    all
}

/// Adds the entries of a page and of those below it.
fn walk(bytes: &[u8], (at, size): (usize, usize), octree: &mut Octree) {
    octree.pages += 1;
    assert_eq!(size % 32, 0);
    for entry in bytes[at..at + size].chunks_exact(32) {
        let key = [0, 4, 8, 12].map(|at| int(entry, at));
        let found =
            Entry { offset: long(entry, 16), bytes: int(entry, 24), points: int(entry, 28) };
        if found.points == -1 {
            walk(bytes, (found.offset as usize, found.bytes as usize), octree);
        } else {
            assert!(octree.entries.insert(key, found).is_none(), "{key:?} twice");
        }
    }
}

fn parent([level, x, y, z]: Key) -> Key {
    [level - 1, x >> 1, y >> 1, z >> 1]
}

impl Octree {
    /// Reads and checks a file: header and records as the specification has them; every voxel once
    /// and with all its ancestors; chunks without gaps, as the chunk table has them; every point in
    /// the voxel of its chunk, and not on a face; counts, bounds and times those of the points.
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        assert_eq!((&bytes[..4], &bytes[24..26]), (&b"LASF"[..], &[1, 4][..]));
        assert_eq!((u16::from_le_bytes(number(&bytes, 94)), bytes[104] & 0xc0), (375, 0x80));
        let info = 375 + 54;
        assert!(bytes[info + 72..info + 160].iter().all(|&b| b == 0), "reserved");
        let triple = |at: usize| [0, 8, 16].map(|i| double(&bytes, at + i));
        let mut octree = Self {
            entries: BTreeMap::new(),
            points: BTreeMap::new(),
            point_format: bytes[104] & 0x3f,
            spacing: double(&bytes, info + 32),
            halfsize: double(&bytes, info + 24),
            grid: [triple(131), triple(155)],
            pages: 0,
        };
        assert!((6..=8).contains(&octree.point_format));
        assert!(octree.spacing > 0.0 && octree.halfsize > 0.0);
        let root = (long(&bytes, info + 40) as usize, long(&bytes, info + 48) as usize);
        walk(&bytes, root, &mut octree);
        for (key, entry) in &octree.entries {
            assert!(key[0] == 0 || octree.entries.contains_key(&parent(*key)), "{key:?}");
            assert!(entry.points > 0 || (entry.offset, entry.bytes) == (0, 0), "{entry:?}");
        }
        octree.read_points(&bytes, triple(info));
        octree
    }

    fn read_points(&mut self, bytes: &[u8], centre: [f64; 3]) {
        let laszip = &vlrs(bytes)[&("laszip encoded".to_owned(), 22204)];
        let laszip = LazVlr::read_from(&laszip[..]).unwrap();
        assert!(laszip.uses_variable_size_chunks());
        let start = int(bytes, 96) as u64;
        let mut file = Cursor::new(bytes);
        file.seek(SeekFrom::Start(start)).unwrap();
        let table = ChunkTable::read_from(&mut file, &laszip).unwrap();
        let mut chunks: Vec<(Key, Entry)> = self.entries.iter().map(|(k, e)| (*k, *e)).collect();
        chunks.retain(|(_, entry)| entry.points > 0);
        chunks.sort_by_key(|(_, entry)| entry.offset);
        assert_eq!(chunks.len(), table.len());
        let count: u64 = chunks.iter().map(|(_, entry)| entry.points as u64).sum();
        assert_eq!(count, long(bytes, 247));
        file.seek(SeekFrom::Start(start)).unwrap();
        let mut reader =
            (count > 0).then(|| LasZipDecompressor::new(file, laszip.clone()).unwrap());
        let mut record = vec![0; laszip.items_size() as usize];
        let (mut end, mut times) = (start + 8, Vec::new());
        for ((key, entry), listed) in chunks.into_iter().zip(&table) {
            assert_eq!((entry.offset, entry.bytes as u64), (end, listed.byte_count));
            assert_eq!(entry.points as u64, listed.point_count);
            end += listed.byte_count;
            let edge = 2.0 * self.halfsize / 2f64.powi(key[0]);
            for _ in 0..entry.points {
                reader.as_mut().unwrap().decompress_one(&mut record).unwrap();
                let raw = [0, 4, 8].map(|at| int(&record, at));
                for axis in 0..3 {
                    let world = self.world(raw, axis);
                    let low = centre[axis] - self.halfsize + f64::from(key[axis + 1]) * edge;
                    assert!(low < world && world < low + edge, "{key:?}: {world} from {low}");
                }
                times.push(double(&record, 22));
                self.points.entry(key).or_default().push(raw);
            }
        }
        times.retain(|time| time.is_finite());
        let range = |pick: fn(f64, f64) -> f64| times.iter().copied().reduce(pick).unwrap_or(0.0);
        let stated = [56, 64].map(|at| double(bytes, 375 + 54 + at));
        assert_eq!(stated, [range(f64::min), range(f64::max)]);
        for axis in 0..3 {
            let all = self.points.values().flatten().map(|&raw| self.world(raw, axis));
            let bounds = [187, 179].map(|at| double(bytes, at + 16 * axis));
            let least = all.clone().reduce(f64::min);
            let found = least.map(|least| [least, all.reduce(f64::max).unwrap()]);
            assert!(found.is_none_or(|found| found == bounds), "{found:?} {bounds:?}");
        }
    }

    fn world(&self, raw: [i32; 3], axis: usize) -> f64 {
        f64::from(raw[axis]) * self.grid[0][axis] + self.grid[1][axis]
    }

    /// Number of entries without points.
    pub fn empty(&self) -> usize {
        self.entries.values().filter(|entry| entry.points == 0).count()
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.points.values().map(Vec::len).sum()
    }

    /// Greatest level.
    pub fn depth(&self) -> i32 {
        self.entries.keys().map(|key| key[0]).max().unwrap()
    }

    /// All raw coordinates, sorted.
    pub fn sorted(&self) -> Vec<[i32; 3]> {
        let mut all: Vec<_> = self.points.values().flatten().copied().collect();
        all.sort_unstable();
        all
    }
}
