//! Scratch space: a few files of rows that are appended to, also by threads in the
//! background, mapped to read, and freed piece by piece as rows are consumed. The files have
//! no names, unless a later build may resume from them. Mapped pages belong to the system
//! cache, not to anonymous memory.

use crate::error::BuildError;
use crate::rows::journal_record::{Record, RecordReader};
use esker_points::place::open_own;
use memmap2::Mmap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

/// Most files. Several are written at the same time, because an operating system lets one thread at
/// a time write to a file.
const FILES_MAX: usize = 8;
/// Bytes of a write to a file.
const WRITE_BYTES: usize = 1 << 20;
/// Stack of a writing thread, which hardly uses any.
const STACK_BYTES: usize = 128 << 10;
/// Beginning and end of the names of scratch files; all but the first have a number before the end.
const NAME: [&str; 2] = [".esker-", ".rows"];

/// A run of bytes in a scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Index of the file.
    pub file: u32,
    /// Offset in the file.
    pub offset: u64,
    /// Length.
    pub bytes: u64,
}

impl Extent {
    /// Adds the extent to a record.
    pub fn put(&self, record: &mut Record) {
        record.put(self.file);
        record.put([self.offset, self.bytes]);
    }

    /// Reads an extent from a record.
    pub fn get(from: &mut RecordReader<'_>) -> Option<Self> {
        let (file, [offset, bytes]) = (from.get()?, from.get()?);
        Some(Self { file, offset, bytes })
    }

    /// The bytes of the extent; `None` if `map` is older than the extent.
    pub fn of<'a>(&self, map: &'a Map) -> Option<&'a [u8]> {
        map.0
            .get(self.file as usize)?
            .get(self.offset as usize..(self.offset + self.bytes) as usize)
    }
}

/// Mappings of all files, as long as they were when they were mapped.
pub struct Map(Vec<Mmap>);

/// Removes the first `bytes` bytes from `extents` and returns their extents.
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

/// Bytes of a shared block, to be written to scratch.
pub struct BlockBytes {
    /// The block.
    pub block: Arc<Vec<u8>>,
    /// Range of its bytes.
    pub bytes: Range<usize>,
}

/// Whether the name of a file is that of a scratch file.
pub fn has_scratch_name(path: &Path) -> bool {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.starts_with(NAME[0]) && name.ends_with(NAME[1])
}

/// Deletes all existing scratch files of which the first has this path.
pub fn remove(first: &Path) {
    (0..FILES_MAX).for_each(|number| drop(fs::remove_file(name_of(first, number))));
}

/// Path of one of the scratch files of which the first has this path.
fn name_of(first: &Path, number: usize) -> PathBuf {
    if number == 0 { first.into() } else { first.with_extension(format!("{number}{}", NAME[1])) }
}

/// Creates a file that only this user can open; one that an earlier build has left is replaced.
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

/// A scratch file that is appended to.
struct AppendFile {
    file: BufWriter<File>,
    /// Length once all appended bytes are written.
    bytes: u64,
    /// Thread that writes in the background.
    writing: Option<JoinHandle<io::Result<()>>>,
}

impl AppendFile {
    fn new(file: File) -> Self {
        Self { file: BufWriter::with_capacity(WRITE_BYTES, file), bytes: 0, writing: None }
    }

