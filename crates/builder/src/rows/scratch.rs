//! Scratch space: few files of rows, each appended to, also by a thread of its own meanwhile,
//! mapped to read, given back piece by piece as it is consumed. They have no names, or some where a
//! later build may go on with them. Their pages are the system's to drop: they are no anonymous
//! memory.

use crate::error::BuildError;
use crate::rows::journal_record::{Reading, Record};
use memmap2::Mmap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

/// Files at most. As many as threads are written to at once, since a system lets one thread at a
/// time write to a file.
const FILES_MAX: usize = 8;
/// Bytes written to a file together.
const WRITE_BYTES: usize = 1 << 20;
/// All that a thread needs that waits for the disk.
const STACK_BYTES: usize = 128 << 10;
/// How names of files of rows begin and end; those of all but the first have a number before the
/// end.
const NAME: [&str; 2] = [".esker-", ".rows"];

/// A run of bytes in a scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Which file.
    pub file: u32,
    /// Where it begins.
    pub offset: u64,
    /// How long it is.
    pub bytes: u64,
}

impl Extent {
    /// Adds it to a record.
    pub fn put(&self, record: &mut Record) {
        record.put(self.file);
        record.put([self.offset, self.bytes]);
    }

    /// Reads it from a record.
    pub fn get(from: &mut Reading<'_>) -> Option<Self> {
        let (file, [offset, bytes]) = (from.get()?, from.get()?);
        Some(Self { file, offset, bytes })
    }

    /// Its bytes in a mapping made since it was appended.
    pub fn of<'a>(&self, map: &'a Map) -> Option<&'a [u8]> {
        map.0
            .get(self.file as usize)?
            .get(self.offset as usize..(self.offset + self.bytes) as usize)
    }
}

/// The content of all files at a moment.
pub struct Map(Vec<Mmap>);

