//! Reads E57 (ASTM E2807) with the crate `e57`: all scans of a file, each in its pose, with all
//! their values. Directions without a return are counted but are no points; images are left out. A
//! pass at opening finds the bounds, unless coordinates are integers on one grid and the file gives
//! their bounds. In a file of several scans a damaged one does not cost the others: what cannot be
//! read of it is refused and counted.
//!
//! If there are several scans, the `point_source_id` of a point is the number of its scan, from 1.

mod buffered;
mod colours;
mod damage;
mod fields;
mod grid;
mod packets;
mod sampled;
pub mod turns;
mod values;
mod xml;

use crate::caught::catch;
use crate::error::ScanError;
use crate::las::crs::unit_of;
use crate::source::{
    Crs, Format, OpenOptions, ReadReport, SCAN_NUMBERS, Scanner, Sink, Source, SourceInfo,
    share_note,
};
use crate::text::blocks::in_order;
use crate::text::naming::{NO_RETURN, NOT_FINITE, colour_max, wide_colours};
use buffered::{BufferedFile, Reader, file_of};
use damage::{Damage, LostScan, lost_scans, with_points};
use e57::{E57Reader, PointCloud, PointCloudReaderRaw, RecordValue};
use esker_points::attribute::names;
use esker_points::lattice::{GridKind, Placement, float_grid};
use esker_points::{Batch, Cancelled, ColourDepth, InputGrid, Rounding, Spread, Task};
use fields::{Fields, FieldsError, Position};
use rayon::prelude::*;
use sampled::Share;
use std::path::Path;

/// E57, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "E57",
    endings: &["e57"],
    is_streamed: false,
    can_sample: true,
    recognises: |head| head.starts_with(b"ASTM-E57"),
    open,
};

/// Greatest number of values in a block, unless one point has more.
const BLOCK_VALUES: usize = 1 << 17;
/// Greatest size of the file's XML that is kept, in bytes.
const XML_BYTES_MAX: usize = 1 << 20;

struct E57Source {
    info: SourceInfo,
    clouds: Vec<PointCloud>,
    fields: Fields,
    /// Scans of which nothing can be read.
    lost: Vec<LostScan>,
    one_in: u32,
}

/// Values of some points of a scan, one point after another.
struct ValueBlock {
    scan: usize,
    values: Vec<RecordValue>,
}

/// What one pass over points finds.
#[derive(Default)]
struct Survey {
    spread: Spread,
    colour_max: u16,
    /// Greatest colour of those whose range is assumed.
    assumed_colour: f64,
    /// Points of damaged scans that cannot be read, and the first fault of each.
    damage: Damage,
}

/// The points decoded from a block, and the number of refused ones.
struct Decoded {
    batch: Batch,
    no_return: u64,
    not_finite: u64,
    beyond: u64,
    rounding: Rounding,
}

/// The reason for which integers are refused that exceed the 32 bits of the grid.
const BEYOND: &str = "coordinate is beyond what the header says";

fn reader_of(path: &Path) -> Result<Reader, ScanError> {
    let file = file_of(path)?;
    guarded(path, "", || E57Reader::new(file))
}

