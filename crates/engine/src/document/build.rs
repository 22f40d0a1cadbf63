//! How a document builds scans that are not built yet, from and to the options of builds. Memory,
//! scratch folder and threads are the machine's, not the document's.

use super::values::in_field;
use anyhow::{Context, Result, anyhow};
use esker_builder::{NormalsMode, Options};
use esker_format::Codec;
use esker_points::ColourDepth;
use esker_scan::Crs;
use esker_scan::system::UNITS;
use esker_scene::Build;

/// Each source of normals, with its name on the command line.
const NORMALS: [(NormalsMode, &str); 4] = [
    (NormalsMode::Keep, "keep"),
    (NormalsMode::Estimate, "estimate"),
    (NormalsMode::Fast, "fast"),
    (NormalsMode::None, "none"),
];
const CODECS: [Codec; 3] = [Codec::Fast, Codec::Small, Codec::None];

/// Options of a build as a document states them.
pub(super) fn options(build: &Build) -> Result<Options> {
    let default = Options::default();
    let normals = build.normals.as_ref().map(|name| {
        let named = NORMALS.iter().find(|(_, own)| own == name).map(|(mode, _)| *mode);
        named.with_context(|| format!("`{name}` is none of keep, estimate, fast and none"))
    });
    let compress = build.compress.as_ref().map(|name| {
        let named = CODECS.into_iter().find(|codec| codec.name() == name);
        named.with_context(|| format!("`{name}` is none of fast, small and none"))
    });
    let depth = build.colour_bits.map(|bits| match bits {
        8 => Ok(ColourDepth::Eight),
        16 => Ok(ColourDepth::Sixteen),
        _ => Err(anyhow!("is {bits}: colours have 8 or 16 bits")),
    });
    let words = |result: Result<_, String>| result.map_err(anyhow::Error::msg);
    let columns = build.columns.as_ref().map(|text| words(text.parse().map(Some)));
    let crs = build.crs.as_ref().map(|text| text.parse::<Crs>().map_err(anyhow::Error::msg));
    let unit = build.unit.as_ref().map(|word| {
        let named = UNITS.iter().find(|(other, _)| other == word).map(|(_, name)| *name);
        named.map(str::to_owned).with_context(|| {
            format!("`{word}` is none of {}", UNITS.map(|(word, _)| word).join(", "))
        })
    });
    Ok(Options {
        normals: in_field("build.normals", normals.transpose())?.unwrap_or_default(),
        sharp_features: build.sharp_features,
        tangents: build.tangents,
        compact: build.compact,
        node_capacity: build.node_capacity.unwrap_or(default.node_capacity),
        colour_depth: in_field("build.colour_bits", depth.transpose())?,
        compress: in_field("build.compress", compress.transpose())?.unwrap_or_default(),
        ignore_crs: build.ignore_crs,
        allow_rounding: build.allow_rounding,
        columns: in_field("build.columns", columns.transpose())?.flatten(),
        skip_lines: build.skip_lines,
        apply_viewpoint: build.apply_viewpoint,
        crs: in_field("build.crs", crs.transpose())?,
        unit: in_field("build.unit", unit.transpose())?,
        ..default
    })
}

/// The document's form of the options of a build.
pub(super) fn form(options: &Options) -> Result<Build> {
    let default = Options::default();
    let normals = NORMALS.iter().find(|(mode, _)| *mode == options.normals);
    let unit = |name: &String| UNITS.iter().find(|(_, own)| own == name).map(|(word, _)| *word);
    let capacity = options.node_capacity;
    Ok(Build {
        normals: normals.filter(|_| options.normals != default.normals).map(|(_, n)| (*n).into()),
        sharp_features: options.sharp_features,
        tangents: options.tangents,
        compact: options.compact,
        node_capacity: (capacity != default.node_capacity).then_some(capacity),
        colour_bits: options.colour_depth.map(|depth| match depth {
            ColourDepth::Eight => 8,
            ColourDepth::Sixteen => 16,
        }),
        compress: (options.compress != default.compress).then(|| options.compress.name().into()),
        ignore_crs: options.ignore_crs,
        allow_rounding: options.allow_rounding,
        columns: options.columns.as_ref().map(ToString::to_string),
        skip_lines: options.skip_lines,
        apply_viewpoint: options.apply_viewpoint,
        crs: options.crs.as_ref().map(crs_text).transpose()?,
        unit: options.unit.as_ref().and_then(unit).map(str::to_owned),
    })
}

/// Text that is read as this system.
fn crs_text(crs: &Crs) -> Result<String> {
    let number = |key: &str| {
        let word = crs.text.split_whitespace().find_map(|word| word.strip_prefix(key));
        word.map(str::to_owned)
    };
    let horizontal = number("ProjectedCSType=").or_else(|| number("GeographicType="));
    let codes = horizontal.map(|horizontal| match number("VerticalCSType=") {
        Some(vertical) => format!("EPSG:{horizontal}+{vertical}"),
        None => format!("EPSG:{horizontal}"),
    });
    let is_it = |text: &String| text.parse::<Crs>().is_ok_and(|read| read == *crs);
    let text = [Some(crs.text.clone()), codes].into_iter().flatten().find(is_it);
    text.context(
        "the coordinate reference system of --crs cannot be written as EPSG numbers or WKT",
    )
}
