//! Merge: the points of all trees of a forest, or of several, become one tree again: as if it had
//! been built from all scans at once onto the lattice that they lie on. Every point is kept
//! exactly, and what is known of its source as well.

use crate::attributes::normals::NormalsMode;
use crate::calls::append::{not_replaced, systems_of};
use crate::calls::build::{Options, Report, build_sources};
use crate::calls::onto::{Merged, Onto};
use crate::error::BuildError;
use crate::input::crs::one_system;
use crate::input::esker_source::Stored;
use esker_format::{EskerFile, Forest, PlaneKind, SourceRecord};
use esker_points::{MultisetHash, Task};
use esker_scan::Source;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Builds `out` from the points of these files and of all that they name, in the current rayon
/// pool; a file that is named twice is taken once.
///
/// # Errors
/// As [`crate::build()`]; where the files lie on different lattices, or are in different coordinate
/// reference systems, unless the options say otherwise; where their points are not those that their
/// footers tell.
pub fn merge(
    files: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Report, BuildError> {
    let forests = files.iter().map(|path| Forest::open(path)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = forests.first() else {
        return Err(BuildError::Options("no input: name at least one .esker file".into()));
    };
    let lattice = *first.lattice();
    if let Some(other) = forests.iter().find(|f| *f.lattice() != lattice) {
        let (first, other) = (first.path().display(), other.path().display());
        return Err(BuildError::Options(format!(
            "{first} and {other} lie on different lattices; append the scans of one to the other instead"
        )));
    }
    if !options.ignore_crs {
        let paths: Vec<_> = forests.iter().map(|f| f.path().display().to_string()).collect();
        let systems = forests.iter().zip(&paths);
        one_system(systems.filter_map(|(f, path)| Some((path.as_str(), systems_of(f).next()?))))?;
    }
    let named: usize = forests.iter().map(|forest| forest.files().len()).sum();
    let mut seen = HashSet::new();
    let files: Vec<_> = forests
        .into_iter()
        .flat_map(Forest::into_files)
        .filter(|file| seen.insert(file.footer().name_hash()))
        .map(Arc::new)
        .collect();
    if files.len() < named {
        let more = named - files.len();
        task.note(&format!(
            "{more} of {named} trees are there already; their points are taken once"
        ));
    }
    files.iter().try_for_each(|file| not_replaced(file, out))?;

    let mut merged = Merged { records: Vec::new(), points: 0, hash: MultisetHash::default() };
    let mut sources: Vec<Box<dyn Source>> = Vec::new();
    for file in &files {
        merged.points += file.footer().points;
        merged.hash += file.footer().hash;
        merged.records.extend(records(file)?);
        sources.extend(Stored::of(file).into_iter().map(|s| Box::new(s) as Box<dyn Source>));
    }
    let rounding_error_max =
        merged.records.iter().map(|r| r.1.rounding_error_max).fold(0.0, f64::max);
    let onto = Onto { lattice: Some(lattice), merged: Some(merged), ..Onto::default() };
    let options = Options { onto, ..options.clone() };
    let mut report = build_sources(sources, out, &options, task)?;
    report.notes.extend(not_taken_over(&files, &options));
    Ok(Report { rounding_error_max, ..report })
}

/// What files have beside points and what is known of their sources is made anew where it is asked
/// for, and else not: which options ask for it, if any are missing.
fn not_taken_over(files: &[Arc<EskerFile>], options: &Options) -> Option<String> {
    let has = |kind| files.iter().any(|file| file.layout().has(kind));
    let is_estimated = files.iter().any(|file| file.metadata().normals.is_estimated());
    let mut missing = Vec::new();
    let estimates = options.normals != NormalsMode::Keep;
    for (is_had, is_asked, option) in [
        (is_estimated, estimates, "--normals estimate"),
        (has(PlaneKind::Tangents), options.tangents, "--tangents"),
        (has(PlaneKind::ClipLines), options.sharp_features, "--sharp-features"),
        (has(PlaneKind::Compact), options.compact, "--compact"),
    ] {
        if is_had && !is_asked {
            missing.push(option);
        }
    }
    let options = missing.join(" ");
    (!missing.is_empty())
        .then(|| format!("what was made for drawing is not taken over; {options} makes it again"))
}

/// What a file knows of its sources, blocks included, each with the path of what brings its points
/// now.
fn records(file: &EskerFile) -> Result<Vec<(PathBuf, SourceRecord)>, BuildError> {
    let records = file.metadata().sources.iter().enumerate();
    let record = |(i, record): (usize, &SourceRecord)| {
        let record = SourceRecord { verbatim: file.verbatim(i)?, ..record.clone() };
        Ok((Stored::path(file, usize::from(record.class)), record))
    };
    records.map(record).collect()
}
