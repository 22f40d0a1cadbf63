//! Verify against the inputs: they are decoded again by the rule that the file recorded, and must be the
//! same multiset of points.

use crate::error::BuildError;
use crate::intake::{Intake, open};
use crate::onto::{OFF_LATTICE, Within};
use crate::row::{Incoming, RowLayout};
use esker_format::EskerFile;
use esker_points::{Batch, MultisetHash, Task};
use esker_scan::{ScanError, Source};
use std::path::{Path, PathBuf};

/// What the inputs were found to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Against {
    /// Points decoded and placed.
    pub points: u64,
    /// Their hash, equal to the file's.
    pub hash: MultisetHash,
}

/// Decodes `inputs` onto the file's lattice and compares count and multiset hash. The hash in the file's
/// footer is trusted here: [`esker_format::verify()`] compares it with the points.
///
/// # Errors
/// [`BuildError::Differs`] where the points are not the same; where an input cannot be read; on request.
pub fn against(
    file: &EskerFile,
    inputs: &[PathBuf],
    task: &dyn Task,
) -> Result<Against, BuildError> {
    against_sources(file, open(inputs, None, task)?, task)
}

/// As [`against`], with opened inputs.
///
/// # Errors
/// As [`against`].
pub fn against_sources(
    file: &EskerFile,
    sources: Vec<Box<dyn Source>>,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    let recorded = &file.metadata().sources;
    // Points outside of a lattice that was given were refused, and are so again.
    let refuses = recorded.iter().any(|s| s.refused.contains_key(OFF_LATTICE));
    let intake = Intake::new(if refuses { Within::all(sources) } else { sources }, false);
    let name = file.path();
    if recorded.len() != intake.sources.len() {
        return differs(
            name,
            format!("was built from {} inputs, {} are named", recorded.len(), intake.sources.len()),
        );
    }
    let plan = intake.plan_on(file.metadata().lattice)?;
    let keys = |s: &esker_points::Schema| {
        s.attributes.iter().map(|a| (a.name.clone(), a.ty)).collect::<Vec<_>>()
    };
    if keys(&plan.schema) != keys(&file.metadata().schema) {
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
    let footer = file.footer();
    let recorded_refused: u64 = recorded.iter().flat_map(|s| s.refused.values()).sum();
    if points != footer.points {
        return differs(name, format!("holds {} points, the inputs hold {points}", footer.points));
    }
    if refused != recorded_refused {
        return differs(
            name,
            format!("{recorded_refused} points were refused when it was built, {refused} now"),
        );
    }
    if hash != footer.hash {
        return differs(
            name,
            format!("its points (hash {}) are not the inputs' (hash {hash})", footer.hash),
        );
    }
    Ok(Against { points, hash })
}

fn differs<T>(file: &Path, what: String) -> Result<T, BuildError> {
    Err(BuildError::Differs(format!("{}: {what}", file.display())))
}
