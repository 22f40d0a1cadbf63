//! Ranges of values for colour maps: from the files' histograms and the nodes' least and greatest values, so that
//! neither a few strays take all colours nor what a filter leaves out takes any. Where an end of these is a number that
//! stands for no value, or strays are so far away that they hide what the others differ by, a sample of the values is read.

use crate::colour::plane_of;
use anyhow::Result;
use esker_format::{EskerFile, Forest, PlaneKind, Shown};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, read_residual};
use esker_points::{AttrType, Node};

/// Share of the values that may lie outside a range on either side.
const STRAYS: f64 = 0.01;
/// Bins of heights.
const BINS: usize = 1024;
/// Numbers from here on stand for no value: scans write the greatest of their type where they have none.
const NO_VALUE: f64 = f32::MAX as f64;
/// Values that a sample has at least, where there are so many.
const SAMPLE: usize = 1 << 17;
/// Less than this share of the whole range, strays and all, is told too coarsely by its bins.
const COARSE: f64 = 1.0 / 16.0;
/// Heights that spread over so many times those of a sample spread over strays.
const SPREAD: f64 = 2.0;

/// The range of an attribute of the forest, in stored values, over all trees that have it.
///
/// # Errors
/// Where statistics cannot be read.
pub fn of_attribute(forest: &Forest, number: usize, shown: &Shown) -> Result<(f64, f64)> {
    let attribute = &forest.schema().attributes[number];
    let (mut range, mut first) = (None, 0);
    for file in forest.files() {
        let nodes = file.table().nodes.len() as u32;
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        if let Some(index) = index.filter(|_| file.footer().points > 0) {
            range = joined(range, within(file, index, shown, first)?);
        }
        first += nodes;
    }
    let range = range.unwrap_or((0.0, 0.0));
    let (is_told, whole) = (is_value(range.0) && is_value(range.1), whole(forest, number)?);
    let whole = whole.map_or(0.0, |(low, high)| high - low);
    if is_told && range.1 - range.0 >= whole * COARSE {
        return Ok(range);
    }
    let sample = of_sample(forest, number, attribute.ty, shown)?;
    Ok(sample.filter(|(low, high)| !is_told || low < high).unwrap_or(range))
}

/// Least and greatest value of an attribute of the forest over all trees, strays and all; `None` where nothing is a number.
///
/// # Errors
/// Where statistics cannot be read.
pub fn whole(forest: &Forest, attribute: usize) -> Result<Option<(f64, f64)>> {
    let attribute = &forest.schema().attributes[attribute];
    let mut range = None;
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        if let Some(index) = index.filter(|_| file.footer().points > 0) {
            let of = file.statistics()?.histograms().ranges().of(index);
            range = joined(range, (of.0 <= of.1).then_some(of));
        }
    }
    Ok(range)
}

/// Which values of an attribute of bytes occur in the forest.
///
/// # Errors
/// Where statistics cannot be read.
pub fn bytes_of(forest: &Forest, attribute: usize) -> Result<Vec<u8>> {
    let attribute = &forest.schema().attributes[attribute];
    let mut occurs = [false; 1 << u8::BITS];
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let statistics = file.statistics()?;
        let histograms = statistics.histograms();
        let (low, high) = histograms.ranges().of(index);
        let counts = histograms.counts(index);
        for (value, occurs) in (0u8..).zip(&mut occurs) {
            let value = f64::from(value);
            // No bin has two, and the last value is in the last.
            let bin = ((value - low) / (high - low) * counts.len() as f64).max(0.0) as usize;
            *occurs |= low <= value && value <= high && counts[bin.min(counts.len() - 1)] > 0;
        }
    }
    Ok((0..).zip(occurs).filter(|(_, occurs)| *occurs).map(|(value, _)| value).collect())
}

/// Whether a number is a value, and does not stand for none.
fn is_value(number: f64) -> bool {
    number.abs() < NO_VALUE
}

/// The range of a sample, without what stands for no value: of the first nodes, whose points are spread evenly.
fn of_sample(
    forest: &Forest,
    attribute: usize,
    ty: AttrType,
    shown: &Shown,
) -> Result<Option<(f64, f64)>> {
    let kind = plane_of(&forest.schema().attributes[attribute].name, ty, attribute);
    let mut values = Vec::new();
    let nodes = 0..forest.table().nodes.len() as u32;
    for node in nodes.filter(|&node| shown.points_max(node) > 0) {
        let planes = forest.read_planes(node, &[kind])?;
        let plane = planes.get(kind).unwrap_or_default().chunks_exact(ty.size());
        values.extend(plane.map(|value| ty.to_f64(value)).filter(|&value| is_value(value)));
        if values.len() >= SAMPLE {
            break;
        }
    }
    Ok(without_strays(values))
}

/// The range of so many values without strays.
fn without_strays(mut values: Vec<f64>) -> Option<(f64, f64)> {
    values.sort_unstable_by(f64::total_cmp);
    let strays = (values.len() as f64 * STRAYS) as usize;
    Some((*values.get(strays)?, *values.iter().rev().nth(strays)?))
}

fn joined(a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Option<(f64, f64)> {
    match (a, b) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (a, b) => a.or(b),
    }
}

