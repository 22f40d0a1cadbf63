//! Files that are built from scans for a window, kept in the user's cache folder: the same scans
//! open at once the next time. A file belongs to the paths, sizes and times of its scans and to the
//! options of the build; a change of any makes another file. Beyond a limit, files that were not
//! used for longest are removed.
//!
//! Each file has a folder of its own, with a list of what it was built from. While it is built, the
//! name of the folder ends with the number of the process, so that what a killed process left is
//! found and removed.

use crate::io::inputs;
use anyhow::{Context, Result};
use esker_builder::Options;
use esker_points::task::Silent;
use serde_json::{Value, json};
use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// The built file, and the list of what it was built from, in its folder.
const BUILT: &str = "scan.esker";
const LIST: &str = "built-from.txt";
/// Most bytes of a list.
const LIST_BYTES_MAX: u64 = 64 << 20;
/// Age from which a folder of an unknown process is taken for left behind, where the system does
/// not tell which processes run.
const LEFT_AGE: Duration = Duration::from_secs(24 * 3600);

/// The kept files of a user.
#[derive(Clone, Debug)]
pub struct Kept {
    folder: PathBuf,
    limit_bytes: u64,
}

/// A place for the file of certain scans and options.
#[derive(Clone, Debug)]
pub struct Place {
    /// What the file is built from, a line each.
    list: String,
    /// Folder of the finished file, and while it is built.
    folder: PathBuf,
    building: PathBuf,
}

impl Kept {
    /// The files in the user's cache folder, of at most `limit_bytes` together; `None` if there is
    /// no such folder, or the limit is 0.
    pub fn of_user(limit_bytes: u64) -> Option<Self> {
        let folder = dirs::cache_dir()?.join("esker").join("built");
        (limit_bytes > 0).then_some(Self { folder, limit_bytes })
    }

    /// The files in a folder, of at most `limit_bytes` together.
    pub fn in_folder(folder: &Path, limit_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), limit_bytes }
    }

    /// Place of the file that is built from scans and folders of scans; `None` if one of them is no
    /// file.
    pub fn place(&self, named: &[PathBuf], options: &Options) -> Option<Place> {
        let mut list = format!("esker {}\n", env!("CARGO_PKG_VERSION"));
        for scan in inputs::scans(named, &Silent).ok()? {
            let path = scan.canonicalize().ok()?;
            let about = path.metadata().ok().filter(fs::Metadata::is_file)?;
            let since = about.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
            let path = path.to_str()?;
            let line =
                json!({"path": path, "bytes": about.len(), "modified": since.as_nanos() as u64});
            list += &format!("{line}\n");
        }
        // How it is built does not change the file.
        let how = Options { memory_bytes: 0, scratch: None, ..options.clone() };
        list += &format!("{how:?}\n");
        let mut hasher = DefaultHasher::new();
        list.hash(&mut hasher);
        let name = format!("{:016x}", hasher.finish());
        let building = self.folder.join(format!("{name}.{}", std::process::id()));
        Some(Place { list, folder: self.folder.join(name), building })
    }

    /// The kept file of a place, which counts as used from now on.
    pub fn find(&self, place: &Place) -> Option<PathBuf> {
        let built = place.folder.join(BUILT);
        let is_same = read_list(&place.folder).is_some_and(|list| list == place.list);
        if !is_same || !built.is_file() {
            return None;
        }
        // A folder that cannot be changed is used as it is.
        if let Ok(list) = File::options().append(true).open(place.folder.join(LIST)) {
            let _ = list.set_modified(SystemTime::now());
        }
        Some(built)
    }

    /// Scans of the kept files that still exist, the last used ones first; at most `most` times.
    pub fn recent(&self, most: usize) -> Vec<Vec<PathBuf>> {
        let mut all: Vec<(SystemTime, PathBuf)> = folders(&self.folder)
            .filter(|folder| process_of(folder).is_none())
            .filter_map(|folder| {
                let used = folder.join(LIST).metadata().ok()?.modified().ok()?;
                Some((used, folder))
            })
            .collect();
        all.sort();
        let scans = |(_, folder): (SystemTime, PathBuf)| -> Option<Vec<PathBuf>> {
            let list = read_list(&folder)?;
            let lines = list.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
            let paths = lines.filter_map(|line| line["path"].as_str().map(PathBuf::from));
            let paths: Vec<PathBuf> = paths.collect();
            (!paths.is_empty() && paths.iter().all(|path| path.is_file())).then_some(paths)
        };
        let mut recent: Vec<Vec<PathBuf>> = Vec::new();
        for paths in all.into_iter().rev().filter_map(scans) {
            if recent.len() < most && !recent.contains(&paths) {
                recent.push(paths);
            }
        }
        recent
    }

    /// Makes the folder in which the file of a place is built, after removing what killed processes
    /// have left. Returns the path of the file to build.
    ///
    /// # Errors
    /// If the folder cannot be made or written.
    pub fn begin(&self, place: &Place) -> Result<PathBuf> {
        self.sweep();
        let context = || format!("{}: cannot keep a built file in it", self.folder.display());
        fs::create_dir_all(&place.building).with_context(context)?;
        let mut list = File::create(place.building.join(LIST)).with_context(context)?;
        list.write_all(place.list.as_bytes()).with_context(context)?;
        Ok(place.building.join(BUILT))
    }

    /// Keeps the file that was built at a place, and removes others beyond the limit. Returns its
    /// path, or `None` if it is larger than the limit alone: it is then still where it was built.
    ///
    /// # Errors
    /// If the folder cannot be renamed.
    pub fn keep(&self, place: &Place) -> Result<Option<PathBuf>> {
        let bytes = place.building.join(BUILT).metadata().map_or(0, |about| about.len());
        if bytes > self.limit_bytes {
            return Ok(None);
        }
        // An older file of a place is damaged, or of the same name by chance.
        if place.folder.exists() {
            let _ = fs::remove_dir_all(&place.folder);
        }
        fs::rename(&place.building, &place.folder)
            .with_context(|| format!("{}: cannot keep the built file", place.folder.display()))?;
        self.trim(place);
        Ok(Some(place.folder.join(BUILT)))
    }

    /// Removes the files that were not used for longest, until the rest is within the limit.
    fn trim(&self, place: &Place) {
        let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for folder in folders(&self.folder).filter(|folder| process_of(folder).is_none()) {
            let used = folder.join(LIST).metadata().and_then(|about| about.modified());
            let bytes = folder.join(BUILT).metadata().map_or(0, |about| about.len());
            files.extend(used.ok().map(|used| (used, bytes, folder)));
        }
        files.sort();
        let mut all: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, bytes, folder) in files {
            if all <= self.limit_bytes {
                break;
            }
            if folder != place.folder && fs::remove_dir_all(&folder).is_ok() {
                all -= bytes;
            }
        }
    }

    /// Removes folders in which a process that has ended was building.
    fn sweep(&self) {
        for folder in folders(&self.folder) {
            if process_of(&folder).is_some_and(|process| !runs(process, &folder)) {
                let _ = fs::remove_dir_all(folder);
            }
        }
    }
}

