//! Points that a program has in memory, as an input: whole steps on a grid, or coordinates in
//! `f64`, and a column for each attribute. They are asked for a range at a time, so that they need
//! not be copied as a whole. Coordinates that are not finite are refused.

use crate::error::ScanError;
use crate::source::{BATCH_POINTS, OpenOptions, ReadReport, Sink, Source, SourceInfo};
use crate::text::naming::{colour_max, wide_colours};
use esker_points::lattice::{Grid, GridKind, Placement, float_grid};
use esker_points::{
    Attribute, Batch, ColourDepth, Column, InputGrid, Rounding, Schema, Spread, Task,
};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Coordinates of some points.
pub enum Coordinates {
    /// Steps on the grid that is given with the points.
    Steps(Vec<[i32; 3]>),
    /// World coordinates.
    World(Vec<[f64; 3]>),
}

impl Coordinates {
    fn len(&self) -> usize {
        match self {
            Self::Steps(steps) => steps.len(),
            Self::World(world) => world.len(),
        }
    }
}

/// Points of a program. The same range gives the same values each time.
pub trait Points: Send + Sync {
    /// Coordinates of the points of a range, of the same kind for all.
    ///
    /// # Errors
    /// Why there are none.
    fn coordinates(&self, range: Range<usize>) -> Result<Coordinates, String>;

    /// Raw little-endian values of an attribute of the points of a range; `attribute` is its index
    /// in the list that was given.
    ///
    /// # Errors
    /// Why there are none.
    fn column(&self, attribute: usize, range: Range<usize>) -> Result<Column, String>;
}

/// What is given with points.
#[derive(Clone, Debug)]
pub struct GivenInfo {
    /// Name of the input in messages and in the file that is built.
    pub name: PathBuf,
    /// Number of points.
    pub count: usize,
    /// Grid of the coordinates. Without one, that of world coordinates follows from their values,
    /// as for other floats.
    pub grid: Option<Grid>,
    /// The attributes.
    pub attributes: Vec<Attribute>,
}

/// Points of a program as an input.
pub struct Given {
    info: SourceInfo,
    points: Box<dyn Points>,
    count: usize,
    /// Index in the list that was given, of each attribute of the schema.
    order: Vec<usize>,
}

impl Given {
    /// Looks at all points once, for their bounds.
    ///
    /// # Errors
    /// If a coordinate is not finite, a grid is missing or too fine, points cannot be had, or on
    /// request.
    pub fn open(
        given: GivenInfo,
        points: Box<dyn Points>,
        options: &OpenOptions,
        task: &dyn Task,
    ) -> Result<Self, ScanError> {
        let GivenInfo { name, count, grid, attributes } = given;
        let schema = Schema::new(attributes.clone());
        let place = |a: &Attribute| attributes.iter().position(|own| own.key() == a.key());
        let order: Vec<usize> = schema.attributes.iter().filter_map(place).collect();
        if order.len() != schema.attributes.len() {
            return Err(ScanError::unsupported(
                &name,
                "two attributes have the same name and type",
            ));
        }
        let record_bytes = schema.record_bytes() + 12;
        let mut source = Self {
            info: SourceInfo {
                path: name,
                format: "arrays".into(),
                grid: InputGrid {
                    name: String::new(),
                    kind: GridKind::Integer,
                    grid: Grid { scale: [1.0; 3], offset: [0.0; 3] },
                    bounds: None,
                },
                schema: Arc::new(schema),
                points_hint: count as u64,
                bytes: (count as u64).saturating_mul(record_bytes as u64),
                colour_depth: None,
                crs: options.crs.clone(),
                scanner: None,
                verbatim: Vec::new(),
                notes: Vec::new(),
            },
            points,
            count,
            order,
        };
        source.look(grid, options, task)?;
        Ok(source)
    }

