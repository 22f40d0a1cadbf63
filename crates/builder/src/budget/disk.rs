//! Disk space: estimated before work starts; a build that cannot succeed is refused early. Of the
//! file only the hot positions are counted, since the size of compressed planes is not known.

use crate::error::BuildError;
use crate::input::intake::Intake;
use crate::input::plan::Plan;
use crate::rows::borders::Borders;
use crate::tree::parting::duplicate_bytes_max;
use esker_points::quant::HOT_POSITION_BYTES;
use std::path::Path;

/// More bytes of rows than these go to scratch if it has room for them, even if memory would hold
/// them: first use of memory costs more than a copy in the system cache, which is made while other
/// points are read.
const HELD_BYTES_MAX: u64 = 1 << 30;

/// Estimated disk space of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskEstimate {
    /// Bytes of all rows.
    pub rows_bytes: u64,
    /// Whether memory holds all rows.
    pub fits_memory: bool,
    /// Whether a cell may hold more rows than a chunk; it is then split through scratch.
    pub may_split: bool,
    /// Most bytes of rows in scratch, if they go there: all rows, and those that are there twice
    /// while a cell is split.
    pub scratch_rows_bytes_max: u64,
    /// Most bytes of positions near the borders of chunks, for the estimation of normals.
    pub borders_bytes_max: u64,
    /// Least bytes of the file: its hot positions.
    pub file_bytes: u64,
}

impl DiskEstimate {
    /// Estimate for the inputs. Rows of `buffer_bytes_max` bytes stay in memory; a chunk has at
    /// most `joined_max` rows of several buckets, or `single_max` of one.
    pub fn of(
        intake: &Intake,
        plan: &Plan,
        buffer_bytes_max: u64,
        (joined_max, single_max): (u64, u64),
    ) -> Self {
        let points = intake.points_likely();
        let rows_bytes = points.saturating_mul(plan.row_bytes() as u64);
        let duplicate_bytes =
            duplicate_bytes_max(buffer_bytes_max, plan.row_bytes()).min(rows_bytes);
        let has_borders = intake.computed.is_any() && points > joined_max;
        let border_bytes = if has_borders { Borders::point_bytes(&plan.rows()) as u64 } else { 0 };
        Self {
            rows_bytes,
            fits_memory: rows_bytes <= buffer_bytes_max,
            may_split: points > single_max,
            scratch_rows_bytes_max: rows_bytes.saturating_add(duplicate_bytes),
            borders_bytes_max: points.saturating_mul(border_bytes),
            file_bytes: points.saturating_mul(HOT_POSITION_BYTES as u64),
        }
    }

    /// Whether rows go to scratch although memory would hold them. `free_bytes` is the free space
    /// there, if known.
    pub fn spills(self, free_bytes: Option<u64>) -> bool {
        self.fits_memory
            && self.rows_bytes > HELD_BYTES_MAX
            && free_bytes.is_none_or(|free| self.scratch_bytes(true) <= free)
    }

    /// Most bytes of scratch at one time.
    pub fn scratch_bytes(self, spills: bool) -> u64 {
        let rows_go = spills || self.may_split || !self.fits_memory;
        let of_rows = if rows_go { self.scratch_rows_bytes_max } else { 0 };
        of_rows.saturating_add(self.borders_bytes_max)
    }

    /// Compares the estimate with the free space of both folders, which `free_bytes` returns if it
    /// is known. Even on one disk the two are not added: scratch is freed while the file grows.
    ///
    /// # Errors
    /// [`BuildError::Space`] if a folder has too little.
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
        // If memory holds the rows, cells are rarely split, and most
        // positions are far from borders.
        let scratch_bytes = if self.fits_memory { 0 } else { self.scratch_bytes(false) };
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

/// Free bytes for this user on the file system of `folder`.
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> Option<u64> {
    // Virtual file systems have no blocks.
    let of = rustix::fs::statvfs(folder).ok().filter(|of| of.f_blocks > 0)?;
    Some(of.f_bavail.saturating_mul(of.f_frsize))
}

/// Free bytes are not known on this system.
#[cfg(not(unix))]
pub fn free_bytes(_folder: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_space_is_refused_with_what_is_needed_and_what_is_free() {
        let estimate = DiskEstimate {
            rows_bytes: 2 << 30,
            fits_memory: false,
            may_split: true,
            scratch_rows_bytes_max: 2 << 30,
            borders_bytes_max: 1 << 30,
            file_bytes: 1 << 30,
        };
        let free = |scratch: u64, out: u64| {
            let free = move |p: &Path| Some(if p.ends_with("scratch") { scratch } else { out });
            estimate
                .check("/scratch".as_ref(), "/out/a.esker".as_ref(), free)
                .map_err(|e| e.to_string())
        };
        assert_eq!(free(3 << 30, 1 << 30), Ok(()));
        let text = free((3 << 30) - 1, 9 << 30).unwrap_err();
        assert!(text.starts_with("/scratch: scratch files need at least 3072 MiB"), "{text}");
        assert!(text.contains("3071 MiB are free") && text.contains("--scratch"), "{text}");
        let text = free(9 << 30, 1 << 20).unwrap_err();
        assert!(text.starts_with("/out: the file needs at least 1024 MiB, 1 MiB are"), "{text}");
        estimate.check("/scratch".as_ref(), "a.esker".as_ref(), |_| None).unwrap();
        // Rows that fit memory need no scratch, unless a cell must be split.
        let estimate = DiskEstimate { fits_memory: true, ..estimate };
        estimate.check("/scratch".as_ref(), "a.esker".as_ref(), |_| Some(1 << 30)).unwrap();
        assert_eq!(estimate.scratch_bytes(false), 3 << 30);
        let unsplit = DiskEstimate { may_split: false, ..estimate };
        assert_eq!(unsplit.scratch_bytes(false), 1 << 30);
    }

    #[test]
    fn many_rows_go_to_scratch_if_it_has_room() {
        let estimate = |rows_bytes, fits_memory| DiskEstimate {
            rows_bytes,
            fits_memory,
            may_split: false,
            scratch_rows_bytes_max: 4 << 30,
            borders_bytes_max: 0,
            file_bytes: 9,
        };
        let large = estimate(3 << 30, true);
        assert!(large.spills(Some(4 << 30)) && large.spills(None));
        assert!(!large.spills(Some((4 << 30) - 1)));
        assert!(!estimate(1 << 30, true).spills(None));
        // These rows do not fit memory anyway.
        assert!(!estimate(3 << 30, false).spills(None));
    }

    #[test]
    #[cfg(unix)]
    fn free_space_is_known_for_existing_folders() {
        assert!(free_bytes(&std::env::temp_dir()).is_some_and(|b| b > 0));
        assert_eq!(free_bytes("/nowhere/at/all".as_ref()), None);
    }
}