impl Place {
    /// Folder in which the file is built.
    pub fn building(&self) -> &Path {
        &self.building
    }
}

/// The folders in a folder.
fn folders(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir())
}

/// Number of the process that builds in a folder, by its name.
fn process_of(folder: &Path) -> Option<u32> {
    folder.extension()?.to_str()?.parse().ok()
}

/// Whether a process may still run that builds in `folder`.
fn runs(process: u32, folder: &Path) -> bool {
    if cfg!(target_os = "linux") {
        return Path::new("/proc").join(process.to_string()).exists();
    }
    let made = folder.metadata().and_then(|about| about.modified()).ok();
    made.and_then(|made| made.elapsed().ok()).is_none_or(|age| age < LEFT_AGE)
}

fn read_list(folder: &Path) -> Option<String> {
    let mut text = String::new();
    let file = File::open(folder.join(LIST)).ok()?;
    file.take(LIST_BYTES_MAX).read_to_string(&mut text).ok()?;
    Some(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    /// Builds a file of so many bytes for a scan, and keeps it.
    fn build(kept: &Kept, scan: &Path, bytes: usize) -> (Place, Option<PathBuf>) {
        let place = kept.place(&[scan.to_owned()], &Options::default()).unwrap();
        assert_eq!(kept.find(&place), None);
        fs::write(kept.begin(&place).unwrap(), vec![7; bytes]).unwrap();
        let path = kept.keep(&place).unwrap();
        (place, path)
    }

    fn scan(folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        fs::write(&path, "1 2 3\n").unwrap();
        path
    }

    #[test]
    fn a_file_is_found_again_until_its_scan_or_the_options_change() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Kept::in_folder(&folder.path().join("kept"), 1000);
        let scan = scan(folder.path(), "a.xyz");
        let (place, path) = build(&kept, &scan, 10);
        assert_eq!(kept.find(&place), path);
        assert_eq!(kept.recent(9), [[scan.canonicalize().unwrap()]]);
        assert!(kept.recent(0).is_empty());
        let of = |options: &Options| kept.place(std::slice::from_ref(&scan), options).unwrap();
        let how = Options { memory_bytes: 1, scratch: Some("x".into()), ..Options::default() };
        assert_eq!(kept.find(&of(&how)), path, "how it is built does not matter");
        let what = Options { node_capacity: 4096, ..Options::default() };
        assert_eq!(kept.find(&of(&what)), None);
        fs::write(&scan, "1 2 3\n4 5 6\n").unwrap();
        assert_eq!(kept.find(&of(&Options::default())), None);
        let none = folder.path().join("none.xyz");
        assert!(kept.place(&[none], &Options::default()).is_none());
        assert!(kept.place(&["synthetic:terrain:1k:1".into()], &Options::default()).is_none());
    }

    #[test]
    fn files_not_used_for_longest_are_removed_beyond_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Kept::in_folder(&folder.path().join("kept"), 1000);
        let scans = ["a.xyz", "b.xyz", "c.xyz"].map(|name| scan(folder.path(), name));
        let [a, b] = [0, 1].map(|i| build(&kept, &scans[i], 400).0);
        let past = SystemTime::now() - Duration::from_secs(50);
        for (place, age) in [(&a, 0), (&b, 20)] {
            let list = File::options().append(true).open(place.folder.join(LIST)).unwrap();
            list.set_modified(past + Duration::from_secs(age)).unwrap();
        }
        assert!(kept.find(&a).is_some(), "it is used now");
        let (c, path) = build(&kept, &scans[2], 400);
        assert!(path.is_some() && kept.find(&c).is_some());
        assert!(kept.find(&a).is_some());
        assert_eq!(kept.find(&b), None);
        let large = scan(folder.path(), "large.xyz");
        let (place, path) = build(&kept, &large, 2000);
        assert!(path.is_none() && place.building().join(BUILT).is_file());
        assert!(kept.find(&a).is_some(), "a file beyond the limit removes no other");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn what_a_killed_process_has_left_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Kept::in_folder(folder.path(), 1000);
        let [dead, alive] = [u32::MAX, std::process::id()]
            .map(|process| folder.path().join(format!("0123456789abcdef.{process}")));
        for path in [&dead, &alive] {
            fs::create_dir(path).unwrap();
        }
        build(&kept, &scan(folder.path(), "a.xyz"), 10);
        assert!(!dead.exists() && alive.exists());
    }
}
