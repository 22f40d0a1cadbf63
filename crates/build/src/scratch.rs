//! Scratch space: one file of rows, appended to, also by a thread of its own meanwhile, mapped to read, given back piece
//! by piece as it is consumed. It has no name, or one where a later build may go on with it. Its pages are the system's to drop: they are no anonymous
//! memory.

use crate::error::BuildError;
use memmap2::Mmap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

/// Bytes written to the file together.
const WRITE_BYTES: usize = 4 << 20;
/// All that a thread needs that waits for the disk.
const STACK_BYTES: usize = 128 << 10;
/// How names of files of rows begin and end.
const NAME: [&str; 2] = [".esker-", ".rows"];

/// A run of bytes in the scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Where it begins.
    pub offset: u64,
    /// How long it is.
    pub bytes: u64,
}

impl Extent {
    /// Its bytes in a mapping made since it was appended.
    pub fn of<'a>(&self, map: &'a Mmap) -> Option<&'a [u8]> {
        map.get(self.offset as usize..(self.offset + self.bytes) as usize)
    }
}

/// Takes so many bytes from the front of extents.
pub fn take_first(extents: &mut Vec<Extent>, bytes: u64) -> Vec<Extent> {
    let (mut taken, mut left) = (Vec::new(), bytes);
    for extent in &mut *extents {
        let bytes = extent.bytes.min(left);
        taken.push(Extent { offset: extent.offset, bytes });
        *extent = Extent { offset: extent.offset + bytes, bytes: extent.bytes - bytes };
        left -= bytes;
        if left == 0 {
            break;
        }
    }
    extents.retain(|extent| extent.bytes > 0);
    taken
}

/// Bytes of a block that others share, on their way to scratch.
pub struct Run {
    /// The block.
    pub block: Arc<Vec<u8>>,
    /// Which of its bytes.
    pub bytes: Range<usize>,
}

/// Whether a file has such a name as files of rows have.
pub fn is_ours(path: &Path) -> bool {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.starts_with(NAME[0]) && name.ends_with(NAME[1])
}

/// A growing file, gone with the process where it has no name.
pub struct Scratch {
    file: BufWriter<File>,
    /// Writes what is appended meanwhile.
    writing: Option<JoinHandle<io::Result<()>>>,
    folder: PathBuf,
    /// Length of the file, once all is written.
    file_bytes: u64,
    /// Bytes ever written.
    written_bytes: u64,
    /// Bytes not yet released.
    held_bytes: u64,
    held_bytes_peak: u64,
    /// Bytes that the file being built has.
    beside_bytes: u64,
    disk_bytes_peak: u64,
    path: Option<PathBuf>,
    is_kept: bool,
}

