//! An open file, and queries of its points.

use crate::arguments::Filter;
use crate::errors::{exception, wrong};
use crate::work::{place, run};
use esker_engine::calls::query::{PointColumns, PointGrid, PointQuery, read_points};
use esker_engine::io::file::open_tree;
use esker_engine::{Attribute, Forest, Task};
use numpy::{IntoPyArray, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// An open `.esker` file, with the files that it names, or an open COPC file.
#[pyclass(frozen, module = "esker._esker")]
pub struct File {
    pub forest: Arc<Forest>,
    grid: PointGrid,
}

#[pymethods]
impl File {
    /// Opens a file or an address.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let path = place(&path);
        let open = |_: &dyn Task| Ok(Arc::new(open_tree(&path)?));
        let (forest, _) = run(py, None, open)?;
        let grid = PointGrid::of(&forest);
        Ok(Self { forest, grid })
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.forest.path().to_owned()
    }

    /// Points of all trees.
    #[getter]
    fn count(&self) -> u64 {
        self.forest.points()
    }

    /// Points that are kept beside the trees, which queries do not return.
    #[getter]
    fn set_aside(&self) -> usize {
        self.forest.files().map(|file| file.metadata().set_aside.len()).sum()
    }

    /// Least and greatest coordinates.
    #[getter]
    fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        self.forest.exact_bounds().map(|corners| corners.map(|corner| self.grid.world(corner)))
    }

    #[getter]
    fn scale(&self) -> [f64; 3] {
        self.grid.scale
    }

    #[getter]
    fn offset(&self) -> [f64; 3] {
        self.grid.offset
    }

    /// Coordinate reference system of the first scan that has one, and its unit.
    #[getter]
    fn crs(&self) -> (Option<String>, Option<String>) {
        let sources = || self.forest.files().flat_map(|file| &file.metadata().sources);
        let systems = || sources().filter_map(|source| source.crs.as_ref());
        let text = systems().find(|crs| !crs.text.is_empty()).map(|crs| crs.text.clone());
        (text, systems().find_map(|crs| crs.unit.clone()))
    }

    /// Attributes of the points ([`described`]).
    fn attributes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        described(py, &self.forest.schema().attributes)
    }

    /// Columns of the node table.
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let nodes = &self.forest.table().nodes;
        let columns = PyDict::new(py);
        let mut levels: Vec<u16> = Vec::with_capacity(nodes.len());
        for node in nodes {
            // Parents come before their children; roots have none.
            let above = levels.get(node.parent as usize).copied();
            levels.push(above.map_or(0, |level| level.saturating_add(1)));
        }
        let corner = |corner: fn(&[[u32; 3]; 2]) -> [u32; 3]| {
            // Nodes of COPC files are on a lattice of their own.
            let world = |corner| match self.forest.is_growing() {
                true => self.forest.lattice().world(corner),
                false => self.grid.world(corner),
            };
            let of = nodes.iter().flat_map(|n| world(corner(&n.own_box())));
            of.collect::<Vec<f64>>()
        };
        columns.set_item("level", levels.into_pyarray(py))?;
        columns.set_item("min", corner(|b| b[0]).into_pyarray(py))?;
        columns.set_item("max", corner(|b| b[1]).into_pyarray(py))?;
        let count = nodes.iter().map(|n| n.points() as u64).collect::<Vec<_>>();
        columns.set_item("count", count.into_pyarray(py))?;
        let spacing = nodes.iter().map(|n| f64::from(n.spacing)).collect::<Vec<_>>();
        columns.set_item("spacing", spacing.into_pyarray(py))?;
        let offset = nodes.iter().map(|n| n.page_offset).collect::<Vec<_>>();
        columns.set_item("offset", offset.into_pyarray(py))?;
        let bytes = nodes.iter().map(|n| n.page_bytes).collect::<Vec<_>>();
        columns.set_item("bytes", bytes.into_pyarray(py))?;
        let parent = nodes.iter().map(|n| n.parent).collect::<Vec<_>>();
        columns.set_item("parent", parent.into_pyarray(py))?;
        Ok(columns)
    }

    /// Single points, each given by its node and its index in it, one after the other in `places`:
    /// attributes, and arrays as those of [`Query::read`].
    #[pyo3(signature = (places, columns=None, threads=0))]
    fn points_at<'py>(
        &self,
        py: Python<'py>,
        places: PyReadonlyArray1<'py, u32>,
        columns: Option<Vec<usize>>,
        threads: usize,
    ) -> PyResult<(Bound<'py, PyList>, Bound<'py, PyList>)> {
        let places = places.as_slice()?.as_chunks::<2>().0.to_vec();
        let read =
            |task: &dyn Task| read_points(&self.forest, &places, columns.as_deref(), threads, task);
        let ((attributes, points), _) = run(py, None, read)?;
        Ok((described(py, &attributes)?, arrays(py, points)?))
    }

    /// Begins a query of the points that `filter` accepts, with the attributes `columns` (indices
    /// of [`File::attributes`]), or all.
    #[pyo3(signature = (filter, columns=None, threads=0))]
    fn query(
        &self,
        py: Python<'_>,
        filter: &Filter,
        columns: Option<Vec<usize>>,
        threads: usize,
    ) -> PyResult<Query> {
        let forest = self.forest.clone();
        let filter = &filter.0;
        let choose =
            move |_: &dyn Task| PointQuery::new(forest, filter, columns.as_deref(), threads);
        let (query, _) = run(py, None, choose)?;
        let attributes = query.attributes().to_vec();
        Ok(Query { query: Mutex::new(query), attributes })
    }
}

