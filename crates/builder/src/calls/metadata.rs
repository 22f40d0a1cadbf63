//! What a new file records of its inputs, and the notes on them for the user.

use crate::input::attribute_types::{note_apart, of_metadata};
use crate::input::crs::{are_same, note_unstated};
use crate::input::gps_times;
use crate::input::intake::Intake;
use crate::input::plan::Plan;
use crate::options::Options;
use esker_format::{Codec, CrsRecord, Metadata, Normals, SetAside, SourceRecord};
use esker_points::{Lattice, PointClass};
use esker_scan::las::{NoData, gps_times};
use esker_scan::synthetic::is_spec;
use esker_scan::{Geographic, ReadReport, SourceInfo};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Metadata of a file of these inputs; bounds and computed planes are added when the tree is built.
pub fn metadata(
    intake: &Intake,
    plan: &Plan,
    (reports, aside): (&[ReadReport], Vec<SetAside>),
    options: &Options,
) -> Metadata {
    let record = |(i, report): (usize, &ReadReport)| {
        let info = intake.sources[i].info();
        SourceRecord {
            path: info.path.display().to_string(),
            format: info.format.clone(),
            grid: intake.grid(i).clone(),
            points: report.points,
            refused: report.refused.clone(),
            rounding_error_max: report.rounding_error_max,
            colour_depth: intake.colour_depth(i),
            colour_depth_forced: options.colour_depth.is_some() && info.colour_depth.is_some(),
            class: plan.class_of[i],
            crs: info
                .crs
                .as_ref()
                .map(|c| CrsRecord { text: c.text.clone(), unit: c.unit.clone() }),
            notes: info.notes.iter().chain(&report.notes).cloned().collect(),
            verbatim: info.verbatim.clone(),
        }
    };
    let (sources, aside) = match &options.inherited.merged {
        None => (reports.iter().enumerate().map(record).collect(), aside),
        Some(merged) => {
            let records = merged.records.iter().map(|r| merged_record(intake, plan, r));
            (records.collect(), merged.aside.clone())
        }
    };
    metadata_of(plan, options, sources, aside)
}

/// Metadata of a file of these sources and points set aside; as [`metadata`] otherwise.
pub fn metadata_of(
    plan: &Plan,
    options: &Options,
    sources: Vec<SourceRecord>,
    set_aside: Vec<SetAside>,
) -> Metadata {
    Metadata {
        lattice: plan.lattice,
        bounds: None,
        schema: plan.schema.clone(),
        classes: plan.classes.clone(),
        node_capacity: options.node_capacity,
        normals: Normals::None,
        has_clip_lines: false,
        has_tangents: false,
        palette: None,
        codec: options.compress,
        sources,
        set_aside,
        forest: options.inherited.forest.clone(),
        generator: concat!("esker ", env!("CARGO_PKG_VERSION")).into(),
    }
}

/// What is known of a COPC file that is drawn as it is.
pub struct CopcMetadata<'a> {
    /// Lattice of its cube.
    pub lattice: Lattice,
    /// The class of all points.
    pub classes: &'a [PointClass],
    /// What the reader knows.
    pub info: &'a SourceInfo,
    /// Number of points.
    pub points: u64,
}

impl CopcMetadata<'_> {
    /// Metadata of the tree.
    pub fn metadata(&self) -> Metadata {
        let Self { lattice, classes, info, points } = self;
        let corner = |world: [f64; 3]| {
            // Bounds of a damaged header lie outside of the cube.
            [0, 1, 2].map(|axis| {
                let steps = lattice.steps_axis(axis, world[axis]).round();
                steps.clamp(0.0, f64::from(u32::MAX)) as u32
            })
        };
        let record = SourceRecord {
            path: info.path.display().to_string(),
            format: info.format.clone(),
            grid: info.grid.clone(),
            points: *points,
            refused: BTreeMap::new(),
            rounding_error_max: 0.0,
            colour_depth: info.colour_depth.and(classes.first().map(|class| class.colour_depth)),
            colour_depth_forced: false,
            class: 0,
            crs: info
                .crs
                .as_ref()
                .map(|c| CrsRecord { text: c.text.clone(), unit: c.unit.clone() }),
            notes: info.notes.clone(),
            verbatim: info.verbatim.clone(),
        };
        Metadata {
            lattice: *lattice,
            bounds: info.grid.bounds.map(|bounds| bounds.map(corner)),
            schema: (*info.schema).clone(),
            classes: classes.to_vec(),
            node_capacity: 0,
            normals: Normals::None,
            has_clip_lines: false,
            has_tangents: false,
            palette: None,
            codec: Codec::None,
            sources: vec![record],
            set_aside: Vec::new(),
            forest: Vec::new(),
            generator: String::new(),
        }
    }
}

