//! The Python package `esker`: native part. Classes and functions are thin: they turn arguments
//! into the engine's, run its calls without the interpreter lock, and hand columns over to NumPy
//! without copies. What users see of it is in `python/esker`.

mod arguments;
mod build;
mod errors;
mod file;
mod jobs;
mod options;
mod picture;
mod reports;
mod work;

use pyo3::prelude::*;

/// Native part of the package `esker`; use that.
#[pymodule]
fn _esker(m: &Bound<'_, PyModule>) -> PyResult<()> {
    esker_engine::hide_caught_panics();
    let py = m.py();
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("EskerError", py.get_type::<errors::EskerError>())?;
    m.add("LossError", py.get_type::<errors::LossError>())?;
    m.add_class::<arguments::Filter>()?;
    m.add_class::<file::File>()?;
    m.add_class::<file::Query>()?;
    m.add_function(wrap_pyfunction!(build::build, m)?)?;
    m.add_function(wrap_pyfunction!(build::build_arrays, m)?)?;
    m.add_function(wrap_pyfunction!(reports::export, m)?)?;
    m.add_function(wrap_pyfunction!(reports::verify, m)?)?;
    m.add_function(wrap_pyfunction!(jobs::job_plan, m)?)?;
    m.add_function(wrap_pyfunction!(jobs::job_step, m)?)?;
    m.add_function(wrap_pyfunction!(jobs::job_join, m)?)?;
    m.add_function(wrap_pyfunction!(jobs::job_status, m)?)?;
    m.add_function(wrap_pyfunction!(picture::render, m)?)?;
    m.add_function(wrap_pyfunction!(picture::png, m)?)?;
    Ok(())
}
