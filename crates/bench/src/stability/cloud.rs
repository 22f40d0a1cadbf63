//! A scan in memory, as a source of builds: integer coordinates on a grid whose step is a power of
//! two, so that moving and scaling it is exact, and the attributes that pictures show.

use anyhow::{Context, Result};
use esker_points::attribute::names;
use esker_points::lattice::{GridKind, Placement};
use esker_points::{
    AttrType, Attribute, Batch, ColourDepth, Grid, InputGrid, Lattice, Rounding, Schema, Spread,
    Task,
};
use esker_scan::source::{BATCH_POINTS, Sink};
use esker_scan::{Geographic, ReadReport, ScanError, Source, SourceInfo};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Most steps of a coordinate that is read: a step of a tenth leaves it within 32 bits.
const STEPS_MAX: f64 = (1u64 << 26) as f64;

/// A scan in memory.
#[derive(Clone, Debug)]
pub(super) struct Cloud {
    /// Name in messages, and order among several.
    pub name: &'static str,
    /// Length of a step, the unit of the scan.
    pub step: f64,
    /// World coordinates of raw 0.
    pub offset: [f64; 3],
    /// Raw coordinates.
    pub positions: Vec<[i32; 3]>,
    /// Attributes.
    pub schema: Arc<Schema>,
    /// Values of a point, in the order of the schema.
    pub records: Vec<u8>,
    /// Bits of colours.
    pub colour_depth: Option<ColourDepth>,
}

impl Cloud {
    /// Reads a scan, or at most `most` of its points, evenly chosen. Coordinates are moved to the
    /// scan's middle and rounded to a step that is a power of two and not above the scan's own,
    /// unless the scan is too large for it. Of attributes, colours and intensity are kept.
    ///
    /// # Errors
    /// If the scan cannot be read, or has no points.
    pub fn read(path: &Path, most: u64, task: &dyn Task) -> Result<Self> {
        let source = esker_scan::open(path, &Default::default(), task)?;
        let info = source.info();
        let lattice = Lattice::choose(std::slice::from_ref(&info.grid))?;
        let placement = lattice.placement(&info.grid);
        let (schema, kept) = shown(&info.schema);
        let every = info.points_hint.div_ceil(most.max(1)).max(1);
        let (mut places, mut records) = (Vec::new(), Vec::new());
        let mut seen = 0u64;
        let mut sink = |batch: Batch| {
            task.check()?;
            for (i, place) in batch.positions.iter().enumerate() {
                let is_outside = batch.outside.iter().any(|(at, _)| *at == i);
                if seen.is_multiple_of(every) && !is_outside {
                    places.push(DVec3::from_array(lattice.world(*place)));
                    for &column in &kept {
                        let size = info.schema.attributes[column].ty.size();
                        records.extend_from_slice(&batch.columns[column][i * size..][..size]);
                    }
                }
                seen += 1;
            }
            Ok(())
        };
        source.read(&placement, task, &mut sink)?;
        let [low, high] = corners(&places)
            .with_context(|| format!("{}: there are no points to draw", path.display()))?;
        let middle = low.midpoint(high);
        let text = info.crs.as_ref().map_or("", |crs| &crs.text);
        let unit = info.crs.as_ref().and_then(|crs| crs.unit.as_deref());
        let degrees = Geographic::of(text, unit);
        let factor = degrees.map_or([1.0; 3], |degrees| degrees.metres(middle.y));
        let factor = DVec3::from_array(factor);
        let finest = (DVec3::from_array(lattice.scale) * factor).min_element();
        let extent = ((high - low) * factor).max_element();
        let step = power_of_two(finest.max(extent / STEPS_MAX));
        let raw = |p: &DVec3| ((*p - middle) * factor / step).round().to_array().map(|c| c as i32);
        Ok(Self {
            name: "scan",
            step,
            offset: [0.0; 3],
            positions: places.iter().map(raw).collect(),
            schema: Arc::new(schema),
            records,
            colour_depth: info.colour_depth,
        })
    }

    /// A scan of places with colours of eight bits, rounded to `step`.
    pub fn of(places: &[(DVec3, [u8; 3])], step: f64) -> Self {
        let colours = [names::RED, names::GREEN, names::BLUE];
        let schema = Schema::new(colours.map(|name| Attribute::new(name, AttrType::U16)).to_vec());
        // Canonical order is blue, green, red.
        let record = |(_, [r, g, b]): &(DVec3, [u8; 3])| [*b, 0, *g, 0, *r, 0];
        Self {
            name: "scan",
            step,
            offset: [0.0; 3],
            positions: places
                .iter()
                .map(|(at, _)| (*at / step).round().to_array().map(|c| c as i32))
                .collect(),
            schema: Arc::new(schema),
            records: places.iter().flat_map(record).collect(),
            colour_depth: Some(ColourDepth::Eight),
        }
    }

