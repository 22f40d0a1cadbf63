//! Writing a file: header, pages as they come, then table, statistics, metadata, footer. Everything
//! goes to a temporary name beside the final one, and the file is renamed only when it is
//! completely on the disk. A writer that is dropped before removes the temporary file, unless it
//! was set to keep it for a later writer. A file can also be sent to a place that takes bytes in
//! their order alone, where it is not there before its end.

use crate::error::{Fault, FormatError, io_error};
use crate::footer::{FOOTER_BYTES, Footer, HEADER_BYTES, Section, VERSIONS, header};
use crate::layout::ALIGNMENT;
use crate::metadata::{Metadata, version_on};
use crate::sequential::{STACK_BYTES, Sequential};
use crate::statistics::Statistics;
use crate::table;
use crate::table_parts::PartSizes;
use esker_points::objects::Upload;
use esker_points::place::open_alone;
use esker_points::positioned::read_exact_at;
use esker_points::read_at::FileSource;
use esker_points::unfinished::Unfinished;
use esker_points::{Lattice, MultisetHash, NodeTable};
use std::ffi::{OsStr, OsString};
use std::fmt::{self, Debug, Formatter};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};

const BUFFER_BYTES: usize = 1 << 20;
/// Bytes that are flushed to the disk at a time while writing goes on, so that little is left at
/// the end.
const SYNC_BYTES: u64 = 64 << 20;

/// Writes one .esker file.
#[derive(Debug)]
pub struct FileWriter {
    path: PathBuf,
    partial: PathBuf,
    /// `None` once finished, and for a file that is sent.
    out: Option<Sequential>,
    sent: Option<Sent>,
    /// Flush in progress, and the offset that it began at.
    syncing: Option<JoinHandle<io::Result<()>>>,
    synced: u64,
    is_kept: bool,
    part_sizes: PartSizes,
    _unfinished: Option<Unfinished>,
}

/// A file that is sent.
struct Sent {
    upload: Box<dyn Upload>,
    /// Bytes that were written.
    bytes: u64,
    /// Version that the header has.
    version: u32,
}

impl Debug for Sent {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sent").field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

/// Skips bytes if they have this CRC-32; returns whether they do.
fn skip(out: &mut Sequential, bytes: u64, crc: u32) -> io::Result<bool> {
    out.flush()?;
    let (mut at, end) = (out.offset(), out.offset().saturating_add(bytes));
    if out.file().metadata()?.len() < end {
        return Ok(false);
    }
    let mut hasher = crc32fast::Hasher::new();
    let mut buffer = vec![0; BUFFER_BYTES];
    while at < end {
        let part = buffer.len().min(usize::try_from(end - at).unwrap_or(usize::MAX));
        read_exact_at(out.file(), &mut buffer[..part], at)?;
        hasher.update(&buffer[..part]);
        at += part as u64;
    }
    let is_there = hasher.finalize() == crc;
    if is_there {
        out.seek(end)?;
    }
    Ok(is_there)
}

/// Name of a file until it is finished.
fn partial_name(name: &OsStr) -> OsString {
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(".partial");
    hidden
}

impl FileWriter {
    /// Begins a file with the final name `path`.
    ///
    /// # Errors
    /// If the temporary file beside it cannot be created, or another writer has it.
    pub fn create(path: &Path) -> Result<Self, FormatError> {
        let writer = Self::resume(path)?;
        if let Some(out) = &writer.out {
            out.file().set_len(0).map_err(io_error(path, "write it"))?;
        }
        Ok(writer)
    }

