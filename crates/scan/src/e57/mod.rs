//! E57 (ASTM E2807): all scans of a file, each in its pose, with all their values; by the crate
//! `e57`. Directions without a return are no points, and counted; images are left out. One pass at
//! opening finds the bounds, but where coordinates are integers on one grid and the file tells
//! their bounds.
//!
//! Where there are several scans, a point's `point_source_id` is that of its scan, from 1.

mod ahead;
mod colours;
mod fields;
mod grid;
mod packets;
mod pose;
mod values;

use crate::bounds::Bounds;
use crate::caught::catch;
use crate::error::ScanError;
use crate::source::{Crs, Format, OpenOptions, ReadReport, Scanner, Sink, Source, SourceInfo};
use crate::text::blocks::in_order;
use crate::text::naming::{NO_RETURN, NOT_FINITE, colour_max, wide_colours};
use ahead::{Ahead, file_of};
use e57::{E57Reader, PointCloud, PointCloudReaderRaw, RecordValue};
use esker_points::lattice::{GridKind, OffLattice, Placement, float_grid};
use esker_points::{Batch, Cancelled, ColourDepth, InputGrid, Task};
use fields::{Fields, FieldsError, Placed};
use rayon::prelude::*;
use std::path::Path;

/// E57, as the registry knows it.
pub const FORMAT: Format = Format {
    name: "E57",
    endings: &["e57"],
    recognises: |head| head.starts_with(b"ASTM-E57"),
    open,
};

/// Values of a block at most, unless one point has more.
const BLOCK_VALUES: usize = 1 << 17;
/// A file's XML is kept up to so many bytes.
const XML_BYTES_MAX: usize = 1 << 20;

struct E57Source {
    info: SourceInfo,
    clouds: Vec<PointCloud>,
    fields: Fields,
}

type Reader = E57Reader<Ahead>;

/// Values of some points of a scan, one point after another.
struct Block {
    scan: usize,
    values: Vec<RecordValue>,
}

/// What one pass over points finds.
struct Survey {
    bounds: Bounds,
    colour_max: u16,
}

/// The points of a block, and what became of the others.
struct Part {
    batch: Batch,
    no_return: u64,
    not_finite: u64,
    rounding_error_max: f64,
}

fn reader_of(path: &Path) -> Result<Reader, ScanError> {
    let file = file_of(path)?;
    guarded(path, "", || E57Reader::new(file))
}

/// What its reader says, as an error of this file; also where it panics.
fn guarded<T>(
    path: &Path,
    what: &str,
    read: impl FnOnce() -> Result<T, e57::Error>,
) -> Result<T, ScanError> {
    match catch(read) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(ScanError::damaged(path, format!("{what}{error}"))),
        Err(_) => Err(ScanError::damaged(path, format!("{what}is damaged"))),
    }
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let reader = reader_of(path)?;
    let clouds = reader.pointclouds();
    if clouds.len() > usize::from(u16::MAX) {
        let what = "has more than 65,535 scans, which are not told apart; part it";
        return Err(ScanError::unsupported(path, what));
    }
    let fields = Fields::new(&clouds, task).map_err(|why| match why {
        FieldsError::Damaged(what) => ScanError::damaged(path, what),
        FieldsError::Cancelled(cancelled) => cancelled.into(),
    })?;
    for (scan, cloud) in with_points(&clouds) {
        let even = packets::are_even(file_of(path)?, reader.header().page_size, cloud, task);
        task.check()?;
        if !even.map_err(|e| ScanError::io(path, e))? {
            let what =
                format!("scan {}: some values are far ahead of others; it is damaged", scan + 1);
            return Err(ScanError::damaged(path, what));
        }
    }
    let told = fields.grid.and_then(|_| told_bounds(&clouds, &fields));
    let survey = match told {
        Some(bounds) => Survey { bounds, ..Survey::EMPTY },
        None => survey_file(path, &clouds, &fields, task)?,
    };
    let bounds = survey.bounds.get();
    let (kind, grid) = match fields.grid {
        Some(grid) => (GridKind::Integer, grid),
        None => (GridKind::Float, float_grid(bounds.unwrap_or_default())),
    };
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let colour_depth = wide_colours(&fields.schema).map(|_| {
        let eight = (1..=u16::from(u8::MAX)).contains(&survey.colour_max) && !fields.are_shares;
        let detected = if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        options.colour_depth.unwrap_or(detected)
    });
    let mut notes = fields.notes.clone();
    match reader.images().len() {
        0 => {}
        1 => notes.push("an image is left out".into()),
        n => notes.push(format!("{n} images are left out")),
    }
    if bounds.is_none() {
        notes.push("has no points".into());
    }
    let crs = reader.coordinate_metadata().map(str::trim).filter(|text| !text.is_empty());
    let xml = reader.xml().as_bytes();
    let verbatim = (xml.len() <= XML_BYTES_MAX).then(|| ("E57 XML".into(), xml.to_vec()));
    let scans = match clouds.len() {
        1 => "one scan".to_owned(),
        n => format!("{n} scans"),
    };
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("E57 1.0, {scans}"),
        grid: InputGrid { name: path.display().to_string(), kind, grid, bounds },
        schema: fields.schema.clone(),
        points_hint: clouds.iter().fold(0, |n, cloud| n.saturating_add(cloud.records)),
        bytes,
        colour_depth,
        crs: crs.map(|text| Crs { text: text.to_owned(), unit: None }),
        scanner: scanner(&clouds, &fields),
        verbatim: verbatim.into_iter().collect(),
        notes,
    };
    Ok(Box::new(E57Source { info, clouds, fields }))
}