/// The range in one file, whose nodes begin at `first` in the forest's table.
fn within(
    file: &EskerFile,
    attribute: usize,
    shown: &Shown,
    first: u32,
) -> Result<Option<(f64, f64)>> {
    let statistics = file.statistics()?;
    let histograms = statistics.histograms();
    let whole = histograms.ranges().of(attribute);
    if whole.0 > whole.1 {
        return Ok(None);
    }
    let counts = histograms.counts(attribute);
    let (low, high) = central(whole, counts);
    if !shown.is_filtered() {
        return Ok(Some((low, high)));
    }
    let nodes = 0..file.table().nodes.len() as u32;
    let wanted = nodes.filter(|&node| shown.points_max(first + node) > 0);
    let kept = wanted.filter_map(|node| statistics.own(node, attribute));
    let kept = kept.fold(None, |all, of| joined(all, Some(of)));
    // What is kept may all be strays of the whole.
    let clamped = kept.map(|(a, b)| (a.max(low), b.min(high)));
    Ok(clamped.filter(|(a, b)| a <= b).or(kept))
}

/// The part of a range without its strays; `counts` are of bins of equal width.
fn central((low, high): (f64, f64), counts: &[u64]) -> (f64, f64) {
    let total: u64 = counts.iter().sum();
    if total == 0 || low >= high {
        return (low, high);
    }
    let strays = (total as f64 * STRAYS) as u64;
    let beyond = |bins: &mut dyn Iterator<Item = &u64>| {
        let mut sum = 0;
        bins.take_while(|&&n| {
            sum += n;
            sum <= strays
        })
        .count()
    };
    let bin = (high - low) / counts.len() as f64;
    let (below, above) = (beyond(&mut counts.iter()), beyond(&mut counts.iter().rev()));
    (low + bin * below as f64, high - bin * above as f64)
}

/// The range of heights, from the nodes' contours; from the first nodes' points where a stray has stretched these. `bounds`
/// are of all points.
///
/// # Errors
/// Where a node cannot be read.
pub fn of_heights(forest: &Forest, bounds: [[f64; 3]; 2], shown: &Shown) -> Result<(f64, f64)> {
    let range = of_contours(forest, bounds, shown);
    let sample = without_strays(heights_of_sample(forest, shown)?);
    let is_stretched =
        |(low, high): &(f64, f64)| low < high && range.1 - range.0 > SPREAD * (high - low);
    Ok(sample.filter(is_stretched).unwrap_or(range))
}

/// Heights of the first nodes' points that are shown.
fn heights_of_sample(forest: &Forest, shown: &Shown) -> Result<Vec<f64>> {
    let mut heights = Vec::new();
    for (index, node) in (0u32..).zip(&forest.table().nodes) {
        let points = node.points().min(shown.points_max(index));
        if points == 0 {
            continue;
        }
        // Where a stray has stretched a node's box, hot positions alone are coarse.
        let planes = shown.read(forest, index, &[PlaneKind::Position, PlaneKind::Residual])?;
        let plane = planes.get(PlaneKind::Position).unwrap_or_default();
        let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
        let (hides, [min, _]) = (shown.hides_points(index), node.own_box());
        let points = plane.as_chunks::<HOT_POSITION_BYTES>().0.iter().take(points).enumerate();
        heights.extend(points.filter(|(_, point)| !hides || point[HIDDEN_AT] == 0).map(
            |(i, point)| {
                let hot = u16::from_le_bytes([point[4], point[5]]);
                let [.., low] = read_residual(residual, i, node.hot_shift);
                let z = exact(hot, low, min[2], node.hot_shift);
                forest.lattice().world_axis(2, f64::from(z))
            },
        ));
        if heights.len() >= SAMPLE {
            break;
        }
    }
    Ok(heights)
}

/// The range of heights of the nodes' contours.
fn of_contours(forest: &Forest, bounds: [[f64; 3]; 2], shown: &Shown) -> (f64, f64) {
    let (low, high) = (bounds[0][2], bounds[1][2]);
    let mut counts = [0u64; BINS];
    let bin = |z: f64| (((z - low) / (high - low) * BINS as f64).max(0.0) as usize).min(BINS - 1);
    for (index, node) in (0u32..).zip(&forest.table().nodes) {
        let points = node.points().min(shown.points_max(index)) as u64;
        let [from, to] = heights(forest, node).map(bin);
        // The points are taken to be spread evenly over the heights of their box.
        for count in &mut counts[from..=to.max(from)] {
            *count += points * 1024 / (to.max(from) - from + 1) as u64;
        }
    }
    central((low, high), &counts)
}

/// Least and greatest height of a node's contour.
fn heights(forest: &Forest, node: &Node) -> [f64; 2] {
    let contour = node.contour();
    let reach = (0..3).map(|i| contour.half[i] * contour.axes[i][2].abs()).sum::<f64>();
    let middle = forest.lattice().world_axis(2, f64::from(node.corner[2])) + contour.centre[2];
    [middle - reach, middle + reach]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strays_take_no_colours() {
        let mut counts = [0; 256];
        (counts[0], counts[100], counts[101], counts[255]) = (3, 500, 496, 1);
        assert_eq!(central((0.0, 256.0), &counts), (100.0, 102.0));
        assert_eq!(central((5.0, 5.0), &counts), (5.0, 5.0));
        assert_eq!(central((0.0, 1.0), &[0; 4]), (0.0, 1.0));
    }
}
