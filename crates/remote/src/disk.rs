//! Blocks that were fetched before, in a folder of bounded size: for each file of a name, size and
//! version two files, `ID.blocks` with the blocks at their places, and `ID.sums` with a checksum of
//! each, so that one that was not written to its end counts as absent. Several processes may use
//! the folder: they write the same bytes to the same places.

use crate::blocks::BLOCK;
use esker_points::place::open_own;
use esker_points::positioned::{read_exact_at, write_all_at};
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::SystemTime;
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// Bytes that the folder in the user's cache has at most.
const BYTES_MAX: u64 = 4 << 30;
/// Bytes of a checksum.
const SUM: u64 = 8;

/// The folder.
#[derive(Debug)]
pub struct Disk {
    folder: PathBuf,
    bytes_max: u64,
}

impl Disk {
    /// A folder, which is made when something is written, of at most about `bytes_max`.
    pub fn new(folder: PathBuf, bytes_max: u64) -> Self {
        Self { folder, bytes_max }
    }

    /// The folder in the user's cache; `None` if the user has none.
    pub fn of_user() -> Option<Self> {
        Some(Self::new(dirs::cache_dir()?.join("esker").join("ranges"), BYTES_MAX))
    }

    /// The blocks of a file of `size` bytes, whose `version` tells it from others at its address;
    /// `None` if they cannot be kept. Removes other files that were not used for longest, where
    /// there are too many bytes.
    pub(crate) fn file(&self, address: &str, version: &str, size: u64) -> Option<DiskFile> {
        self.make_folder().ok()?;
        let name = format!("{address}\n{version}\n{size}");
        let id = format!("{:032x}", xxh3_128(name.as_bytes()));
        self.make_room(&id);
        let open = |ending: &str| {
            let path = self.folder.join(format!("{id}.{ending}"));
            open_own(&path)
                .or_else(|_| OpenOptions::new().read(true).write(true).create_new(true).open(&path))
                // Another process has made it since.
                .or_else(|_| open_own(&path))
        };
        let (blocks, sums) = (open("blocks").ok()?, open("sums").ok()?);
        // The time of its use, for the choice of what is removed.
        let _ = sums.set_modified(SystemTime::now());
        // The other half is for other files.
        let left = (self.bytes_max / 2).saturating_sub(taken(&blocks));
        Some(DiskFile { blocks, sums, size, left: Mutex::new(left) })
    }

    /// Makes the folder. Files that only this user may fetch are nothing for others to read.
    fn make_folder(&self) -> io::Result<()> {
        if let Some(parent) = self.folder.parent() {
            std::fs::create_dir_all(parent)?;
        }
        let mut builder = std::fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        match builder.create(&self.folder) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
            _ => Ok(()),
        }
    }

    /// Removes files, but for those of `id`, until half of the room is free or none is left.
    fn make_room(&self, id: &str) {
        let mut found: Vec<(SystemTime, PathBuf, u64)> = Vec::new();
        let mut sum = 0;
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.extension().is_none_or(|e| e != "sums") {
                continue;
            }
            let bytes = File::open(path.with_extension("blocks")).map_or(0, |file| taken(&file));
            sum += bytes;
            if path.file_stem().is_some_and(|stem| stem != id) {
                let used =
                    entry.metadata().and_then(|m| m.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
                found.push((used, path, bytes));
            }
        }
        found.sort();
        for (_, path, bytes) in found {
            if sum <= self.bytes_max / 2 {
                return;
            }
            let _ = std::fs::remove_file(path.with_extension("blocks"));
            let _ = std::fs::remove_file(&path);
            sum = sum.saturating_sub(bytes);
        }
    }

    /// Path of the folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

/// Bytes on the disk of a file with holes.
#[cfg(unix)]
fn taken(file: &File) -> u64 {
    use std::os::unix::fs::MetadataExt;
    file.metadata().map_or(0, |m| m.blocks() * 512)
}

#[cfg(not(unix))]
fn taken(file: &File) -> u64 {
    file.metadata().map_or(0, |m| m.len())
}

/// Blocks of a file.
#[derive(Debug)]
pub(crate) struct DiskFile {
    blocks: File,
    sums: File,
    size: u64,
    /// Bytes that may still be written.
    left: Mutex<u64>,
}

impl DiskFile {
    /// Bytes of a block, if it was kept.
    pub(crate) fn read(&self, number: u64) -> Option<Vec<u8>> {
        let mut sum = [0; SUM as usize];
        read_exact_at(&self.sums, &mut sum, number * SUM).ok()?;
        if sum == [0; SUM as usize] {
            return None;
        }
        let start = number * BLOCK;
        let mut bytes = vec![0; self.size.checked_sub(start)?.min(BLOCK) as usize];
        read_exact_at(&self.blocks, &mut bytes, start).ok()?;
        (sum_of(&bytes) == sum).then_some(bytes)
    }