/// Runs a call of the crate `e57`. Its errors, and its panics, become errors of this file.
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
    let file = file_of(path)?;
    let text = guarded(path, "", || E57Reader::raw_xml(file))?;
    xml::check(&text).map_err(|what| ScanError::damaged(path, what))?;
    drop(text);
    task.check()?;
    let reader = reader_of(path)?;
    let mut clouds = reader.pointclouds();
    if clouds.len() > usize::from(u16::MAX) {
        let what = "has more than 65,535 scans, more than Esker can distinguish; split the file";
        return Err(ScanError::unsupported(path, what));
    }
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    let one_in = options.one_in.max(1);
    let lost = lost_scans(path, &mut clouds, &reader, one_in > 1, task)?;
    let mut points_hint = clouds.iter().fold(0, |n: u64, cloud| n.saturating_add(cloud.records));
    if one_in > 1 {
        points_hint = sampled_count(path, &clouds, &reader, one_in, task)?;
    }
    let mut fields = Fields::new(&clouds, task).map_err(|why| match why {
        FieldsError::Damaged(what) => ScanError::damaged(path, what),
        FieldsError::Cancelled(cancelled) => cancelled.into(),
    })?;
    let claimed = fields.grid.and_then(|_| claimed_bounds(&clouds, &fields));
    let survey = match claimed {
        Some(spread) if fields.assumes_colours() => {
            Survey { spread, ..survey_file(path, &clouds, &fields, one_in, task)? }
        }
        Some(spread) => Survey { spread, ..Survey::default() },
        None => survey_file(path, &clouds, &fields, one_in, task)?,
    };
    fields.assume_colours(survey.assumed_colour);
    let (kind, grid, bounds) = match fields.grid {
        Some(grid) => (GridKind::Integer, grid, survey.spread.bounds()),
        None => {
            let (grid, bounds) = float_grid(&survey.spread, fields.are_single(&clouds));
            (GridKind::Float, grid, bounds)
        }
    };
    let colour_depth = wide_colours(&fields.schema).map(|_| {
        let eight = (1..=u16::from(u8::MAX)).contains(&survey.colour_max) && !fields.are_scaled;
        let detected = if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        options.colour_depth.unwrap_or(detected)
    });
    if let (None, Some(error)) = (bounds, survey.damage.error(path)) {
        return Err(error);
    }
    let mut notes = fields.notes.clone();
    notes.extend(lost.iter().map(LostScan::note));
    notes.extend((one_in > 1).then(|| share_note(one_in)));
    match reader.images().len() {
        0 => {}
        1 => notes.push("an image is left out".into()),
        n => notes.push(format!("{n} images are left out")),
    }
    if fields.schema.find(names::POINT_SOURCE_ID).is_some() && clouds.len() > 1 {
        notes.push(SCAN_NUMBERS.into());
    }
    if bounds.is_none() {
        notes.push("has no points".into());
    }
    let crs = reader.coordinate_metadata().map(str::trim).filter(|text| !text.is_empty());
    let xml = reader.xml().as_bytes();
    let verbatim = (xml.len() <= XML_BYTES_MAX).then(|| (turns::XML_BLOCK.into(), xml.to_vec()));
    let scans = match clouds.len() {
        1 => "one scan".to_owned(),
        n => format!("{n} scans"),
    };
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("E57 1.0, {scans}"),
        grid: InputGrid { name: path.display().to_string(), kind, grid, bounds },
        schema: fields.schema.clone(),
        points_hint,
        bytes,
        colour_depth,
        // ASTM E2807 has coordinates in metres, unless a system says otherwise.
        crs: Some(match crs {
            Some(text) => Crs { text: text.to_owned(), unit: unit_of(text) },
            None => Crs { text: String::new(), unit: Some("metre".into()) },
        }),
        scanner: scanner(&clouds, &fields),
        verbatim: verbatim.into_iter().collect(),
        notes,
    };
    Ok(Box::new(E57Source { info, clouds, fields, lost, one_in }))
}

/// Number of points of one in `one_in`.
///
/// # Errors
/// If a scan is damaged, or its packets have hardly a point whole.
fn sampled_count(
    path: &Path,
    clouds: &[PointCloud],
    reader: &Reader,
    one_in: u32,
    task: &dyn Task,
) -> Result<u64, ScanError> {
    let page_bytes = reader.header().page_size;
    let mut count = 0u64;
    for (_, cloud) in with_points(clouds) {
        task.check()?;
        let share = Share::new(path, page_bytes, cloud, one_in, points_max(cloud))?;
        let points = share.count(path)?;
        if points < cloud.records / (2 * u64::from(one_in)) {
            let what = "its points cannot be read in part: their values lie in different packets";
            return Err(ScanError::unsupported(path, what));
        }
        count = count.saturating_add(points);
    }
    Ok(count)
}

/// Positions of the scanner. A scan's pose counts as one if the file gives it or if points have
/// directions.
fn scanner(clouds: &[PointCloud], fields: &Fields) -> Option<Scanner> {
    let is_known = |cloud: &PointCloud| {
        cloud.transform.is_some() || cloud.has_spherical() || cloud.has_row_column()
    };
    let scans = clouds.iter().zip(&fields.scans).zip(1..);
    let known: Vec<(u16, [f64; 3])> = scans
        .filter(|((cloud, _), _)| is_known(cloud))
        .map(|((_, scan_fields), number)| (number, scan_fields.pose.at))
        .collect();
    match (known.as_slice(), clouds.len()) {
        ([], _) => None,
        ([(_, at)], 1) => Some(Scanner::At(*at)),
        _ => Some(Scanner::BySource(known.into_iter().collect())),
    }
}