/// Where the scans were made, as far as they tell: by a pose, or by directions.
fn scanner(clouds: &[PointCloud], fields: &Fields) -> Option<Scanner> {
    let is_told = |cloud: &PointCloud| {
        cloud.transform.is_some() || cloud.has_spherical() || cloud.has_row_column()
    };
    let scans = clouds.iter().zip(&fields.scans).zip(1..);
    let told: Vec<(u16, [f64; 3])> = scans
        .filter(|((cloud, _), _)| is_told(cloud))
        .map(|((_, taken), number)| (number, taken.pose.at))
        .collect();
    match (told.as_slice(), clouds.len()) {
        ([], _) => None,
        ([(_, at)], 1) => Some(Scanner::At(*at)),
        _ => Some(Scanner::BySource(told.into_iter().collect())),
    }
}

/// The bounds of all points that scans which are not turned tell, if they all do.
fn told_bounds(clouds: &[PointCloud], fields: &Fields) -> Option<Bounds> {
    let mut bounds = Bounds::EMPTY;
    for (cloud, taken) in clouds.iter().zip(&fields.scans).filter(|(cloud, _)| cloud.records > 0) {
        let (told, at) = (cloud.cartesian_bounds.as_ref()?, taken.pose.at);
        let low = [told.x_min?, told.y_min?, told.z_min?];
        let high = [told.x_max?, told.y_max?, told.z_max?];
        let is_sound = |i: usize| low[i] <= high[i] && (high[i] - low[i] + at[i]).is_finite();
        if !(0..3).all(is_sound) {
            return None;
        }
        for corner in [low, high] {
            bounds.add([0, 1, 2].map(|i| corner[i] + at[i]));
        }
    }
    Some(bounds)
}

/// The values of a scan's points, block by block.
struct Blocks<'a> {
    path: &'a Path,
    /// The scan's place in the file, for messages.
    what: String,
    scan: usize,
    points: PointCloudReaderRaw<'a, Ahead>,
    points_max: usize,
}

impl<'a> Blocks<'a> {
    fn new(
        path: &'a Path,
        reader: &'a mut Reader,
        (scan, cloud): (usize, &PointCloud),
    ) -> Result<Self, ScanError> {
        let what = format!("scan {}: ", scan + 1);
        let points = guarded(path, &what, || reader.pointcloud_raw(cloud))?;
        let points_max = (BLOCK_VALUES / cloud.prototype.len().max(1)).max(1);
        Ok(Self { path, what, scan, points, points_max })
    }

    fn next(&mut self) -> Result<Option<Block>, ScanError> {
        let mut values = Vec::new();
        guarded(self.path, &self.what, || {
            for point in self.points.by_ref().take(self.points_max) {
                values.extend(point?);
            }
            Ok(())
        })?;
        Ok((!values.is_empty()).then_some(Block { scan: self.scan, values }))
    }
}

/// The scans that have points.
fn with_points(clouds: &[PointCloud]) -> Vec<(usize, &PointCloud)> {
    clouds.iter().enumerate().filter(|(_, cloud)| cloud.records > 0).collect()
}

