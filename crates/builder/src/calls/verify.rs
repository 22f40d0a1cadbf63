//! Verifies a file against its inputs: they are decoded again onto the recorded lattice
//! and must be the same multiset of points. For a forest, the inputs are those of its
//! last tree or of all trees.

use crate::error::BuildError;
use crate::input::intake::{Intake, open, open_with};
use crate::input::within_lattice::{OFF_LATTICE, WithinLattice};
use crate::rows::row::{Incoming, RowLayout};
use esker_format::{EskerFile, Forest, SourceRecord};
use esker_points::{Batch, MultisetHash, Schema, Task};
use esker_scan::{OpenOptions, ScanError, Source};
use std::path::{Path, PathBuf};

/// Points of inputs that are equal to those of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Against {
    /// Points decoded and placed.
    pub points: u64,
    /// Hash of the points, equal to the file's.
    pub hash: MultisetHash,
    /// Points of the inputs that were refused when the file was built, and so are not in it.
    pub refused: u64,
    /// Number of trees that the inputs belong to: one (the last), or all.
    pub trees: usize,
}

/// Trees that are compared with inputs as if they were one.
struct Trees<'a> {
    /// Files, the last of the forest first. Never empty.
    files: Vec<&'a EskerFile>,
    schema: &'a Schema,
}

impl<'a> Trees<'a> {
    /// The tree of `file`.
    fn one(file: &'a EskerFile) -> Self {
        Self { files: vec![file], schema: &file.metadata().schema }
    }

    /// The last tree, or all trees, whichever was built from this number of inputs.
    fn with(forest: &'a Forest, inputs: usize) -> Result<Self, BuildError> {
        let all = Self { files: forest.files().collect(), schema: forest.schema() };
        let last = Self::one(all.files[0]);
        let (of_all, of_last) = (all.sources().count(), last.sources().count());
        match inputs {
            // If there is one tree, comparing it reports the difference.
            n if n == of_last || all.files.len() == 1 => Ok(last),
            n if n == of_all => Ok(all),
            n => differs(
                forest.path(),
                format!(
                    "was built from {of_last} inputs, {of_all} with those of the files that it names; {n} are named"
                ),
            ),
        }
    }

    fn path(&self) -> &Path {
        self.files[0].path()
    }

    fn sources(&self) -> impl Iterator<Item = &SourceRecord> {
        self.files.iter().flat_map(|file| &file.metadata().sources)
    }

    fn points(&self) -> u64 {
        self.files.iter().map(|file| file.footer().points).sum()
    }

    fn hash(&self) -> MultisetHash {
        let mut sum = MultisetHash::default();
        self.files.iter().for_each(|file| sum += file.footer().hash);
        sum
    }
}

/// Decodes `inputs`, opened with `reading`, onto the forest's lattice and compares count and
/// multiset hash with those of its last tree, or of all its trees, depending on the number of
/// inputs. The hashes in the footers are trusted here: [`esker_format::verify()`] compares them
/// with the points.
///
/// # Errors
/// [`BuildError::Differs`] if the points are not the same; if an input cannot be read; on request.
pub fn against_forest(
    forest: &Forest,
    inputs: &[PathBuf],
    reading: &OpenOptions,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    let trees = Trees::with(forest, inputs.len())?;
    compare(&trees, open_with(inputs, reading, task)?, task)
}

/// Compares `inputs` with the tree of `file`, but not with those that the file names.
///
/// # Errors
/// [`BuildError::Differs`] if the points are not the same; if an input cannot be read; on request.
pub fn against(
    file: &EskerFile,
    inputs: &[PathBuf],
    task: &dyn Task,
) -> Result<Against, BuildError> {
    against_sources(file, open(inputs, None, task)?, task)
}

/// Compares opened inputs with the tree of `file`.
///
/// # Errors
/// [`BuildError::Differs`] if the points are not the same; if an input cannot be read; on request.
pub fn against_sources(
    file: &EskerFile,
    sources: Vec<Box<dyn Source>>,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    compare(&Trees::one(file), sources, task)
}

fn compare(
    trees: &Trees<'_>,
    sources: Vec<Box<dyn Source>>,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    // If points outside of the lattice were refused in the build, they are refused again.
    let refuses = trees.sources().any(|s| s.refused.contains_key(OFF_LATTICE));
    let sources = if refuses { WithinLattice::all(sources) } else { sources };
    let intake = Intake::new(sources, false);
    let name = trees.path();
    let recorded = trees.sources().count();
    if recorded != intake.sources.len() {
        return differs(
            name,
            format!("was built from {recorded} inputs, {} are named", intake.sources.len()),
        );
    }
    let plan = intake.plan_on(trees.files[0].metadata().lattice)?;
    let keys = |s: &Schema| s.attributes.iter().map(|a| (a.name.clone(), a.ty)).collect::<Vec<_>>();
    if keys(&plan.schema) != keys(trees.schema) {
        return differs(name, "its attributes are not those of the inputs".into());
    }
    let rows = RowLayout::new(&plan.schema, &plan.classes);
    let (mut points, mut refused) = (0, 0);
    let mut hash = MultisetHash::default();
    task.phase("reading inputs", Some(intake.points_hint()), "points");
    for (i, source) in intake.sources.iter().enumerate() {
        let placement = plan.lattice.placement(&source.info().grid);
        let mut sink = |batch: Batch| -> Result<(), ScanError> {
            let points = Incoming {
                batch: &batch,
                class: plan.class_of[i],
                to_file: plan.to_file(i),
                towards: &[],
            };
            hash += rows.for_each_rows(&points, &mut |_| ());
            task.advance(batch.len() as u64);
            Ok(task.check()?)
        };
        let report = match source.read(&placement, task, &mut sink) {
            Ok(report) => report,
            Err(ScanError::OffLattice { path, world }) => {
                return differs(
                    name,
                    format!("does not hold the point at {world:?} of {}", path.display()),
                );
            }
            Err(e) => return Err(BuildError::from_sink(e)),
        };
        points += report.points;
        refused += report.refused.values().sum::<u64>();
    }
    // The counts in the file are not trusted: their sum may overflow.
    let recorded = trees.sources().flat_map(|s| s.refused.values());
    let recorded_refused = recorded.fold(0u64, |all, &n| all.saturating_add(n));
    if points != trees.points() {
        return differs(name, format!("holds {} points, the inputs hold {points}", trees.points()));
    }
    if refused != recorded_refused {
        return differs(
            name,
            format!("{recorded_refused} points were refused when it was built, {refused} now"),
        );
    }
    if hash != trees.hash() {
        return differs(
            name,
            format!("its points (hash {}) are not the inputs' (hash {hash})", trees.hash()),
        );
    }
    Ok(Against { points, hash, refused, trees: trees.files.len() })
}

fn differs<T>(file: &Path, what: String) -> Result<T, BuildError> {
    Err(BuildError::Differs(format!("{}: {what}", file.display())))
}
