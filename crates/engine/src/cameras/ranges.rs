//! Ranges of values for colour maps, from the histograms of the files and the least and greatest
//! values of nodes: without strays (the outermost values) and without what a filter rejects. Strays
//! can be so far away that bins are coarser than the differences of all other values; then points
//! of a few nodes are read. If an end is a number that means "no value", the range is that of a
//! sample.

use anyhow::Result;
use esker_format::{EskerFile, Forest, ForestFilter, PlaneKind};
use esker_points::AttrType;
use esker_points::attribute::names;
use std::collections::BTreeSet;

/// Fraction of the values that may be outside a range at either end.
pub(super) const STRAYS: f64 = 0.01;
/// These mean "no value", with either sign: scans write the greatest number of their type.
const NO_VALUES: [f64; 2] = [f32::MAX as f64, f64::MAX];
/// Least number of values of a sample, if there are so many.
pub(super) const SAMPLE: usize = 1 << 17;
/// A range that is a smaller fraction of the whole one, strays included, is too coarse in bins.
pub(super) const COARSE: f64 = 1.0 / 16.0;

/// Plane of the attribute at `index` of a schema.
pub(crate) fn plane_of(name: &str, ty: AttrType, index: usize) -> PlaneKind {
    if name == names::INTENSITY && ty == AttrType::U16 {
        PlaneKind::Intensity
    } else {
        PlaneKind::Attribute(index as u16)
    }
}

/// Range of an attribute, in stored values, over all trees that have it; `number` is its index in
/// the schema of the forest.
///
/// # Errors
/// If statistics cannot be read.
pub fn of_attribute(forest: &Forest, number: usize, shown: &ForestFilter) -> Result<(f64, f64)> {
    if forest.is_partial() && shown.is_filtered() {
        // The values of all nodes count that the filter accepts.
        let whole = forest.whole()?;
        return of_attribute(&whole, number, &shown.of_other(&whole)?);
    }
    let attribute = &forest.schema().attributes[number];
    let (mut range, mut first) = (None, 0);
    for file in forest.files() {
        let nodes = file.table().nodes.len() as u32;
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        if let Some(index) = index.filter(|_| file.footer().points > 0) {
            range = joined(range, within(forest, file, index, (shown, first))?);
        }
        first += nodes;
    }
    let range = range.unwrap_or((0.0, 0.0));
    if is_value(range.0) && is_value(range.1) {
        return Ok(range);
    }
    of_sample(forest, number, attribute.ty, shown)
}

/// Least and greatest value of an attribute over all trees, strays included; `None` if no value is
/// a number.
///
/// # Errors
/// If statistics cannot be read.
pub fn whole(forest: &Forest, attribute: usize) -> Result<Option<(f64, f64)>> {
    let attribute = &forest.schema().attributes[attribute];
    let mut range = None;
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        if let Some(index) = index.filter(|_| file.footer().points > 0) {
            let of = file.histograms()?.ranges().of(index);
            range = joined(range, (of.0 <= of.1).then_some(of));
        }
    }
    Ok(range)
}

/// Values of an attribute of bytes that occur, ascending.
///
/// # Errors
/// If statistics cannot be read.
pub fn bytes_of(forest: &Forest, attribute: usize) -> Result<Vec<u8>> {
    let points = points_of_bytes(forest, attribute)?;
    Ok((0..).zip(points).filter(|(_, points)| *points > 0).map(|(value, _)| value).collect())
}

/// Points with each value of an attribute of bytes.
///
/// # Errors
/// If statistics cannot be read.
pub fn points_of_bytes(forest: &Forest, attribute: usize) -> Result<[u64; 1 << u8::BITS]> {
    let attribute = &forest.schema().attributes[attribute];
    let mut points = [0; 1 << u8::BITS];
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let histograms = file.histograms()?;
        let counts = histograms.counts(index);
        for (value, points) in (0u8..).zip(&mut points) {
            // Bytes have a bin each.
            *points += histograms.bin_of(index, value.into()).map_or(0, |bin| counts[bin]);
        }
    }
    Ok(points)
}

