//! What gives points their colour: the name that the user gives becomes the renderer's map and the plane
//! that it needs, with the range of values from the file's statistics.

use anyhow::{Result, bail};
use esker_format::{EskerFile, Forest, PlaneKind};
use esker_points::AttrType;
use esker_points::attribute::names;
use esker_render::{ColourBy, ColourMap, Palette};

/// Where the colours of a picture come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colouring {
    /// How values become colours.
    pub by: ColourBy,
    /// The plane that the frame needs for it, and the type of its values where they are scalars.
    pub plane: Option<(PlaneKind, Option<AttrType>)>,
}

/// Share of the values that may lie outside a map's range on either side: a few strays must not take
/// all of its colours.
const STRAYS: f64 = 0.01;

/// The colouring of this name; the best that the file has where there is none: its colours, else its
/// intensity where it has no normals to be lit by, else elevation.
///
/// # Errors
/// Where the file has no such attribute.
pub fn colouring(file: &Forest, name: Option<&str>, bounds: [[f64; 3]; 2]) -> Result<Colouring> {
    let elevation = || {
        let map = ColourMap { low: bounds[0][2], high: bounds[1][2], palette: Palette::Terrain };
        Colouring { by: ColourBy::Elevation(map), plane: None }
    };
    let plain = |by| Ok(Colouring { by, plane: None });
    match name {
        None if file.has(PlaneKind::Colour) && has_colours(file)? => {
            colouring(file, Some("rgb"), bounds)
        }
        None if file.has(PlaneKind::Normal) => plain(ColourBy::Plain),
        None => Ok(elevation()),
        Some("rgb" | "colour" | "color") if file.has(PlaneKind::Colour) => {
            Ok(Colouring { by: ColourBy::Rgb, plane: Some((PlaneKind::Colour, None)) })
        }
        Some("rgb" | "colour" | "color") => {
            bail!("{}: has no colours; try --colour-by elevation", file.path().display())
        }
        Some("plain" | "none") => plain(ColourBy::Plain),
        Some("elevation" | "z") => Ok(elevation()),
        Some("level" | "cell" | "node") => plain(ColourBy::Cell),
        Some("normal" | "normals") => plain(ColourBy::Normal),
        Some("depth") => {
            let extent: f64 =
                (0..3).map(|i| (bounds[1][i] - bounds[0][i]).powi(2)).sum::<f64>().sqrt();
            plain(ColourBy::EyeDepth(ColourMap {
                low: 0.0,
                high: extent,
                palette: Palette::Viridis,
            }))
        }
        Some(name) => attribute(file, name),
    }
}

/// Whether any colour differs from black: many LAS files have the fields and nothing in them.
fn has_colours(file: &Forest) -> Result<bool> {
    let colours = [names::RED, names::GREEN, names::BLUE];
    for file in file.files() {
        let statistics = file.statistics()?;
        let attributes = file.metadata().schema.attributes.iter().enumerate();
        let mut indices = attributes.filter(|(_, a)| colours.contains(&a.name.as_str()));
        if indices.any(|(i, _)| statistics.histograms().ranges().of(i).1 > 0.0) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn attribute(file: &Forest, name: &str) -> Result<Colouring> {
    let schema = file.schema();
    let Some(index) = schema.find(name) else {
        let mut known: Vec<_> = schema.attributes.iter().map(|a| a.name.as_str()).collect();
        known.extend(["rgb", "elevation", "plain", "level", "normal", "depth"]);
        bail!("{}: has no attribute `{name}`; it has {}", file.path().display(), known.join(", "));
    };
    let ty = schema.attributes[index].ty;
    let kind = if name == names::INTENSITY && ty == AttrType::U16 {
        PlaneKind::Intensity
    } else {
        PlaneKind::Attribute(index as u16)
    };
    if !file.has(kind) {
        bail!("{}: `{name}` is a part of the colour; use --colour-by rgb", file.path().display());
    }
    if name == names::CLASSIFICATION && ty == AttrType::U8 {
        return Ok(Colouring { by: ColourBy::Classification, plane: Some((kind, Some(ty))) });
    }
    let (low, high) = central_range(file, index)?;
    let palette = if kind == PlaneKind::Intensity { Palette::Grey } else { Palette::Viridis };
    Ok(Colouring {
        by: ColourBy::Scalar(ColourMap { low, high, palette }),
        plane: Some((kind, Some(ty))),
    })
}

/// The range of an attribute without its strays, over all trees that have it.
fn central_range(forest: &Forest, attribute: usize) -> Result<(f64, f64)> {
    let attribute = &forest.schema().attributes[attribute];
    let mut range: Option<(f64, f64)> = None;
    for file in forest.files().filter(|file| file.footer().points > 0) {
        let schema = &file.metadata().schema;
        if let Some(index) = schema.find_typed(&attribute.name, attribute.ty) {
            let (low, high) = range_in(file, index)?;
            range = Some(range.map_or((low, high), |r| (r.0.min(low), r.1.max(high))));
        }
    }
    Ok(range.unwrap_or((0.0, 0.0)))
}

fn range_in(file: &EskerFile, attribute: usize) -> Result<(f64, f64)> {
    let statistics = file.statistics()?;
    let histograms = statistics.histograms();
    let (low, high) = histograms.ranges().of(attribute);
    let counts = histograms.counts(attribute);
    let total: u64 = counts.iter().sum();
    if total == 0 || low >= high {
        return Ok((low, high));
    }
    let strays = (total as f64 * STRAYS) as u64;
    let beyond = |bins: &mut dyn Iterator<Item = &u64>| {
        let mut sum = 0;
        bins.take_while(|&&n| {
            sum += n;
            sum <= strays
        })
        .count()
    };
    let bin = (high - low) / counts.len() as f64;
    let (below, above) = (beyond(&mut counts.iter()), beyond(&mut counts.iter().rev()));
    Ok((low + bin * below as f64, high - bin * above as f64))
}
