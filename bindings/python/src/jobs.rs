//! The steps of a divided build; reports as JSON.

use crate::errors::{exception, wrong};
use crate::options::read_options;
use crate::reports::json;
use crate::work::{place, places, run};
use esker_engine::calls::job;
use esker_engine::{JobResources, PlanHow, Task};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Plans the build of `inputs` into the place `to`.
#[pyfunction]
#[pyo3(signature = (inputs, to, options, jobs=None, measure=false, threads=0, progress=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of the function in Python")]
pub fn job_plan(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    to: PathBuf,
    options: &Bound<'_, PyDict>,
    jobs: Option<u32>,
    measure: bool,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let options = read_options(options)?;
    let (inputs, to) = (places(&inputs), place(&to));
    let how = PlanHow { jobs, measures: measure };
    let work = |task: &dyn Task| job::plan(&inputs, &to, &options, &how, threads, task);
    json(&run(py, progress, work)?.0)
}

/// Does one step of the plan in the place `to`: `take` or `build` of an index, or `cut`.
#[pyfunction]
#[pyo3(signature = (step, to, index, options, threads=0, progress=None))]
pub fn job_step(
    py: Python<'_>,
    step: &str,
    to: PathBuf,
    index: u32,
    options: &Bound<'_, PyDict>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let (to, with) = (place(&to), resources(options)?);
    match step {
        "take" => json(&run(py, progress, |task| job::take(&to, index, &with, threads, task))?.0),
        "cut" => json(&run(py, progress, |task| job::cut(&to, &with, threads, task))?.0),
        "build" => json(&run(py, progress, |task| job::build(&to, index, &with, threads, task))?.0),
        _ => Err(wrong(format!("there is no step {step}"))),
    }
}

/// Joins the parts of the plan in the place `to` to the file `out`.
#[pyfunction]
#[pyo3(signature = (to, out, options, threads=0, progress=None))]
pub fn job_join(
    py: Python<'_>,
    to: PathBuf,
    out: PathBuf,
    options: &Bound<'_, PyDict>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let (to, out, with) = (place(&to), place(&out), resources(options)?);
    json(&run(py, progress, |task| job::join(&to, &out, &with, threads, task))?.0)
}

/// What is done of the plan in the place `to`.
#[pyfunction]
pub fn job_status(py: Python<'_>, to: PathBuf) -> PyResult<String> {
    let to = place(&to);
    let status = py.detach(|| job::status(&to));
    json(&status.map_err(|error| exception(&error))?)
}

/// Memory and scratch of a step, of the options that builds have.
fn resources(options: &Bound<'_, PyDict>) -> PyResult<JobResources> {
    let options = read_options(options)?;
    Ok(JobResources { memory_bytes: options.memory_bytes, scratch: options.scratch })
}