/// The bounds in the headers of scans without rotation; `None` if a scan lacks them.
fn claimed_bounds(clouds: &[PointCloud], fields: &Fields) -> Option<Spread> {
    let mut bounds = Spread::default();
    for (cloud, scan_fields) in
        clouds.iter().zip(&fields.scans).filter(|(cloud, _)| cloud.records > 0)
    {
        let (claimed, at) = (cloud.cartesian_bounds.as_ref()?, scan_fields.pose.at);
        let low = [claimed.x_min?, claimed.y_min?, claimed.z_min?];
        let high = [claimed.x_max?, claimed.y_max?, claimed.z_max?];
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

/// Reads the values of a scan's points, block by block.
struct Blocks<'a> {
    path: &'a Path,
    /// Number of the scan in the file, for messages.
    what: String,
    scan: usize,
    points: Points<'a>,
    points_max: usize,
    /// Number of values of a point.
    width: usize,
    /// Number of points that were read.
    there: u64,
    /// Why no more can be read.
    fault: Option<ScanError>,
}

/// Greatest number of points in a block.
fn points_max(cloud: &PointCloud) -> usize {
    (BLOCK_VALUES / cloud.prototype.len().max(1)).max(1)
}

/// The points of a scan, or a share of them.
enum Points<'a> {
    All(Box<PointCloudReaderRaw<'a, BufferedFile>>),
    Some(Share),
}

impl<'a> Blocks<'a> {
    fn new(
        path: &'a Path,
        reader: &'a mut Reader,
        (scan, cloud): (usize, &PointCloud),
        one_in: u32,
    ) -> Result<Self, ScanError> {
        let what = format!("scan {}: ", scan + 1);
        let width = cloud.prototype.len();
        let points_max = points_max(cloud);
        let page_bytes = reader.header().page_size;
        let points = if one_in > 1 {
            Points::Some(Share::new(path, page_bytes, cloud, one_in, points_max)?)
        } else {
            Points::All(Box::new(guarded(path, &what, || reader.pointcloud_raw(cloud))?))
        };
        Ok(Self { path, what, scan, points, points_max, width, there: 0, fault: None })
    }

    /// The next points; `None` at the end and where the scan is damaged, which sets `fault`.
    fn next(&mut self) -> Option<ValueBlock> {
        if self.fault.is_some() {
            return None;
        }
        let mut values = Vec::new();
        let read = match &mut self.points {
            Points::All(points) => guarded(self.path, &self.what, || {
                for point in points.by_ref().take(self.points_max) {
                    values.extend(point?);
                }
                Ok(())
            }),
            Points::Some(share) => share.next(self.path).map(|next| values = next),
        };
        self.fault = read.err();
        self.there += (values.len() / self.width.max(1)) as u64;
        (!values.is_empty()).then_some(ValueBlock { scan: self.scan, values })
    }
}

fn survey_file(
    path: &Path,
    clouds: &[PointCloud],
    fields: &Fields,
    one_in: u32,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    // Scans are surveyed in parallel; within a scan, the crate `e57` unpacks values on one core.
    let surveys = with_points(clouds).into_par_iter().map_init(
        || reader_of(path).map_err(Some),
        |reader, scan| {
            let reader = reader.as_mut().map_err(|e| e.take().unwrap_or(Cancelled.into()))?;
            let mut found = Survey::default();
            let mut blocks = match Blocks::new(path, reader, scan, one_in) {
                Ok(blocks) => blocks,
                Err(fault) => {
                    found.damage.add(scan, 0, fault, clouds)?;
                    return Ok(found);
                }
            };
            while let Some(block) = blocks.next() {
                task.check()?;
                found.merge(Survey::of_block(&block, clouds, fields));
            }
            if let Some(fault) = blocks.fault.take() {
                found.damage.add(scan, blocks.there, fault, clouds)?;
            }
            Ok(found)
        },
    );
    surveys.try_reduce(Survey::default, |mut found, part| {
        found.merge(part);
        Ok(found)
    })
}

impl Survey {
    fn of_block(block: &ValueBlock, clouds: &[PointCloud], fields: &Fields) -> Self {
        let mut found = Self::default();
        let (cloud, scan_fields) = (&clouds[block.scan], &fields.scans[block.scan]);
        let colours = wide_colours(&fields.schema);
        let mut columns = vec![Vec::new(); fields.schema.attributes.len()];
        for values in block.values.chunks_exact(cloud.prototype.len()) {
            let Position::At(world) = scan_fields.position(cloud, values) else { continue };
            found.spread.add(world);
            let assumed = scan_fields.assumed_colour(cloud, values);
            found.assumed_colour = found.assumed_colour.max(assumed);
            if let Some(colours) = colours {
                columns.iter_mut().for_each(Vec::clear);
                scan_fields.put((block.scan, cloud), values, &fields.schema, &mut columns);
                for column in colours {
                    let value = columns[column].first_chunk().copied().unwrap_or_default();
                    found.colour_max = found.colour_max.max(u16::from_le_bytes(value));
                }
            }
        }
        found
    }

    fn merge(&mut self, later: Self) {
        self.spread.merge(later.spread);
        self.colour_max = self.colour_max.max(later.colour_max);
        self.assumed_colour = self.assumed_colour.max(later.assumed_colour);
        self.damage.merge(later.damage);
    }
}

impl E57Source {
    fn decode(&self, block: &ValueBlock, placement: &Placement) -> Result<Decoded, ScanError> {
        let (cloud, scan_fields) = (&self.clouds[block.scan], &self.fields.scans[block.scan]);
        let schema = &self.info.schema;
        let points = block.values.len() / cloud.prototype.len();
        let batch = Batch::with_capacity(schema.clone(), points);
        let mut decoded = Decoded {
            batch,
            no_return: 0,
            not_finite: 0,
            beyond: 0,
            rounding: Rounding::default(),
        };
        for values in block.values.chunks_exact(cloud.prototype.len()) {
            let rounding = &mut decoded.rounding;
            let placed = if let Some(grid) = &self.fields.grid {
                if !scan_fields.is_return(cloud, values) {
                    decoded.no_return += 1;
                    continue;
                }
                let Some(raw) = scan_fields.raw(values) else {
                    decoded.beyond += 1;
                    continue;
                };
                placement.integer(raw, grid, rounding)
            } else {
                match scan_fields.position(cloud, values) {
                    Position::At(world) => placement.real(world, rounding),
                    Position::NoReturn => {
                        decoded.no_return += 1;
                        continue;
                    }
                    Position::NotFinite => {
                        decoded.not_finite += 1;
                        continue;
                    }
                }
            };
            decoded.batch.positions.push(placed);
            scan_fields.put((block.scan, cloud), values, schema, &mut decoded.batch.columns);
        }
        Ok(decoded)
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
        let mut damage = Damage::default();
        for scan in with_points(&self.clouds) {
            let mut blocks = match Blocks::new(path, &mut reader, scan, self.one_in) {
                Ok(blocks) => blocks,
                Err(fault) => {
                    damage.add(scan, 0, fault, &self.clouds)?;
                    continue;
                }
            };
            in_order(
                task,
                || Ok(blocks.next()),
                |block| self.decode(&block, placement),
                |decoded: Decoded| {
                    let refused = [
                        (NO_RETURN, decoded.no_return),
                        (NOT_FINITE, decoded.not_finite),
                        (BEYOND, decoded.beyond),
                    ];
                    // Scaled colours use all 16 bits, however dark they are.
                    let are_scaled = self.fields.are_scaled && !decoded.batch.is_empty();
                    let most = if are_scaled { u16::MAX } else { colour_max(&decoded.batch) };
                    report.take(decoded.batch, &refused, decoded.rounding, most, sink)
                },
            )?;
            if let Some(fault) = blocks.fault.take() {
                damage.add(scan, blocks.there, fault, &self.clouds)?;
            }
        }
        if let (0, Some(error)) = (report.points, damage.error(path)) {
            return Err(error);
        }
        damage.report(&self.lost, self.info.bytes, &mut report);
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let path = &self.info.path;
        Ok(survey_file(path, &self.clouds, &self.fields, self.one_in, task)?.spread)
    }
}