/// Points that are being read, and attributes of their columns.
#[pyclass(frozen, module = "esker._esker")]
pub struct Query {
    query: Mutex<PointQuery>,
    attributes: Vec<Attribute>,
}

#[pymethods]
impl Query {
    /// Attributes of the columns ([`described`]).
    fn attributes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        described(py, &self.attributes)
    }

    /// The next `points` points, or all that are left, as X, Y, Z and the bytes of each column;
    /// `None` behind the last one.
    #[pyo3(signature = (points=None, progress=None))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        points: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyList>>> {
        if points == Some(0) {
            return Err(wrong("parts of 0 points never end; take at least 1"));
        }
        let read = |task: &dyn Task| {
            let mut query = self.query.lock().unwrap_or_else(PoisonError::into_inner);
            query.read(points, task)
        };
        let found = run(py, progress, read);
        if found.is_err() {
            // What raised may have come after the points were read.
            self.query.lock().unwrap_or_else(PoisonError::into_inner).end();
        }
        let (found, _) = found?;
        found.map(|points| arrays(py, points)).transpose()
    }
}

/// X, Y, Z and the bytes of each column as arrays, which own the vectors: nothing is copied.
fn arrays(py: Python<'_>, points: PointColumns) -> PyResult<Bound<'_, PyList>> {
    let PointColumns { steps, columns } = points;
    let all = PyList::empty(py);
    steps.into_iter().try_for_each(|steps| all.append(steps.into_pyarray(py)))?;
    columns.into_iter().try_for_each(|column| all.append(column.into_pyarray(py)))?;
    Ok(all)
}

/// Attributes as tuples of name, NumPy type, scale, offset and description.
fn described<'py>(py: Python<'py>, attributes: &[Attribute]) -> PyResult<Bound<'py, PyList>> {
    let of = |a: &Attribute| {
        let ty = a.ty.name();
        let (kind, bits) = ty.split_at(1);
        let bytes = bits.parse::<usize>().map_err(|e| exception(&e.into()))? / 8;
        Ok((a.name.clone(), format!("<{kind}{bytes}"), a.scale, a.offset, a.description.clone()))
    };
    PyList::new(py, attributes.iter().map(of).collect::<PyResult<Vec<_>>>()?)
}
