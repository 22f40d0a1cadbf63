//! Pictures of open files, scans and scene documents.

use crate::arguments::{Filter, parse};
use crate::errors::{exception, wrong};
use crate::file::File;
use crate::options::read_options;
use crate::reports::json;
use crate::work::{places, run};
use anyhow::Result;
use esker_engine::calls::render::{RenderReport, draw, draw_with_layers};
use esker_engine::cameras::camera::Camera;
use esker_engine::document::Document;
use esker_engine::draw::layers::{LayerChoice, Layers};
use esker_engine::draw::method::{METHODS, method_of_name};
use esker_engine::draw::scene::{PictureRequest, open};
use esker_engine::io::{picture, quantity};
use esker_engine::light::settings::{BOUNCES, SAMPLES};
use esker_engine::light::spec::{LightSpec, joined};
use esker_engine::machine::backend::Backend;
use esker_engine::machine::pool;
use esker_engine::{Forest, Picture, Task};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use std::path::PathBuf;

/// What is drawn: an open file, or paths.
#[derive(FromPyObject)]
pub enum Subject<'py> {
    /// An open file.
    Open(PyRef<'py, File>),
    /// Paths of `.esker` files, of scans, or of a scene document.
    Paths(Vec<PathBuf>),
}

/// Draws a picture; returns the report as JSON, height and width, the bytes of its pixels, its
/// depths, and the normals and points of its pixels, which are empty unless `layers` wants them.
#[pyfunction]
#[pyo3(signature = (subject, filter, request, build, layers=(false, false), progress=None))]
pub fn render<'py>(
    py: Python<'py>,
    subject: Subject<'py>,
    filter: Option<PyRef<'py, Filter>>,
    request: &Bound<'py, PyDict>,
    build: &Bound<'py, PyDict>,
    layers: (bool, bool),
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyTuple>> {
    let (forest, mut inputs) = match subject {
        Subject::Open(file) => (Some(file.forest.clone()), Vec::new()),
        Subject::Paths(paths) => (None, places(&paths)),
    };
    let mut base = PictureRequest::of_options();
    if let Some(document) = Document::among(&inputs).map_err(|e| exception(&e))? {
        base = document.request().map_err(|e| exception(&e))?;
        inputs = places(&document.inputs().map_err(|e| exception(&e))?);
    }
    if let Some(filter) = filter {
        base.filter = filter.0.clone();
    }
    if !build.is_empty() {
        base.build = read_options(build)?;
    }
    let request = read_request(base, request)?;
    let wanted = LayerChoice { normals: layers.0, points: layers.1 };
    let draw_file = |forest: &Forest, task: &dyn Task| -> Result<Drawn> {
        if wanted != LayerChoice::default() {
            return draw_with_layers(forest, &request, wanted, task);
        }
        let (picture, report) = draw(forest, &request, task)?;
        Ok((picture, report, Layers::default()))
    };
    let work = |task: &dyn Task| {
        pool::run(request.threads, || match &forest {
            Some(forest) => draw_file(forest, task),
            None => {
                let (forest, _folder) = open(&inputs, &request, task)?;
                draw_file(&forest, task)
            }
        })
    };
    let ((picture, report, layers), _) = run(py, progress, work)?;
    let report = json(&report)?;
    let Picture { width, height, rgba, depth, .. } = picture;
    let (rgba, depth) = (rgba.into_pyarray(py), depth.into_pyarray(py));
    let normals = layers.normals.into_flattened().into_pyarray(py);
    let points = layers.points.into_flattened().into_pyarray(py);
    (report, (height, width), rgba, depth, normals, points).into_pyobject(py)
}

/// A picture, its report, and the images beside it.
type Drawn = (Picture, RenderReport, Layers);

/// A picture of `height` rows as the bytes of a PNG file.
#[pyfunction]
pub fn png<'py>(
    py: Python<'py>,
    rgba: PyBackedBytes,
    width: u32,
    height: u32,
) -> PyResult<Bound<'py, PyBytes>> {
    let picture = Picture { width, height, rgba: rgba.to_vec(), ..Picture::default() };
    let (bytes, _) = run(py, None, |_| picture::encode_png(&picture))?;
    Ok(PyBytes::new(py, &bytes))
}

