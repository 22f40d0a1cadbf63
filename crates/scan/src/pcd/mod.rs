//! Reads PCD (Point Cloud Library, 0.5 to 0.7): points as lines, as records, or compressed, with
//! all their fields. Colours packed into a number become red, green, blue (and alpha). Compressed
//! points are stored field after field, so all of them are held in memory. A pass at opening finds
//! the bounds.

mod header;
mod lzf;
pub(crate) mod packed;
mod points;

use crate::error::ScanError;
use crate::packed::open_stream;
use crate::ply::plan::{Decoded, RecordPlan, Survey};
use crate::pose::Pose;
use crate::runs::{Region, Runs, are_too_many};
use crate::source::{
    BESIDE_HELD_BYTES, Format, OpenOptions, ReadReport, Scanner, Sink, Source, SourceInfo,
    share_note,
};
use crate::text::blocks::in_order;
use crate::text::naming::wide_colours;
use esker_points::lattice::Placement;
use esker_points::{ColourDepth, InputGrid, Spread, Task};
use header::{Data, Header};
use points::{Layout, Points, Raw, sizes, too_few};
use std::fs::File;
use std::io::{BufRead, Read};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// PCD, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "PCD",
    endings: &["pcd"],
    is_streamed: true,
    can_sample: true,
    recognises,
    open,
};

/// Locked while all points of a file are held during opening.
static HOLDING: Mutex<()> = Mutex::new(());

struct PcdSource {
    info: SourceInfo,
    layout: Layout,
    plan: RecordPlan,
    held_bytes: u64,
    one_in: u32,
}

fn recognises(head: &[u8]) -> bool {
    let mut lines = head.split(|&b| b == b'\n').map(|line| line.trim_ascii());
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"));
    head.starts_with(b"# .PCD")
        || [&b"VERSION "[..], b"FIELDS ", b"COLUMNS "]
            .iter()
            .any(|word| first.is_some_and(|line| line.starts_with(word)))
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let (mut stream, packing) = open_stream(path)?;
    let header = Header::read(&mut stream).map_err(|e| ScanError::io(path, e))?;
    let header = header.map_err(|what| ScanError::damaged(path, what))?;
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    if let (Some(packing), Data::Compressed) = (packing, header.data) {
        let packing = packing.name();
        let what =
            format!("has compressed points and is compressed with {packing}; unpack it first");
        return Err(ScanError::unsupported(path, what));
    }
    // What a compressed file has room for shows only in the end.
    let room = packing.map_or(bytes, |_| u64::MAX);
    let held_bytes = check_room(path, &header, room)?;
    if let Some(memory_bytes) = options.memory_bytes {
        check_held(held_bytes, memory_bytes, path)?;
    }
    let one_in = options.one_in.max(1);
    if one_in > 1 && header.data == Data::Compressed {
        let what = "its points cannot be read in part: they are compressed as a whole";
        return Err(ScanError::unsupported(path, what));
    }
    let mut layout = Layout::new(header);
    let mut plan = RecordPlan::of_element(&layout.element, layout.encoding())
        .ok_or_else(|| ScanError::damaged(path, "its fields lack x, y or z: no points"))?;
    let header = &layout.header;
    let viewpoint = header.viewpoint.unwrap_or(Pose::NONE);
    if options.apply_viewpoint && viewpoint != Pose::NONE {
        plan.apply(viewpoint, header.viewpoint_decimals);
    }
    let survey = survey_points(path, stream, &layout, &plan, one_in, task)?;
    if one_in > 1 && are_too_many(survey.vertices, layout.header.points, one_in) {
        let what = "its points cannot be read in part: many lines follow them";
        return Err(ScanError::unsupported(path, what));
    }
    layout.are_colours_numbers = survey.packed.are_numbers();
    let (kind, grid, bounds) = plan.choose_grid(&layout.element, &survey);
    let colour_depth = wide_colours(&plan.schema).map(|_| {
        let eight = plan.colour_max <= u16::from(u8::MAX);
        let detected = if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        options.colour_depth.unwrap_or(detected)
    });
    let header = &layout.header;
    let mut notes = viewpoint_note(header, options.apply_viewpoint);
    notes.extend((one_in > 1).then(|| share_note(one_in)));
    notes.extend(plan.notes.iter().cloned());
    notes.extend(survey.packed.notes(header.data == Data::Ascii));
    notes.extend(survey.rest.map(|rest| rest.note(header.points, "points")));
    if header.points == 0 {
        notes.push("has no points".into());
    }
    let data = match header.data {
        Data::Ascii => "ASCII",
        Data::Binary => "binary",
        Data::Compressed => "compressed",
    };
    let packing = packing.map_or(String::new(), |packing| format!(", {}", packing.name()));
    // The viewpoint is the origin by default. That is the scanner only if points are rows of an
    // image.
    let is_scanner = header.rows > 1 || viewpoint != Pose::NONE;
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("PCD {}, {data}{packing}", header.version),
        grid: InputGrid { name: path.display().to_string(), kind, grid, bounds },
        schema: plan.schema.clone(),
        points_hint: if one_in > 1 { survey.vertices } else { header.points },
        bytes,
        colour_depth,
        crs: None,
        scanner: is_scanner.then_some(Scanner::At(viewpoint.at)),
        verbatim: plan.verbatim("PCD header", &header.text),
        notes,
    };
    Ok(Box::new(PcdSource { info, layout, plan, held_bytes, one_in }))
}

