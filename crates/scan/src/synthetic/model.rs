//! Generated models: solids whose splats have normals, colours, and clip lines on their edges.
//! Lengths are in the file's unit; the seed has no effect.

use super::csg::{Solid, Splat, Surface};
use super::draw::cos_sin;
use crate::error::ScanError;
use crate::source::{ReadReport, Sink, Source, SourceInfo};
use esker_points::attribute::{CLOSED_BLOCK, names};
use esker_points::lattice::{GridKind, Placement};
use esker_points::{AttrType, Attribute, Batch, Grid, InputGrid, Rounding, Schema, Spread, Task};
use std::path::Path;
use std::sync::Arc;

/// Greatest number of splats of a model.
pub const SPLATS_MAX: u64 = 4_000_000;
/// Least and greatest distance of splats. With a greater one, splats of a cube's faces would lie
/// beyond its edges, where no surface is.
const SPACINGS: [f64; 2] = [1e-4, 0.7];
/// Step of coordinates: a model is two units wide.
const STEP: f64 = 1e-6;
/// Splats in a batch.
const BATCH_POINTS: usize = 1 << 14;

/// A kind of model.
pub struct ModelKind {
    /// Name in `synthetic:NAME:...`.
    pub name: &'static str,
    make: fn() -> Solid,
}

/// All models.
pub static MODELS: &[ModelKind] =
    &[ModelKind { name: "cube", make: cube }, ModelKind { name: "csg", make: csg }];

/// A cube of edge 1, rotated so that no edge is parallel to an axis.
fn cube() -> Solid {
    let axes = turned();
    let wall = |k: usize| {
        let side = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        Surface::HalfSpace(axes[k / 2].map(|c| c * side), 0.5)
    };
    Solid { surfaces: (0..6).map(wall).collect(), is_inside: |inside| inside.iter().all(|i| *i) }
}

/// Three orthogonal unit vectors.
fn turned() -> [[f64; 3]; 3] {
    let ([a, b], [c, d]) = (cos_sin(0.07), cos_sin(0.11));
    [[a, b, 0.0], [-b * c, a * c, d], [b * d, -a * d, c]]
}

/// A block with a shaft through it, a bowl in its side, a notch in its edge and a tower on its top
/// (as in zwicker2004, figure 8: straight and round edges, convex and concave corners).
fn csg() -> Solid {
    let wall = |i: usize, side: f64, offset: f64| {
        let mut n = [0.0; 3];
        n[i] = side;
        Surface::HalfSpace(n, offset)
    };
    let surfaces = vec![
        // The block.
        wall(0, 1.0, 0.8),
        wall(0, -1.0, 0.8),
        wall(1, 1.0, 0.6),
        wall(1, -1.0, 0.6),
        wall(2, 1.0, 0.1),
        wall(2, -1.0, 0.5),
        // The shaft, the bowl, the notch.
        Surface::Cylinder([-0.4, 0.1], 0.22),
        Surface::Ball([0.35, -0.6, 0.1], 0.3),
        wall(0, -1.0, -0.3),
        wall(1, -1.0, -0.2),
        wall(2, -1.0, 0.2),
        // The tower and its top.
        Surface::Cylinder([0.2, 0.0], 0.25),
        wall(2, 1.0, 0.6),
    ];
    let is_inside = |inside: &[bool]| {
        let all = |some: &[usize]| some.iter().all(|&i| inside[i]);
        let block = all(&[0, 1, 2, 3, 4, 5]) && !inside[6] && !all(&[8, 9, 10]);
        (block || all(&[11, 12, 5])) && !inside[7]
    };
    Solid { surfaces, is_inside }
}

struct Model {
    info: SourceInfo,
    solid: Solid,
    /// Distance of splats; `None` without splats.
    spacing: Option<f64>,
}

/// Opens a model of about `points` splats.
///
/// # Errors
/// If these are too many.
pub fn open(path: &Path, kind: &ModelKind, points: u64) -> Result<Box<dyn Source>, ScanError> {
    if points > SPLATS_MAX {
        let what = format!("a generated model has at most {SPLATS_MAX} splats");
        return Err(ScanError::unsupported(path, what));
    }
    let solid = (kind.make)();
    let spacing = (points > 0).then(|| spacing(&solid, points));
    let census = spacing.map_or_else(Census::default, |spacing| Census::of(&solid, spacing));
    let grid = Grid { scale: [STEP; 3], offset: [0.0; 3] };
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("synthetic {}", kind.name),
        grid: InputGrid {
            name: path.display().to_string(),
            kind: GridKind::Integer,
            grid,
            bounds: census.bounds(),
        },
        schema: Arc::new(schema()),
        points_hint: census.splats,
        bytes: 0,
        colour_depth: None,
        crs: None,
        scanner: None,
        verbatim: vec![(CLOSED_BLOCK.into(), Vec::new())],
        notes: Vec::new(),
    };
    Ok(Box::new(Model { info, solid, spacing }))
}