    /// Begins a file over what an earlier writer left: its pages can be skipped, or written again.
    ///
    /// # Errors
    /// See [`FileWriter::create`].
    pub fn resume(path: &Path) -> Result<Self, FormatError> {
        let name = path.file_name().ok_or_else(|| FormatError::Io {
            path: path.into(),
            what: "write it",
            source: io::Error::other("the path names no file"),
        })?;
        let partial = path.with_file_name(partial_name(name));
        // The rename at the end would replace a device or fail on a folder.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(FormatError::Io {
                path: path.into(),
                what: "write it",
                source: io::Error::other("something other than a file has this name"),
            });
        }
        let file = open_alone(&partial, "build").map_err(io_error(path, "write it"))?;
        let out = Some(Sequential::new(file, &partial).map_err(io_error(path, "write it"))?);
        let (path, syncing, part_sizes) = (path.into(), None, PartSizes::default());
        let _unfinished = Some(Unfinished::new(&partial));
        let (sent, synced, is_kept) = (None, 0, false);
        let mut writer =
            Self { path, partial, out, sent, syncing, synced, is_kept, part_sizes, _unfinished };
        writer.write(&header(*VERSIONS.start()))?;
        Ok(writer)
    }

    /// Begins a file on `lattice` that is sent by `upload`; `path` names it in errors.
    ///
    /// # Errors
    /// If it cannot be sent.
    pub fn send(
        path: &Path,
        upload: Box<dyn Upload>,
        lattice: &Lattice,
    ) -> Result<Self, FormatError> {
        let version = version_on(lattice);
        let mut writer = Self {
            path: path.into(),
            partial: path.into(),
            out: None,
            sent: Some(Sent { upload, bytes: 0, version }),
            syncing: None,
            synced: 0,
            is_kept: false,
            part_sizes: PartSizes::default(),
            _unfinished: None,
        };
        writer.write(&header(version))?;
        Ok(writer)
    }

    /// Whether a writer of `path` has left a temporary file, or is still writing it.
    pub fn has_left(path: &Path) -> bool {
        let name = path.file_name().map(partial_name);
        name.is_some_and(|name| path.with_file_name(name).exists())
    }

    /// Sets whether the temporary file stays if the writer is dropped before its end.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Sets how the node table can be read in parts.
    pub fn set_part_sizes(&mut self, sizes: PartSizes) {
        self.part_sizes = sizes;
    }

    /// Skips bytes that an earlier writer left, if they have this CRC-32; returns whether they do.
    /// Otherwise nothing is skipped.
    ///
    /// # Errors
    /// If the disk fails.
    pub fn skip(&mut self, bytes: u64, crc: u32) -> Result<bool, FormatError> {
        let Some(out) = &mut self.out else { return Ok(false) };
        skip(out, bytes, crc).map_err(io_error(&self.partial, "read it"))
    }

    /// Passes buffered bytes to the system.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn flush(&mut self) -> Result<(), FormatError> {
        let Some(out) = &mut self.out else { return Ok(()) };
        out.flush().map_err(io_error(&self.path, "write it"))
    }

    /// What was written so far, to be read at the offsets of pages.
    ///
    /// # Errors
    /// If the disk is full, or the file was finished or is sent.
    pub fn written(&mut self) -> Result<FileSource, FormatError> {
        self.flush()?;
        let file = self.out.as_ref().map(|out| out.file().try_clone());
        let file = file.unwrap_or_else(|| Err(io::Error::other("it is finished or sent")));
        file.map(FileSource).map_err(io_error(&self.partial, "read it"))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), FormatError> {
        if let Some(sent) = &mut self.sent {
            sent.bytes += bytes.len() as u64;
            return sent.upload.write_all(bytes).map_err(io_error(&self.path, "write it"));
        }
        if let Some(out) = &mut self.out {
            out.write_all(bytes).map_err(io_error(&self.path, "write it"))?;
        }
        if self.offset() - self.synced >= SYNC_BYTES {
            self.begin_sync()?;
        }
        Ok(())
    }

    /// Starts a flush of everything written so far in a separate thread, unless one is in progress.
    fn begin_sync(&mut self) -> Result<(), FormatError> {
        if self.syncing.as_ref().is_some_and(|syncing| !syncing.is_finished()) {
            return Ok(());
        }
        self.end_sync()?;
        self.synced = self.offset();
        let Some(Ok(file)) = self.out.as_ref().map(|out| out.file().try_clone()) else {
            return Ok(());
        };
        let thread = thread::Builder::new().name("esker-sync".into()).stack_size(STACK_BYTES);
        // Without a thread, everything is flushed at the end.
        self.syncing = thread.spawn(move || file.sync_data()).ok();
        Ok(())
    }

    /// Waits for the flush. The system reports an error only once.
    fn end_sync(&mut self) -> Result<(), FormatError> {
        let synced = self.syncing.take().and_then(|syncing| syncing.join().ok());
        synced.unwrap_or(Ok(())).map_err(io_error(&self.path, "write it"))
    }

    /// Offset of the next page.
    pub fn offset(&self) -> u64 {
        let sent = self.sent.as_ref().map(|sent| sent.bytes);
        sent.or(self.out.as_ref().map(Sequential::offset)).unwrap_or(0)
    }

    /// Appends a page of [`crate::encode_page`]; returns its offset in the file.
    ///
    /// # Errors
    /// If the disk is full, or the page is not a whole page or has 4 GiB or more.
    pub fn write_page(&mut self, page: &[u8]) -> Result<u64, FormatError> {
        if !(page.len() as u64).is_multiple_of(ALIGNMENT) || u32::try_from(page.len()).is_err() {
            let fault = format!(
                "a page of {} bytes; choose a smaller node capacity if it is over 4 GiB",
                page.len()
            );
            return Err(FormatError::Unwritable { path: self.path.clone(), fault });
        }
        let offset = self.offset();
        self.write(page)?;
        Ok(offset)
    }

    fn section(&mut self, bytes: &[u8]) -> Result<Section, FormatError> {
        let offset = self.offset();
        self.write(bytes)?;
        Ok(Section { offset, bytes: bytes.len() as u64, crc: crc32fast::hash(bytes) })
    }

    /// Writes everything that follows the pages and renames the file; returns its length in bytes.
    ///
    /// # Errors
    /// If the disk is full, or table or metadata break the rules of the format.
    pub fn finish(
        &mut self,
        table: &NodeTable,
        statistics: &Statistics,
        metadata: &Metadata,
        points: u64,
        hash: MultisetHash,
    ) -> Result<u64, FormatError> {
        let path = self.path.clone();
        let unwritable = |fault: Fault| fault.unwritable(&path);
        let (json, verbatim) = metadata.encode().map_err(unwritable)?;
        table::check(table, &metadata.layout(), self.offset(), points).map_err(unwritable)?;
        table::check_pages_fill(table, self.offset()).map_err(unwritable)?;
        statistics.check_shape(table, &metadata.schema).map_err(unwritable)?;
        if self.sent.as_ref().is_some_and(|sent| sent.version != metadata.version()) {
            return Err(unwritable(Fault::new("header", "the file was begun on another lattice")));
        }
        metadata.check_classes(points).map_err(unwritable)?;
        let has_parts = !table.nodes.is_empty() && table.nodes.len() >= self.part_sizes.from_nodes;
        let columns = statistics.encode(table, has_parts.then_some(self.part_sizes));
        let mut footer = Footer {
            version: metadata.version(),
            points,
            nodes: table.nodes.len() as u64,
            hash,
            rounding_error_max: metadata.rounding_error_max(),
            node_capacity: metadata.node_capacity,
            table: self.section(bytemuck::cast_slice(&table.nodes))?,
            statistics: self.section(&columns)?,
            metadata: self.section(&json)?,
            verbatim: self.section(&verbatim)?,
            file_bytes: 0,
        };
        footer.file_bytes = self.offset() + FOOTER_BYTES as u64;
        self.write(&footer.encode())?;
        self.write_header(footer.version)?;
        self.commit()?;
        Ok(footer.file_bytes)
    }

    /// Replaces the header, which has the first version until the metadata are known.
    fn write_header(&mut self, version: u32) -> Result<(), FormatError> {
        let Some(out) = self.out.as_mut().filter(|_| version != *VERSIONS.start()) else {
            return Ok(());
        };
        let end = out.offset();
        out.seek(0)
            .and_then(|()| out.write_all(&header(version)))
            .and_then(|()| out.seek(end))
            .map_err(io_error(&self.path, "write it"))
    }

    /// Flushes the file and gives it its final name. No reader has the file before.
    fn commit(&mut self) -> Result<(), FormatError> {
        debug_assert!(self.offset() >= (HEADER_BYTES + FOOTER_BYTES) as u64);
        if let Some(sent) = self.sent.take() {
            return sent.upload.finish().map_err(io_error(&self.path, "write it"));
        }
        self.flush()?;
        self.end_sync()?;
        let Some(out) = &self.out else { return Ok(()) };
        out.file()
            .set_len(out.offset())
            .and_then(|()| out.file().sync_all())
            .and_then(|()| fs::rename(&self.partial, &self.path))
            .map_err(io_error(&self.path, "write it"))?;
        self.out = None;
        Ok(())
    }
}

impl Drop for FileWriter {
    fn drop(&mut self) {
        let Some(out) = self.out.take() else { return };
        let _ = self.end_sync();
        if !self.is_kept {
            // Removed while it is locked, so that it cannot be another writer's.
            let _ = fs::remove_file(&self.partial);
        }
        drop(out);
    }
}
