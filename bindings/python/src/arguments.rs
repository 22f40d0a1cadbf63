//! Arguments of calls: filters of points, and words that stand for the engine's choices.

use crate::errors::wrong;
use esker_engine as engine;
use pyo3::prelude::*;
use std::str::FromStr;

/// Corners of the rings of polygons.
type Polygons = Vec<Vec<Vec<[f64; 2]>>>;

/// Which points are wanted.
#[pyclass(frozen, module = "esker._esker")]
pub struct Filter(pub engine::Filter);

#[pymethods]
impl Filter {
    #[new]
    #[pyo3(signature = (*, bounds=None, polygon=None, classes=None, values=None, flags=None, without_flags=None, resolution=None))]
    fn new(
        bounds: Option<[[f64; 3]; 2]>,
        polygon: Option<Polygons>,
        classes: Option<String>,
        values: Option<Vec<String>>,
        flags: Option<String>,
        without_flags: Option<String>,
        resolution: Option<f64>,
    ) -> PyResult<Self> {
        let bounds = bounds.map(checked).transpose()?;
        let polygon = polygon.map(engine::Polygon::any_of).transpose().map_err(wrong)?;
        if let Some(spacing) = resolution.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(wrong(format!(
                "a resolution of {spacing} is no length: it must be above 0, in the file's unit"
            )));
        }
        let values = values.unwrap_or_default();
        Ok(Self(engine::Filter {
            bounds,
            polygon,
            classes: parse(classes.as_deref())?,
            values: values.iter().map(|v| v.parse().map_err(wrong)).collect::<PyResult<_>>()?,
            flags: parse(flags.as_deref())?.unwrap_or_default(),
            without_flags: parse(without_flags.as_deref())?.unwrap_or_default(),
            max_spacing: resolution,
            ..engine::Filter::default()
        }))
    }
}

/// Parses a word.
///
/// # Errors
/// `ValueError` with the engine's message.
pub fn parse<T: FromStr<Err: std::fmt::Display>>(word: Option<&str>) -> PyResult<Option<T>> {
    word.map(|word| word.parse().map_err(wrong)).transpose()
}

/// A box whose least corner comes first.
fn checked([min, max]: [[f64; 3]; 2]) -> PyResult<engine::Bounds> {
    for axis in 0..3 {
        let (low, high) = (min[axis], max[axis]);
        if low.is_nan() || high.is_nan() || low > high {
            return Err(wrong(format!(
                "bounds of {low} to {high} hold nothing: give ((x0, y0), (x1, y1)) or \
                 ((x0, y0, z0), (x1, y1, z1)), the least corner first"
            )));
        }
    }
    Ok(engine::Bounds { min, max })
}
