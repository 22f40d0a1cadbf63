//! Space on disks: estimated before work starts, and refused early where it cannot suffice. What
//! the file takes beside hot positions is not known, and counts for nothing.

use crate::error::BuildError;
use crate::input::intake::{Intake, Plan};
use crate::rows::borders::POSITION_BYTES;
use crate::tree::parting::twice_bytes_max;
use esker_points::quant::HOT_POSITION_BYTES;
use std::path::Path;

/// More rows than these go to scratch where it has room for them, also where memory would hold
/// them. Memory that was never touched before costs more than a copy in the system's cache, made
/// while others are read, of which little is touched at a time.
const HELD_BYTES_MAX: u64 = 1 << 30;

/// What a build needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Bytes of all rows.
    pub rows_bytes: u64,
    /// Whether memory holds them.
    pub is_held: bool,
    /// Whether a cell may hold more of them than a chunk, which then is parted through scratch.
    pub may_part: bool,
    /// Bytes of scratch at most, where rows go there: all of them, and those that a cell that is
    /// parted has twice.
    pub parted_bytes_max: u64,
    /// And wherever rows are, of what chunks put aside for each other where normals are estimated:
    /// the positions near borders, at most all.
    pub aside_bytes_max: u64,
    /// Bytes of the file at least: hot positions, what it has of every point whatever the rest is
    /// compressed to.
    pub file_bytes: u64,
}

impl Needs {
    /// Of these inputs, of which rows of `buffer_bytes_max` stay in memory, and chunks have so many
    /// rows, of several buckets or of one.
    pub fn of(
        intake: &Intake,
        plan: &Plan,
        buffer_bytes_max: u64,
        (joined_max, single_max): (u64, u64),
    ) -> Self {
        let points = intake.points_likely();
        let rows_bytes = points.saturating_mul(plan.row_bytes() as u64);
        let twice_bytes = twice_bytes_max(buffer_bytes_max, plan.row_bytes()).min(rows_bytes);
        let has_borders = intake.estimates_normals && points > joined_max;
        let aside_bytes = if has_borders { POSITION_BYTES as u64 } else { 0 };
        Self {
            rows_bytes,
            is_held: rows_bytes <= buffer_bytes_max,
            may_part: points > single_max,
            parted_bytes_max: rows_bytes.saturating_add(twice_bytes),
            aside_bytes_max: points.saturating_mul(aside_bytes),
            file_bytes: points.saturating_mul(HOT_POSITION_BYTES as u64),
        }
    }

    /// Whether rows go to scratch, where so much is free as far as the system tells, although
    /// memory would hold them.
    pub fn spills(self, free_bytes: Option<u64>) -> bool {
        self.is_held
            && self.rows_bytes > HELD_BYTES_MAX
            && free_bytes.is_none_or(|free| self.scratch_bytes(true) <= free)
    }

    /// What scratch files have at once at most, as estimated.
    pub fn scratch_bytes(self, spills: bool) -> u64 {
        let rows_go = spills || self.may_part || !self.is_held;
        let of_rows = if rows_go { self.parted_bytes_max } else { 0 };
        of_rows.saturating_add(self.aside_bytes_max)
    }

    /// Holds them against the space that is free in the folders, as `free_bytes` tells it, where it
    /// does. On one disk too neither is added to the other: scratch is given back while the file
    /// grows.
    ///
    /// # Errors
    /// [`BuildError::Space`] where one is more than there is.
    pub fn check(
        self,
        scratch: &Path,
        out: &Path,
        free_bytes: impl Fn(&Path) -> Option<u64>,
    ) -> Result<(), BuildError> {
        let folder = match out.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let of_scratch =
            ("scratch files need", "name another folder with --scratch, or give more --memory");
        let of_file = ("the file needs", "choose another folder for it");
        // Where memory holds the rows, few builds part a cell, and of positions most are far from
        // borders.
        let scratch_bytes = if self.is_held { 0 } else { self.scratch_bytes(false) };
        for (path, needed_bytes, (what, remedy)) in
            [(scratch, scratch_bytes, of_scratch), (folder, self.file_bytes, of_file)]
        {
            if let Some(free_bytes) = free_bytes(path).filter(|&free| needed_bytes > free) {
                let path = path.to_owned();
                return Err(BuildError::Space { path, what, needed_bytes, free_bytes, remedy });
            }
        }
        Ok(())
    }
}

/// The bytes that are free for this user where a folder lies.
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> Option<u64> {
    // File systems of the kernel's own have no blocks at all.
    let of = rustix::fs::statvfs(folder).ok().filter(|of| of.f_blocks > 0)?;
    Some(of.f_bavail.saturating_mul(of.f_frsize))
}

/// Not told by this system.
#[cfg(not(unix))]
pub fn free_bytes(_folder: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_space_is_refused_with_what_is_needed_and_what_is_free() {
        let needs = Needs {
            rows_bytes: 2 << 30,
            is_held: false,
            may_part: true,
            parted_bytes_max: 2 << 30,
            aside_bytes_max: 1 << 30,
            file_bytes: 1 << 30,
        };
        let free = |scratch: u64, out: u64| {
            let free = move |p: &Path| Some(if p.ends_with("scratch") { scratch } else { out });
            needs
                .check("/scratch".as_ref(), "/out/a.esker".as_ref(), free)
                .map_err(|e| e.to_string())
        };
        assert_eq!(free(3 << 30, 1 << 30), Ok(()));
        let text = free((3 << 30) - 1, 9 << 30).unwrap_err();
        assert!(text.starts_with("/scratch: scratch files need at least 3072 MiB"), "{text}");
        assert!(text.contains("3071 MiB are free") && text.contains("--scratch"), "{text}");
        let text = free(9 << 30, 1 << 20).unwrap_err();
        assert!(text.starts_with("/out: the file needs at least 1024 MiB, 1 MiB are"), "{text}");
        needs.check("/scratch".as_ref(), "a.esker".as_ref(), |_| None).unwrap();
        // What memory holds is built without, where no cell has to be parted.
        let needs = Needs { is_held: true, ..needs };
        needs.check("/scratch".as_ref(), "a.esker".as_ref(), |_| Some(1 << 30)).unwrap();
        assert_eq!(needs.scratch_bytes(false), 3 << 30);
        assert_eq!(Needs { may_part: false, ..needs }.scratch_bytes(false), 1 << 30);
    }

    #[test]
    fn many_rows_go_to_scratch_where_it_has_room() {
        let needs = |rows_bytes, is_held| Needs {
            rows_bytes,
            is_held,
            may_part: false,
            parted_bytes_max: 4 << 30,
            aside_bytes_max: 0,
            file_bytes: 9,
        };
        assert!(needs(3 << 30, true).spills(Some(4 << 30)) && needs(3 << 30, true).spills(None));
        assert!(!needs(3 << 30, true).spills(Some((4 << 30) - 1)));
        assert!(!needs(1 << 30, true).spills(None));
        // Memory holds less anyway.
        assert!(!needs(3 << 30, false).spills(None));
    }

    #[test]
    #[cfg(unix)]
    fn free_space_is_told_of_folders_that_exist() {
        assert!(free_bytes(&std::env::temp_dir()).is_some_and(|b| b > 0));
        assert_eq!(free_bytes("/nowhere/at/all".as_ref()), None);
    }
}
