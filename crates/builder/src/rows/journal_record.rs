//! The bytes of a journal's records. Numbers are as the machine has them: only the machine that
//! wrote a journal goes on from it.

use bytemuck::{AnyBitPattern, NoUninit};

/// What a record tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// What is built: options, inputs, where scratch lies. The first one.
    Begun = 1,
    /// What is known of the inputs beyond their headers; what was taken in before is void.
    Known,
    /// Points of the inputs have gone to scratch.
    Taken,
    /// The typical distance of points is known, which normals are estimated by.
    Spaced,
    /// The palette of compact planes is known.
    Trained,
    /// What chunks need of each other to estimate normals is put aside in scratch.
    Aside,
    /// A bucket was parted, and its parts have gone to scratch.
    Parted,
    /// A chunk is built, and its pages are in the file.
    Built,
}

/// Bytes before the content: its length, its CRC-32, its kind.
pub const HEAD_BYTES: usize = 13;

/// A record being made.
pub struct Record(Vec<u8>);

impl Record {
    /// An empty one.
    pub fn new(kind: Kind) -> Self {
        let mut bytes = vec![0; HEAD_BYTES];
        bytes[HEAD_BYTES - 1] = kind as u8;
        Self(bytes)
    }

    /// Adds a number, or some of fixed count.
    pub fn put(&mut self, value: impl NoUninit) {
        self.0.extend_from_slice(bytemuck::bytes_of(&value));
    }

    /// Adds numbers, and how many they are.
    pub fn put_all(&mut self, values: &[impl NoUninit]) {
        self.put(values.len() as u64);
        self.0.extend_from_slice(bytemuck::cast_slice(values));
    }

    /// Adds what another has.
    pub fn append(&mut self, other: &Self) {
        self.0.extend_from_slice(&other.0[HEAD_BYTES..]);
    }

    /// Its bytes in the journal.
    pub fn seal(mut self) -> Vec<u8> {
        let bytes = (self.0.len() - HEAD_BYTES) as u64;
        let crc = crc32fast::hash(&self.0[HEAD_BYTES - 1..]);
        self.0[..8].copy_from_slice(&bytes.to_le_bytes());
        self.0[8..12].copy_from_slice(&crc.to_le_bytes());
        self.0
    }
}

/// What is left to read of a record. `None` where it is shorter than what is asked for.
pub struct Reading<'a>(pub &'a [u8]);

impl Reading<'_> {
    fn take(&mut self, bytes: usize) -> Option<&[u8]> {
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(taken)
    }

    /// A number, or some of fixed count.
    pub fn get<T: AnyBitPattern>(&mut self) -> Option<T> {
        self.take(size_of::<T>()).map(bytemuck::pod_read_unaligned)
    }

    /// Numbers, as many as the record says.
    pub fn get_all<T: AnyBitPattern>(&mut self) -> Option<Vec<T>> {
        let count = usize::try_from(self.get::<u64>()?).ok()?;
        let bytes = self.take(count.checked_mul(size_of::<T>())?)?;
        Some(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
    }

    /// A text.
    pub fn get_text(&mut self) -> Option<String> {
        String::from_utf8(self.get_all()?).ok()
    }
}