    /// Waits for the thread that writes in the background.
    fn wait(&mut self) -> io::Result<()> {
        let Some(writing) = self.writing.take() else { return Ok(()) };
        writing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Writes all appended bytes to the system.
    fn flush(&mut self) -> io::Result<()> {
        self.wait()?;
        self.file.flush()
    }

    /// Appends runs in the background. The inner error says that no thread could be started.
    fn append_in_background(&mut self, runs: Vec<BlockBytes>) -> io::Result<io::Result<()>> {
        self.flush()?;
        let file = self.file.get_ref().try_clone()?;
        let write = move || {
            let mut file = BufWriter::with_capacity(WRITE_BYTES, file);
            // Each block is dropped when it is written.
            runs.into_iter().try_for_each(|run| file.write_all(&run.block[run.bytes]))?;
            file.flush()
        };
        let thread = thread::Builder::new().name("esker-scratch".into()).stack_size(STACK_BYTES);
        Ok(thread.spawn(write).map(|writing| self.writing = Some(writing)))
    }
}

/// The scratch files of a build. Files without names vanish with the process.
pub struct Scratch {
    files: Vec<AppendFile>,
    folder: PathBuf,
    /// Bytes written since the beginning.
    written_bytes: u64,
    /// Bytes not yet released.
    held_bytes: u64,
    held_bytes_peak: u64,
    /// Bytes of the file that is being built.
    output_bytes: u64,
    disk_bytes_peak: u64,
    /// Path of the first file, if the files have names.
    path: Option<PathBuf>,
    is_kept: bool,
}

impl Scratch {
    /// Creates a scratch file in `folder`; more are created when they are needed.
    ///
    /// # Errors
    /// If no file can be created in the folder.
    pub fn new(folder: &Path) -> Result<Self, BuildError> {
        let file = tempfile::tempfile_in(folder).map_err(|e| not_made(folder, e))?;
        Ok(Self {
            files: vec![AppendFile::new(file)],
            folder: folder.to_owned(),
            written_bytes: 0,
            held_bytes: 0,
            held_bytes_peak: 0,
            output_bytes: 0,
            disk_bytes_peak: 0,
            path: None,
            is_kept: false,
        })
    }

    /// Replaces the files, which are empty, by files with names, for the journal. Returns the path
    /// of the first; `None` if the folder's path is not Unicode.
    ///
    /// # Errors
    /// If no file can be created in the folder.
    pub fn make_named(&mut self) -> Result<Option<&Path>, BuildError> {
        debug_assert!(self.is_empty());
        if self.path.is_none() && self.folder.to_str().is_some() {
            let failed = |e| not_made(&self.folder, e);
            // An absolute path is valid from the current folder of any later build.
            let folder = self.folder.canonicalize().map_err(failed)?;
            let mut named = tempfile::Builder::new();
            let named = named.prefix(NAME[0]).suffix(NAME[1]).tempfile_in(folder);
            let (file, path) =
                named.and_then(|n| n.keep().map_err(io::Error::from)).map_err(failed)?;
            self.files = vec![AppendFile::new(file)];
            self.path = Some(path);
        }
        Ok(self.path.as_deref())
    }

    /// Opens the files of an earlier build, up to the first missing one. [`Scratch::restore`] then
    /// takes the extents in them.
    ///
    /// # Errors
    /// If the first file does not exist, or one cannot be opened.
    pub fn reopen(&mut self, path: &Path) -> io::Result<()> {
        if !has_scratch_name(path) {
            return Err(io::Error::other("it has another name than scratch files have"));
        }
        let open = |number| open_own(&name_of(path, number));
        self.files = vec![AppendFile::new(open(0)?)];
        for number in 1..FILES_MAX {
            match open(number) {
                Ok(file) => self.files.push(AppendFile::new(file)),
                Err(e) if e.kind() == io::ErrorKind::NotFound => break,
                Err(e) => return Err(e),
            }
        }
        self.path = Some(path.into());
        Ok(())
    }

    /// Creates one more file.
    fn add_file(&mut self) -> Result<(), BuildError> {
        let file = match &self.path {
            None => tempfile::tempfile_in(&self.folder),
            Some(first) => create(&name_of(first, self.files.len())),
        };
        self.files.push(AppendFile::new(file.map_err(|e| not_made(&self.folder, e))?));
        Ok(())
    }