/// Takes so many bytes from the front of extents.
pub fn take_first(extents: &mut Vec<Extent>, bytes: u64) -> Vec<Extent> {
    let (mut taken, mut left) = (Vec::new(), bytes);
    for extent in &mut *extents {
        let bytes = extent.bytes.min(left);
        taken.push(Extent { bytes, ..*extent });
        (extent.offset, extent.bytes) = (extent.offset + bytes, extent.bytes - bytes);
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

/// Deletes files of rows, by the name of the first, whichever are there.
pub fn remove(first: &Path) {
    (0..FILES_MAX).for_each(|number| drop(fs::remove_file(name_of(first, number))));
}

/// The name of one of the files of which the first has this name.
fn name_of(first: &Path, number: usize) -> PathBuf {
    if number == 0 { first.into() } else { first.with_extension(format!("{number}{}", NAME[1])) }
}

/// A new file, for this user alone, in place of one that an earlier build may have left.
fn create(path: &Path) -> io::Result<File> {
    let _ = fs::remove_file(path);
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)
}

fn not_made(folder: &Path, e: io::Error) -> BuildError {
    BuildError::scratch(folder, "cannot make a scratch file", e)
}

/// A growing file.
struct Growing {
    file: BufWriter<File>,
    /// Its length, once all is written.
    bytes: u64,
    /// Writes what is appended meanwhile.
    writing: Option<JoinHandle<io::Result<()>>>,
}

impl Growing {
    fn new(file: File) -> Self {
        Self { file: BufWriter::with_capacity(WRITE_BYTES, file), bytes: 0, writing: None }
    }

    /// Waits for what is written meanwhile.
    fn settle(&mut self) -> io::Result<()> {
        let Some(writing) = self.writing.take() else { return Ok(()) };
        writing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Hands all that was appended to the system.
    fn flush(&mut self) -> io::Result<()> {
        self.settle()?;
        self.file.flush()
    }

    /// Appends runs meanwhile; where the system gives no thread, it says so.
    fn append_meanwhile(&mut self, runs: Vec<Run>) -> io::Result<io::Result<()>> {
        self.flush()?;
        let file = self.file.get_ref().try_clone()?;
        let write = move || {
            let mut file = BufWriter::with_capacity(WRITE_BYTES, file);
            // A block that is written is let go of.
            runs.into_iter().try_for_each(|run| file.write_all(&run.block[run.bytes]))?;
            file.flush()
        };
        let thread = thread::Builder::new().name("esker-scratch".into()).stack_size(STACK_BYTES);
        Ok(thread.spawn(write).map(|writing| self.writing = Some(writing)))
    }
}

/// Growing files, gone with the process where they have no names.
pub struct Scratch {
    files: Vec<Growing>,
    folder: PathBuf,
    /// Bytes ever written.
    written_bytes: u64,
    /// Bytes not yet released.
    held_bytes: u64,
    held_bytes_peak: u64,
    /// Bytes that the file being built has.
    beside_bytes: u64,
    disk_bytes_peak: u64,
    /// The name of the first.
    path: Option<PathBuf>,
    is_kept: bool,
}

impl Scratch {
    /// A new scratch file in this folder; more where they are needed.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn new(folder: &Path) -> Result<Self, BuildError> {
        let file = tempfile::tempfile_in(folder).map_err(|e| not_made(folder, e))?;
        Ok(Self {
            files: vec![Growing::new(file)],
            folder: folder.to_owned(),
            written_bytes: 0,
            held_bytes: 0,
            held_bytes_peak: 0,
            beside_bytes: 0,
            disk_bytes_peak: 0,
            path: None,
            is_kept: false,
        })
    }

    /// Gives the files, in which nothing is yet, names that can be kept in a journal, if their
    /// folder's has letters. That of the first.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn name(&mut self) -> Result<Option<&Path>, BuildError> {
        debug_assert!(self.is_empty());
        if self.path.is_none() && self.folder.to_str().is_some() {
            let failed = |e| not_made(&self.folder, e);
            // A name from the root leads to it from wherever a later build begins.
            let folder = self.folder.canonicalize().map_err(failed)?;
            let mut named = tempfile::Builder::new();
            let named = named.prefix(NAME[0]).suffix(NAME[1]).tempfile_in(folder);
            let (file, path) =
                named.and_then(|n| n.keep().map_err(io::Error::from)).map_err(failed)?;
            self.files = vec![Growing::new(file)];
            self.path = Some(path);
        }
        Ok(self.path.as_deref())
    }

    /// Takes the files of an earlier build, up to one that is not there; [`Scratch::restore`] is to
    /// be told what is in them.
    ///
    /// # Errors
    /// Where the first is not there, or one cannot be opened.
    pub fn reopen(&mut self, path: &Path) -> io::Result<()> {
        if !is_ours(path) {
            return Err(io::Error::other("it has another name than scratch files have"));
        }
        let open = |number| OpenOptions::new().read(true).write(true).open(name_of(path, number));
        self.files = vec![Growing::new(open(0)?)];
        for number in 1..FILES_MAX {
            match open(number) {
                Ok(file) => self.files.push(Growing::new(file)),
                Err(e) if e.kind() == io::ErrorKind::NotFound => break,
                Err(e) => return Err(e),
            }
        }
        self.path = Some(path.into());
        Ok(())
    }

    /// One more file.
    fn add_file(&mut self) -> Result<(), BuildError> {
        let file = match &self.path {
            None => tempfile::tempfile_in(&self.folder),
            Some(first) => create(&name_of(first, self.files.len())),
        };
        self.files.push(Growing::new(file.map_err(|e| not_made(&self.folder, e))?));
        Ok(())
    }

    /// These extents are in the files that were reopened, and nothing behind them. Whether that can
    /// be.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn restore(&mut self, extents: &[Extent]) -> Result<bool, BuildError> {
        for extent in extents {
            let Some(file) = self.files.get_mut(extent.file as usize) else { return Ok(false) };
            let Some(end) = extent.offset.checked_add(extent.bytes) else { return Ok(false) };
            file.bytes = file.bytes.max(end);
            self.written_bytes += extent.bytes;
            self.held_bytes += extent.bytes;
        }
        self.note_peaks();
        let mut is_there = true;
        for Growing { file, bytes, .. } in &mut self.files {
            let sought = file.seek(io::SeekFrom::Start(*bytes));
            let length = sought.and_then(|_| file.get_ref().metadata()).map(|m| m.len());
            let failed = |e| BuildError::scratch(&self.folder, "cannot read scratch data", e);
            is_there &= length.map_err(failed)? >= *bytes;
        }
        Ok(is_there)
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.files.iter().all(|file| file.bytes == 0)
    }

    /// Whether it stays when it is dropped, where it has a name.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Hands all that was appended to the system; the files have it then.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn flush(&mut self) -> Result<(), BuildError> {
        // Each is waited for, whatever becomes of the others.
        let flushed: Vec<io::Result<()>> = self.files.iter_mut().map(Growing::flush).collect();
        flushed.into_iter().collect::<io::Result<()>>().map_err(|e| self.not_written(e))
    }

    fn not_written(&self, e: io::Error) -> BuildError {
        BuildError::scratch(&self.folder, "cannot write scratch data", e)
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<Extent, BuildError> {
        let first = &mut self.files[0];
        let written = first.settle().and_then(|()| first.file.write_all(bytes));
        let extent = Extent { file: 0, offset: first.bytes, bytes: bytes.len() as u64 };
        first.bytes += extent.bytes;
        written.map_err(|e| self.not_written(e))?;
        self.grow(extent.bytes);
        Ok(extent)
    }

    /// Appends parts, each of which is runs that come to lie behind each other, while the caller
    /// goes on: what it asks next of the files waits for them, and has their errors. Where each
    /// part will be.
    ///
    /// # Errors
    /// Where the disk is full, for what was appended before; where the system gives no thread.
    pub fn append_meanwhile(&mut self, parts: Vec<Vec<Run>>) -> Result<Vec<Extent>, BuildError> {
        self.flush()?;
        let bytes_of = |runs: &[Run]| runs.iter().map(|run| run.bytes.len() as u64).sum::<u64>();
        let total: u64 = parts.iter().map(|runs| bytes_of(runs)).sum();
        let files = rayon::current_num_threads().clamp(1, FILES_MAX);
        let share = total.div_ceil(files as u64).max(1);
        let mut runs_of: Vec<Vec<Run>> = Vec::new();
        let mut extents = Vec::with_capacity(parts.len());
        let mut before = 0;
        for mut runs in parts {
            let file = ((before / share) as usize).min(files - 1);
            while runs_of.len() <= file {
                runs_of.push(Vec::new());
                if self.files.len() < runs_of.len() {
                    self.add_file()?;
                }
            }
            let bytes = bytes_of(&runs);
            let end = &mut self.files[file].bytes;
            extents.push(Extent { file: file as u32, offset: *end, bytes });
            *end += bytes;
            before += bytes;
            runs_of[file].append(&mut runs);
        }
        for (file, runs) in runs_of.into_iter().enumerate().filter(|(_, runs)| !runs.is_empty()) {
            let begun = self.files[file].append_meanwhile(runs).map_err(|e| self.not_written(e))?;
            begun.map_err(BuildError::no_thread)?;
        }
        self.grow(total);
        Ok(extents)
    }

    /// So many bytes more are in the files, or on their way to them.
    fn grow(&mut self, bytes: u64) {
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
        self.held_bytes = 0;
        for rows in &mut self.files {
            // What could not be written is void too.
            let _ = rows.settle();
            rows.bytes = 0;
            rows.file
                .flush()
                .and_then(|()| rows.file.get_ref().set_len(0))
                .and_then(|()| rows.file.rewind())
                .map_err(|e| BuildError::scratch(&self.folder, "cannot clear scratch data", e))?;
        }
        Ok(())
    }

    /// The files' content so far.
    ///
    /// # Errors
    /// Where the disk is full, or the system refuses a mapping.
    pub fn map(&mut self) -> Result<Map, BuildError> {
        self.flush()?;
        // SAFETY: this process alone holds the files: they have no names, or random ones of this
        // user's, which the journal of an output alone knows, and the output is locked; they are
        // only appended to, cut only when no extent is left (`clear` takes `&mut self` where no map
        // lives), and holes are punched only in extents that nobody reads any more (whoever parts
        // rows may still have slices of them, but is past them), so the mapped bytes never change
        // under a reader and a mapping never reaches past its file's end.
        let map = |rows: &Growing| unsafe { Mmap::map(rows.file.get_ref()) };
        let maps: io::Result<Vec<Mmap>> = self.files.iter().map(map).collect();
        let failed = |e| BuildError::scratch(&self.folder, "cannot map scratch data", e);
        maps.map(Map).map_err(failed)
    }

    /// Gives the space of extents back to the system, neighbours together. Best effort: what is not
    /// given back is freed at the end.
    pub fn release(&mut self, mut extents: Vec<Extent>) {
        extents.sort_unstable_by_key(|e| (e.file, e.offset));
        for run in extents.chunk_by(|a, b| a.file == b.file && a.offset + a.bytes == b.offset) {
            let bytes = run.iter().map(|e| e.bytes).sum();
            let file = self.files.get(run[0].file as usize);
            if file.is_some_and(|rows| punch(rows.file.get_ref(), run[0].offset, bytes)) {
                self.held_bytes -= bytes;
            }
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Whoever wants to know whether all was written has asked.
        self.files.iter_mut().for_each(|rows| drop(rows.writing.take().map(JoinHandle::join)));
        if let Some(path) = self.path.take().filter(|_| !self.is_kept) {
            remove(&path);
        }
    }
}

/// Whether the system took so many bytes back: not every file system knows holes.
#[cfg(target_os = "linux")]
fn punch(file: &File, offset: u64, bytes: u64) -> bool {
    use rustix::fs::{FallocateFlags, fallocate};
    let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
    fallocate(file, hole, offset, bytes).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn punch(_file: &File, _offset: u64, _bytes: u64) -> bool {
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
        assert_eq!(b.of(&map), Some(&[2; 10_000][..]));
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let block = Arc::new(vec![1, 2, 3, 3, 4]);
        let run = |bytes| Run { block: Arc::clone(&block), bytes };
        let parts = vec![vec![run(3..5), run(0..1)], vec![], vec![run(1..3)]];
        let extents = scratch.append_meanwhile(parts).unwrap();
        let map = scratch.map().unwrap();
        let read: Vec<_> = extents.iter().map(|extent| extent.of(&map).unwrap()).collect();
        assert_eq!(read, [&[3, 4, 1][..], &[], &[2, 3]]);
        assert_eq!(Arc::strong_count(&block), 1);
        drop(map);
        scratch.clear().unwrap();
        let c = scratch.append(&[3; 10]).unwrap();
        assert_eq!(c.of(&scratch.map().unwrap()), Some(&[3; 10][..]));
        assert_eq!((scratch.bytes(), scratch.bytes_peak()), (20_015, 20_000));
        assert_eq!(scratch.disk_bytes_peak(), 20_500);
    }

    #[test]
    fn the_first_bytes_of_extents_are_taken_across_their_ends() {
        let extent = |offset, bytes| Extent { file: 3, offset, bytes };
        let mut extents = vec![extent(100, 10), extent(7, 20), extent(500, 5)];
        assert_eq!(take_first(&mut extents, 10), [extent(100, 10)]);
        assert_eq!(take_first(&mut extents, 3), [extent(7, 3)]);
        assert_eq!(take_first(&mut extents, 18), [extent(10, 17), extent(500, 1)]);
        assert_eq!(extents, [extent(501, 4)]);
    }

    #[test]
    fn as_many_files_as_threads_are_written_and_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let names = || fs::read_dir(folder.path()).unwrap().count();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let block = Arc::new((0..=255).collect::<Vec<u8>>());
        let parts = || -> Vec<Vec<Run>> {
            let run = |bytes| vec![Run { block: Arc::clone(&block), bytes }];
            [0..100, 100..130, 130..131, 131..256].map(run).into()
        };
        let mut scratch = Scratch::new(folder.path()).unwrap();
        let first = scratch.name().unwrap().unwrap().to_owned();
        let mut extents = pool.install(|| scratch.append_meanwhile(parts())).unwrap();
        assert_eq!(extents.iter().map(|e| e.file).collect::<Vec<_>>(), [0, 1, 1, 1]);
        extents.extend(pool.install(|| scratch.append_meanwhile(parts())).unwrap());
        scratch.flush().unwrap();
        scratch.keep(true);
        drop(scratch);
        assert_eq!(names(), 2);
        let mut scratch = Scratch::new(folder.path()).unwrap();
        scratch.reopen(&first).unwrap();
        assert!(scratch.restore(&extents).unwrap());
        extents.push(scratch.append(&[9; 50]).unwrap());
        let map = scratch.map().unwrap();
        let read: Vec<u8> = extents.iter().flat_map(|e| e.of(&map).unwrap().to_vec()).collect();
        assert_eq!(read, [&block[..], &block[..], &[9; 50]].concat());
        // What was never written, and a file that never was.
        let behind = Extent { offset: 1 << 40, ..extents[0] };
        assert!(!scratch.restore(&[behind]).unwrap());
        assert!(!scratch.restore(&[Extent { file: 2, ..behind }]).unwrap());
        drop((map, scratch));
        assert_eq!(names(), 0);
        // Whichever are left are deleted.
        for number in [0, 1, 3, FILES_MAX - 1] {
            fs::write(name_of(&first, number), []).unwrap();
        }
        fs::remove_file(&first).unwrap();
        remove(&first);
        assert_eq!(names(), 0);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Scratch::new(Path::new("/nowhere/at/all")).err().unwrap();
        assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    }
}
