//! Directory of a page: one entry a plane with kind, encoding, offset, length and checksum. The
//! order of planes and their offsets are checked against the layout.

use crate::bytes::{u16_at, u32_at};
use crate::codec::Encoding;
use crate::error::Fault;
use crate::layout::{
    ALIGNMENT, DIRECTORY_ENTRY_BYTES, DIRECTORY_HEAD_BYTES, PageLayout, PlaneSpec,
};
use std::ops::Range;

/// First bytes of every page.
pub const PAGE_MAGIC: [u8; 4] = *b"ESPG";

/// One plane of one page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Encoding of the values.
    pub encoding: Encoding,
    /// Offset from the start of the page, bytes.
    pub offset: u32,
    /// Length on disk, bytes.
    pub bytes: u32,
    /// CRC-32 of these bytes.
    pub crc: u32,
}

impl Entry {
    /// Byte range in the page.
    pub fn range(&self) -> Range<usize> {
        self.offset as usize..self.offset as usize + self.bytes as usize
    }
}

/// Directory of one page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Directory {
    /// One entry a plane, in the layout's order.
    pub entries: Vec<Entry>,
}

impl Directory {
    /// Bytes of the directory for a page of `points` points.
    pub(crate) fn encode(&self, layout: &PageLayout, points: usize) -> Vec<u8> {
        let mut out = Vec::with_capacity(layout.directory_bytes());
        out.extend_from_slice(&PAGE_MAGIC);
        out.extend_from_slice(&(points as u32).to_le_bytes());
        out.extend_from_slice(&(self.entries.len() as u16).to_le_bytes());
        out.extend_from_slice(&[0; 2]);
        for (plane, entry) in layout.planes().iter().zip(&self.entries) {
            out.extend_from_slice(&plane.kind.number().to_le_bytes());
            out.extend_from_slice(&plane.kind.attribute().to_le_bytes());
            out.push(entry.encoding.number());
            out.extend_from_slice(&[0; 3]);
            for field in [entry.offset, entry.bytes, entry.crc] {
                out.extend_from_slice(&field.to_le_bytes());
            }
        }
        let crc = crc32fast::hash(&out);
        out.extend_from_slice(&crc.to_le_bytes());
        out
    }

    /// Reads and checks the directory at the start of `page` (at least
    /// [`PageLayout::directory_bytes`] long) of a node with `points` points, whose page has
    /// `page_bytes`.
    pub(crate) fn decode(
        layout: &PageLayout,
        page: &[u8],
        points: usize,
        hot_shift: u8,
        page_bytes: u32,
    ) -> Result<Self, Fault> {
        let fault = |what: &str| Err(Fault::new("directory", what));
        let Some(bytes) = page.get(..layout.directory_bytes()) else {
            return fault("the page is shorter than its directory");
        };
        let (body, crc) = bytes.split_at(bytes.len() - 4);
        if u32_at(crc, 0) != crc32fast::hash(body) {
            return fault("its checksum does not match");
        }
        let count = usize::from(u16_at(body, 8));
        if body[..4] != PAGE_MAGIC || u16_at(body, 10) != 0 || count != layout.planes().len() {
            return fault("it is not that of a page of this file");
        }
        if u32_at(body, 4) as usize != points {
            return fault("its count of points is not that of the node");
        }
        let mut end = layout.directory_bytes() as u64;
        let mut entries = Vec::with_capacity(count);
        let records = body[DIRECTORY_HEAD_BYTES..].chunks_exact(DIRECTORY_ENTRY_BYTES);
        for (plane, record) in layout.planes().iter().zip(records) {
            let entry = decode_entry(plane, record, points, hot_shift)?;
            if u64::from(entry.offset) != end.next_multiple_of(ALIGNMENT) {
                return fault("a plane is not where it should be");
            }
            end = u64::from(entry.offset) + u64::from(entry.bytes);
            entries.push(entry);
        }
        if end.next_multiple_of(ALIGNMENT) != u64::from(page_bytes) {
            return fault("the planes do not fill the page");
        }
        Ok(Self { entries })
    }
}

fn decode_entry(
    plane: &PlaneSpec,
    record: &[u8],
    points: usize,
    hot_shift: u8,
) -> Result<Entry, Fault> {
    let fault = |what: &str| Err(Fault::new("directory", what));
    if u16_at(record, 0) != plane.kind.number() || u16_at(record, 2) != plane.kind.attribute() {
        return fault("a plane is not of the kind that the metadata lists");
    }
    if record[5..8] != [0; 3] {
        return fault("reserved bytes are not zero");
    }
    let entry = Entry {
        encoding: Encoding::from_number(record[4]),
        offset: u32_at(record, 8),
        bytes: u32_at(record, 12),
        crc: u32_at(record, 16),
    };
    if !plane.hot && !plane.kind.is_written() {
        return Ok(entry);
    }
    let raw_bytes = PageLayout::raw_bytes(plane, points, hot_shift);
    let bytes = u64::from(entry.bytes);
    let fits = match entry.encoding {
        Encoding::Raw => bytes == raw_bytes,
        _ if plane.hot => return fault("a hot plane is not raw"),
        Encoding::Constant => bytes == u64::from(plane.value_bytes),
        Encoding::Lz4 | Encoding::Zstd => bytes < raw_bytes,
        Encoding::Unknown(_) => true,
    };
    if !fits {
        return fault("a plane's length does not suit the node's points");
    }
    Ok(entry)
}