/// What became of the pose of the sensor, unless it is the default.
fn viewpoint_note(header: &Header, is_applied: bool) -> Vec<String> {
    let Some(pose) = header.viewpoint else {
        return vec!["its VIEWPOINT is no pose and is not used".into()];
    };
    let mut notes: Vec<String> = header.viewpoint_length.map(length_note).into_iter().collect();
    if pose == Pose::NONE {
        return notes;
    }
    let [x, y, z] = pose.at;
    let turn = if pose.is_turned { ", turned" } else { "" };
    let what = if is_applied {
        "points and normals are transformed by it"
    } else {
        "points are kept as they are; --apply-viewpoint transforms them by it"
    };
    notes.insert(0, format!("its VIEWPOINT is {x} {y} {z}{turn}: {what}"));
    notes
}

fn length_note(length: f64) -> String {
    format!("its VIEWPOINT has a quaternion of length {length:.4}: it is scaled to 1")
}

/// Refuses a count that the file has no room for; otherwise returns the bytes that are held at once
/// while points are read.
fn check_room(path: &Path, header: &Header, bytes: u64) -> Result<u64, ScanError> {
    let room = bytes.saturating_sub(header.text.len() as u64);
    match header.data {
        Data::Ascii => Ok(0),
        Data::Binary => {
            let available = room / header.stride as u64;
            if available < header.points {
                return Err(too_few(path, header.points, available));
            }
            Ok(0)
        }
        Data::Compressed if header.points == 0 => Ok(0),
        Data::Compressed => {
            let [packed, unpacked] = sizes(path, &mut body_of(path, header)?, header)?;
            if packed > room.saturating_sub(8) {
                let what = format!(
                    "{packed} bytes of compressed points should follow the header, {} do; the file is cut",
                    room.saturating_sub(8)
                );
                return Err(ScanError::damaged(path, what));
            }
            Ok(packed + unpacked)
        }
    }
}

/// Checks that the memory has room for the held bytes.
fn check_held(held_bytes: u64, memory_bytes: u64, path: &Path) -> Result<(), ScanError> {
    let needed_bytes = held_bytes + BESIDE_HELD_BYTES;
    if held_bytes == 0 || needed_bytes <= memory_bytes {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let what = format!(
        "its compressed points are needed at once, {} MiB with the packed ones: give {} MiB of --memory, or write it with `DATA binary`",
        mib(held_bytes),
        mib(needed_bytes),
    );
    Err(ScanError::unsupported(path, what))
}

/// The stream after the header.
fn body_of(path: &Path, header: &Header) -> Result<Box<dyn BufRead + Send>, ScanError> {
    let (mut stream, _) = open_stream(path)?;
    let mut text = vec![0; header.text.len()];
    stream.read_exact(&mut text).map_err(|e| ScanError::io(path, e))?;
    if text != header.text {
        return Err(ScanError::damaged(path, "it changed since it was opened"));
    }
    Ok(stream)
}

/// One in `one_in` of the points of a file, whose `body` is behind the header.
fn points_of<'a>(
    path: &Path,
    body: Box<dyn BufRead + Send>,
    layout: &'a Layout,
    one_in: u32,
) -> Result<Points<'a>, ScanError> {
    if one_in <= 1 {
        return Points::new(path, body, layout);
    }
    let io = |e| ScanError::io(path, e);
    let file = File::open(path).map_err(io)?;
    let header = &layout.header;
    let start = header.text.len() as u64;
    let region = if header.data == Data::Ascii {
        let end = file.metadata().map_err(io)?.len();
        Region::Lines { start, end, mark: b'\n' }
    } else {
        Region::Records { start, stride: header.stride as u64, count: header.points }
    };
    Ok(Points::of_share(path, Runs::new(file, region, one_in), layout))
}

fn survey_points(
    path: &Path,
    body: Box<dyn BufRead + Send>,
    layout: &Layout,
    plan: &RecordPlan,
    one_in: u32,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    let survey = |raw: Raw| {
        let mut part = Survey::default();
        let records = layout.records(path, plan, &raw, Some(&mut part))?;
        plan.survey_records(&records, &mut part);
        Ok::<_, ScanError>(part)
    };
    let mut found = Survey::default();
    if layout.header.data == Data::Compressed {
        // Inputs are opened in parallel, and one alone may fill the memory. While the lock is held
        // no task is spawned: a thread that waited for one might open another input.
        let _alone = HOLDING.lock().unwrap_or_else(PoisonError::into_inner);
        let mut points = Points::new(path, body, layout)?;
        while let Some(raw) = points.next()? {
            task.check()?;
            found.merge(survey(raw)?);
        }
        found.rest = points.rest(task)?;
        return Ok(found);
    }
    let mut points = points_of(path, body, layout, one_in)?;
    in_order(
        task,
        || points.next(),
        survey,
        |part| {
            found.merge(part);
            Ok(())
        },
    )?;
    found.rest = points.rest(task)?;
    Ok(found)
}

impl Source for PcdSource {
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
        let body = body_of(path, &self.layout.header)?;
        let mut points = points_of(path, body, &self.layout, self.one_in)?;
        in_order(
            task,
            || points.next(),
            |raw| {
                let records = self.layout.records(path, &self.plan, &raw, None)?;
                self.plan.decode_records(path, &records, placement)
            },
            |decoded: Decoded| {
                let refused = [(Decoded::REASON, decoded.not_finite)];
                report.take(decoded.batch, &refused, decoded.rounding, decoded.colour_max, sink)
            },
        )?;
        Ok(report)
    }

    fn is_text(&self) -> bool {
        self.layout.header.data == Data::Ascii
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let body = body_of(&self.info.path, &self.layout.header)?;
        let (path, one_in) = (&self.info.path, self.one_in);
        Ok(survey_points(path, body, &self.layout, &self.plan, one_in, task)?.spread)
    }

    fn held_bytes(&self) -> u64 {
        self.held_bytes
    }
}
