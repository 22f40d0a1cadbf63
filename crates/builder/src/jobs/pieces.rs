//! Pieces of the sources, which the takes of a divided build decode: whole sources, and ranges of
//! the points of large ones whose format allows that. All pieces of a take follow each other in the
//! order of the sources.

use esker_points::lattice::Placement;
use esker_points::{AttrType, Spread, Task};
use esker_scan::source::Sink;
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Bytes that a point of a generated scan counts for, which has no file.
const GENERATED_BYTES: u64 = 34;

/// A source, or a range of its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Piece {
    /// Index of the source.
    pub source: u32,
    /// Range of the points, from the first to the one behind the last; all if it is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<[u64; 2]>,
}

impl Piece {
    /// Whether it has the first point of the source: one piece of each source does.
    pub fn is_first(&self) -> bool {
        self.points.is_none_or(|[first, _]| first == 0)
    }
}

/// Size by which a source is divided, in bytes.
pub fn weight(info: &SourceInfo) -> u64 {
    match info.bytes {
        0 => info.points_hint.saturating_mul(GENERATED_BYTES),
        bytes => bytes,
    }
}

/// Divides sources among `jobs` takes, so that their pieces have about equal bytes. The last takes
/// have no pieces if the sources cannot be divided so far.
pub fn divide(sources: &[Box<dyn Source>], jobs: u32) -> Vec<Vec<Piece>> {
    let weights: Vec<u128> = sources.iter().map(|s| weight(s.info()).max(1).into()).collect();
    let total = weights.iter().sum::<u128>().max(1);
    let jobs = u128::from(jobs.max(1));
    let mut takes: Vec<(u128, Vec<Piece>)> = Vec::new();
    let mut before = 0;
    for (index, (source, weight)) in (0..).zip(sources.iter().zip(weights)) {
        let points = source.info().points_hint;
        let parts = u64::try_from((weight * jobs).div_ceil(total)).unwrap_or(u64::MAX);
        for range in ranges(source.as_ref(), parts) {
            // The take in whose share the middle of the piece lies.
            let middle = u128::from(range.start) + u128::from(range.end);
            let middle = before + weight * middle / (2 * u128::from(points.max(1)));
            let take = (middle * jobs / total).min(jobs - 1);
            let is_whole = range == (0..points);
            let points = (!is_whole).then_some([range.start, range.end]);
            let piece = Piece { source: index, points };
            match takes.last_mut() {
                Some((last, pieces)) if *last == take => join(pieces, piece),
                _ => takes.push((take, vec![piece])),
            }
        }
        before += weight;
    }
    let mut takes: Vec<Vec<Piece>> = takes.into_iter().map(|(_, pieces)| pieces).collect();
    takes.resize(jobs as usize, Vec::new());
    takes
}

/// Adds a piece to those of a take; ranges of one source that follow each other become one.
fn join(pieces: &mut Vec<Piece>, piece: Piece) {
    match (pieces.last_mut(), piece.points) {
        (Some(Piece { source, points: Some([_, end]) }), Some([first, last]))
            if *source == piece.source && *end == first =>
        {
            *end = last;
        }
        _ => pieces.push(piece),
    }
}

/// Ranges of about equal length, at most `parts`, in which a source can be read.
fn ranges(source: &dyn Source, parts: u64) -> Vec<Range<u64>> {
    let points = source.info().points_hint;
    // The number of points is at most 2^40, that of the parts at most that of the jobs.
    let end =
        |i: u64| source.begin_near((u128::from(points) * u128::from(i) / u128::from(parts)) as u64);
    let mut starts: Vec<u64> = (0..parts.max(1)).map(end).collect();
    starts.dedup();
    let ends = starts.iter().skip(1).copied().chain([points]);
    let ranges: Vec<_> = starts.iter().zip(ends).map(|(&start, end)| start..end).collect();
    ranges.into_iter().filter(|range| range.start == 0 || !range.is_empty()).collect()
}

/// A piece as a source of its own, under the name that the user gave the source.
pub struct PieceSource {
    source: Box<dyn Source>,
    piece: Piece,
    info: SourceInfo,
}

impl PieceSource {
    /// The piece of an opened source, which the user called `info.path`.
    pub fn new(source: Box<dyn Source>, piece: Piece, info: SourceInfo) -> Self {
        let points = piece.points.map(|[first, end]| end.saturating_sub(first));
        let info = SourceInfo { points_hint: points.unwrap_or(info.points_hint), ..info };
        Self { source, piece, info }
    }
}

impl Source for PieceSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        match self.piece.points {
            None => self.source.read(placement, task, sink),
            Some([first, end]) => self.source.read_range(first..end, placement, task, sink),
        }
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.source.survey(task)
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }

    fn is_text(&self) -> bool {
        self.source.is_text()
    }

    fn typed_by_values(&self) -> Vec<usize> {
        self.source.typed_by_values()
    }

    fn widen(&mut self, attribute: usize, ty: AttrType) {
        self.source.widen(attribute, ty);
        self.info.schema = self.source.info().schema.clone();
    }
}
