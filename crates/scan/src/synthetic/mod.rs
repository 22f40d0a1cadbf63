//! Generated scans, accepted wherever an input is: `synthetic:SCENE:POINTS:SEED`. Every point is a
//! function of the scene, the number of points, the seed and its index, the same on every machine
//! (see [`draw`]), so blocks of points are made independently, on all cores, and passed on in
//! order. They have the grid and the fields of a LAS file of point format 7.
//!
//! | scene | what it is |
//! |---|---|
//! | `bridge` | a bridge over a river, scanned from tripods around, under and on it |
//! | `office` | three floors of furnished rooms, scanned from a tripod in every room |
//! | `terrain` | country with woods, fields, villages and power lines, scanned from the air |
//!
//! There are also models ([`model`]), `cube` and `csg`: solids of about the given number of splats,
//! with clip lines on their edges.

mod airborne;
mod bridge;
mod csg;
mod draw;
mod floor_plan;
mod furniture;
mod landscape;
pub mod model;
mod office;
mod point;
mod ray;
mod room;
mod scene;
mod scenes;
mod solid;
mod spec;
mod station;
mod tree;
mod valley;
mod viaduct;

use crate::error::ScanError;
use crate::source::{Crs, OpenOptions, ReadReport, Sink, Source, SourceInfo};
use esker_points::lattice::{GridKind, Placement};
use esker_points::{ColourDepth, InputGrid, Spread, Task};
use point::{Point, Run};
use rayon::prelude::*;
use scene::{BLOCK_POINTS, Scene};
pub use scenes::SCENES;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

pub use spec::{POINTS_MAX, is_spec, parse_points};

/// Blocks made while earlier ones are consumed: 16 MiB of batches.
const GROUP_BLOCKS: u64 = 28;

/// ETRS89 / UTM zone 32N, EPSG 25832.
const CRS: &str = r#"PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#;

struct Synthetic {
    info: SourceInfo,
    scene: Box<dyn Scene>,
}

/// Opens a generated scan.
///
/// # Errors
/// If no generated scan has this name.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, ScanError> {
    let spec = spec::Spec::parse(path)?;
    let Some(kind) = SCENES.get(spec.scene) else {
        return model::open(path, &model::MODELS[spec.scene - SCENES.len()], spec.points);
    };
    let scene = (kind.make)(spec.points, spec.seed);
    let grid = scene.grid();
    let world = |corner: [f64; 3]| [0, 1, 2].map(|i| corner[i] + grid.offset[i]);
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("synthetic {}", kind.name),
        grid: InputGrid {
            name: path.display().to_string(),
            kind: GridKind::Integer,
            grid,
            bounds: (spec.points > 0).then_some(scene.bounds().map(world)),
        },
        schema: Arc::new(point::schema()),
        points_hint: spec.points,
        bytes: 0,
        colour_depth: Some(options.colour_depth.unwrap_or(ColourDepth::Sixteen)),
        crs: Some(Crs { text: CRS.to_owned(), unit: Some("metre".to_owned()) }),
        scanner: scene.scanner(),
        verbatim: Vec::new(),
        notes: Vec::new(),
    };
    Ok(Box::new(Synthetic { info, scene }))
}

impl Synthetic {
    /// Makes the blocks of a range, in order, on all cores.
    fn group<T: Send>(
        &self,
        blocks: Range<u64>,
        make: &(dyn Fn(&[Point]) -> Result<T, ScanError> + Sync),
    ) -> Result<Vec<T>, ScanError> {
        let one = |block: u64| {
            let start = block * BLOCK_POINTS;
            let range = start..self.info.points_hint.min(start + BLOCK_POINTS);
            let mut points = Vec::with_capacity(BLOCK_POINTS as usize);
            self.scene.block(range, &mut points);
            make(&points)
        };
        blocks.into_par_iter().map(one).collect()
    }

    /// Passes the result of `make` for every block of a range of points to `sink`, in order, while
    /// the next ones are made. The range begins with a block.
    fn each<T: Send>(
        &self,
        points: Range<u64>,
        task: &dyn Task,
        make: &(dyn Fn(&[Point]) -> Result<T, ScanError> + Sync),
        sink: &mut dyn FnMut(T) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let end = points.end.min(self.info.points_hint).div_ceil(BLOCK_POINTS);
        let mut ready = Vec::new();
        for start in (points.start / BLOCK_POINTS..end).step_by(GROUP_BLOCKS as usize) {
            task.check()?;
            let blocks = start..end.min(start + GROUP_BLOCKS);
            let mut made = Ok(Vec::new());
            let sunk = rayon::in_place_scope(|scope| {
                scope.spawn(|_| made = self.group(blocks, make));
                std::mem::take(&mut ready).into_iter().try_for_each(&mut *sink)
            });
            ready = sunk.and(made)?;
        }
        ready.into_iter().try_for_each(sink)
    }
}

impl Source for Synthetic {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        self.read_range(0..u64::MAX, placement, task, sink)
    }

    fn begin_near(&self, point: u64) -> u64 {
        point.min(self.info.points_hint) / BLOCK_POINTS * BLOCK_POINTS
    }

    fn read_range(
        &self,
        points: Range<u64>,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let (schema, grid) = (&self.info.schema, &self.info.grid.grid);
        let make = |points: &[Point]| Ok(point::run(points, schema, grid, placement));
        self.each(points, task, &make, &mut |mut run: Run| {
            report.points += run.batch.len() as u64;
            report.colour_max = report.colour_max.max(run.colour_max);
            report.rounding_error_max = report.rounding_error_max.max(run.rounding.error_max);
            run.batch.outside = run.rounding.outside;
            sink(run.batch)
        })?;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        let make = |points: &[Point]| {
            Ok(points.iter().fold([[i32::MAX; 3], [i32::MIN; 3]], |[low, high], p| {
                [
                    [0, 1, 2].map(|i| low[i].min(p.position[i])),
                    [0, 1, 2].map(|i| high[i].max(p.position[i])),
                ]
            }))
        };
        self.each(0..u64::MAX, task, &make, &mut |[low, high]| {
            let [least, greatest] = bounds.unwrap_or([low, high]);
            bounds = Some([
                [0, 1, 2].map(|i| low[i].min(least[i])),
                [0, 1, 2].map(|i| high[i].max(greatest[i])),
            ]);
            Ok(())
        })?;
        let grid = &self.info.grid.grid;
        Ok(Spread::of(bounds.map(|b| b.map(|corner| grid.world(corner)))))
    }
}