/// The request with what is given in place of its own, by the names of the arguments in Python.
fn read_request(
    mut request: PictureRequest,
    given: &Bound<'_, PyDict>,
) -> PyResult<PictureRequest> {
    for (name, value) in given {
        let name: String = name.extract()?;
        let of_engine = |e: anyhow::Error| wrong(format!("{name}: {}", esker_engine::one_line(&e)));
        match name.as_str() {
            "size" => request.size = value.extract()?,
            "window" => {
                request.window = Some(quantity::window(value.extract()?).map_err(of_engine)?);
            }
            "camera" => {
                request.camera = Camera::parse(value.extract()?).map_err(of_engine)?;
            }
            "method" => {
                let name: String = value.extract()?;
                let known = METHODS.map(|(_, name, _)| name).join(", ");
                let unknown = || wrong(format!("there is no method {name}; there are {known}"));
                request.method = method_of_name(&name).ok_or_else(unknown)?;
            }
            "colour" => request.colour_by = Some(value.extract()?),
            "budget_points" => request.budget_points = value.extract()?,
            "target_spacing" => {
                let text = value.str()?.to_string();
                request.target_spacing_px = quantity::spacing_px(&text).map_err(of_engine)?;
            }
            "point_size" => {
                let text = value.str()?.to_string();
                request.dots.size = quantity::point_size(&text).map_err(of_engine)?;
            }
            "eye_dome" => {
                let text = value.str()?.to_string();
                request.dots.eye_dome = quantity::strength(&text).map_err(of_engine)?;
            }
            "highlights" => request.shines = value.extract()?,
            "even_exposure" => request.evens_exposure = value.extract()?,
            "cull_back" => request.culls_back = value.extract()?,
            "full" => request.full = value.extract()?,
            "lights" => {
                let words: Vec<String> = value.extract()?;
                let read =
                    |word: &String| parse::<LightSpec>(Some(word)).map(|light| light.into_iter());
                let lights = words.iter().map(read).collect::<PyResult<Vec<_>>>()?;
                request.light.lights = joined(lights.into_iter().flatten().collect());
            }
            "samples" => request.light.samples = value.extract()?,
            "bounces" => request.light.bounces = value.extract()?,
            "seed" => request.light.seed = value.extract()?,
            "exposure" => request.light.exposure = Some(value.extract()?),
            "backend" => {
                request.with.backend = match value.extract()? {
                    "auto" => Backend::Auto,
                    "cpu" => Backend::Cpu,
                    "gpu" => Backend::Gpu,
                    name => {
                        return Err(wrong(format!("a backend is auto, cpu or gpu, not {name}")));
                    }
                }
            }
            "threads" => request.threads = value.extract()?,
            _ => return Err(wrong(format!("a picture has no option {name}"))),
        }
    }
    check(&request)?;
    Ok(request)
}

/// Refuses numbers that the engine's own command line refuses.
fn check(request: &PictureRequest) -> PyResult<()> {
    let [width, height] = request.size;
    let of_engine = |e: anyhow::Error| wrong(esker_engine::one_line(&e));
    quantity::picture_size(&format!("{width}x{height}")).map_err(of_engine)?;
    quantity::points_budget(&request.budget_points.to_string()).map_err(of_engine)?;
    for (name, number, range) in
        [("samples", request.light.samples, SAMPLES), ("bounces", request.light.bounces, BOUNCES)]
    {
        if !range.contains(&i64::from(number)) {
            let (least, most) = (range.start(), range.end());
            return Err(wrong(format!("{name}: {number} is not from {least} to {most}")));
        }
    }
    if request.light.exposure.is_some_and(|e| !(e.is_finite() && e > 0.0)) {
        return Err(wrong("exposure: must be above 0"));
    }
    picture::check_size(request.shown_size(), request.method).map_err(of_engine)
}
