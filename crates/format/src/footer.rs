//! Header and footer: fixed records at both ends of the file. The footer has version, counts,
//! sections and checksums; its hash identifies the file in forests.

use crate::bytes::{u32_at, u64_at};
use esker_points::MultisetHash;
use xxhash_rust::xxh3::xxh3_128;

/// Versions that this crate reads and writes: 2 where coordinates are scaled to lengths, else 1.
pub const VERSIONS: std::ops::RangeInclusive<u32> = 1..=2;
/// First bytes of the file, chosen so that a transfer as text damages them.
pub const HEADER_MAGIC: [u8; 8] = *b"\x89ESKER\r\n";
/// First bytes of the footer.
pub const FOOTER_MAGIC: [u8; 8] = *b"ESKEREND";
/// Bytes of the header; the pages begin here.
pub const HEADER_BYTES: usize = 64;
/// Bytes of the footer, the last of the file.
pub const FOOTER_BYTES: usize = 192;

/// Byte range and checksum of a part of the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// First byte.
    pub offset: u64,
    /// Length, bytes.
    pub bytes: u64,
    /// CRC-32 of its bytes.
    pub crc: u32,
}

impl Section {
    /// First byte after the section, if it fits 64 bits.
    pub fn end(&self) -> Option<u64> {
        self.offset.checked_add(self.bytes)
    }
}

/// The footer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footer {
    /// Version of the format.
    pub version: u32,
    /// Number of points.
    pub points: u64,
    /// Number of nodes.
    pub nodes: u64,
    /// Multiset hash of all points.
    pub hash: MultisetHash,
    /// Greatest distance by which a coordinate was rounded, along one axis, in the file's unit.
    pub rounding_error_max: f64,
    /// Intended greatest number of points of a node.
    pub node_capacity: u32,
    /// The node table.
    pub table: Section,
    /// Statistics.
    pub statistics: Section,
    /// Schema and metadata, JSON.
    pub metadata: Section,
    /// Blocks of the sources kept verbatim.
    pub verbatim: Section,
    /// Bytes of the whole file.
    pub file_bytes: u64,
}

impl Footer {
    /// Bytes of the footer.
    pub fn encode(&self) -> [u8; FOOTER_BYTES] {
        let mut out = Vec::with_capacity(FOOTER_BYTES);
        out.extend_from_slice(&FOOTER_MAGIC);
        out.extend_from_slice(&self.version.to_le_bytes());
        out.extend_from_slice(&(FOOTER_BYTES as u32).to_le_bytes());
        out.extend_from_slice(&self.points.to_le_bytes());
        out.extend_from_slice(&self.nodes.to_le_bytes());
        out.extend_from_slice(&self.hash.0.to_le_bytes());
        out.extend_from_slice(&self.rounding_error_max.to_le_bytes());
        out.extend_from_slice(&self.node_capacity.to_le_bytes());
        out.extend_from_slice(&[0; 4]);
        for s in [self.table, self.statistics, self.metadata, self.verbatim] {
            out.extend_from_slice(&s.offset.to_le_bytes());
            out.extend_from_slice(&s.bytes.to_le_bytes());
            out.extend_from_slice(&s.crc.to_le_bytes());
            out.extend_from_slice(&[0; 4]);
        }
        out.extend_from_slice(&self.file_bytes.to_le_bytes());
        sealed(&out)
    }

    /// Reads and checks a footer.
    ///
    /// # Errors
    /// [`FooterFault`].
    pub fn decode(bytes: &[u8; FOOTER_BYTES]) -> Result<Self, FooterFault> {
        if bytes[..8] != FOOTER_MAGIC {
            return Err(FooterFault::None("it has no footer"));
        }
        if !is_sealed(bytes) {
            return Err(FooterFault::None("the footer's checksum does not match"));
        }
        let version = u32_at(bytes, 8);
        if !VERSIONS.contains(&version) || u32_at(bytes, 12) as usize != FOOTER_BYTES {
            return Err(FooterFault::Version(version));
        }
        let section = |at: usize| Section {
            offset: u64_at(bytes, at),
            bytes: u64_at(bytes, at + 8),
            crc: u32_at(bytes, at + 16),
        };
        let footer = Self {
            version,
            points: u64_at(bytes, 16),
            nodes: u64_at(bytes, 24),
            hash: MultisetHash(u128::from(u64_at(bytes, 32)) | u128::from(u64_at(bytes, 40)) << 64),
            rounding_error_max: f64::from_bits(u64_at(bytes, 48)),
            node_capacity: u32_at(bytes, 56),
            table: section(64),
            statistics: section(88),
            metadata: section(112),
            verbatim: section(136),
            file_bytes: u64_at(bytes, 160),
        };
        // Bytes outside of the fields must be zero: then the footer's bytes follow from its fields.
        if footer.encode() != *bytes {
            return Err(FooterFault::None("the footer's reserved bytes are not zero"));
        }
        Ok(footer)
    }

    /// Identity of the file in forests: XXH3-128 of the footer's bytes.
    pub fn name_hash(&self) -> u128 {
        xxh3_128(&self.encode())
    }
}

/// Reason why some bytes are not a footer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FooterFault {
    /// There is no valid footer.
    None(&'static str),
    /// The file has another version.
    Version(u32),
}

/// The header of a version: magic, version, zeros, checksum.
pub fn header(version: u32) -> [u8; HEADER_BYTES] {
    let mut out = HEADER_MAGIC.to_vec();
    out.extend_from_slice(&version.to_le_bytes());
    out.extend_from_slice(&(HEADER_BYTES as u32).to_le_bytes());
    sealed(&out)
}

/// Returns `body`, zeros, and the CRC-32 of both.
fn sealed<const N: usize>(body: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    out[..body.len()].copy_from_slice(body);
    let crc = crc32fast::hash(&out[..N - 4]);
    out[N - 4..].copy_from_slice(&crc.to_le_bytes());
    out
}

fn is_sealed(bytes: &[u8]) -> bool {
    let (body, crc) = bytes.split_at(bytes.len() - 4);
    crc32fast::hash(body) == u32_at(crc, 0)
}
