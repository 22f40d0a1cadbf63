//! Options of builds by the names of their arguments in Python.

use crate::arguments::parse;
use crate::errors::wrong;
use esker_engine::io::quantity;
use esker_engine::{BuildOptions, Codec, ColourDepth, NormalsMode, UNITS};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Options of a build, by the names of the arguments in Python.
pub fn read_options(given: &Bound<'_, PyDict>) -> PyResult<BuildOptions> {
    // Points are lost only on request.
    let mut options = BuildOptions { refuse_loss: true, ..BuildOptions::default() };
    for (name, value) in given {
        let name: String = name.extract()?;
        let of_engine = |e: anyhow::Error| wrong(format!("{name}: {}", esker_engine::one_line(&e)));
        if value.is_none() {
            continue;
        }
        match name.as_str() {
            "memory" => {
                options.memory_bytes = match value.extract() {
                    Ok(bytes) => bytes,
                    Err(_) => quantity::bytes(value.extract()?).map_err(of_engine)?,
                }
            }
            "scratch" => options.scratch = Some(value.extract()?),
            "node_capacity" => options.node_capacity = value.extract()?,
            "colour_bits" => {
                options.colour_depth = Some(match value.extract()? {
                    8 => ColourDepth::Eight,
                    16 => ColourDepth::Sixteen,
                    bits => return Err(wrong(format!("colours have 8 or 16 bits, not {bits}"))),
                });
            }
            "compress" => options.compress = codec(value.extract()?)?,
            "normals" => options.normals = normals(value.extract()?)?,
            "crs" => options.crs = parse(Some(value.extract()?))?,
            "unit" => options.unit = Some(unit(value.extract()?)?),
            "columns" => options.columns = parse(Some(value.extract()?))?,
            "skip_lines" => options.skip_lines = value.extract()?,
            "ignore_crs" => options.ignore_crs = value.extract()?,
            "sharp_features" => options.sharp_features = value.extract()?,
            "tangents" => options.tangents = value.extract()?,
            "compact" => options.compact = value.extract()?,
            "apply_viewpoint" => options.apply_viewpoint = value.extract()?,
            "allow_rounding" => options.allow_rounding = value.extract()?,
            "allow_loss" => options.refuse_loss = !value.extract::<bool>()?,
            _ => return Err(wrong(format!("a build has no option {name}"))),
        }
    }
    Ok(options)
}

fn codec(name: &str) -> PyResult<Codec> {
    let all = [Codec::None, Codec::Fast, Codec::Small];
    let found = all.into_iter().find(|codec| codec.name() == name);
    found.ok_or_else(|| wrong(format!("compress is none, fast or small, not {name}")))
}

fn normals(name: &str) -> PyResult<NormalsMode> {
    Ok(match name {
        "keep" => NormalsMode::Keep,
        "fast" => NormalsMode::Fast,
        "estimate" => NormalsMode::Estimate,
        "none" => NormalsMode::None,
        _ => return Err(wrong(format!("normals are keep, fast, estimate or none, not {name}"))),
    })
}

fn unit(name: &str) -> PyResult<String> {
    let known =
        || wrong(format!("there is no unit {name}; there are {}", UNITS.map(|u| u.0).join(", ")));
    let found = UNITS.iter().find(|(word, _)| *word == name);
    found.map(|(_, unit)| (*unit).to_owned()).ok_or_else(known)
}