impl Scratch {
    /// A new scratch file in this folder.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn new(folder: &Path) -> Result<Self, BuildError> {
        let file = tempfile::tempfile_in(folder)
            .map_err(|e| BuildError::scratch(folder, "cannot make a scratch file", e))?;
        Ok(Self {
            file: BufWriter::with_capacity(WRITE_BYTES, file),
            writing: None,
            folder: folder.to_owned(),
            file_bytes: 0,
            written_bytes: 0,
            held_bytes: 0,
            held_bytes_peak: 0,
            beside_bytes: 0,
            disk_bytes_peak: 0,
            path: None,
            is_kept: false,
        })
    }

    /// Gives the file, in which nothing is yet, a name that can be kept in a journal, if its folder's has letters.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn name(&mut self) -> Result<Option<&Path>, BuildError> {
        debug_assert_eq!(self.file_bytes, 0);
        if self.path.is_none() && self.folder.to_str().is_some() {
            let failed = |e| BuildError::scratch(&self.folder, "cannot make a scratch file", e);
            // A name from the root leads to it from wherever a later build begins.
            let folder = self.folder.canonicalize().map_err(failed)?;
            let mut named = tempfile::Builder::new();
            let named = named.prefix(NAME[0]).suffix(NAME[1]).tempfile_in(folder);
            let (file, path) =
                named.and_then(|n| n.keep().map_err(io::Error::from)).map_err(failed)?;
            self.file = BufWriter::with_capacity(WRITE_BYTES, file);
            self.path = Some(path);
        }
        Ok(self.path.as_deref())
    }

    /// Takes the file of an earlier build, which is to be told by [`Scratch::restore`] what is in it.
    ///
    /// # Errors
    /// Where it is not there.
    pub fn reopen(&mut self, path: &Path) -> io::Result<()> {
        if !is_ours(path) {
            return Err(io::Error::other("it has another name than scratch files have"));
        }
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        self.file = BufWriter::with_capacity(WRITE_BYTES, file);
        self.path = Some(path.into());
        Ok(())
    }

    /// These extents are in the file that was reopened, and nothing behind them. Whether that can be.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn restore(&mut self, extents: &[Extent]) -> Result<bool, BuildError> {
        for extent in extents {
            let Some(end) = extent.offset.checked_add(extent.bytes) else { return Ok(false) };
            self.file_bytes = self.file_bytes.max(end);
            self.written_bytes += extent.bytes;
            self.held_bytes += extent.bytes;
        }
        self.note_peaks();
        let sought = self.file.seek(io::SeekFrom::Start(self.file_bytes));
        let length = sought.and_then(|_| self.file.get_ref().metadata());
        length
            .map(|m| m.len() >= self.file_bytes)
            .map_err(|e| BuildError::scratch(&self.folder, "cannot read scratch data", e))
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.file_bytes == 0
    }

    /// Whether it stays when it is dropped, where it has a name.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Where the next byte goes.
    pub fn end(&self) -> u64 {
        self.file_bytes
    }

    /// Hands all that was appended to the system; the file has it then.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn flush(&mut self) -> Result<(), BuildError> {
        self.settle()?;
        let flushed = self.file.flush();
        flushed.map_err(|e| self.not_written(e))
    }

    /// Waits for what is written meanwhile.
    fn settle(&mut self) -> Result<(), BuildError> {
        let Some(writing) = self.writing.take() else { return Ok(()) };
        let written = writing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        written.map_err(|e| self.not_written(e))
    }

    fn not_written(&self, e: io::Error) -> BuildError {
        BuildError::scratch(&self.folder, "cannot write scratch data", e)
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<Extent, BuildError> {
        self.settle()?;
        self.file.write_all(bytes).map_err(|e| self.not_written(e))?;
        let extent = Extent { offset: self.file_bytes, bytes: bytes.len() as u64 };
        self.grow(extent.bytes);
        Ok(extent)
    }

    /// Appends runs, one behind the other, while the caller goes on: what it asks next of the file waits for them, and has
    /// their errors.
    ///
    /// # Errors
    /// Where the disk is full, for what was appended before; where the system gives no thread.
    pub fn append_meanwhile(&mut self, runs: Vec<Run>) -> Result<(), BuildError> {
        self.flush()?;
        if runs.is_empty() {
            return Ok(());
        }
        let bytes = runs.iter().map(|run| run.bytes.len() as u64).sum();
        let file = self.file.get_ref().try_clone().map_err(|e| self.not_written(e))?;
        let write = move || {
            let mut file = BufWriter::with_capacity(WRITE_BYTES, file);
            // A block that is written is let go of.
            runs.into_iter().try_for_each(|run| file.write_all(&run.block[run.bytes]))?;
            file.flush()
        };
        let thread = thread::Builder::new().name("esker-scratch".into()).stack_size(STACK_BYTES);
        self.writing = Some(thread.spawn(write).map_err(BuildError::no_thread)?);
        self.grow(bytes);
        Ok(())
    }

    /// So many bytes more are in the file, or on their way to it.
    fn grow(&mut self, bytes: u64) {
        self.file_bytes += bytes;
        self.written_bytes += bytes;
        self.held_bytes += bytes;
        self.note_peaks();
    }

    /// Told that the file that is being built now has so many bytes.
    pub fn set_beside(&mut self, bytes: u64) {
        self.beside_bytes = bytes;
        self.note_peaks();
    }

    fn note_peaks(&mut self) {
        self.held_bytes_peak = self.held_bytes_peak.max(self.held_bytes);
        self.disk_bytes_peak = self.disk_bytes_peak.max(self.held_bytes + self.beside_bytes);
    }

    /// Bytes ever written.
    pub fn bytes(&self) -> u64 {
        self.written_bytes
    }

    /// The most bytes that were held at once.
    pub fn bytes_peak(&self) -> u64 {
        self.held_bytes_peak
    }

    /// The most bytes that scratch and the file being built had at once.
    pub fn disk_bytes_peak(&self) -> u64 {
        self.disk_bytes_peak
    }

    /// Begins anew; all extents are void.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn clear(&mut self) -> Result<(), BuildError> {
        // What could not be written is void too.
        let _ = self.settle();
        (self.file_bytes, self.held_bytes) = (0, 0);
        self.file
            .flush()
            .and_then(|()| self.file.get_ref().set_len(0))
            .and_then(|()| self.file.rewind())
            .map_err(|e| BuildError::scratch(&self.folder, "cannot clear scratch data", e))
    }

    /// The file's content so far.
    ///
    /// # Errors
    /// Where the disk is full, or the system refuses the mapping.
    pub fn map(&mut self) -> Result<Mmap, BuildError> {
        self.flush()?;
        // SAFETY: this process alone holds the file: it has no name, or a random one of this user's, which the
        // journal of an output alone knows, and the output is locked; it is only appended to, cut only when
        // no extent is left (`clear` takes `&mut self` where no map lives), and holes
        // are punched only in extents that nobody reads any more (whoever parts rows may still have slices of them, but is
        // past them), so the mapped bytes never change under a reader and the mapping never reaches past the file's end.
        unsafe { Mmap::map(self.file.get_ref()) }
            .map_err(|e| BuildError::scratch(&self.folder, "cannot map scratch data", e))
    }

    /// Gives the space of extents back to the system, neighbours together. Best effort: what is not given
    /// back is freed at the end.
    pub fn release(&mut self, mut extents: Vec<Extent>) {
        extents.sort_unstable_by_key(|e| e.offset);
        for run in extents.chunk_by(|a, b| a.offset + a.bytes == b.offset) {
            let bytes = run.iter().map(|e| e.bytes).sum();
            if punch(self.file.get_ref(), Extent { offset: run[0].offset, bytes }) {
                self.held_bytes -= bytes;
            }
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Whoever wants to know whether all was written has asked.
        let _ = self.writing.take().map(JoinHandle::join);
        if let Some(path) = self.path.take().filter(|_| !self.is_kept) {
            let _ = fs::remove_file(path);
        }
    }
}

