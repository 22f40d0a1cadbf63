//! Exports and verification; reports as JSON.

use crate::arguments::Filter;
use crate::errors::{exception, wrong};
use crate::options::read_options;
use crate::work::{place, places, run};
use esker_engine::calls::{export as exporting, verify as verifying};
use esker_engine::io::output;
use esker_engine::{ColourDepth, ExportOptions, Task};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use std::path::PathBuf;

/// A report as JSON.
///
/// # Errors
/// If it has a number that JSON has not.
pub fn json(report: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(report).map_err(|error| exception(&error.into()))
}

/// Writes the points of `file` that `filter` accepts to the scan `out`; returns the report.
#[pyfunction]
#[pyo3(signature = (file, out, filter, colour_bits=None, crs=None, overwrite=false, threads=0, progress=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of the function in Python")]
pub fn export(
    py: Python<'_>,
    file: PathBuf,
    out: PathBuf,
    filter: &Filter,
    colour_bits: Option<u32>,
    crs: Option<String>,
    overwrite: bool,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let colour_depth = match colour_bits {
        None => None,
        Some(8) => Some(ColourDepth::Eight),
        Some(16) => Some(ColourDepth::Sixteen),
        Some(bits) => return Err(wrong(format!("colours have 8 or 16 bits, not {bits}"))),
    };
    let options = ExportOptions { colour_depth, crs };
    let filter = &filter.0;
    let file = place(&file);
    let work = |task: &dyn Task| {
        if !overwrite {
            output::may_create(&out)?;
        }
        exporting::export(&file, &out, filter, options, threads, task)
    };
    let (report, _) = run(py, progress, work)?;
    json(&report)
}

/// Checks every byte of `file`, and with `against` that it has the points of these scans; returns
/// the report.
#[pyfunction]
#[pyo3(signature = (file, against, options, threads=0, progress=None))]
pub fn verify(
    py: Python<'_>,
    file: PathBuf,
    against: Vec<PathBuf>,
    options: &Bound<'_, PyDict>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let reading = read_options(options)?.open_options();
    let (file, against) = (place(&file), places(&against));
    let work = |task: &dyn Task| verifying::verify(&file, &against, &reading, threads, task);
    let (report, _) = run(py, progress, work)?;
    json(&report)
}