    /// Keeps a block; does nothing where it cannot.
    pub(crate) fn write(&self, number: u64, bytes: &[u8]) {
        let mut left = self.left.lock().unwrap_or_else(PoisonError::into_inner);
        if *left < bytes.len() as u64 {
            return;
        }
        let write = || -> io::Result<()> {
            write_all_at(&self.blocks, bytes, number * BLOCK)?;
            write_all_at(&self.sums, &sum_of(bytes), number * SUM)
        };
        match write() {
            Ok(()) => *left -= bytes.len() as u64,
            // A full disk: nothing more is kept.
            Err(_) => *left = 0,
        }
    }
}

/// Checksum of a block; never zero, which stands for a block that is absent.
fn sum_of(bytes: &[u8]) -> [u8; SUM as usize] {
    xxh3_64(bytes).max(1).to_le_bytes()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn blocks_come_back_and_damaged_or_unknown_ones_are_absent() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::new(folder.path().join("ranges"), 1 << 30);
        let size = 3 * BLOCK + 10;
        let file = disk.file("https://host/a", "1", size).unwrap();
        let [whole, last] = [vec![7; BLOCK as usize], vec![9; 10]];
        file.write(1, &whole);
        file.write(3, &last);
        assert_eq!(file.read(1), Some(whole.clone()));
        assert_eq!(file.read(3), Some(last));
        assert_eq!([file.read(0), file.read(2), file.read(4)], [None, None, None]);
        // Another process has it too, another version of the file has not.
        assert_eq!(disk.file("https://host/a", "1", size).unwrap().read(1), Some(whole));
        assert_eq!(disk.file("https://host/a", "2", size).unwrap().read(1), None);
        assert_eq!(disk.file("https://host/b", "1", size).unwrap().read(1), None);
        write_all_at(&file.blocks, &[1], BLOCK + 5).unwrap();
        assert_eq!(file.read(1), None, "damaged");
        // Files that others cut or emptied have nothing.
        file.write(1, &[7; BLOCK as usize]);
        file.blocks.set_len(BLOCK + 5).unwrap();
        assert_eq!(file.read(1), None, "cut");
        file.sums.set_len(0).unwrap();
        assert_eq!(file.read(1), None, "empty");
    }

    #[test]
    #[cfg(unix)]
    fn nobody_else_reads_the_folder_and_one_that_cannot_be_made_is_done_without() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("esker").join("ranges");
        Disk::new(place.clone(), 1 << 30).file("https://host/a", "1", 10).unwrap();
        assert_eq!(place.metadata().unwrap().permissions().mode() & 0o777, 0o700);
        let taken = folder.path().join("taken");
        std::fs::write(&taken, "a file").unwrap();
        assert!(Disk::new(taken.clone(), 1 << 30).file("https://host/a", "1", 10).is_none());
        assert!(Disk::new(taken.join("x"), 1 << 30).file("https://host/a", "1", 10).is_none());
    }

    #[test]
    fn processes_that_use_and_remove_the_same_files_read_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let folder = folder.path();
                scope.spawn(move || {
                    for i in 0..40 {
                        // So small that each file that is opened removes others.
                        let disk = Disk::new(folder.to_owned(), 8 * BLOCK);
                        let number = (i + thread) % 3;
                        let address = format!("https://host/{number}");
                        let Some(file) = disk.file(&address, "1", 4 * BLOCK) else { continue };
                        let block = vec![number as u8 + 1; BLOCK as usize];
                        for at in 0..4 {
                            if let Some(read) = file.read(at) {
                                assert_eq!(read, block);
                            }
                            file.write(at, &block);
                        }
                    }
                });
            }
        });
    }

    #[test]
    fn the_folder_keeps_its_bound_and_what_was_used_last() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Disk::new(folder.path().to_owned(), 16 * BLOCK);
        let block = vec![1; BLOCK as usize];
        for i in 0..20 {
            let file = disk.file(&format!("https://host/{i}"), "1", 100 * BLOCK).unwrap();
            (0..20).for_each(|number| file.write(number, &block));
            assert!(file.read(0).is_some());
            let files = std::fs::read_dir(folder.path()).unwrap().flatten();
            let sum: u64 = files.map(|f| taken(&File::open(f.path()).unwrap())).sum();
            assert!(sum <= 17 * BLOCK, "{sum}");
            let names = std::fs::read_dir(folder.path()).unwrap().count();
            assert!(names <= 4, "{names}");
        }
    }
}