/// Whole numbers from 0 on of an attribute that occur, ascending, and whether these are all: where
/// they are far apart, they are those of a sample.
///
/// # Errors
/// If statistics or pages cannot be read.
pub fn whole_numbers_of(forest: &Forest, number: usize) -> Result<(Vec<u32>, bool)> {
    let attribute = &forest.schema().attributes[number];
    let (mut found, mut are_all) = (BTreeSet::new(), true);
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let histograms = file.histograms()?;
        let (low, high) = histograms.ranges().of(index);
        // Whole numbers have a bin each.
        let is_whole = !matches!(attribute.ty, AttrType::F32 | AttrType::F64);
        let counts = histograms.counts(index);
        let has_bins = is_whole
            && low >= 0.0
            && high <= f64::from(u32::MAX)
            && high - low < counts.len() as f64;
        are_all &= has_bins || low > high;
        if has_bins {
            let occurs =
                |value: f64| histograms.bin_of(index, value).is_some_and(|b| counts[b] > 0);
            let values = (low as u32..=high as u32).filter(|&value| occurs(value.into()));
            found.extend(values);
        }
    }
    if !are_all {
        let kind = plane_of(&attribute.name, attribute.ty, number);
        let values;
        (values, are_all) = sample(forest, kind, attribute.ty, &ForestFilter::default())?;
        found.extend(values.into_iter().map(|value| value as u32));
    }
    Ok((found.into_iter().collect(), are_all))
}

/// Whether a number is a value, and does not mean "no value".
fn is_value(number: f64) -> bool {
    number.is_finite() && !NO_VALUES.contains(&number.abs())
}

/// Range of a sample.
fn of_sample(
    forest: &Forest,
    attribute: usize,
    ty: AttrType,
    shown: &ForestFilter,
) -> Result<(f64, f64)> {
    let kind = plane_of(&forest.schema().attributes[attribute].name, ty, attribute);
    let (mut values, _) = sample(forest, kind, ty, shown)?;
    values.sort_unstable_by(f64::total_cmp);
    let strays = (values.len() as f64 * STRAYS) as usize;
    let end = |end: Option<&f64>| end.copied().unwrap_or(0.0);
    Ok((end(values.get(strays)), end(values.iter().rev().nth(strays))))
}

/// Values of the first nodes, whose points are evenly spread, and whether these are all nodes. Of
/// large files, the first ones of their overview.
pub(super) fn sample(
    forest: &Forest,
    kind: PlaneKind,
    ty: AttrType,
    shown: &ForestFilter,
) -> Result<(Vec<f64>, bool)> {
    let mut values = Vec::new();
    let nodes = forest.overview();
    let is_whole = nodes.len() as u64 == forest.nodes();
    let nodes = nodes.into_iter().map(|of| of.node).filter(|&node| shown.points_max(node) > 0);
    let mut left = SAMPLE;
    let first = nodes.clone().take_while(|&node| {
        let is_read = left > 0;
        left = left.saturating_sub(forest.record(node).points());
        is_read
    });
    forest.will_read_planes(first, &[kind]);
    for node in nodes {
        let planes = forest.read_planes(node, &[kind])?;
        let plane = planes.get(kind).unwrap_or_default().chunks_exact(ty.size());
        values.extend(plane.map(|value| ty.to_f64(value)).filter(|&value| is_value(value)));
        if values.len() >= SAMPLE {
            return Ok((values, false));
        }
    }
    Ok((values, is_whole))
}

fn joined(a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Option<(f64, f64)> {
    match (a, b) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (a, b) => a.or(b),
    }
}

