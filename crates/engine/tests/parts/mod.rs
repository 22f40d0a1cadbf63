//! Scans in two parts, each built as a tree of its own, one appended to the other; and the whole
//! scan built at once.

use esker_builder::{NormalsMode, Options, append_sources, build_sources};
use esker_format::Forest;
use esker_points::lattice::Placement;
use esker_points::task::Silent;
use esker_points::{Batch, Spread, Task};
use esker_scan::source::Sink;
use esker_scan::{OpenOptions, ReadReport, ScanError, Source, SourceInfo};
use std::path::Path;

/// How points are divided into two parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    /// West and east.
    Space,
    /// Each point at random.
    Shuffled,
    /// One of fifty everywhere, and the rest.
    Thinned,
    /// One of thirty everywhere, and all others in the middle ninth; the rest is left out.
    Patch,
}

impl Split {
    /// Part of the point number `i` at the fraction `share` of the bounds.
    fn part(self, i: u64, share: [f64; 2]) -> Option<usize> {
        let dice = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        match self {
            Self::Space => Some(usize::from(share[0] > 0.5)),
            Self::Shuffled => Some((dice % 2) as usize),
            Self::Thinned => Some(usize::from(!dice.is_multiple_of(50))),
            Self::Patch if dice.is_multiple_of(30) => Some(0),
            Self::Patch => share.iter().all(|s| (0.33..0.67).contains(s)).then_some(1),
        }
    }
}

/// The points of a scan that belong to a part.
struct Part {
    scan: Box<dyn Source>,
    split: Option<Split>,
    parts: Vec<usize>,
}

impl Source for Part {
    fn info(&self) -> &SourceInfo {
        self.scan.info()
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let Some(split) = self.split else { return self.scan.read(placement, task, sink) };
        let (mut next, mut points) = (0, 0);
        let [low, high] = self.info().grid.bounds.unwrap();
        let lattice = *placement.lattice();
        let mut report = self.scan.read(placement, task, &mut |batch| {
            let is_own = |i: &usize| {
                let world = lattice.world(batch.positions[*i]);
                let share = [0, 1].map(|axis| (world[axis] - low[axis]) / (high[axis] - low[axis]));
                split.part(next + *i as u64, share).is_some_and(|part| self.parts.contains(&part))
            };
            let own: Vec<usize> = (0..batch.len()).filter(is_own).collect();
            next += batch.len() as u64;
            points += own.len() as u64;
            let mut kept = Batch::with_capacity(batch.schema.clone(), own.len());
            kept.positions.extend(own.iter().map(|&i| batch.positions[i]));
            for ((to, from), a) in
                kept.columns.iter_mut().zip(&batch.columns).zip(&batch.schema.attributes)
            {
                let size = a.ty.size();
                own.iter().for_each(|&i| to.extend_from_slice(&from[i * size..][..size]));
            }
            sink(kept)
        })?;
        report.points = points;
        Ok(report)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.scan.survey(task)
    }
}

fn part(scan: &Path, split: Option<Split>, parts: &[usize]) -> Vec<Box<dyn Source>> {
    let scan = esker_scan::open(scan, &OpenOptions::default(), &Silent).unwrap();
    vec![Box::new(Part { scan, split, parts: parts.to_vec() })]
}

/// An open file and its folder.
pub struct Whole {
    pub file: Forest,
    _folder: tempfile::TempDir,
}

/// Options without normals, which a tree estimates from its own points: those of a part differ.
fn bare(node_capacity: u32) -> Options {
    Options { node_capacity, normals: NormalsMode::None, ..Options::default() }
}

/// Builds a scan at once.
pub fn whole(scan: &Path, node_capacity: u32) -> Whole {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("whole.esker");
    let options = bare(node_capacity);
    build_sources(part(scan, None, &[]), &out, &options, &Silent).unwrap();
    Whole { file: Forest::open(&out).unwrap(), _folder: folder }
}

/// The same points in one tree and in two.
pub struct Both {
    pub at_once: Forest,
    pub forest: Forest,
    pub folder: tempfile::TempDir,
}

/// Builds both.
pub fn built(scan: &Path, split: Split, node_capacity: u32) -> Both {
    let folder = tempfile::tempdir().unwrap();
    let [at_once, a, b] =
        ["at-once", "a", "b"].map(|name| folder.path().join(format!("{name}.esker")));
    let options = bare(node_capacity);
    build_sources(part(scan, Some(split), &[0, 1]), &at_once, &options, &Silent).unwrap();
    build_sources(part(scan, Some(split), &[0]), &a, &options, &Silent).unwrap();
    let old = Forest::open(&a).unwrap();
    append_sources(&old, part(scan, Some(split), &[1]), &b, &options, &Silent).unwrap();
    let [at_once, forest] = [at_once, b].map(|path| Forest::open(&path).unwrap());
    Both { at_once, forest, folder }
}
