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
use crate::source::{Crs, Format, OpenOptions, ReadReport, Sink, Source, SourceInfo};
use crate::text::blocks::in_order;
use crate::text::naming::wide_colours;
use esker_points::lattice::Placement;
use esker_points::{ColourDepth, InputGrid, Spread, Task};
use header::{Encoding, Header, HeaderError, Shape};
use plan::{Decoded, RecordPlan, Survey};
use records::{Vertices, too_few};
use std::io::{BufRead, Read};
use std::path::Path;

/// PLY, an entry of the registry.
pub const FORMAT: Format = Format {
    name: "PLY",
    endings: &["ply"],
    is_streamed: true,
    can_sample: false,
    recognises,
    open,
};

struct PlySource {
    info: SourceInfo,
    header: Header,
    plan: RecordPlan,
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
    let survey = survey_stream(path, stream, &header, &plan, task)?;
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
        points_hint: element.count,
        bytes,
        colour_depth,
        crs: comments::crs_of(&header.text).map(|text| Crs { unit: wkt_unit(&text), text }),
        scanner: None,
        verbatim: plan.verbatim("PLY header", &header.text),
        notes: notes(&header, &plan, &survey),
    };
    Ok(Box::new(PlySource { info, header, plan }))
}

/// Refuses a count that the file has no room for, if its size alone shows that.
fn check_room(
    path: &Path,
    header: &Header,
    plan: &RecordPlan,
    bytes: u64,
) -> Result<(), ScanError> {
    let element = &header.elements[plan.vertex];
    let (Some(stride), true) = (element.stride(), header.encoding != Encoding::Ascii) else {
        return Ok(());
    };
    let mut before = header.text.len() as u64;
    for e in &header.elements[..plan.vertex] {
        let Some(stride) = e.stride() else { return Ok(()) };
        before = before.saturating_add(stride.saturating_mul(e.count));
    }
    let available = bytes.saturating_sub(before) / stride;
    if available < element.count {
        return Err(too_few(path, element.count, available));
    }
    Ok(())
}

/// Notes on what is left out.
fn notes(header: &Header, plan: &RecordPlan, survey: &Survey) -> Vec<String> {
    let mut notes = plan.notes.clone();
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

fn survey_stream(
    path: &Path,
    body: Box<dyn BufRead + Send>,
    header: &Header,
    plan: &RecordPlan,
    task: &dyn Task,
) -> Result<Survey, ScanError> {
    let element = &header.elements[plan.vertex];
    let mut vertices = Vertices::new(path, body, header, plan.vertex, task)?;
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
        let mut vertices = Vertices::new(path, self.body()?, &self.header, self.plan.vertex, task)?;
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

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        let body = self.body()?;
        Ok(survey_stream(&self.info.path, body, &self.header, &self.plan, task)?.spread)
    }
}
