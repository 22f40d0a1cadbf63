//! LAS and LAZ: versions 1.0 to 1.5, point formats 0 to 10, extra bytes, COPC (which is LAZ 1.4,
//! and is read by voxels by [`copc`]). Opening reads header, VLRs, chunk table and the colours of
//! the first points; [`decode`] decodes points and [`points`] makes columns of them. Whether points
//! are compressed is recognised by the upper bits of the point format and the LASzip record, never
//! by the file name.

mod about;
pub mod copc;
pub(crate) mod crs;
mod decode;
pub(crate) mod extra_bytes;
pub(crate) mod geodetic;
pub(crate) mod header;
mod heights;
mod items;
mod laszip;
mod no_data;
pub(crate) mod points;
mod sampled;
pub(crate) mod vlr;

pub(crate) use about::EXTRA_BYTES_MAX;
pub use header::GpsTimes;
pub use no_data::NoData;

use crate::error::ScanError;
use crate::source::{
    BESIDE_HELD_BYTES, Format, OpenOptions, ReadReport, Sink, Source, SourceInfo, share_note,
};
use about::{FORMAT_NAME, HEAD_BYTES, extra_attributes, source_info};
use decode::{Points, WINDOW_BYTES_MAX};
use esker_points::lattice::Placement;
use esker_points::read_at::Input;
use esker_points::{ColourDepth, Spread, Task};
use header::Header;
use laszip::Compression;
use points::{Layout, raw_position};
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use vlr::Records;

/// LAS and LAZ.
pub const FORMAT: Format = Format {
    name: "LAS/LAZ",
    endings: &["las", "laz"],
    is_streamed: false,
    can_sample: true,
    recognises: |head| head.starts_with(b"LASF"),
    open,
};

/// Raw records under way on all threads: share of the memory.
const WINDOW_SHARE: u64 = 16;
/// Number of first points whose colours are examined for 8-bit values in 16-bit fields.
const COLOUR_PROBE_POINTS: u64 = 1 << 16;
/// Bytes after the points that are read at once.
const BEHIND_BLOCK_BYTES: u64 = 64 << 10;
/// Records after the points that are examined, and how many of the header's boxes away they must
/// lie not to be points.
const FAR_RECORDS: usize = 1000;
const FAR_BOXES: f64 = 100.0;

/// Block of a source that is no LAS file: the name of the epoch of its GPS times.
pub(crate) const TIMES_BLOCK: &str = "GPS times";

/// Epoch of the GPS times of a source, from its blocks kept verbatim; `None` if it is not known.
pub fn gps_times(verbatim: &[(String, Vec<u8>)]) -> Option<GpsTimes> {
    let block = |name| verbatim.iter().find(|(n, _)| n == name).map(|(_, bytes)| bytes.as_slice());
    match block("las header") {
        // The header was checked when it was read; here its sizes are not trusted.
        Some(head) => Header::parse(head, u64::MAX, Path::new("")).ok()?.gps_times,
        None => GpsTimes::of_name(block(TIMES_BLOCK)?),
    }
}

/// The block with the epoch of the GPS times of a source that is no LAS file, and a note if it is
/// concluded from their values. `stated` is the epoch that the source states.
pub(crate) fn times_block(
    stated: Option<GpsTimes>,
    are_beyond_week: bool,
) -> (Option<(String, Vec<u8>)>, Option<String>) {
    let concluded = are_beyond_week.then_some(GpsTimes::Adjusted);
    let block = |times: GpsTimes| (TIMES_BLOCK.to_owned(), times.name().as_bytes().to_vec());
    let note = "GPS times lie outside of a week of 604,800 seconds: they are taken for adjusted standard time";
    let is_concluded = stated.is_none() && are_beyond_week;
    (stated.or(concluded).map(block), is_concluded.then(|| note.to_owned()))
}

/// Bounds that the header of a file states; `None` if it is no sound one or has no points.
pub(crate) fn header_bounds(path: &Path) -> Option<[[f64; 3]; 2]> {
    let file = Input::open(path).ok()?;
    let bytes = file.end();
    let mut head = Vec::new();
    file.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
    let header = Header::parse(&head, bytes, path).ok()?;
    let is_sound = header.bounds.iter().flatten().all(|c| c.is_finite());
    (is_sound && header.points > 0).then_some(header.bounds)
}

