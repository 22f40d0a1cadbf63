//! The request, and the order of the measurements.

use crate::stability::lab::Lab;
use crate::stability::report::StabilityReport;
use crate::stability::{axes, relations, stiffness};
use anyhow::Result;
use esker_engine::machine::pool;
use esker_points::Task;
use std::path::PathBuf;

/// Scans of the relations, if none are named.
const SCANS: [&str; 2] = ["synthetic:terrain:300000:1", "synthetic:office:300000:1"];

/// Scans and extent of the measurements.
#[derive(Clone, Debug, Default)]
pub struct StabilityRequest {
    /// Scans on which the relations are tested; generated ones if there are none.
    pub scans: Vec<PathBuf>,
    /// Tries more values, and more points.
    pub is_full: bool,
    /// Names of the parts that are measured: `relations`, `axes`, `stiffness`, or of an axis; all
    /// if there are none.
    pub parts: Vec<String>,
    /// Folder for the pictures of all cases beside the exact ones.
    pub pictures: Option<PathBuf>,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

impl StabilityRequest {
    /// Whether a part is measured.
    fn wants(&self, part: &str) -> bool {
        self.parts.is_empty() || self.parts.iter().any(|wanted| wanted == part)
    }
}

/// Tests relations, sweeps conditions and fits times.
///
/// # Errors
/// If a scan cannot be read, a file cannot be built or drawn where nothing is expected to fail, or
/// `task` is cancelled.
pub fn measure(request: &StabilityRequest, task: &dyn Task) -> Result<StabilityReport> {
    axes::check_names(&request.parts)?;
    pool::run(request.threads, || {
        let mut report = StabilityReport::new(request.is_full);
        let size = if request.is_full { [480, 320] } else { [240, 160] };
        let lab = Lab::new(size, request.is_full, request.pictures.clone(), task)?;
        if request.wants("relations") {
            let defaults = SCANS.map(PathBuf::from).to_vec();
            let scans = if request.scans.is_empty() { &defaults } else { &request.scans };
            for scan in scans {
                let (rows, floors) = relations::of(scan, &lab)?;
                report.relations.extend(rows);
                report.floors.extend(floors);
            }
        }
        for axis in axes::all() {
            if request.wants("axes") || request.parts.iter().any(|part| part == axis.condition.name)
            {
                axes::sweep(axis, &lab, &mut report)?;
            }
        }
        if request.wants("stiffness") {
            report.stiffness = stiffness::all(&lab)?;
        }
        Ok(report)
    })
}
