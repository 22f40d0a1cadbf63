//! Append: new scans become a file of their own over the lattice of an old one, and name it. The
//! old file and the files that it names stay unchanged; all together are a forest
//! (`docs/design/format.md`).

use crate::calls::build::{build_sources, check_not_replaced};
use crate::calls::metadata::note_no_data;
use crate::error::BuildError;
use crate::input::attribute_types::{self, take_types};
use crate::input::attribute_units::check_attribute_units;
use crate::input::crs::{self, check_same_system};
use crate::input::gps_times;
use crate::input::guesses::note_guesses;
use crate::input::intake::open_with;
use crate::input::plan::schema_of;
use crate::options::{Inherited, Options, Report};
use esker_format::TREES_MAX;
use esker_format::{Forest, TreeRef};
use esker_points::lattice::GridKind;
use esker_points::{AttrType, Schema, Task};
use esker_scan::Source;
use esker_scan::las::{NoData, gps_times};
use std::path::{Path, PathBuf};

/// Builds `out` from `inputs` over the lattice of the file `old`, and names `old` and all files
/// that it names; in the current rayon pool. Points off the lattice are rounded. Points
/// outside of it are an error, or are refused and counted if the options say so; strays are set
/// aside.
///
/// # Errors
/// If [`crate::build()`] fails; if `old` or a file that it names does not open; if they and the
/// inputs are in different coordinate reference systems, unless the options allow it.
pub fn append(
    old: &Path,
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    let forest = Forest::open(old)?;
    let sources = open_with(inputs, &options.open_options(), task)?;
    note_guesses(&sources, options, task);
    append_sources(&forest, sources, out, options, task)
}

/// Builds `out` from opened inputs and opened files; otherwise like [`append`].
///
/// # Errors
/// If the build fails, or the old files and the inputs do not fit together (see [`append`]).
pub fn append_sources(
    old: &Forest,
    mut sources: Vec<Box<dyn Source>>,
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    for file in old.files() {
        check_not_replaced(file.path(), out)?;
    }
    if old.files().len() >= TREES_MAX {
        let (path, trees) = (old.path().display(), old.files().len());
        return Err(BuildError::Options(format!(
            "{path}: has {trees} trees already, as many as a forest can; make one of them first with esker build --merge"
        )));
    }
    if !options.ignore_crs {
        check_same_system_with(old, &sources)?;
    }
    if !options.drop_outside {
        check_room(old, &sources)?;
    }
    let all: Vec<u16> = (0..old.schema().attributes.len() as u16).collect();
    sources.iter_mut().for_each(|source| take_types(source, old.schema(), &all));
    let known = old.files().map(|file| (file.path(), &file.metadata().schema));
    let new = sources.iter().map(|s| s.info()).map(|i| (i.path.as_path(), &*i.schema));
    check_attribute_units(known.chain(new))?;
    let forest = old.files().map(|file| TreeRef::new(out, file)).collect::<Result<_, _>>()?;
    // With one palette for all trees they are drawn together from their compact planes.
    let palette = old.palette().cloned();
    let inherited = Inherited { lattice: Some(*old.lattice()), palette, forest, merged: None };
    let are_given = schema_of(&sources).normals().is_some();
    let options = Options { inherited, ..options.beside(old.files(), are_given) };
    let mut notes: Vec<String> = note_different_times(old, &sources)?.into_iter().collect();
    notes.extend(note_different_no_data(old, &sources)?);
    notes.extend(note_unstated(old, &sources));
    notes.extend(note_apart(old, &sources));
    let mut report = build_sources(sources, out, &options, task)?;
    report.notes.extend(notes);
    Ok(report)
}

/// Checks that the lattice of the old files has room for what the headers of the inputs claim.
///
/// # Errors
/// If it has not; the message names the coordinates that do not fit.
fn check_room(old: &Forest, sources: &[Box<dyn Source>]) -> Result<(), BuildError> {
    let lattice = old.lattice();
    for info in sources.iter().map(|source| source.info()) {
        // Headers of integer grids may claim more than there is; their points are checked later.
        let bounds = info.grid.bounds.filter(|_| info.grid.kind != GridKind::Integer);
        for axis in 0..3 {
            let ends = bounds.map(|b| b.map(|corner| corner[axis]));
            let holds = |c: f64| {
                let steps = lattice.steps_axis(axis, c).round_ties_even();
                (0.0..f64::from(u32::MAX)).contains(&steps)
            };
            let Some([low, high]) = ends.filter(|ends| !ends.iter().all(|&c| holds(c))) else {
                continue;
            };
            let room = [0.0, f64::from(u32::MAX)].map(|u| lattice.world_axis(axis, u));
            return Err(BuildError::Options(format!(
                "{}: its points reach from {low} to {high} along {}, {} holds coordinates from {} to {}: build both anew into one file, or leave the points outside out with --drop-outside",
                info.path.display(),
                ['x', 'y', 'z'][axis],
                old.path().display(),
                room[0],
                room[1],
            )));
        }
    }
    Ok(())
}