/// An opened LAS or LAZ file.
struct LasSource {
    info: SourceInfo,
    layout: Layout,
    points: Points,
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let io = |e| ScanError::io(path, e);
    let mut file = Input::open(path).map_err(io)?;
    let bytes = file.end();
    let mut head = Vec::new();
    file.by_ref().take(HEAD_BYTES).read_to_end(&mut head).map_err(io)?;
    let mut header = Header::parse(&head, bytes, path)?;
    let mut notes = Vec::new();
    let records = Records::read(&mut file, &header, bytes, path, &mut notes)?;
    let mut points = points_of(&mut header, &records, &mut file, bytes, path, &mut notes, task)?;
    if let Some(memory_bytes) = options.memory_bytes {
        check_held(points.held_bytes(), memory_bytes, path)?;
        points.window_bytes_max = (memory_bytes / WINDOW_SHARE).min(WINDOW_BYTES_MAX);
    }
    if options.one_in > 1 && !points.can_sample() {
        let what = "its points cannot be read in part: they are compressed as a whole";
        return Err(ScanError::unsupported(path, what));
    }
    let extra = extra_attributes(&header, &records, path, &mut notes)?;
    let layout = Layout::new(header.point_format, header.record_bytes, extra);
    let colour_depth = layout
        .rgb_offset
        .map(|_| options.colour_depth.map_or_else(|| detect_depth(&layout, &points, task), Ok))
        .transpose()?;
    // The first points alone told their depth.
    points.one_in = options.one_in.max(1);
    if points.one_in > 1 {
        notes.push(share_note(points.one_in));
    }
    let name = if points.compression.is_some() { FORMAT_NAME } else { "LAS" };
    let format = format!("{name} 1.{}, point format {}", header.minor, header.point_format);
    let info = source_info(path, format, &header, &layout, bytes, (records, notes));
    let points_hint = points.sampled_count(points.one_in);
    let info = SourceInfo { points_hint, colour_depth, ..info };
    Ok(Box::new(LasSource { info, layout, points }))
}

/// Locates the points after checking the header's claims against the file.
fn points_of(
    header: &mut Header,
    records: &Records,
    file: &mut Input,
    file_bytes: u64,
    path: &Path,
    notes: &mut Vec<String>,
    task: &dyn Task,
) -> Result<Points, ScanError> {
    let vlr = laszip::record(records);
    let (start, compression) = match (header.is_compressed, vlr) {
        (true, None) => {
            let what = "its point format says that points are compressed, but the LASzip record is missing";
            return Err(ScanError::damaged(path, what));
        }
        (true, Some(vlr)) => {
            let compression = Compression::read(vlr, header, file, file_bytes, path, notes)?;
            (compression.start, Some(compression))
        }
        (false, vlr) => {
            if vlr.is_some() {
                notes.push("it has a LASzip record, but its point format says that points are not compressed".into());
            }
            check_count(header, file, file_bytes, path, notes, task)?;
            (header.points_start, None)
        }
    };
    Ok(Points {
        path: path.to_owned(),
        start,
        count: header.points,
        record_bytes: header.record_bytes,
        compression,
        window_bytes_max: WINDOW_BYTES_MAX,
        one_in: 1,
    })
}

