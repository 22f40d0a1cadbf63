//! Writing a file: header, pages as they come, then table, statistics, metadata, footer. Everything goes to
//! a temporary name beside the final one, which is taken only when all is on the disk; a writer that is
//! dropped before that leaves nothing behind.

use crate::error::{Fault, FormatError, io_error};
use crate::footer::{FOOTER_BYTES, Footer, HEADER_BYTES, Section, header};
use crate::layout::ALIGNMENT;
use crate::metadata::Metadata;
use crate::statistics::Statistics;
use crate::table;
use esker_points::{MultisetHash, NodeTable};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const BUFFER_BYTES: usize = 1 << 20;

/// Writes one .esker file.
#[derive(Debug)]
pub struct FileWriter {
    path: PathBuf,
    partial: PathBuf,
    /// `None` once finished.
    out: Option<BufWriter<File>>,
    offset: u64,
}

impl FileWriter {
    /// Begins a file that will stand at `path`.
    ///
    /// # Errors
    /// Where the temporary file beside it cannot be created.
    pub fn create(path: &Path) -> Result<Self, FormatError> {
        let name = path.file_name().ok_or_else(|| FormatError::Io {
            path: path.into(),
            what: "write it",
            source: std::io::Error::other("the path names no file"),
        })?;
        // The rename at the end would put a file in the place of a device or fail on a folder.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(FormatError::Io {
                path: path.into(),
                what: "write it",
                source: std::io::Error::other("something that is no file has this name"),
            });
        }
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.partial", std::process::id()));
        let partial = path.with_file_name(hidden);
        let file = File::create(&partial).map_err(io_error(&partial, "create it"))?;
        let mut writer = Self {
            path: path.into(),
            partial,
            out: Some(BufWriter::with_capacity(BUFFER_BYTES, file)),
            offset: 0,
        };
        writer.write(&header())?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), FormatError> {
        if let Some(out) = &mut self.out {
            out.write_all(bytes).map_err(io_error(&self.path, "write it"))?;
        }
        self.offset += bytes.len() as u64;
        Ok(())
    }

    /// Where the next page will stand.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Appends a page of [`crate::encode_page`]; its place in the file.
    ///
    /// # Errors
    /// Where the disk is full, or the page is no whole page or 4 GiB or more.
    pub fn write_page(&mut self, page: &[u8]) -> Result<u64, FormatError> {
        if !(page.len() as u64).is_multiple_of(ALIGNMENT) || u32::try_from(page.len()).is_err() {
            let fault = format!(
                "a page of {} bytes; choose a smaller node capacity if it is over 4 GiB",
                page.len()
            );
            return Err(FormatError::Unwritable { path: self.path.clone(), fault });
        }
        let offset = self.offset;
        self.write(page)?;
        Ok(offset)
    }

    fn section(&mut self, bytes: &[u8]) -> Result<Section, FormatError> {
        let offset = self.offset;
        self.write(bytes)?;
        Ok(Section { offset, bytes: bytes.len() as u64, crc: crc32fast::hash(bytes) })
    }

    /// Writes all that follows the pages and gives the file its name; its length in bytes.
    ///
    /// # Errors
    /// Where the disk is full, or table or metadata break the format's rules.
    pub fn finish(
        mut self,
        table: &NodeTable,
        statistics: &Statistics,
        metadata: &Metadata,
        points: u64,
        hash: MultisetHash,
    ) -> Result<u64, FormatError> {
        let path = self.path.clone();
        let unwritable = |fault: Fault| fault.unwritable(&path);
        let (json, verbatim) = metadata.encode().map_err(unwritable)?;
        table::check(table, &metadata.layout(), self.offset, points).map_err(unwritable)?;
        table::check_pages_fill(table, self.offset).map_err(unwritable)?;
        statistics.check_shape(table, &metadata.schema).map_err(unwritable)?;
        metadata.check_classes(points).map_err(unwritable)?;
        let mut footer = Footer {
            points,
            nodes: table.nodes.len() as u64,
            hash,
            rounding_error_max: metadata.rounding_error_max(),
            node_capacity: metadata.node_capacity,
            table: self.section(bytemuck::cast_slice(&table.nodes))?,
            statistics: self.section(&statistics.encode())?,
            metadata: self.section(&json)?,
            verbatim: self.section(&verbatim)?,
            file_bytes: 0,
        };
        footer.file_bytes = self.offset + FOOTER_BYTES as u64;
        self.write(&footer.encode())?;
        self.commit()?;
        Ok(footer.file_bytes)
    }

    /// To the disk, then under the final name.
    fn commit(mut self) -> Result<(), FormatError> {
        debug_assert!(self.offset >= (HEADER_BYTES + FOOTER_BYTES) as u64);
        let Some(out) = self.out.take() else { return Ok(()) };
        let finished = out
            .into_inner()
            .map_err(|e| e.into_error())
            .and_then(|file| file.sync_all())
            .and_then(|()| fs::rename(&self.partial, &self.path));
        if finished.is_err() {
            let _ = fs::remove_file(&self.partial);
        }
        finished.map_err(io_error(&self.path, "write it"))
    }
}

impl Drop for FileWriter {
    fn drop(&mut self) {
        if let Some(out) = self.out.take() {
            // Without flushing: what is buffered is of no use. Closed first, since Windows removes no
            // open file.
            drop(out.into_parts());
            let _ = fs::remove_file(&self.partial);
        }
    }
}