/// Whether the system took it back: not every file system knows holes.
#[cfg(target_os = "linux")]
fn punch(file: &File, extent: Extent) -> bool {
    use rustix::fs::{FallocateFlags, fallocate};
    let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
    fallocate(file, hole, extent.offset, extent.bytes).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn punch(_file: &File, _extent: Extent) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extents_read_back_and_neighbours_survive_a_release() {
        let folder = tempfile::tempdir().unwrap();
        let mut scratch = Scratch::new(folder.path()).unwrap();
        let a = scratch.append(&[1; 10_000]).unwrap();
        let b = scratch.append(&[2; 10_000]).unwrap();
        scratch.set_beside(500);
        scratch.release(vec![a]);
        scratch.set_beside(7_000);
        let map = scratch.map().unwrap();
        assert_eq!(&map[b.offset as usize..][..b.bytes as usize], &[2; 10_000]);
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let block = Arc::new(vec![1, 2, 3, 3, 4]);
        let run = |bytes| Run { block: Arc::clone(&block), bytes };
        let end = scratch.end();
        scratch.append_meanwhile(vec![run(3..5), run(0..1)]).unwrap();
        assert_eq!(scratch.map().unwrap()[end as usize..], [3, 4, 1]);
        assert_eq!(Arc::strong_count(&block), 1);
        scratch.clear().unwrap();
        let c = scratch.append(&[3; 10]).unwrap();
        assert_eq!(scratch.map().unwrap()[c.offset as usize..], [3; 10]);
        assert_eq!((scratch.bytes(), scratch.bytes_peak()), (20_013, 20_000));
        assert_eq!(scratch.disk_bytes_peak(), 20_500);
    }

    #[test]
    fn the_first_bytes_of_extents_are_taken_across_their_ends() {
        let extent = |offset, bytes| Extent { offset, bytes };
        let mut extents = vec![extent(100, 10), extent(7, 20), extent(500, 5)];
        assert_eq!(take_first(&mut extents, 10), [extent(100, 10)]);
        assert_eq!(take_first(&mut extents, 3), [extent(7, 3)]);
        assert_eq!(take_first(&mut extents, 18), [extent(10, 17), extent(500, 1)]);
        assert_eq!(extents, [extent(501, 4)]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Scratch::new(Path::new("/nowhere/at/all")).err().unwrap();
        assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    }
}
