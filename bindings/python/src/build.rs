//! Builds: from scans, and from arrays, whose values are copied a batch at a time while the build
//! needs them.

use crate::errors::wrong;
use crate::options::read_options;
use crate::reports::json;
use crate::work::{places, run};
use esker_engine::calls::build::{self as building, BuildReport};
use esker_engine::given::{Coordinates, GivenInfo, Points};
use esker_engine::{AttrType, Attribute, Grid, Task};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;
use std::path::PathBuf;

/// Bytes of the coordinates of a point as three `i32`, and as three `f64`.
const STEPS_BYTES: usize = 12;
const WORLD_BYTES: usize = 24;

/// Builds `out` from scans and folders of scans; returns the report as JSON, with all notes.
#[pyfunction]
#[pyo3(signature = (inputs, out, options, threads=0, progress=None))]
pub fn build(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    out: PathBuf,
    options: &Bound<'_, PyDict>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let options = read_options(options)?;
    let inputs = places(&inputs);
    let work = |task: &dyn Task| building::build(&inputs, &out, &options, threads, task);
    let (report, notes) = run(py, progress, work)?;
    with_notes(report, notes)
}

/// An attribute: name, type as in `u16`, scale, offset, description, and the bytes of its values.
type Column = (String, String, f64, f64, String, Py<PyArray1<u8>>);

/// Builds `out` from arrays of bytes: `coordinates` are three `i32` a point if `are_steps`, and
/// otherwise three `f64`.
#[pyfunction]
#[pyo3(signature = (coordinates, are_steps, columns, grid, out, options, threads=0, progress=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of the function in Python")]
pub fn build_arrays(
    py: Python<'_>,
    coordinates: Py<PyArray1<u8>>,
    are_steps: bool,
    columns: Vec<Column>,
    grid: Option<[[f64; 3]; 2]>,
    out: PathBuf,
    options: &Bound<'_, PyDict>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let options = read_options(options)?;
    let point_bytes = if are_steps { STEPS_BYTES } else { WORLD_BYTES };
    let count = coordinates.bind(py).readonly().as_slice()?.len() / point_bytes;
    let (mut attributes, mut values) = (Vec::new(), Vec::new());
    for (name, ty, scale, offset, description, column) in columns {
        let ty = type_of(&ty).ok_or_else(|| wrong(format!("{name}: no values of {ty}")))?;
        attributes.push(Attribute { name, ty, description, scale, offset });
        values.push((ty.size(), column));
    }
    let grid = grid.map(|[scale, offset]| Grid { scale, offset });
    let given = GivenInfo { name: "arrays".into(), count, grid, attributes };
    let arrays = Box::new(Arrays { coordinates, are_steps, columns: values });
    let work =
        |task: &dyn Task| building::build_given(given, arrays, &out, &options, threads, task);
    let (report, notes) = run(py, progress, work)?;
    with_notes(report, notes)
}

/// The type called `name`.
fn type_of(name: &str) -> Option<AttrType> {
    use AttrType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64].into_iter().find(|ty| ty.name() == name)
}

/// Arrays of the caller. They are read with the interpreter lock, since Python may change them.
struct Arrays {
    coordinates: Py<PyArray1<u8>>,
    are_steps: bool,
    /// Bytes of a value, and the values.
    columns: Vec<(usize, Py<PyArray1<u8>>)>,
}

/// The bytes of values of an array.
fn bytes(array: &Py<PyArray1<u8>>, range: Range<usize>, size: usize) -> Result<Vec<u8>, String> {
    let copy = |py: Python<'_>| {
        let array = array.bind(py).try_readonly().map_err(|e| e.to_string())?;
        let all = array.as_slice().map_err(|e| e.to_string())?;
        let some = all.get(range.start * size..range.end * size);
        some.map(<[u8]>::to_vec).ok_or_else(|| "an array is shorter than the others".to_owned())
    };
    Python::try_attach(copy).unwrap_or_else(|| Err("Python is ending".to_owned()))
}

impl Points for Arrays {
    fn coordinates(&self, range: Range<usize>) -> Result<Coordinates, String> {
        let size = if self.are_steps { STEPS_BYTES } else { WORLD_BYTES };
        let bytes = bytes(&self.coordinates, range, size)?;
        Ok(if self.are_steps {
            let points = bytes.as_chunks::<STEPS_BYTES>().0.iter();
            Coordinates::Steps(points.map(|p| [0, 4, 8].map(|at| i32_at(p, at))).collect())
        } else {
            let points = bytes.as_chunks::<WORLD_BYTES>().0.iter();
            Coordinates::World(points.map(|p| [0, 8, 16].map(|at| f64_at(p, at))).collect())
        })
    }

    fn column(&self, attribute: usize, range: Range<usize>) -> Result<Vec<u8>, String> {
        let (size, column) = &self.columns[attribute];
        bytes(column, range, *size)
    }
}

fn i32_at(bytes: &[u8], at: usize) -> i32 {
    let mut raw = [0; 4];
    raw.copy_from_slice(&bytes[at..at + 4]);
    i32::from_le_bytes(raw)
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    let mut raw = [0; 8];
    raw.copy_from_slice(&bytes[at..at + 8]);
    f64::from_le_bytes(raw)
}

/// The report with the notes that it does not have.
fn with_notes(mut report: BuildReport, notes: Vec<String>) -> PyResult<String> {
    let more: Vec<_> = notes.into_iter().filter(|note| !report.notes.contains(note)).collect();
    report.notes.extend(more);
    json(&report)
}