/// Checks that the memory has room for the compressed bytes of the largest chunk.
fn check_held(held_bytes: u64, memory_bytes: u64, path: &Path) -> Result<(), ScanError> {
    let needed_bytes = held_bytes + BESIDE_HELD_BYTES;
    if held_bytes == 0 || needed_bytes <= memory_bytes {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    Err(ScanError::unsupported(
        path,
        format!(
            "its largest chunk has {} MiB of compressed points, all of which its decoder needs at once: give {} MiB of --memory, or compress it anew with chunks of 50000 points",
            mib(held_bytes),
            mib(needed_bytes)
        ),
    ))
}

/// Checks the claimed count of uncompressed points against the bytes in the file. If the bytes are
/// whole records, their number is the true count, whatever the header claims, unless all records
/// that the header leaves out are zero: padding. If a record is cut off and points are missing, the
/// file is truncated.
fn check_count(
    header: &mut Header,
    file: &mut Input,
    file_bytes: u64,
    path: &Path,
    notes: &mut Vec<String>,
    task: &dyn Task,
) -> Result<(), ScanError> {
    let behind = [header.evlrs.map(|(start, _)| start), header.waveforms_start];
    let is_behind = |&start: &u64| start >= header.points_start && start <= file_bytes;
    let end = behind.into_iter().flatten().filter(is_behind).min().unwrap_or(file_bytes);
    let record_bytes = header.record_bytes as u64;
    let room = file_bytes - header.points_start;
    let (whole, available) = (room / record_bytes, (end - header.points_start) / record_bytes);
    let is_whole = (end - header.points_start).is_multiple_of(record_bytes) && available > 0;
    let leaves_out = is_whole && (1..available).contains(&header.points);
    let claimed_end = || header.points_start + header.points * record_bytes;
    let is_padded = leaves_out && is_zero(file, claimed_end()..end, path, task)?;
    let is_foreign = leaves_out && !is_padded && is_far(header, file, claimed_end()..end, path)?;
    if is_whole && !is_padded && !is_foreign && (header.points > whole || header.points < available)
    {
        notes.push(format!(
            "the header claims {} points, but {available} whole records are there; these are read",
            header.points
        ));
        header.points = available;
    } else if header.points > whole {
        let what = format!(
            "the header claims {} points, but there are bytes for {whole} only: it is cut short or damaged",
            header.points
        );
        return Err(ScanError::damaged(path, what));
    }
    if header.points > available {
        notes.push(format!(
            "records behind the points are said to begin after {available} of {} points; all points are read",
            header.points
        ));
    } else if header.points < available {
        notes.push(format!(
            "{} bytes{} behind the {} points that the header claims are left out",
            end - header.points_start - header.points * record_bytes,
            if is_padded { " of zeros" } else { "" },
            header.points
        ));
    }
    Ok(())
}

/// Whether the bytes after the claimed points are not points: all of the first whole records among
/// them lie many boxes away from the header's box, and none of the first claimed records does.
/// (Points that were appended later may lie outside an outdated box, but not as far away as text
/// does.)
fn is_far(
    header: &Header,
    file: &mut Input,
    behind: Range<u64>,
    path: &Path,
) -> Result<bool, ScanError> {
    let Header { grid, bounds: [low, high], record_bytes, .. } = header;
    let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let is_far = |record: &[u8]| {
        record.as_chunks().0.iter().take(3).enumerate().any(|(axis, &raw)| {
            let at = f64::from(i32::from_le_bytes(raw)) * grid.scale[axis] + grid.offset[axis];
            let slack = extent * FAR_BOXES + grid.scale[axis].abs();
            !(low[axis] - slack..=high[axis] + slack).contains(&at)
        })
    };
    let mut first_of = |span: Range<u64>| -> Result<Vec<u8>, ScanError> {
        let bytes = (span.end - span.start).min((FAR_RECORDS * record_bytes) as u64);
        let mut records = vec![0; bytes as usize];
        file.seek(SeekFrom::Start(span.start)).map_err(|e| ScanError::io(path, e))?;
        file.read_exact(&mut records).map_err(|e| ScanError::io(path, e))?;
        Ok(records)
    };
    let (claimed, others) = (first_of(header.points_start..behind.start)?, first_of(behind)?);
    Ok(!claimed.chunks_exact(*record_bytes).any(is_far)
        && others.chunks_exact(*record_bytes).all(is_far))
}

/// Whether a range of a file is all zero; reads no further than the first block that is not.
fn is_zero(
    file: &mut Input,
    span: Range<u64>,
    path: &Path,
    task: &dyn Task,
) -> Result<bool, ScanError> {
    let io = |e| ScanError::io(path, e);
    file.seek(SeekFrom::Start(span.start)).map_err(io)?;
    let mut block = Vec::new();
    for at in span.clone().step_by(BEHIND_BLOCK_BYTES as usize) {
        task.check()?;
        block.resize((span.end - at).min(BEHIND_BLOCK_BYTES) as usize, 0);
        file.read_exact(&mut block).map_err(io)?;
        if block.iter().any(|&b| b != 0) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Detects whether the 16-bit colours of the first points all fit 8 bits. Damage found here is
/// reported when the points are read.
fn detect_depth(
    layout: &Layout,
    points: &Points,
    task: &dyn Task,
) -> Result<ColourDepth, ScanError> {
    // Large chunks are decoded only once; a wrong depth is corrected after reading.
    if points.held_bytes() > 0 {
        return Ok(ColourDepth::Sixteen);
    }
    let mut max = 0;
    let probed = points.for_each_run(
        0..COLOUR_PROBE_POINTS,
        task,
        &|records| Ok(layout.colour_max(records)),
        &mut |of_run| {
            max = max.max(of_run);
            Ok(())
        },
    );
    match probed {
        Err(ScanError::Cancelled(c)) => Err(c.into()),
        _ if (1..=255).contains(&max) => Ok(ColourDepth::Eight),
        _ => Ok(ColourDepth::Sixteen),
    }
}

impl Source for LasSource {
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
        self.points.begin_near(point)
    }

    fn read_range(
        &self,
        points: Range<u64>,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let mut report = ReadReport::default();
        let grid = &self.info.grid.grid;
        self.points.for_each_run(
            points,
            task,
            &|records| Ok(self.layout.convert(records, placement, grid)),
            &mut |run| report.take(run.batch, &[], run.rounding, run.colour_max, sink),
        )?;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let grid = &self.info.grid.grid;
        let of_run = |records: &[u8]| {
            let mut spread = Spread::default();
            let raw = records.chunks_exact(self.points.record_bytes).map(raw_position);
            raw.for_each(|raw| spread.add(grid.world(raw)));
            Ok(spread)
        };
        let mut spread = Spread::default();
        self.points.for_each_run(0..u64::MAX, task, &of_run, &mut |run| {
            spread.merge(run);
            Ok(())
        })?;
        Ok(spread)
    }

    fn held_bytes(&self) -> u64 {
        self.points.held_bytes()
    }
}