    /// Sets the extents that the reopened files hold; new bytes are appended after the last one.
    /// Returns whether the files are long enough.
    ///
    /// # Errors
    /// If the disk fails.
    pub fn restore(&mut self, extents: &[Extent]) -> Result<bool, BuildError> {
        for extent in extents {
            let Some(file) = self.files.get_mut(extent.file as usize) else { return Ok(false) };
            let Some(end) = extent.offset.checked_add(extent.bytes) else { return Ok(false) };
            file.bytes = file.bytes.max(end);
            self.written_bytes += extent.bytes;
            self.held_bytes += extent.bytes;
        }
        self.note_peaks();
        let mut is_long_enough = true;
        for AppendFile { file, bytes, .. } in &mut self.files {
            let sought = file.seek(io::SeekFrom::Start(*bytes));
            let length = sought.and_then(|_| file.get_ref().metadata()).map(|m| m.len());
            let failed = |e| BuildError::scratch(&self.folder, "cannot read scratch data", e);
            is_long_enough &= length.map_err(failed)? >= *bytes;
        }
        Ok(is_long_enough)
    }

    /// Whether no bytes were appended.
    pub fn is_empty(&self) -> bool {
        self.files.iter().all(|file| file.bytes == 0)
    }

    /// Sets whether named files stay when the scratch space is dropped.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Writes all appended bytes to the system.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn flush(&mut self) -> Result<(), BuildError> {
        // All threads are waited for, also after an error.
        let flushed: Vec<io::Result<()>> = self.files.iter_mut().map(AppendFile::flush).collect();
        flushed.into_iter().collect::<io::Result<()>>().map_err(|e| self.not_written(e))
    }

    fn not_written(&self, e: io::Error) -> BuildError {
        BuildError::scratch(&self.folder, "cannot write scratch data", e)
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<Extent, BuildError> {
        let first = &mut self.files[0];
        let written = first.wait().and_then(|()| first.file.write_all(bytes));
        let extent = Extent { file: 0, offset: first.bytes, bytes: bytes.len() as u64 };
        first.bytes += extent.bytes;
        written.map_err(|e| self.not_written(e))?;
        self.grow(extent.bytes);
        Ok(extent)
    }

    /// Appends groups of runs in the background, the runs of a group consecutively. The
    /// next call that uses the files waits, and returns the errors of the threads. Returns
    /// the extent of each group.
    ///
    /// # Errors
    /// If the disk is full for bytes appended before; if no thread can be started.
    pub fn append_in_background(
        &mut self,
        groups: Vec<Vec<BlockBytes>>,
    ) -> Result<Vec<Extent>, BuildError> {
        self.flush()?;
        let bytes_of =
            |runs: &[BlockBytes]| runs.iter().map(|run| run.bytes.len() as u64).sum::<u64>();
        let total: u64 = groups.iter().map(|runs| bytes_of(runs)).sum();
        let files = rayon::current_num_threads().clamp(1, FILES_MAX);
        let share = total.div_ceil(files as u64).max(1);
        let mut runs_of: Vec<Vec<BlockBytes>> = Vec::new();
        let mut extents = Vec::with_capacity(groups.len());
        let mut before = 0;
        for mut runs in groups {
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
            let started =
                self.files[file].append_in_background(runs).map_err(|e| self.not_written(e))?;
            started.map_err(BuildError::no_thread)?;
        }
        self.grow(total);
        Ok(extents)
    }

    /// Counts bytes that were appended, written or not.
    fn grow(&mut self, bytes: u64) {
        self.written_bytes += bytes;
        self.held_bytes += bytes;
        self.note_peaks();
    }

    /// Sets the length of the file that is being built, for [`Self::disk_bytes_peak`].
    pub fn set_output_bytes(&mut self, bytes: u64) {
        self.output_bytes = bytes;
        self.note_peaks();
    }

    fn note_peaks(&mut self) {
        self.held_bytes_peak = self.held_bytes_peak.max(self.held_bytes);
        self.disk_bytes_peak = self.disk_bytes_peak.max(self.held_bytes + self.output_bytes);
    }

    /// Bytes written since the beginning.
    pub fn bytes(&self) -> u64 {
        self.written_bytes
    }

    /// Most bytes that were held at one time.
    pub fn bytes_peak(&self) -> u64 {
        self.held_bytes_peak
    }

    /// Most bytes that scratch and the file that is being built held together at one time.
    pub fn disk_bytes_peak(&self) -> u64 {
        self.disk_bytes_peak
    }

    /// Empties the files; all extents become invalid.
    ///
    /// # Errors
    /// If a file cannot be cut.
    pub fn clear(&mut self) -> Result<(), BuildError> {
        self.held_bytes = 0;
        for rows in &mut self.files {
            // Bytes that could not be written are not needed any more.
            let _ = rows.wait();
            rows.bytes = 0;
            rows.file
                .flush()
                .and_then(|()| rows.file.get_ref().set_len(0))
                .and_then(|()| rows.file.rewind())
                .map_err(|e| BuildError::scratch(&self.folder, "cannot clear scratch data", e))?;
        }
        Ok(())
    }

    /// Maps the files as they are now.
    ///
    /// # Errors
    /// If the disk is full, or the system refuses a mapping.
    pub fn map(&mut self) -> Result<Map, BuildError> {
        self.flush()?;
        // SAFETY: only this process opens the files: they have no names, or random names of this
        // user that only the journal of an output knows, and the output is locked. They are only
        // appended to, and cut only when no extent is left (`clear` takes `&mut self` when no map
        // lives). Holes are punched only in extents that are not read any more (code that splits a
        // bucket may still have slices of them, but is past them). So mapped bytes never change
        // under a reader, and a mapping never reaches past the end of its file.
        let map = |rows: &AppendFile| unsafe { Mmap::map(rows.file.get_ref()) };
        let maps: io::Result<Vec<Mmap>> = self.files.iter().map(map).collect();
        let failed = |e| BuildError::scratch(&self.folder, "cannot map scratch data", e);
        maps.map(Map).map_err(failed)
    }

    /// Frees the space of extents, adjacent ones together. Space that cannot be freed now is freed
    /// at the end.
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
        // Errors were returned by `flush`, or nobody needs the bytes.
        self.files.iter_mut().for_each(|rows| drop(rows.writing.take().map(JoinHandle::join)));
        if let Some(path) = self.path.take().filter(|_| !self.is_kept) {
            remove(&path);
        }
    }
}

