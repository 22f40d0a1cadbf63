//! Verifies a file against its inputs: they are decoded again onto the recorded lattice
//! and must be the same multiset of points. For a forest, the inputs are those of its
//! last tree or of all trees.

use crate::error::BuildError;
use crate::input::attribute_types::{join_types, take_types};
use crate::input::crs::are_same;
use crate::input::intake::{Intake, open, open_with};
use crate::input::outside::{OFF_LATTICE, Outside};
use crate::input::plan::Plan;
use crate::rows::row::{Incoming, RowLayout};
use esker_format::{EskerFile, Forest, SourceRecord};
use esker_points::{Batch, Conflict, MultisetHash, Schema, Task};
use esker_scan::las::{NoData, gps_times};
use esker_scan::{OpenOptions, ScanError, Source};
use std::path::{Path, PathBuf};

/// Points of inputs that are equal to those of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Against {
    /// Points decoded and placed.
    pub points: u64,
    /// Hash of the points, equal to the file's.
    pub hash: MultisetHash,
    /// Points of the inputs that the file keeps beside its tree.
    pub set_aside: u64,
    /// Greatest distance by which a coordinate was rounded, as the file states it, in its unit.
    pub rounding_error_max: f64,
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

    /// The record of a source: that of its path, or the only one of its file name, or the only one;
    /// with its file and its number there.
    fn record_of(&self, source: &dyn Source) -> Option<(&'a EskerFile, usize)> {
        let numbered = |file: &&'a EskerFile| {
            let file = *file;
            (0..file.metadata().sources.len()).map(move |i| (file, i))
        };
        let all: Vec<_> = self.files.iter().flat_map(numbered).collect();
        let path = |&(file, i): &(&'a EskerFile, usize)| &file.metadata().sources[i].path;
        let own = source.info().path.display().to_string();
        if let [only] = all[..] {
            return Some(only);
        }
        if let Some(same) = all.iter().find(|record| *path(record) == own) {
            return Some(*same);
        }
        let name = |path: &str| Path::new(path).file_name().map(std::ffi::OsStr::to_owned);
        let mut named = all.iter().filter(|record| name(path(record)) == name(&own));
        named.next().filter(|_| named.next().is_none()).copied()
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

/// Decodes `inputs`, opened with `options`, onto the forest's lattice and compares count and
/// multiset hash with those of its last tree, or of all its trees, depending on the number of
/// inputs. The hashes in the footers are trusted here: [`esker_format::verify()`] compares them
/// with the points.
///
/// # Errors
/// [`BuildError::Differs`] if the points are not the same; if an input cannot be read; on request.
pub fn against_forest(
    forest: &Forest,
    inputs: &[PathBuf],
    options: &OpenOptions,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    let trees = Trees::with(forest, inputs.len())?;
    compare(&trees, open_with(inputs, options, task)?, task)
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
    mut sources: Vec<Box<dyn Source>>,
    task: &dyn Task,
) -> Result<Against, BuildError> {
    take_recorded_types(trees, &mut sources)?;
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
    check_attributes(trees, &plan.schema)?;
    let rows = RowLayout::new(&plan.schema, &plan.classes);
    let (mut points, mut refused) = (0, 0);
    let (mut hash, mut rounding) = (MultisetHash::default(), 0.0f64);
    // Points outside of the lattice were set aside, or refused, when the file was built.
    let mut outside = OutsideSum::default();
    task.phase("reading inputs", Some(intake.points_hint()), "points");
    for (i, source) in intake.sources.iter().enumerate() {
        let placement = plan.lattice.placement(&source.info().grid);
        let mut sink = |mut batch: Batch| -> Result<(), ScanError> {
            let found = Outside::of(&mut batch, 0, None);
            outside.add(&found, &plan, (i, source.as_ref()));
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
            Err(e) => return Err(BuildError::from_sink(e)),
        };
        points += report.points;
        rounding = rounding.max(report.rounding_error_max);
        refused += report.refused.values().sum::<u64>();
    }
    let (points, refused) = outside.check(trees, (points, refused))?;
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
    let stated = trees.sources().map(|s| s.rounding_error_max).fold(0.0, f64::max);
    if rounding > stated * (1.0 + ROUNDING_NOISE) {
        return differs(
            name,
            format!(
                "states that coordinates were rounded by up to {stated:e}, the inputs' are rounded by {rounding:e}"
            ),
        );
    }
    let set_aside = outside.aside;
    Ok(Against {
        points,
        hash,
        refused,
        set_aside,
        rounding_error_max: stated,
        trees: trees.files.len(),
    })
}

/// Gives attributes of the inputs the types that they have in the trees, where the inputs do not
/// tell them, and compares what else the inputs state.
fn take_recorded_types(
    trees: &Trees<'_>,
    sources: &mut [Box<dyn Source>],
) -> Result<(), BuildError> {
    let records: Vec<_> = sources.iter().map(|s| trees.record_of(s.as_ref())).collect();
    if records.iter().all(Option::is_some) {
        for (source, (file, i)) in sources.iter_mut().zip(records.into_iter().flatten()) {
            let metadata = file.metadata();
            let class = metadata.classes.get(usize::from(metadata.sources[i].class));
            take_types(source, &metadata.schema, class.map_or(&[], |class| &class.present));
            check_meaning(trees.path(), source.as_ref(), (file, i))?;
        }
    } else {
        join_types(sources);
    }
    Ok(())
}

/// Compares the attributes of the inputs, `schema`, with those of the trees.
fn check_attributes(trees: &Trees<'_>, schema: &Schema) -> Result<(), BuildError> {
    let keys = |s: &Schema| s.attributes.iter().map(|a| (a.name.clone(), a.ty)).collect::<Vec<_>>();
    if keys(schema) != keys(trees.schema) {
        return differs(trees.path(), "its attributes are not those of the inputs".into());
    }
    if let Some(Conflict { name: attribute, scales, offsets }) = trees.schema.conflict(schema) {
        let steps = |i: usize| format!("{} * n + {}", scales[i], offsets[i]);
        let what = format!("its `{attribute}` is {}, that of the inputs {}", steps(0), steps(1));
        return differs(trees.path(), what);
    }
    Ok(())
}

/// Compares what an input states about the meaning of its values with what was recorded: the
/// coordinate reference system, where both state one, the epoch of GPS times, and which values of
/// extra bytes stand for none.
fn check_meaning(
    name: &Path,
    source: &dyn Source,
    (file, i): (&EskerFile, usize),
) -> Result<(), BuildError> {
    let (info, record) = (source.info(), &file.metadata().sources[i]);
    let path = info.path.display();
    let texts = [record.crs.as_ref().map(|c| &c.text), info.crs.as_ref().map(|c| &c.text)];
    if let [Some(recorded), Some(own)] = texts
        && !are_same(recorded, own)
    {
        let what = format!("{path} states another coordinate reference system than it did");
        return differs(name, what);
    }
    let recorded = file.verbatim(i)?;
    let epochs = [gps_times(&recorded), gps_times(&info.verbatim)];
    if let [Some(before), Some(now)] = epochs
        && before != now
    {
        let (before, now) = (before.name(), now.name());
        let what = format!("GPS times of {path} were {before} times, and are {now} times now");
        return differs(name, what);
    }
    let mut values = NoData::default();
    values.add(&recorded);
    values.add(&info.verbatim);
    let conflicts = values.conflicts();
    if !conflicts.is_empty() {
        let all = conflicts.join(", ");
        return differs(name, format!("other values of {path} stand for none than did: {all}"));
    }
    Ok(())
}

/// Relative difference of two computations of the same rounding.
const ROUNDING_NOISE: f64 = 1e-9;

/// Points of the inputs outside of the lattice.
#[derive(Default)]
struct OutsideSum {
    /// World coordinates of the first, and the input that has it.
    first: Option<([f64; 3], String)>,
    aside: u64,
    aside_hash: MultisetHash,
    refused: u64,
}

impl OutsideSum {
    /// Adds points of source `i`.
    fn add(&mut self, outside: &Outside, plan: &Plan, (i, source): (usize, &dyn Source)) {
        let class = &plan.classes[usize::from(plan.class_of[i])];
        for point in &outside.aside {
            let path = || source.info().path.display().to_string();
            self.first.get_or_insert_with(|| (point.place, path()));
            point.add_to(&mut self.aside_hash, class.seed(&plan.schema));
        }
        self.aside += outside.aside.len() as u64;
        self.refused += outside.len() - outside.aside.len() as u64;
    }

    /// Compares them with what the trees keep beside their points; returns how many of the `points`
    /// that were read are then in a tree, and how many were refused.
    fn check(
        &mut self,
        trees: &Trees<'_>,
        (points, refused): (u64, u64),
    ) -> Result<(u64, u64), BuildError> {
        let kept = trees.files.iter().map(|file| &file.metadata().set_aside);
        let kept_points = kept.clone().map(|aside| aside.len() as u64).sum::<u64>();
        let dropped: u64 = trees
            .sources()
            .filter_map(|s| s.refused.get(OFF_LATTICE))
            .fold(0, |n, m| n.saturating_add(*m));
        if self.aside != kept_points.saturating_add(dropped) {
            let first = self.first.take();
            let first = first.map(|(place, path)| format!(", such as {place:?} of {path}"));
            return differs(
                trees.path(),
                format!(
                    "does not hold {} points of the inputs{}; {kept_points} were set aside and {dropped} refused when it was built",
                    self.aside,
                    first.unwrap_or_default()
                ),
            );
        }
        let mut hash = MultisetHash::default();
        trees.files.iter().for_each(|file| hash += file.metadata().set_aside_hash());
        if dropped == 0 && hash != self.aside_hash {
            return differs(
                trees.path(),
                "the points that it keeps beside its tree are not those of the inputs".into(),
            );
        }
        let outside = self.aside + self.refused;
        self.aside = kept_points;
        Ok((points - outside, refused + self.refused + dropped))
    }
}

fn differs<T>(file: &Path, what: String) -> Result<T, BuildError> {
    Err(BuildError::Differs(format!("{}: {what}", file.display())))
}
