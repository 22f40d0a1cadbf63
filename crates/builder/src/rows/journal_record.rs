//! The bytes of the journal's records. Numbers are in the byte order of the machine: a build can be
//! resumed only on the machine that wrote the journal.

use bytemuck::{AnyBitPattern, NoUninit};

/// Kinds of records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Options, inputs and the path of scratch. The first record.
    Start = 1,
    /// Corrected bounds and colour depths of the inputs. Makes all earlier records of rows void.
    Inputs,
    /// Rows of the inputs that are in scratch.
    Rows,
    /// The typical distance of points, which the reach of normals depends on.
    Distances,
    /// The palette of compact planes.
    Palette,
    /// Points near the borders of chunks, stored in scratch for the estimation of normals.
    Borders,
    /// Rows of a bucket that were split into smaller cells and are in scratch again.
    Split,
    /// A chunk whose pages are in the file.
    Chunk,
    /// What a take of a divided build has found, behind its rows.
    Take,
    /// The cut of a divided build: sums over all takes, and its parts.
    Cut,
    /// The cells of a part of a divided build.
    Part,
    /// The places of the parts that a job of a divided build has built.
    Built,
}

/// Bytes before the content: its length, its CRC-32, its kind.
pub const HEAD_BYTES: usize = 13;

/// A record being written.
pub struct Record(Vec<u8>);

impl Record {
    /// An empty record.
    pub fn new(kind: Kind) -> Self {
        let mut bytes = vec![0; HEAD_BYTES];
        bytes[HEAD_BYTES - 1] = kind as u8;
        Self(bytes)
    }

    /// Adds a number, or an array of numbers.
    pub fn put(&mut self, value: impl NoUninit) {
        self.0.extend_from_slice(bytemuck::bytes_of(&value));
    }

    /// Adds the number of `values`, then the values.
    pub fn put_all(&mut self, values: &[impl NoUninit]) {
        self.put(values.len() as u64);
        self.0.extend_from_slice(bytemuck::cast_slice(values));
    }

    /// Adds the content of another record.
    pub fn append(&mut self, other: &Self) {
        self.0.extend_from_slice(&other.0[HEAD_BYTES..]);
    }

    /// Writes length and CRC-32, and returns the bytes for the journal.
    pub fn seal(mut self) -> Vec<u8> {
        let bytes = (self.0.len() - HEAD_BYTES) as u64;
        let crc = crc32fast::hash(&self.0[HEAD_BYTES - 1..]);
        self.0[..8].copy_from_slice(&bytes.to_le_bytes());
        self.0[8..12].copy_from_slice(&crc.to_le_bytes());
        self.0
    }
}

/// The content of a sealed record; `None` unless it is whole and of this kind.
pub fn unsealed(bytes: &[u8], kind: Kind) -> Option<RecordReader<'_>> {
    let (head, content) = bytes.split_first_chunk::<HEAD_BYTES>()?;
    let [length @ .., a, b, c, d, found] = *head;
    let is_whole = u64::from_le_bytes(length) == content.len() as u64;
    let is_sound = crc32fast::hash(&bytes[HEAD_BYTES - 1..]).to_le_bytes() == [a, b, c, d];
    (is_whole && is_sound && found == kind as u8).then_some(RecordReader(content))
}

/// Reads the content of a record. All methods return `None` if the rest is too short.
pub struct RecordReader<'a>(pub &'a [u8]);

impl RecordReader<'_> {
    fn take(&mut self, bytes: usize) -> Option<&[u8]> {
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(taken)
    }

    /// Reads a number, or an array of numbers.
    pub fn get<T: AnyBitPattern>(&mut self) -> Option<T> {
        self.take(size_of::<T>()).map(bytemuck::pod_read_unaligned)
    }

    /// Reads values that [`Record::put_all`] added.
    pub fn get_all<T: AnyBitPattern>(&mut self) -> Option<Vec<T>> {
        let count = usize::try_from(self.get::<u64>()?).ok()?;
        let bytes = self.take(count.checked_mul(size_of::<T>())?)?;
        Some(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
    }

    /// Reads a text.
    pub fn get_text(&mut self) -> Option<String> {
        String::from_utf8(self.get_all()?).ok()
    }
}
