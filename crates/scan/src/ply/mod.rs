//! Reads PLY (Turk 1994), ASCII and binary of either byte order, plain or compressed as a whole:
//! the vertices with all their scalar properties. Faces, other elements and lists are left out,
//! with a note. A pass at opening finds the bounds; no pass keeps more than a few blocks.

pub(crate) mod ascii;
pub(crate) mod comments;
pub(crate) mod header;
pub(crate) mod plan;
pub(crate) mod records;
pub(crate) mod rest;

use crate::error::ScanError;
use crate::las::crs::wkt_unit;
use crate::packed::open_stream;
use crate::runs::{Region, Runs, are_too_many};
use crate::source::{Crs, Format, OpenOptions, ReadReport, Sink, Source, SourceInfo, share_note};
use crate::text::blocks::in_order;
use crate::text::naming::wide_colours;
use esker_points::lattice::Placement;
use esker_points::{ColourDepth, InputGrid, Spread, Task};
use header::{Encoding, Header, HeaderError, Shape};
use plan::{Decoded, RecordPlan, Survey};
use records::{Vertices, too_few};
use std::fs::File;
use std::io::{BufRead, Read};
use std::path::Path;

/// PLY, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "PLY",
    endings: &["ply"],
    is_streamed: true,
    can_sample: true,
    recognises,
    open,
};

struct PlySource {
    info: SourceInfo,
    header: Header,
    plan: RecordPlan,
    one_in: u32,
}

fn recognises(head: &[u8]) -> bool {
    let Some(rest) = head.strip_prefix(b"ply") else { return false };
    let end = rest.iter().find(|b| !matches!(b, b' ' | b'\t'));
    matches!(end, Some(b'\r' | b'\n'))
}

fn open(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError> {
    let (mut stream, packing) = open_stream(path)?;
    let header = Header::read(&mut stream).map_err(|e| match e {
        HeaderError::Io(e) => ScanError::io(path, e),
        HeaderError::Damaged(what) => ScanError::damaged(path, what),
    })?;
    let mut plan = RecordPlan::new(&header).map_err(|what| ScanError::damaged(path, what))?;
    let element = &header.elements[plan.vertex];
    let bytes = std::fs::metadata(path).map_err(|e| ScanError::io(path, e))?.len();
    if packing.is_none() {
        check_room(path, &header, &plan, bytes)?;
    }
    let one_in = options.one_in.max(1);
    let vertices = vertices_of(path, stream, &header, &plan, one_in, task)?;
    let survey = survey_vertices(path, vertices, &header, &plan, task)?;
    if one_in > 1 && are_too_many(survey.vertices, element.count, one_in) {
        return Err(ScanError::unsupported(path, NOT_IN_PART));
    }
    let (kind, grid, bounds) = plan.choose_grid(element, &survey);
    let packing = packing.map_or(String::new(), |packing| format!(", {}", packing.name()));
    let colour_depth = wide_colours(&plan.schema).map(|_| {
        let eight = plan.colour_max <= u16::from(u8::MAX);
        let detected = if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        options.colour_depth.unwrap_or(detected)
    });
    let info = SourceInfo {
        path: path.to_owned(),
        format: format!("PLY 1.0, {}{packing}", header.encoding.name()),
        grid: InputGrid { name: path.display().to_string(), kind, grid, bounds },
        schema: plan.schema.clone(),
        points_hint: if one_in > 1 { survey.vertices } else { element.count },
        bytes,
        colour_depth,
        crs: comments::crs_of(&header.text).map(|text| Crs { unit: wkt_unit(&text), text }),
        scanner: None,
        verbatim: plan.verbatim("PLY header", &header.text),
        notes: notes(&header, &plan, &survey, one_in),
    };
    Ok(Box::new(PlySource { info, header, plan, one_in }))
}

/// Why a file cannot be read in part.
const NOT_IN_PART: &str = "its vertices cannot be read in part: other elements stand beside them, \
    or they have lists";

/// Offset of the vertices of a binary file, and the size of each, in bytes; `None` if elements
/// before them vary in size, or they do.
fn place_of(header: &Header, plan: &RecordPlan) -> Option<[u64; 2]> {
    let mut start = header.text.len() as u64;
    for e in &header.elements[..plan.vertex] {
        start = start.saturating_add(e.stride()?.saturating_mul(e.count));
    }
    Some([start, header.elements[plan.vertex].stride()?])
}

/// Refuses a count that the file has no room for, if its size alone shows that.
fn check_room(
    path: &Path,
    header: &Header,
    plan: &RecordPlan,
    bytes: u64,
) -> Result<(), ScanError> {
    let element = &header.elements[plan.vertex];
    let (Some([start, stride]), true) =
        (place_of(header, plan), header.encoding != Encoding::Ascii)
    else {
        return Ok(());
    };
    let available = bytes.saturating_sub(start) / stride;
    if available < element.count {
        return Err(too_few(path, element.count, available));
    }
    Ok(())
}

/// Notes on what is left out.
fn notes(header: &Header, plan: &RecordPlan, survey: &Survey, one_in: u32) -> Vec<String> {
    let mut notes = plan.notes.clone();
    notes.extend((one_in > 1).then(|| share_note(one_in)));
    let count = header.elements[plan.vertex].count;
    notes.extend(survey.rest.map(|rest| rest.note(count, "vertices")));
    for (i, e) in header.elements.iter().enumerate() {
        match e.name.as_str() {
            _ if i == plan.vertex || e.count == 0 => {}
            "face" => notes.push(format!("{} faces ignored", e.count)),
            name => notes.push(format!("{} elements `{name}` ignored", e.count)),
        }
    }
    for property in &header.elements[plan.vertex].properties {
        if let Shape::List { .. } = property.shape {
            notes.push(format!("the list `{}` of each vertex is left out", property.name));
        }
    }
    notes
}

/// One in `one_in` of the vertices of a file, whose `body` is behind the header.
fn vertices_of<'a>(
    path: &Path,
    body: Box<dyn BufRead + Send>,
    header: &'a Header,
    plan: &RecordPlan,
    one_in: u32,
    task: &dyn Task,
) -> Result<Vertices<'a>, ScanError> {
    if one_in <= 1 {
        return Vertices::new(path, body, header, plan.vertex, task);
    }
    let not_in_part = || ScanError::unsupported(path, NOT_IN_PART);
    let io = |e| ScanError::io(path, e);
    let file = File::open(path).map_err(io)?;
    let region = if header.encoding == Encoding::Ascii {
        let others = header.elements.iter().enumerate().filter(|(i, _)| *i != plan.vertex);
        if others.into_iter().any(|(_, e)| e.count > 0 && !e.properties.is_empty()) {
            return Err(not_in_part());
        }
        let end = file.metadata().map_err(io)?.len();
        Region::Lines { start: header.text.len() as u64, end, mark: b'\n' }
    } else {
        let [start, stride] = place_of(header, plan).ok_or_else(not_in_part)?;
        Region::Records { start, stride, count: header.elements[plan.vertex].count }
    };
    Ok(Vertices::of_share(path, Runs::new(file, region, one_in), header, plan.vertex))
}