/// Range in one file of a forest; `first` is the index of its first node in the forest's table.
fn within(
    forest: &Forest,
    file: &EskerFile,
    attribute: usize,
    (shown, first): (&ForestFilter, u32),
) -> Result<Option<(f64, f64)>> {
    let histograms = file.histograms()?;
    let whole = histograms.ranges().of(attribute);
    if whole.0 > whole.1 {
        return Ok(None);
    }
    let counts = histograms.counts(attribute);
    let bin = (whole.1 - whole.0) / counts.len() as f64;
    let mut range = central(whole, counts);
    if range.1 - range.0 < (whole.1 - whole.0) * COARSE {
        let last = first + file.table().nodes.len() as u32;
        let nodes = forest.overview().into_iter().map(|of| of.node);
        let nodes = nodes.filter(|node| (first..last).contains(node)).map(|node| node - first);
        range = within_bins(file, nodes, attribute, range, bin)?;
    }
    let (low, high) = range;
    if !shown.is_filtered() {
        return Ok(Some((low, high)));
    }
    let statistics = file.statistics()?;
    let nodes = 0..file.table().nodes.len() as u32;
    let wanted = nodes.filter(|&node| shown.points_max(first + node) > 0);
    let kept = wanted.filter_map(|node| statistics.own(node, attribute));
    let kept = kept.fold(None, |all, of| joined(all, Some(of)));
    // All accepted values may be strays of the file.
    let clamped = kept.map(|(a, b)| (a.max(low), b.min(high)));
    Ok(clamped.filter(|(a, b)| a <= b).or(kept))
}

/// Moves the ends of a range, which are those of bins, to the outermost values in these bins, if
/// the first ones of `nodes` have any.
fn within_bins(
    file: &EskerFile,
    nodes: impl Iterator<Item = u32>,
    attribute: usize,
    (low, high): (f64, f64),
    bin: f64,
) -> Result<(f64, f64)> {
    let of = &file.metadata().schema.attributes[attribute];
    let kind = plane_of(&of.name, of.ty, attribute);
    let (mut least, mut greatest, mut read) = (f64::INFINITY, f64::NEG_INFINITY, 0);
    for node in nodes {
        if read >= SAMPLE {
            break;
        }
        let planes = file.read_planes(node, &[kind])?;
        let plane = planes.get(kind).unwrap_or_default();
        for value in plane.chunks_exact(of.ty.size()).map(|value| of.ty.to_f64(value)) {
            if value >= low && value <= high {
                (least, greatest) = (least.min(value), greatest.max(value));
            }
            read += 1;
        }
    }
    let least = if least <= low + bin { least } else { low };
    let greatest = if greatest >= high - bin { greatest } else { high };
    Ok((least, greatest))
}

/// Range without its strays; `counts` are those of bins of equal width.
fn central((low, high): (f64, f64), counts: &[u64]) -> (f64, f64) {
    let total: u64 = counts.iter().sum();
    if total == 0 || low >= high {
        return (low, high);
    }
    let strays = total as f64 * STRAYS;
    let counts = || counts.iter().map(|&n| n as f64);
    let bin = (high - low) / counts().len() as f64;
    (low + bin * outer(counts(), strays) as f64, high - bin * outer(counts().rev(), strays) as f64)
}

/// Number of outermost bins that have no more points than the strays.
pub(super) fn outer(counts: impl Iterator<Item = f64>, strays: f64) -> usize {
    let mut sum = 0.0;
    let is_stray = |n: &f64| {
        sum += n;
        sum <= strays
    };
    counts.take_while(is_stray).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_numbers_are_values_unless_they_are_the_greatest_of_a_type() {
        for value in [0.0, -1e300, 1e300, 3.5e38, 1e30] {
            assert!(is_value(value), "{value}");
        }
        for none in [f32::MAX.into(), f32::MIN.into(), f64::MAX, f64::MIN, f64::INFINITY, f64::NAN]
        {
            assert!(!is_value(none), "{none}");
        }
    }

    #[test]
    fn strays_take_no_colours() {
        let mut counts = [0; 256];
        (counts[0], counts[100], counts[101], counts[255]) = (3, 500, 496, 1);
        assert_eq!(central((0.0, 256.0), &counts), (100.0, 102.0));
        assert_eq!(central((5.0, 5.0), &counts), (5.0, 5.0));
        assert_eq!(central((0.0, 1.0), &[0; 4]), (0.0, 1.0));
    }
}
