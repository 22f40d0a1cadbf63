//! Merge: the points of all trees of one or more forests become one tree, as if it had been built
//! from all scans at once on their lattice. Every point is kept exactly, and so are the records of
//! its source.

use crate::attributes::normals::NormalsMode;
use crate::calls::append::systems_of;
use crate::calls::build::{build_sources, check_not_replaced};
use crate::error::BuildError;
use crate::input::crs::check_same_system;
use crate::input::esker_source::EskerSource;
use crate::input::plan::schema_of;
use crate::options::{Inherited, Merged, Options, Report};
use esker_format::{EskerFile, Forest, PlaneKind, SetAside, SourceRecord};
use esker_points::{MultisetHash, Task};
use esker_scan::Source;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Builds `out` from the points of `files` and of all files that they name, in the current rayon
/// pool. The points of a file that is named twice are taken once.
///
/// # Errors
/// If [`crate::build()`] fails; if the files have different lattices, or, unless the options allow
/// it, different coordinate reference systems; if their points are not those of their footers.
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
        let known = systems.filter_map(|(f, path)| Some((path.as_str(), systems_of(f).next()?)));
        check_same_system(known)?;
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
    files.iter().try_for_each(|file| check_not_replaced(file.path(), out))?;

    let mut merged =
        Merged { aside: Vec::new(), records: Vec::new(), points: 0, hash: MultisetHash::default() };
    let mut sources: Vec<Box<dyn Source>> = Vec::new();
    for file in &files {
        merged.points += file.footer().points;
        merged.hash += file.footer().hash;
        let first = merged.records.len() as u32;
        let aside = file.metadata().set_aside.iter();
        let moved = |p: &SetAside| SetAside { source: p.source + first, ..p.clone() };
        merged.aside.extend(aside.map(moved));
        merged.records.extend(records(file)?);
        let own = EskerSource::all_of(file);
        sources.extend(own.into_iter().map(|s| Box::new(s) as Box<dyn Source>));
    }
    let rounding_error_max =
        merged.records.iter().map(|r| r.1.rounding_error_max).fold(0.0, f64::max);
    let inherited =
        Inherited { lattice: Some(lattice), merged: Some(merged), ..Inherited::default() };
    let are_given = schema_of(&sources).normals().is_some();
    let own = files.iter().map(|file| &**file);
    let options = Options { inherited, ..options.beside(own, are_given) };
    let mut report = build_sources(sources, out, &options, task)?;
    report.notes.extend(note_dropped(&files, &options, are_given));
    Ok(Report { rounding_error_max, ..report })
}

/// A note that names the options to set if planes that were computed for the old files are not
/// computed for the new one: computed planes are not merged. `are_given` says whether points have
/// normals of their own.
fn note_dropped(files: &[Arc<EskerFile>], options: &Options, are_given: bool) -> Option<String> {
    let has = |kind| files.iter().any(|file| file.layout().has(kind));
    let is_estimated = files.iter().any(|file| file.metadata().normals.is_estimated());
    let mut missing = Vec::new();
    let estimates = options.normals != NormalsMode::Keep || !are_given;
    for (is_present, is_chosen, option) in [
        (is_estimated, estimates, "--normals estimate"),
        (has(PlaneKind::Tangents), options.tangents, "--tangents"),
        (has(PlaneKind::ClipLines), options.sharp_features, "--sharp-features"),
        (has(PlaneKind::Compact), options.compact, "--compact"),
    ] {
        if is_present && !is_chosen {
            missing.push(option);
        }
    }
    let options = missing.join(" ");
    (!missing.is_empty())
        .then(|| format!("what was made for drawing is not taken over; {options} makes it again"))
}

/// The source records of a file, verbatim blocks included, each with the path of the input that now
/// has its points.
fn records(file: &EskerFile) -> Result<Vec<(PathBuf, SourceRecord)>, BuildError> {
    let records = file.metadata().sources.iter().enumerate();
    let record = |(i, record): (usize, &SourceRecord)| {
        let record = SourceRecord { verbatim: file.verbatim(i)?, ..record.clone() };
        Ok((EskerSource::path(file, usize::from(record.class)), record))
    };
    records.map(record).collect()
}
