//! Append: builds new scans into a file of their own, on the lattice of an older file, which it
//! names. The older file and those that it names do not change; together they are a forest.

use crate::calls::build::{Options, Report, build_sources, one_meaning};
use crate::calls::onto::{Onto, Within};
use crate::error::BuildError;
use crate::input::crs::one_system;
use crate::input::gps_times;
use crate::input::intake::open_with;
use esker_format::{EskerFile, Forest, TREES_MAX, TreeRef};
use esker_points::Task;
use esker_scan::Source;
use esker_scan::las::gps_times;
use std::path::{Path, PathBuf};

/// Builds `out` from `inputs` onto the lattice of the file `old`, which it then names with all that
/// `old` names; in the current rayon pool. Points off the lattice are rounded, points outside of it
/// refused; the report counts them.
///
/// # Errors
/// As [`crate::build()`]; where `old` or what it names does not open; where they and the inputs are
/// in different coordinate reference systems, unless the options say otherwise.
pub fn append(
    old: &Path,
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    let forest = Forest::open(old)?;
    append_sources(&forest, open_with(inputs, &options.opening(), task)?, out, options, task)
}

/// As [`append`], from opened inputs, onto opened files.
///
/// # Errors
/// As [`append`].
pub fn append_sources(
    old: &Forest,
    sources: Vec<Box<dyn Source>>,
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    for file in old.files() {
        not_replaced(file, out)?;
    }
    if old.files().len() >= TREES_MAX {
        let (path, trees) = (old.path().display(), old.files().len());
        return Err(BuildError::Options(format!(
            "{path}: has {trees} trees already, as many as a forest can; make one of them first with esker build --merge"
        )));
    }
    if !options.ignore_crs {
        one_system_with(old, &sources)?;
    }
    let known = old.files().map(|file| (file.path(), &file.metadata().schema));
    let new = sources.iter().map(|s| s.info()).map(|i| (i.path.as_path(), &*i.schema));
    one_meaning(known.chain(new))?;
    let forest = old.files().map(|file| TreeRef::new(out, file)).collect::<Result<_, _>>()?;
    // One palette for all trees: so they are drawn from their compact planes together.
    let palette = old.palette().cloned();
    let onto = Onto { lattice: Some(*old.lattice()), palette, forest, merged: None };
    let options = Options { onto, ..options.clone() };
    let times = mixed_times(old, &sources)?;
    let mut report = build_sources(Within::all(sources), out, &options, task)?;
    report.notes.extend(times);
    Ok(report)
}

/// A line where GPS times of the old files and of the inputs don't compare, unless either's alone
/// do not.
fn mixed_times(old: &Forest, sources: &[Box<dyn Source>]) -> Result<Option<String>, BuildError> {
    let (mut known, mut new) = (Vec::new(), Vec::new());
    for file in old.files() {
        for (i, record) in file.metadata().sources.iter().enumerate() {
            known.push((record.path.clone(), gps_times(&file.verbatim(i)?)));
        }
    }
    for info in sources.iter().map(|source| source.info()) {
        new.push((info.path.display().to_string(), gps_times(&info.verbatim)));
    }
    let is_told = [&known, &new].iter().any(|of| gps_times::mixed(of.iter().cloned()).is_some());
    Ok(if is_told { None } else { gps_times::mixed(known.into_iter().chain(new)) })
}

/// A file that is read must not be written.
pub(crate) fn not_replaced(file: &EskerFile, out: &Path) -> Result<(), BuildError> {
    let same =
        |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if same(file.path(), out) {
        let path = file.path().display();
        return Err(BuildError::Options(format!(
            "{path}: is input and output at once; choose another output"
        )));
    }
    Ok(())
}

/// The first system that the old files tell, and all of the inputs'.
fn one_system_with(old: &Forest, sources: &[Box<dyn Source>]) -> Result<(), BuildError> {
    let path = old.path().display().to_string();
    let known = systems_of(old).next();
    let mut told: Vec<(String, &str)> = known.map(|text| (path, text)).into_iter().collect();
    for info in sources.iter().map(|source| source.info()) {
        told.extend(info.crs.as_ref().map(|c| (info.path.display().to_string(), c.text.as_str())));
    }
    one_system(told.iter().map(|(path, text)| (path.as_str(), *text)))
}

/// The coordinate reference systems that files tell.
pub(crate) fn systems_of(forest: &Forest) -> impl Iterator<Item = &str> {
    let records = forest.files().flat_map(|file| &file.metadata().sources);
    records.filter_map(|record| record.crs.as_ref().map(|crs| crs.text.as_str()))
}
