//! Files that are compressed as a whole, with zstd (RFC 8878) or gzip (RFC 1952): in a path, out
//! the stream of what they hold. Formats that are read from front to back are read from it; the
//! others need the file itself.

use crate::error::ScanError;
use crate::source::HEAD_BYTES;
use esker_points::read_at::{Input, is_remote};
use flate2::bufread::MultiGzDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result as IoResult};
use std::path::Path;

/// How a file is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    Zstd,
    Gzip,
}

/// File name extensions of compressed files, which follow that of the format.
pub(crate) const ENDINGS: [&str; 3] = ["zst", "zstd", "gz"];

/// Largest zstd window: 2^25 bytes, what level 20 needs; more would break the bound on memory.
const ZSTD_WINDOW_LOG_MAX: u32 = 25;
/// Bytes read from the file at once.
pub(crate) const READ_BYTES: usize = 256 << 10;
/// Decompressed bytes that a compressed one may stand for, beyond the first [`FREE_BYTES`]. Gzip
/// reaches 1032; a small file could otherwise keep a reader busy for hours.
const BYTES_A_BYTE_MAX: u64 = 1 << 11;
const FREE_BYTES: u64 = 64 << 20;

impl Packing {
    /// Packing of a file that begins with `head`.
    fn of(head: &[u8]) -> Option<Self> {
        match head {
            [0x28, 0xB5, 0x2F, 0xFD, ..] => Some(Self::Zstd),
            [0x1F, 0x8B, 8, ..] => Some(Self::Gzip),
            _ => None,
        }
    }

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Zstd => "zstd",
            Self::Gzip => "gzip",
        }
    }
}

/// Opens the decompressed stream of a file, and returns how it was compressed.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn open_stream(
    path: &Path,
) -> Result<(Box<dyn BufRead + Send>, Option<Packing>), ScanError> {
    let io = |e| ScanError::io(path, e);
    let file = File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let mut file = BufReader::with_capacity(READ_BYTES, file);
    let packing = Packing::of(file.fill_buf().map_err(io)?);
    let unpacked: Box<dyn Read + Send> = match packing {
        None => return Ok((Box::new(file), None)),
        Some(Packing::Zstd) => {
            let mut unpacked = zstd::Decoder::with_buffer(file).map_err(io)?;
            unpacked.window_log_max(ZSTD_WINDOW_LOG_MAX).map_err(io)?;
            Box::new(unpacked)
        }
        Some(Packing::Gzip) => Box::new(MultiGzDecoder::new(file)),
    };
    let left = bytes.saturating_mul(BYTES_A_BYTE_MAX).saturating_add(FREE_BYTES);
    let bounded = Bounded { input: unpacked, left };
    Ok((Box::new(BufReader::with_capacity(READ_BYTES, bounded)), packing))
}

/// The first bytes of what a file holds, from which its format is recognised, and how it is
/// compressed.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn head_of(path: &Path) -> Result<(Vec<u8>, Option<Packing>), ScanError> {
    let mut head = Vec::new();
    if is_remote(path) {
        let file = Input::open(path).map_err(|e| ScanError::io(path, e))?;
        file.take(HEAD_BYTES).read_to_end(&mut head).map_err(|e| ScanError::io(path, e))?;
        let packing = Packing::of(&head);
        return Ok((head, packing));
    }
    let (stream, packing) = open_stream(path)?;
    stream.take(HEAD_BYTES).read_to_end(&mut head).map_err(|e| ScanError::io(path, e))?;
    Ok((head, packing))
}

/// A decompressed stream that ends with an error where it is implausibly long.
struct Bounded<R> {
    input: R,
    left: u64,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> IoResult<usize> {
        let bytes = self.input.read(buffer)?;
        self.left = self.left.checked_sub(bytes as u64).ok_or_else(|| {
            let what = "it holds over 2,048 times its size; if that is right, unpack it first";
            Error::new(ErrorKind::InvalidData, what)
        })?;
        Ok(bytes)
    }
}