/// A note if the GPS times of the old files and those of the inputs cannot be compared, unless the
/// old files, or the inputs, already disagree among themselves.
fn note_different_times(
    old: &Forest,
    sources: &[Box<dyn Source>],
) -> Result<Option<String>, BuildError> {
    let (mut known, mut new) = (Vec::new(), Vec::new());
    for file in old.files() {
        for (i, record) in file.metadata().sources.iter().enumerate() {
            known.push((record.path.clone(), gps_times(&file.verbatim(i)?)));
        }
    }
    for info in sources.iter().map(|source| source.info()) {
        new.push((info.path.display().to_string(), gps_times(&info.verbatim)));
    }
    let is_noted =
        [&known, &new].iter().any(|of| gps_times::note_different(of.iter().cloned()).is_some());
    if is_noted {
        return Ok(None);
    }
    Ok(gps_times::note_different(known.into_iter().chain(new)))
}

/// A note if the old files or the inputs state a coordinate reference system, and the others do
/// not.
fn note_unstated(old: &Forest, sources: &[Box<dyn Source>]) -> Option<String> {
    let known = (old.path().display().to_string(), systems_of(old).next().is_some());
    let states =
        |source: &dyn Source| source.info().crs.as_ref().is_some_and(|c| !c.text.is_empty());
    let new = sources.iter().map(|s| (s.info().path.display().to_string(), states(s.as_ref())));
    crs::note_unstated(std::iter::once(known).chain(new))
}

/// A note on attributes that the old files and the inputs have with different types.
fn note_apart(old: &Forest, sources: &[Box<dyn Source>]) -> Option<String> {
    let typed = |path: &Path, schema: &Schema| -> Vec<(String, String, AttrType)> {
        let path = path.display().to_string();
        schema.attributes.iter().map(|a| (path.clone(), a.name.clone(), a.ty)).collect()
    };
    let new = sources.iter().flat_map(|s| typed(&s.info().path, &s.info().schema));
    attribute_types::note_apart(typed(old.path(), old.schema()).into_iter().chain(new))
}

/// Compares the first system that the old files state with those of all inputs.
fn check_same_system_with(old: &Forest, sources: &[Box<dyn Source>]) -> Result<(), BuildError> {
    let path = old.path().display().to_string();
    let known = systems_of(old).next();
    let mut systems: Vec<(String, &str)> = known.map(|text| (path, text)).into_iter().collect();
    for info in sources.iter().map(|source| source.info()) {
        systems
            .extend(info.crs.as_ref().map(|c| (info.path.display().to_string(), c.text.as_str())));
    }
    check_same_system(systems.iter().map(|(path, text)| (path.as_str(), *text)))
}

/// The coordinate reference systems that the files of a forest state.
pub(crate) fn systems_of(forest: &Forest) -> impl Iterator<Item = &str> {
    let records = forest.files().flat_map(|file| &file.metadata().sources);
    records
        .filter_map(|record| record.crs.as_ref().map(|crs| crs.text.as_str()))
        .filter(|text| !text.is_empty())
}

/// A note if the inputs state other no-data values than the old files, unless the inputs already
/// disagree among themselves, which the build notes.
fn note_different_no_data(
    old: &Forest,
    sources: &[Box<dyn Source>],
) -> Result<Option<String>, BuildError> {
    let (mut known, mut new) = (NoData::default(), NoData::default());
    for file in old.files() {
        (0..file.metadata().sources.len())
            .try_for_each(|i| file.verbatim(i).map(|blocks| known.add(&blocks)))?;
    }
    let mut all = known.clone();
    for info in sources.iter().map(|source| source.info()) {
        new.add(&info.verbatim);
        all.add(&info.verbatim);
    }
    let conflicts = all.conflicts();
    let is_noted = conflicts == known.conflicts() || conflicts == new.conflicts();
    Ok((!is_noted).then(|| note_no_data(&conflicts)))
}