fn survey_file(
    path: &Path,
    clouds: &[PointCloud],
    fields: &Fields,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    // Scan by scan on all cores, each by itself: only so are values unpacked by more than one.
    let surveys = with_points(clouds).into_par_iter().map_init(
        || reader_of(path).map_err(Some),
        |reader, scan| {
            let reader = reader.as_mut().map_err(|e| e.take().unwrap_or(Cancelled.into()))?;
            let mut blocks = Blocks::new(path, reader, scan)?;
            let mut found = Survey::EMPTY;
            while let Some(block) = blocks.next()? {
                task.check()?;
                found.merge(Survey::of_block(&block, clouds, fields));
            }
            Ok(found)
        },
    );
    surveys.try_reduce(
        || Survey::EMPTY,
        |mut found, part| {
            found.merge(part);
            Ok(found)
        },
    )
}

impl Survey {
    const EMPTY: Self = Self { bounds: Bounds::EMPTY, colour_max: 0 };

    fn of_block(block: &Block, clouds: &[PointCloud], fields: &Fields) -> Self {
        let mut found = Self::EMPTY;
        let (cloud, taken) = (&clouds[block.scan], &fields.scans[block.scan]);
        let colours = wide_colours(&fields.schema);
        let mut columns = vec![Vec::new(); fields.schema.attributes.len()];
        for values in block.values.chunks_exact(cloud.prototype.len()) {
            let Placed::At(world) = taken.place(cloud, values) else { continue };
            found.bounds.add(world);
            if let Some(colours) = colours {
                columns.iter_mut().for_each(Vec::clear);
                taken.put((block.scan, cloud), values, &fields.schema, &mut columns);
                for column in colours {
                    let value = columns[column].first_chunk().copied().unwrap_or_default();
                    found.colour_max = found.colour_max.max(u16::from_le_bytes(value));
                }
            }
        }
        found
    }

    fn merge(&mut self, later: Self) {
        self.bounds.merge(later.bounds);
        self.colour_max = self.colour_max.max(later.colour_max);
    }
}

impl E57Source {
    fn decode(&self, block: &Block, placement: &Placement) -> Result<Part, ScanError> {
        let (cloud, taken) = (&self.clouds[block.scan], &self.fields.scans[block.scan]);
        let schema = &self.info.schema;
        let points = block.values.len() / cloud.prototype.len();
        let batch = Batch::with_capacity(schema.clone(), points);
        let mut part = Part { batch, no_return: 0, not_finite: 0, rounding_error_max: 0.0 };
        for values in block.values.chunks_exact(cloud.prototype.len()) {
            let error = &mut part.rounding_error_max;
            let placed = if let Some(grid) = &self.fields.grid {
                if !taken.is_return(cloud, values) {
                    part.no_return += 1;
                    continue;
                }
                let raw = taken.raw(values).ok_or_else(|| {
                    let what = "a coordinate is beyond what its header says; it is damaged";
                    ScanError::damaged(&self.info.path, format!("scan {}: {what}", block.scan + 1))
                })?;
                placement.integer(raw, grid, error)
            } else {
                match taken.place(cloud, values) {
                    Placed::At(world) => placement.real(world, error),
                    Placed::NoReturn => {
                        part.no_return += 1;
                        continue;
                    }
                    Placed::NotFinite => {
                        part.not_finite += 1;
                        continue;
                    }
                }
            };
            let off = |e: OffLattice| ScanError::OffLattice {
                path: self.info.path.clone(),
                world: e.world,
            };
            part.batch.positions.push(placed.map_err(off)?);
            taken.put((block.scan, cloud), values, schema, &mut part.batch.columns);
        }
        Ok(part)
    }
}

impl Source for E57Source {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let path = &self.info.path;
        let mut report = ReadReport::default();
        let mut reader = reader_of(path)?;
        for scan in with_points(&self.clouds) {
            let mut blocks = Blocks::new(path, &mut reader, scan)?;
            in_order(
                task,
                || blocks.next(),
                |block| self.decode(&block, placement),
                |part: Part| {
                    let refused = [(NO_RETURN, part.no_return), (NOT_FINITE, part.not_finite)];
                    // Shares are of 16 bits, however dark they are.
                    let are_shares = self.fields.are_shares && !part.batch.is_empty();
                    let most = if are_shares { u16::MAX } else { colour_max(&part.batch) };
                    report.take(part.batch, &refused, part.rounding_error_max, most, sink)
                },
            )?;
        }
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Option<[[f64; 3]; 2]>, ScanError> {
        let path = &self.info.path;
        Ok(survey_file(path, &self.clouds, &self.fields, task)?.bounds.get())
    }
}