/// The distance with which a solid has about `points` splats, found in a few tries.
fn spacing(solid: &Solid, points: u64) -> f64 {
    let mut spacing = (5.0 / points as f64).sqrt().min(0.5);
    let drawn = |spacing: f64| spacing.clamp(SPACINGS[0], SPACINGS[1]);
    for _ in 0..3 {
        let splats = Census::of(solid, drawn(spacing)).splats;
        spacing *= (splats.max(1) as f64 / points as f64).sqrt();
    }
    drawn(spacing)
}

/// Number and bounds of splats.
struct Census {
    splats: u64,
    low: [i32; 3],
    high: [i32; 3],
}

impl Default for Census {
    fn default() -> Self {
        Self { splats: 0, low: [i32::MAX; 3], high: [i32::MIN; 3] }
    }
}

impl Census {
    fn of(solid: &Solid, spacing: f64) -> Self {
        let mut census = Self::default();
        solid.for_each(spacing, &mut |splat| {
            let at = steps(splat.at);
            census.splats += 1;
            census.low = [0, 1, 2].map(|i| census.low[i].min(at[i]));
            census.high = [0, 1, 2].map(|i| census.high[i].max(at[i]));
            true
        });
        census
    }

    fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let world = |corner: [i32; 3]| corner.map(|c| f64::from(c) * STEP);
        (self.splats > 0).then(|| [world(self.low), world(self.high)])
    }
}

fn steps(at: [f64; 3]) -> [i32; 3] {
    at.map(|c| (c / STEP).round() as i32)
}

fn schema() -> Schema {
    use AttrType::{F32, F64, U8};
    let colours = [names::RED, names::GREEN, names::BLUE].map(|name| (name, U8));
    let normals = [names::NX, names::NY, names::NZ].map(|name| (name, F32));
    let ends = names::CLIP_ENDS.iter().flatten().map(|&name| (name, F64));
    let all = colours.into_iter().chain(normals).chain(ends).chain([(names::CLIP, U8)]);
    Schema::new(all.map(|(name, ty)| Attribute::new(name, ty)).collect())
}

/// A smooth texture, 0 to 255.
fn colour(at: [f64; 3]) -> [u8; 3] {
    let wave = |turns: f64| (140.0 + 90.0 * cos_sin(turns)[0]) as u8;
    [wave(at[0] + 0.4 * at[2]), wave(0.8 * at[1] - at[0] + 0.3), wave(1.3 * at[2] + at[1] + 0.6)]
}

impl Splat {
    /// The raw bytes of an attribute.
    fn value(&self, name: &str) -> Vec<u8> {
        let component = |all: &[&str]| all.iter().position(|&n| n == name);
        if let Some(i) = component(&[names::RED, names::GREEN, names::BLUE]) {
            return vec![colour(self.at)[i]];
        }
        if let Some(i) = component(&[names::NX, names::NY, names::NZ]) {
            return (self.normal[i] as f32).to_le_bytes().to_vec();
        }
        for (end, all) in names::CLIP_ENDS.iter().enumerate() {
            if let Some(i) = component(all) {
                let value = self.lines[end / 2].map_or(0.0, |line| line[end % 2][i]);
                return value.to_le_bytes().to_vec();
            }
        }
        let lines = self.lines.iter().flatten().count() as u8;
        vec![if self.either { 3 } else { lines }]
    }
}

impl Source for Model {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let (mut splats, mut is_read) = (Vec::with_capacity(BATCH_POINTS), Ok(()));
        let mut give = |splats: &mut Vec<Splat>| {
            task.check()?;
            report.points += splats.len() as u64;
            let batch = self.batch(splats, placement, &mut report);
            splats.clear();
            sink(batch)
        };
        if let Some(spacing) = self.spacing {
            self.solid.for_each(spacing, &mut |splat| {
                splats.push(splat);
                if splats.len() == BATCH_POINTS {
                    is_read = give(&mut splats);
                }
                is_read.is_ok()
            });
        }
        is_read?;
        if !splats.is_empty() {
            give(&mut splats)?;
        }
        Ok(report)
    }

    fn survey(&self, _: &dyn Task) -> Result<Spread, ScanError> {
        Ok(Spread::of(self.info.grid.bounds))
    }
}

impl Model {
    fn batch(&self, splats: &[Splat], placement: &Placement, report: &mut ReadReport) -> Batch {
        let mut batch = Batch::with_capacity(Arc::clone(&self.info.schema), splats.len());
        let (mut rounding, grid) = (Rounding::default(), &self.info.grid.grid);
        for splat in splats {
            batch.positions.push(placement.integer(steps(splat.at), grid, &mut rounding));
        }
        report.rounding_error_max = report.rounding_error_max.max(rounding.error_max);
        batch.outside = rounding.outside;
        for (attribute, column) in self.info.schema.attributes.iter().zip(&mut batch.columns) {
            splats.iter().for_each(|s| column.extend(s.value(&attribute.name)));
        }
        batch
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_of_few_splats_has_some() {
        for kind in MODELS {
            for points in 1..=60 {
                let solid = (kind.make)();
                let census = Census::of(&solid, spacing(&solid, points));
                assert!(census.splats > 0, "{} of {points}", kind.name);
                assert!(census.bounds().is_some());
            }
        }
    }
}
