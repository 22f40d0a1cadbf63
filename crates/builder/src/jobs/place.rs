//! The place of a divided build ([`esker_points::objects`]) in a folder, on a disk or a file system
//! that many machines share; and which place a path names.

pub use esker_points::objects::{Listed, Place, Upload};

use esker_points::objects;
use esker_points::place::no_file_at;
use esker_points::read_at::{FileSource, ReadAt, is_remote};
use esker_points::unfinished::Unfinished;
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes of a write of a large object.
const WRITE_BYTES: usize = 1 << 20;
/// End of the name of a small object that is not created yet.
const NEW: &str = ".new";

/// Sixteen hexadecimal digits that no other process has, on this machine or another.
pub fn unique() -> String {
    // The keys of this hasher are random numbers of the system.
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    format!("{:016x}", hasher.finish())
}

/// The place that a path names: below an address, or in a folder.
///
/// # Errors
/// For an address, as for [`objects::at`].
pub fn at(path: &Path) -> io::Result<Box<dyn Place>> {
    if is_remote(path) { objects::at(path) } else { Ok(Box::new(Folder::new(path))) }
}

/// A place in a folder, which is made when it is first written.
pub struct Folder(PathBuf);

impl Folder {
    /// The place in the folder of this path.
    pub fn new(path: &Path) -> Self {
        Self(path.to_owned())
    }

    fn path(&self, name: &str) -> PathBuf {
        name.split('/').fold(self.0.clone(), |path, part| path.join(part))
    }

    /// Creates a file of a name that is not there yet, and its folder.
    fn create_new(&self, name: &str) -> io::Result<(File, PathBuf)> {
        let path = self.path(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        Ok((OpenOptions::new().write(true).create_new(true).open(&path)?, path))
    }
}

impl Place for Folder {
    fn create(&self, name: &str, bytes: &[u8]) -> io::Result<bool> {
        let path = self.path(name);
        let (mut file, new) = self.create_new(&format!("{name}-{}{NEW}", unique()))?;
        let listed = Unfinished::new(&new);
        let written = file.write_all(bytes).and_then(|()| file.sync_all());
        drop(file);
        let created = written.and_then(|()| publish(&new, &path));
        let _ = fs::remove_file(&new);
        drop(listed);
        if created.as_ref().is_ok_and(|&is_first| is_first) {
            sync_folder(&path);
        }
        created
    }

    fn read(&self, name: &str, bytes_max: u64) -> io::Result<Option<Vec<u8>>> {
        let path = self.path(name);
        let file = match File::open(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => {
                // Clients of NFS remember for a while that a name was not there, unless the folder
                // is opened.
                drop(path.parent().map(fs::read_dir));
                match File::open(&path) {
                    Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
                    file => file?,
                }
            }
            file => file?,
        };
        let mut bytes = Vec::new();
        file.take(bytes_max.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > bytes_max {
            return Err(io::Error::other(format!("is longer than {bytes_max} bytes")));
        }
        Ok(Some(bytes))
    }

    fn begin(&self, name: &str) -> io::Result<Box<dyn Upload>> {
        let (file, path) = self.create_new(name)?;
        let listed = Unfinished::new(&path);
        let file = Some(BufWriter::with_capacity(WRITE_BYTES, file));
        Ok(Box::new(FileUpload { file, path, _listed: listed }))
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn ReadAt>> {
        let path = self.path(name);
        if let Some(what) = no_file_at(&path)? {
            return Err(io::Error::other(what));
        }
        Ok(Arc::new(FileSource(File::open(path)?)))
    }

    fn list(&self, prefix: &str) -> io::Result<Vec<Listed>> {
        let (folder, _) = prefix.rsplit_once('/').unwrap_or(("", prefix));
        let entries = match fs::read_dir(self.path(folder)) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries?,
        };
        let mut listed = Vec::new();
        for entry in entries {
            let entry = entry?;
            let Ok(own) = entry.file_name().into_string() else { continue };
            let name = if folder.is_empty() { own } else { format!("{folder}/{own}") };
            // What another job has removed meanwhile is not there.
            let Ok(metadata) = entry.metadata() else { continue };
            if metadata.is_file() && name.starts_with(prefix) {
                listed.push(Listed { name, bytes: metadata.len() });
            }
        }
        listed.sort_unstable();
        Ok(listed)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        match fs::remove_file(self.path(name)) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
            _ => Ok(()),
        }
    }

    fn shown(&self) -> String {
        self.0.display().to_string()
    }
}

/// A large file being written.
struct FileUpload {
    /// `None` once it is whole.
    file: Option<BufWriter<File>>,
    path: PathBuf,
    _listed: Unfinished,
}

impl Write for FileUpload {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), BufWriter::flush)
    }
}

impl Upload for FileUpload {
    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.flush()?;
        // File systems of networks report a full disk only here.
        if let Some(file) = &self.file {
            file.get_ref().sync_all()?;
        }
        sync_folder(&self.path);
        self.file = None;
        Ok(())
    }
}

impl Drop for FileUpload {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // Nothing of what is buffered needs to be written.
            drop(file.into_parts());
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Gives a whole file a second name, unless there is one; returns whether it did.
fn publish(new: &Path, path: &Path) -> io::Result<bool> {
    let linked = fs::hard_link(new, path);
    match linked {
        Ok(()) => Ok(true),
        // The answer of a server may be lost, and the request repeated: then the link is there.
        Err(_) if has_two_names(new) => Ok(true),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::StorageFull) => Err(e),
        Err(e) => rename_new(new, path).unwrap_or_else(|| Err(no_first(&e))),
    }
}

/// Error where a file system cannot create a whole file under a name that is not there.
fn no_first(e: &io::Error) -> io::Error {
    io::Error::other(format!(
        "{e}: this file system has neither hard links nor renames that replace nothing, by which \
         jobs agree who is first; choose another folder"
    ))
}

/// Whether a file has a second name.
#[cfg(unix)]
fn has_two_names(path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    path.symlink_metadata().is_ok_and(|metadata| metadata.nlink() == 2)
}

#[cfg(not(unix))]
fn has_two_names(_path: &Path) -> bool {
    false
}

/// Renames a file to a name that is not there yet, where the system can do that at once; `None`
/// where it cannot.
#[cfg(target_os = "linux")]
fn rename_new(new: &Path, path: &Path) -> Option<io::Result<bool>> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    use rustix::io::Errno;
    match renameat_with(CWD, new, CWD, path, RenameFlags::NOREPLACE) {
        Ok(()) => Some(Ok(true)),
        Err(Errno::EXIST) => Some(Ok(false)),
        Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => None,
        Err(e) => Some(Err(e.into())),
    }
}

#[cfg(not(target_os = "linux"))]
fn rename_new(_new: &Path, _path: &Path) -> Option<io::Result<bool>> {
    None
}

/// Writes the names in the folder of a file to the disk, where the system can.
fn sync_folder(path: &Path) {
    if let Some(Ok(folder)) = path.parent().map(File::open) {
        let _ = folder.sync_all();
    }
}
