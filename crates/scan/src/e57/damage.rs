//! Damaged scans of an E57 file of several: which of them cannot be read, from where on, and why.
//! Their points are refused and counted. A file of one scan that is damaged is an error.

use super::buffered::{Reader, file_of, sparse_file_of};
use super::{fields, packets};
use crate::error::ScanError;
use crate::source::ReadReport;
use e57::PointCloud;
use esker_points::Task;
use std::path::Path;

/// The reason for which points are refused.
const DAMAGED: &str = "point of a damaged scan";

/// A scan of which nothing can be read.
pub(super) struct LostScan {
    /// Index in the file.
    scan: usize,
    /// Claimed number of points.
    points: u64,
    why: String,
}

impl LostScan {
    /// A note on the scan.
    pub fn note(&self) -> String {
        let (number, why, points) = (self.scan + 1, &self.why, self.points);
        format!("scan {number} {why}: its {points} points are refused")
    }
}

/// Scans that turned out damaged while their points were read.
#[derive(Default)]
pub(super) struct Damage {
    /// Index of the scan, points that were read, points that are claimed, and what is wrong, in the
    /// order of the scans.
    scans: Vec<(usize, u64, u64, String)>,
}

impl Damage {
    /// Adds a scan, of which `there` points can be read.
    ///
    /// # Errors
    /// If the file could not be read at all, or has no other scan with points: the fault.
    pub fn add(
        &mut self,
        (scan, cloud): (usize, &PointCloud),
        there: u64,
        fault: ScanError,
        clouds: &[PointCloud],
    ) -> Result<(), ScanError> {
        let ScanError::Damaged { what, .. } = &fault else { return Err(fault) };
        if with_points(clouds).len() < 2 {
            return Err(fault);
        }
        self.scans.push((scan, there, cloud.records, what.clone()));
        Ok(())
    }

    pub fn merge(&mut self, later: Self) {
        self.scans.extend(later.scans);
    }

    /// The error of a file of which nothing could be read.
    pub fn error(&self, path: &Path) -> Option<ScanError> {
        self.scans.first().map(|(.., what)| ScanError::damaged(path, what.clone()))
    }

    /// Adds refused points and notes to a report. A file of this number of `bytes` has at most one
    /// point a bit, whatever it claims.
    pub fn report(self, lost: &[LostScan], bytes: u64, report: &mut ReadReport) {
        let mut refused = lost.iter().fold(0u64, |n, scan| n.saturating_add(scan.points));
        for (_, there, claimed, what) in self.scans {
            let missing = claimed.saturating_sub(there);
            refused = refused.saturating_add(missing);
            report.notes.push(format!(
                "{what}; {there} of its {claimed} points are kept, the others are refused"
            ));
        }
        if refused > 0 {
            let refused = refused.min(bytes.saturating_mul(8));
            *report.refused.entry(DAMAGED.to_owned()).or_default() += refused;
        }
    }
}

/// The scans that have points, with their indices.
pub(super) fn with_points(clouds: &[PointCloud]) -> Vec<(usize, &PointCloud)> {
    clouds.iter().enumerate().filter(|(_, cloud)| cloud.records > 0).collect()
}

/// Finds scans of which nothing can be read by their headers, and takes their points away from
/// `clouds`. If a share of the points is wanted, little of the file is read.
///
/// # Errors
/// If no scan with points is left: the first fault. If the file cannot be read; on request.
pub(super) fn lost_scans(
    path: &Path,
    clouds: &mut [PointCloud],
    reader: &Reader,
    is_share: bool,
    task: &dyn Task,
) -> Result<Vec<LostScan>, ScanError> {
    let mut lost = Vec::new();
    for (scan, cloud) in clouds.iter_mut().enumerate() {
        task.check()?;
        let mut why = fields::fault_of(cloud).map(str::to_owned);
        if why.is_none() && cloud.records > 0 {
            let file = if is_share { sparse_file_of(path)? } else { file_of(path)? };
            match packets::are_even(file, reader.header().page_size, cloud, task) {
                Ok(true) => {}
                Ok(false) => {
                    why = Some("has values that are far ahead of others; it is damaged".into());
                }
                Err(e) => why = Some(format!("cannot be read ({e}); it is damaged")),
            }
            task.check()?;
        }
        if let Some(why) = why {
            lost.push(LostScan { scan, points: cloud.records, why });
            cloud.records = 0;
            cloud.prototype.clear();
        }
    }
    match lost.first() {
        Some(LostScan { scan, why, .. }) if clouds.iter().all(|cloud| cloud.records == 0) => {
            Err(ScanError::damaged(path, format!("scan {} {why}", scan + 1)))
        }
        _ => Ok(lost),
    }
}