/// Frees bytes of a file; returns whether that worked: not every file system supports holes.
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
        scratch.set_output_bytes(500);
        scratch.release(vec![a]);
        scratch.set_output_bytes(7_000);
        let map = scratch.map().unwrap();
        assert_eq!(b.of(&map), Some(&[2; 10_000][..]));
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let block = Arc::new(vec![1, 2, 3, 3, 4]);
        let run = |bytes| BlockBytes { block: Arc::clone(&block), bytes };
        let groups = vec![vec![run(3..5), run(0..1)], vec![], vec![run(1..3)]];
        let extents = scratch.append_in_background(groups).unwrap();
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
    fn one_file_a_thread_is_written_and_reopened() {
        let folder = tempfile::tempdir().unwrap();
        let names = || fs::read_dir(folder.path()).unwrap().count();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let block = Arc::new((0..=255).collect::<Vec<u8>>());
        let groups = || -> Vec<Vec<BlockBytes>> {
            let run = |bytes| vec![BlockBytes { block: Arc::clone(&block), bytes }];
            [0..100, 100..130, 130..131, 131..256].map(run).into()
        };
        let mut scratch = Scratch::new(folder.path()).unwrap();
        let first = scratch.make_named().unwrap().unwrap().to_owned();
        let mut extents = pool.install(|| scratch.append_in_background(groups())).unwrap();
        assert_eq!(extents.iter().map(|e| e.file).collect::<Vec<_>>(), [0, 1, 1, 1]);
        extents.extend(pool.install(|| scratch.append_in_background(groups())).unwrap());
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
        // Bytes that were never written, and a file that never existed.
        let behind = Extent { offset: 1 << 40, ..extents[0] };
        assert!(!scratch.restore(&[behind]).unwrap());
        assert!(!scratch.restore(&[Extent { file: 2, ..behind }]).unwrap());
        drop((map, scratch));
        assert_eq!(names(), 0);
        // All files that are left are deleted.
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
