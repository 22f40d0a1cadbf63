//! Buffered reading of an E57 file, whose reader seeks to each page in turn.

use crate::error::ScanError;
use e57::E57Reader;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes read from the file at once.
const READ_BYTES: usize = 256 << 10;
/// Bytes that are read at once where most of the file is passed over.
const SPARSE_READ_BYTES: usize = 4 << 10;

/// A file whose read-ahead buffer survives the reader's seeks to each page.
pub(crate) struct BufferedFile {
    file: BufReader<File>,
    at: u64,
}

/// The reader of a file.
pub(crate) type Reader = E57Reader<BufferedFile>;

impl Read for BufferedFile {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let bytes = self.file.read(buffer)?;
        self.at += bytes as u64;
        Ok(bytes)
    }
}

impl Seek for BufferedFile {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match to {
            SeekFrom::Start(to) if to <= i64::MAX as u64 => {
                self.file.seek_relative(to as i64 - self.at as i64)?;
                self.at = to;
            }
            to => self.at = self.file.seek(to)?,
        }
        Ok(self.at)
    }
}

/// Opens a file for buffered reading.
pub(crate) fn file_of(path: &Path) -> Result<BufferedFile, ScanError> {
    open(path, READ_BYTES)
}

/// Opens a file of which a small part is read.
pub(crate) fn sparse_file_of(path: &Path) -> Result<BufferedFile, ScanError> {
    open(path, SPARSE_READ_BYTES)
}

fn open(path: &Path, read_bytes: usize) -> Result<BufferedFile, ScanError> {
    let file = File::open(path).map_err(|e| ScanError::io(path, e))?;
    Ok(BufferedFile { file: BufReader::with_capacity(read_bytes, file), at: 0 })
}