    /// The same points at other raw coordinates.
    pub fn moved(&self, to: impl Fn([i32; 3]) -> [i32; 3]) -> Self {
        let positions = self.positions.iter().map(|p| to(*p)).collect();
        Self { positions, ..self.clone() }
    }

    /// The points of these numbers, in this order.
    pub fn chosen(&self, numbers: impl Iterator<Item = usize> + Clone) -> Self {
        let size = self.schema.record_bytes();
        let record = |i: usize| self.records[i * size..][..size].to_vec();
        Self {
            positions: numbers.clone().map(|i| self.positions[i]).collect(),
            records: numbers.flat_map(record).collect(),
            ..self.clone()
        }
    }

    /// Least and greatest raw coordinates; zeros of no points.
    pub fn raw_bounds(&self) -> [[i32; 3]; 2] {
        let all = self.positions.iter().map(|p| [*p, *p]);
        let join = |[low, high]: [[i32; 3]; 2], [a, b]: [[i32; 3]; 2]| {
            [[0, 1, 2].map(|i| low[i].min(a[i])), [0, 1, 2].map(|i| high[i].max(b[i]))]
        };
        all.reduce(join).unwrap_or_default()
    }

    /// The scan as a source of a build.
    pub fn source(&self) -> Box<dyn Source> {
        let grid = Grid { scale: [self.step; 3], offset: self.offset };
        let bounds = self.raw_bounds().map(|corner| grid.world(corner));
        let kind = GridKind::Integer;
        let grid = InputGrid { name: self.name.into(), kind, grid, bounds: Some(bounds) };
        let info = SourceInfo {
            path: self.name.into(),
            format: "points in memory".into(),
            grid,
            schema: self.schema.clone(),
            points_hint: self.positions.len() as u64,
            bytes: 0,
            colour_depth: self.colour_depth,
            crs: None,
            scanner: None,
            verbatim: Vec::new(),
            notes: Vec::new(),
        };
        Box::new(CloudSource { cloud: self.clone(), info })
    }
}

/// A cloud that is read.
struct CloudSource {
    cloud: Cloud,
    info: SourceInfo,
}

impl Source for CloudSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let Cloud { positions, records, schema, .. } = &self.cloud;
        let size = schema.record_bytes();
        let mut report = ReadReport { colour_max: self.colour_max(), ..Default::default() };
        for first in (0..positions.len()).step_by(BATCH_POINTS) {
            task.check()?;
            let end = positions.len().min(first + BATCH_POINTS);
            let mut batch = Batch::with_capacity(schema.clone(), end - first);
            let mut rounding = Rounding::default();
            for point in first..end {
                let place =
                    placement.integer(positions[point], &self.info.grid.grid, &mut rounding);
                batch.positions.push(place);
                let mut record = &records[point * size..][..size];
                for (column, attribute) in batch.columns.iter_mut().zip(&schema.attributes) {
                    let (value, rest) = record.split_at(attribute.ty.size());
                    column.extend_from_slice(value);
                    record = rest;
                }
            }
            report.rounding_error_max = report.rounding_error_max.max(rounding.error_max);
            batch.outside = rounding.outside;
            report.points += (end - first) as u64;
            sink(batch)?;
        }
        Ok(report)
    }

    fn survey(&self, _task: &dyn Task) -> Result<Spread, ScanError> {
        let mut spread = Spread::default();
        self.cloud.positions.iter().for_each(|p| spread.add(self.info.grid.grid.world(*p)));
        Ok(spread)
    }
}

impl CloudSource {
    /// Greatest value of colours of 16 bits.
    fn colour_max(&self) -> u16 {
        let Cloud { records, schema, .. } = &self.cloud;
        let (mut at, mut most) = (0, 0);
        for attribute in &schema.attributes {
            let is_colour = [names::RED, names::GREEN, names::BLUE].contains(&&*attribute.name);
            if is_colour && attribute.ty == AttrType::U16 {
                let values = records.chunks_exact(schema.record_bytes().max(1));
                let values = values.map(|record| u16::from_le_bytes([record[at], record[at + 1]]));
                most = values.max().unwrap_or(0).max(most);
            }
            at += attribute.ty.size();
        }
        most
    }
}

/// The attributes of a scan that pictures show, and their indices.
fn shown(schema: &Schema) -> (Schema, Vec<usize>) {
    let is_shown =
        |name: &str| [names::RED, names::GREEN, names::BLUE, names::INTENSITY].contains(&name);
    let attributes = schema.attributes.iter().enumerate();
    let kept: Vec<usize> =
        attributes.filter(|(_, attribute)| is_shown(&attribute.name)).map(|(i, _)| i).collect();
    (Schema::new(kept.iter().map(|&i| schema.attributes[i].clone()).collect()), kept)
}

fn corners(places: &[DVec3]) -> Option<[DVec3; 2]> {
    let all = places.iter().map(|p| [*p, *p]);
    all.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)])
}

/// The greatest power of two that is not above `length`.
pub(super) fn power_of_two(length: f64) -> f64 {
    2f64.powi(length.log2().floor() as i32)
}