fn survey_vertices(
    path: &Path,
    mut vertices: Vertices<'_>,
    header: &Header,
    plan: &RecordPlan,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    let element = &header.elements[plan.vertex];
    let mut found = Survey::default();
    in_order(
        task,
        || vertices.next(header.encoding),
        |raw| plan.survey(path, element, raw),
        |part| {
            found.merge(part);
            Ok(())
        },
    )?;
    let is_last = header.elements[plan.vertex + 1..].iter().all(|e| e.count == 0);
    if is_last {
        found.rest = vertices.rest(task)?;
    }
    Ok(found)
}

impl PlySource {
    /// The stream after the header.
    fn body(&self) -> Result<Box<dyn BufRead + Send>, ScanError> {
        let (mut stream, _) = open_stream(&self.info.path)?;
        let mut header = vec![0; self.header.text.len()];
        stream.read_exact(&mut header).map_err(|e| ScanError::io(&self.info.path, e))?;
        if header != self.header.text {
            return Err(ScanError::damaged(&self.info.path, "it changed since it was opened"));
        }
        Ok(stream)
    }

    fn vertices(&self, task: &dyn Task) -> Result<Vertices<'_>, ScanError> {
        let body = self.body()?;
        vertices_of(&self.info.path, body, &self.header, &self.plan, self.one_in, task)
    }
}

impl Source for PlySource {
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
        let element = &self.header.elements[self.plan.vertex];
        let mut report = ReadReport::default();
        let mut vertices = self.vertices(task)?;
        in_order(
            task,
            || vertices.next(self.header.encoding),
            |raw| self.plan.decode(path, element, raw, placement),
            |decoded: Decoded| {
                let refused = [(Decoded::REASON, decoded.not_finite)];
                report.take(decoded.batch, &refused, decoded.rounding, decoded.colour_max, sink)
            },
        )?;
        Ok(report)
    }

    fn is_text(&self) -> bool {
        self.header.encoding == Encoding::Ascii
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let vertices = self.vertices(task)?;
        Ok(survey_vertices(&self.info.path, vertices, &self.header, &self.plan, task)?.spread)
    }
}
