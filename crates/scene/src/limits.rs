//! Version and length of the documents that this crate reads and writes.

/// Version of the documents that this crate reads and writes.
pub const VERSION: u32 = 1;
/// Most bytes of a document. Polygons and skies given by numbers make documents long.
pub const BYTES_MAX: u64 = 16 << 20;
/// Mark that some editors write at the start of a text.
pub(crate) const BOM: &str = "\u{feff}";