    /// Finds bounds, grid and depth of colours.
    fn look(
        &mut self,
        grid: Option<Grid>,
        options: &OpenOptions,
        task: &dyn Task,
    ) -> Result<(), ScanError> {
        let (mut spread, mut are_steps, mut colour) = (Spread::default(), grid.is_some(), 0);
        let wide = wide_colours(&self.info.schema);
        for range in self.ranges() {
            task.check()?;
            match self.coordinates(range.clone())? {
                Coordinates::Steps(steps) => {
                    let Some(grid) = grid else {
                        return Err(self.refused("steps need the scale and offset of their grid"));
                    };
                    steps.iter().for_each(|&step| spread.add(grid.world(step)));
                }
                Coordinates::World(world) => {
                    are_steps = false;
                    if let Some(i) = world.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
                        let (row, place) = (range.start + i, world[i]);
                        return Err(self.refused(&format!(
                            "row {row} is at {place:?}, which is no place; leave out points \
                             without coordinates"
                        )));
                    }
                    world.iter().for_each(|&place| spread.add(place));
                }
            }
            if wide.is_some() && options.colour_depth.is_none() {
                colour = colour.max(colour_max(&self.columns(range)?));
            }
        }
        let bounds = spread.bounds();
        let own = &mut self.info.grid;
        own.name = self.info.path.display().to_string();
        (own.grid, own.bounds) = match grid {
            Some(grid) => (grid, bounds),
            None => float_grid(&spread, false),
        };
        own.kind = if grid.is_some() { GridKind::Integer } else { GridKind::Float };
        let detected =
            if colour <= u16::from(u8::MAX) { ColourDepth::Eight } else { ColourDepth::Sixteen };
        self.info.colour_depth = wide.map(|_| options.colour_depth.unwrap_or(detected));
        let fits = |[low, high]: [[f64; 3]; 2]| {
            (0..3).all(|axis| {
                let Grid { scale, offset } = own.grid;
                let step = |c: [f64; 3]| ((c[axis] - offset[axis]) / scale[axis]).round();
                step(low) >= f64::from(i32::MIN) && step(high) <= f64::from(i32::MAX)
            })
        };
        if grid.is_some() && !are_steps && !bounds.is_none_or(fits) {
            let Grid { scale, offset } = self.info.grid.grid;
            return Err(self.refused(&format!(
                "coordinates from {:?} to {:?} are more than 2^31 steps of {scale:?} from the \
                 offset {offset:?}; choose a greater scale, or an offset near the points",
                bounds.unwrap_or_default()[0],
                bounds.unwrap_or_default()[1]
            )));
        }
        Ok(())
    }

    fn ranges(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let count = self.count;
        (0..count).step_by(BATCH_POINTS).map(move |at| at..(at + BATCH_POINTS).min(count))
    }

    fn coordinates(&self, range: Range<usize>) -> Result<Coordinates, ScanError> {
        let points = range.len();
        let coordinates = self.points.coordinates(range).map_err(|why| self.refused(&why))?;
        if coordinates.len() == points {
            return Ok(coordinates);
        }
        Err(self.refused("the coordinates are not one a point"))
    }

    /// A batch with the attributes of a range; its positions are not filled in.
    fn columns(&self, range: Range<usize>) -> Result<Batch, ScanError> {
        let mut batch = Batch::with_capacity(self.info.schema.clone(), 0);
        for (attribute, &given) in self.order.iter().enumerate() {
            let column = self.points.column(given, range.clone()).map_err(|e| self.refused(&e))?;
            let of = &self.info.schema.attributes[attribute];
            if column.len() != range.len() * of.ty.size() {
                return Err(self.refused(&format!("`{}` has not one value a point", of.name)));
            }
            batch.columns[attribute] = column;
        }
        Ok(batch)
    }

    fn refused(&self, what: &str) -> ScanError {
        ScanError::damaged(&self.info.path, what)
    }

    /// Name of the input.
    pub fn path(&self) -> &Path {
        &self.info.path
    }
}

impl Source for Given {
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
        for range in self.ranges() {
            task.check()?;
            let mut batch = self.columns(range.clone())?;
            let mut rounding = Rounding::default();
            batch.positions = match self.coordinates(range)? {
                Coordinates::Steps(steps) => steps
                    .into_iter()
                    .map(|step| placement.integer(step, &self.info.grid.grid, &mut rounding))
                    .collect(),
                Coordinates::World(world) => {
                    world.into_iter().map(|place| placement.real(place, &mut rounding)).collect()
                }
            };
            let colour = colour_max(&batch);
            report.take(batch, &[], rounding, colour, sink)?;
        }
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let mut spread = Spread::default();
        for range in self.ranges() {
            task.check()?;
            match self.coordinates(range)? {
                Coordinates::Steps(steps) => {
                    steps.iter().for_each(|&step| spread.add(self.info.grid.grid.world(step)));
                }
                Coordinates::World(world) => world.iter().for_each(|&place| spread.add(place)),
            }
        }
        Ok(spread)
    }
}