/// Record of a source whose points were merged, with their class in the new file.
fn merged_record(
    intake: &Intake,
    plan: &Plan,
    (path, record): &(PathBuf, SourceRecord),
) -> SourceRecord {
    let at = intake.sources.iter().position(|source| source.info().path == *path);
    SourceRecord { class: at.map_or(0, |i| plan.class_of[i]), ..record.clone() }
}

/// A note on the lengths of points whose coordinates are degrees.
fn note_degrees(metadata: &Metadata) -> Option<String> {
    let systems = metadata.sources.iter().filter_map(|s| s.crs.as_ref());
    systems.into_iter().find_map(|crs| Geographic::of(&crs.text, crs.unit.as_deref()))?;
    if !metadata.lattice.is_scaled() {
        return Some(
            "x and y are degrees and heights are not, and lengths are not scaled: distances mean \
             nothing and pictures are distorted; transform the scans to a projected system first"
                .into(),
        );
    }
    let [x, y, _] = metadata.lattice.factor;
    Some(format!("lengths are in metres: a unit of x is {x:.1} m, a unit of y {y:.1} m"))
}

/// A note if the unit of length of sources is not known. Generated scans are in metres.
fn unknown_unit(metadata: &Metadata) -> Option<String> {
    let is_unknown = |s: &&SourceRecord| {
        s.crs.as_ref().is_none_or(|crs| crs.unit.is_none()) && !is_spec(Path::new(&s.path))
    };
    let (first, number) = {
        let mut unknown = metadata.sources.iter().filter(is_unknown);
        (unknown.next()?, unknown.count() + 1)
    };
    let (path, all) = (&first.path, metadata.sources.len());
    let which =
        if all == 1 { path.clone() } else { format!("{number} of {all} inputs, first {path}") };
    Some(format!("{which}: the unit of length is not stated; --unit sets it"))
}

/// The notes on all sources, and notes if their reference systems differ or their
/// GPS times do not compare.
pub fn notes(metadata: &Metadata) -> Vec<String> {
    let mut out: Vec<String> = metadata
        .sources
        .iter()
        .flat_map(|s| s.notes.iter().map(move |n| format!("{}: {n}", s.path)))
        .collect();
    out.extend(unknown_unit(metadata));
    out.extend(note_degrees(metadata));
    out.extend(note_apart(of_metadata(metadata)));
    let states = |s: &SourceRecord| s.crs.as_ref().is_some_and(|crs| !crs.text.is_empty());
    out.extend(note_unstated(metadata.sources.iter().map(|s| (s.path.clone(), states(s)))));
    let stated = |s: &SourceRecord| s.crs.clone().filter(|crs| !crs.text.is_empty());
    let mut systems = metadata.sources.iter().filter_map(|s| Some((s, stated(s)?)));
    if let Some((first, crs)) = systems.next()
        && let Some((other, _)) = systems.find(|(_, c)| !are_same(&c.text, &crs.text))
    {
        out.push(format!("{} and {} name different coordinate reference systems; coordinates are taken as they are", first.path, other.path));
    }
    out.extend(gps_times::note_different(
        metadata.sources.iter().map(|s| (s.path.clone(), gps_times(&s.verbatim))),
    ));
    let mut no_data = NoData::default();
    metadata.sources.iter().for_each(|s| no_data.add(&s.verbatim));
    let conflicts = no_data.conflicts();
    if !conflicts.is_empty() {
        out.push(note_no_data(&conflicts));
    }
    out
}

/// A note on attributes for which inputs state different no-data values.
pub fn note_no_data(conflicts: &[String]) -> String {
    let names = conflicts.join(", ");
    format!(
        "inputs state different no-data values, of which an export has the first or none: {names}"
    )
}

/// A note on the points that were set aside.
pub fn note_aside(metadata: &Metadata) -> Option<String> {
    let first = metadata.set_aside.first()?;
    let path = metadata.sources.get(first.source as usize).map_or("", |s| s.path.as_str());
    let [x, y, z] = first.place;
    Some(format!(
        "points far from nearly all others are kept exactly beside the tree and not drawn: {}, the first at {x} {y} {z} of {path}",
        metadata.set_aside.len()
    ))
}
