//! Histograms of what gives points their colours, for windows that let people choose a range: of
//! all points where the file's statistics have one, otherwise of a sample, the points of the first
//! nodes.

use crate::cameras::colour::AttributeColours;
use crate::cameras::colour_request::ColourRequest;
use crate::cameras::ranges;
use crate::cameras::vertical::{AXES, Vertical};
use anyhow::Result;
use esker_format::{Forest, ForestFilter, PlaneKind};
use esker_points::AttrType;
use esker_points::named::{Part, RETURN_NUMBER_MASK};
use esker_points::quant::{HOT_POSITION_BYTES, exact, read_residual};

/// Most bins.
const BINS: usize = 64;
/// Room at either end, as a share of the extent of nearly all values.
const ROOM: f64 = 0.15;

/// Numbers of points by value.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Lower end of the first bin and upper end of the last one, values as they are shown.
    pub range: [f64; 2],
    /// Points of each bin, which are equally wide. A share of a bin of the file's statistics may
    /// count.
    pub counts: Vec<f64>,
    /// Number of points that were counted, if they are a sample.
    pub sample: Option<u64>,
    /// Whether values are whole numbers.
    pub is_whole: bool,
}

impl Histogram {
    /// Counts values within `[low, high]`, the range of nearly all of them.
    fn of_values(values: &[f64], is_whole: bool) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let strays = (sorted.len() as f64 * ranges::STRAYS) as usize;
        let (least, greatest) = (*sorted.first()?, *sorted.last()?);
        let central = [sorted[strays], sorted[sorted.len() - 1 - strays]];
        let mut empty = Self::empty(central, [least, greatest], is_whole)?;
        sorted.iter().for_each(|&value| empty.add([value, value], 1.0));
        Some(Self { sample: Some(values.len() as u64), ..empty })
    }

    /// Bins over the range of nearly all values, with some room, within that of all values.
    fn empty(central: [f64; 2], whole: [f64; 2], is_whole: bool) -> Option<Self> {
        let room = (central[1] - central[0]) * ROOM;
        let mut range = [(central[0] - room).max(whole[0]), (central[1] + room).min(whole[1])];
        let mut bins = BINS;
        if is_whole {
            // Each bin has as many whole numbers as the others.
            let (low, high) = (range[0].floor(), range[1].ceil());
            let numbers = high - low + 1.0;
            let width = (numbers / BINS as f64).ceil().max(1.0);
            bins = (numbers / width).ceil() as usize;
            range = [low - 0.5, low - 0.5 + width * bins as f64];
        }
        let is_range = range.iter().all(|end| end.is_finite()) && range[0] < range[1];
        let counts = vec![0.0; bins];
        is_range.then_some(Self { range, counts, sample: None, is_whole })
    }

    /// States that the statistics of a file that is drawn without being built are those of a
    /// sample.
    fn counted_in(self, forest: &Forest) -> Self {
        let counted = || self.counts.iter().sum::<f64>().round() as u64;
        let sample = self.sample.or_else(|| forest.is_growing().then(counted));
        Self { sample, ..self }
    }

    /// Counts points whose values are evenly spread over `[from, to]`.
    fn add(&mut self, [from, to]: [f64; 2], points: f64) {
        let [low, high] = self.range;
        let bins = self.counts.len();
        let place = |value: f64| (value - low) / (high - low) * bins as f64;
        let (from, to) = (place(from), place(to));
        if to < 0.0 || from > bins as f64 || points == 0.0 {
            return;
        }
        let bin = |place: f64| (place.max(0.0) as usize).min(bins - 1);
        if bin(from) == bin(to) && from >= 0.0 && to <= bins as f64 {
            self.counts[bin(from)] += points;
            return;
        }
        for at in bin(from)..=bin(to) {
            let share = (to.min(at as f64 + 1.0) - from.max(at as f64)).max(0.0) / (to - from);
            self.counts[at] += points * share;
        }
    }
}

/// Histogram of what `name` requests, a source of colours with or without a range; elevations are
/// along `vertical`. `None` if its values have no range: colours, classes, numbers of scans.
///
/// Reads from the disk where the file has no statistics, so the render thread should not call it.
///
/// # Errors
/// If there is no such attribute, or statistics or nodes cannot be read.
pub fn histogram(forest: &Forest, name: &str, vertical: Vertical) -> Result<Option<Histogram>> {
    let request = ColourRequest::parse(name)?;
    let is_attribute = forest.schema().find(request.name).is_some();
    let lower = request.name.to_ascii_lowercase();
    let histogram = match lower.as_str() {
        "elevation" | "height" => of_places(forest, vertical),
        "x" | "y" | "z" if !is_attribute => {
            let axis = AXES.iter().position(|axis| *axis == lower).unwrap_or(2);
            of_places(forest, Vertical { axis, is_down: false })
        }
        "rgb" | "colour" | "color" | "plain" | "none" | "level" | "cell" | "node" | "normal"
        | "normals" | "depth"
            if !is_attribute =>
        {
            Ok(None)
        }
        _ => {
            let shown = ForestFilter::default();
            let colours = AttributeColours::find(forest, &request, &shown)?;
            if colours.has_labels() { Ok(None) } else { of_attribute(forest, &colours) }
        }
    };
    Ok(histogram?.map(|all| all.counted_in(forest)))
}

/// Histogram of the values of an attribute, also where they have colours of their own; `None` if
/// they have no range. Reads from the disk, as [`histogram`].
///
/// # Errors
/// If there is no such attribute, or statistics or nodes cannot be read.
pub fn value_histogram(forest: &Forest, name: &str) -> Result<Option<Histogram>> {
    let request = ColourRequest::parse(name)?;
    let shown = ForestFilter::default();
    let colours = AttributeColours::find_any(forest, &request, &shown)?;
    let histogram = match colours.returns() {
        Some(part) => of_returns(forest, colours.index, part),
        None => of_attribute(forest, &colours),
    };
    Ok(histogram?.map(|all| all.counted_in(forest)))
}

/// Histogram of a part of bytes of returns.
fn of_returns(forest: &Forest, attribute: usize, part: Part) -> Result<Option<Histogram>> {
    let mut all = [0.0; 1 + RETURN_NUMBER_MASK as usize];
    for (byte, points) in (0u8..).zip(ranges::points_of_bytes(forest, attribute)?) {
        all[usize::from(part.of_byte(byte))] += points as f64;
    }
    let occurs = |points: &f64| *points > 0.0;
    let ends = all.iter().position(occurs).zip(all.iter().rposition(occurs));
    Ok(ends.map(|(low, high)| Histogram {
        range: [low as f64 - 0.5, high as f64 + 0.5],
        counts: all[low..=high].to_vec(),
        sample: None,
        is_whole: true,
    }))
}

/// Histogram of the coordinates of the first points along an axis.
fn of_places(forest: &Forest, vertical: Vertical) -> Result<Option<Histogram>> {
    let (axis, mut values) = (vertical.axis, Vec::new());
    let factor = forest.lattice().factor[axis];
    for index in forest.overview().into_iter().map(|of| of.node) {
        let planes = forest.read_planes(index, &[PlaneKind::Position, PlaneKind::Residual])?;
        let (node, [min, _]) = (forest.record(index), forest.record(index).own_box());
        let points = planes.get(PlaneKind::Position).unwrap_or_default();
        let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
        let points = points.as_chunks::<HOT_POSITION_BYTES>().0.iter().enumerate();
        values.extend(points.map(|(i, point)| {
            let hot = u16::from_le_bytes([point[2 * axis], point[2 * axis + 1]]);
            let low = read_residual(residual, i, node.hot_shift)[axis];
            let steps = exact(hot, low, min[axis], node.hot_shift);
            let coordinate = forest.metric().world_axis(axis, f64::from(steps)) / factor;
            vertical.turned([coordinate; 2])[0]
        }));
        if values.len() >= ranges::SAMPLE {
            break;
        }
    }
    Ok(Histogram::of_values(&values, false))
}

/// Histogram of an attribute: of all points where bins of the statistics are fine enough.
fn of_attribute(forest: &Forest, colours: &AttributeColours<'_>) -> Result<Option<Histogram>> {
    let attribute = &forest.schema().attributes[colours.index];
    let shown = |stored: f64| colours.shown_value(stored);
    let is_whole =
        !matches!(attribute.ty, AttrType::F32 | AttrType::F64) && shown(1.0) - shown(0.0) == 1.0;
    let Some(whole) = ranges::whole(forest, colours.index)? else { return Ok(None) };
    let central = ranges::of_attribute(forest, colours.index, &ForestFilter::default())?;
    if central.1 - central.0 < (whole.1 - whole.0) * ranges::COARSE && central.0 < central.1 {
        let kind = colours.kind;
        let (values, _) = ranges::sample(forest, kind, attribute.ty, &ForestFilter::default())?;
        let values: Vec<f64> = values.into_iter().map(shown).collect();
        return Ok(Histogram::of_values(&values, is_whole));
    }
    let ends = |(low, high): (f64, f64)| [shown(low), shown(high)];
    let Some(mut all) = Histogram::empty(ends(central), ends(whole), is_whole) else {
        return Ok(None);
    };
    for file in forest.files() {
        let index = file.metadata().schema.find_typed(&attribute.name, attribute.ty);
        let Some(index) = index.filter(|_| file.footer().points > 0) else { continue };
        let histograms = file.histograms()?;
        let counts = histograms.counts(index);
        let (low, high) = histograms.ranges().of(index);
        if low > high {
            continue;
        }
        if is_whole && high - low < counts.len() as f64 {
            // Whole numbers have a bin each.
            for value in low as i64..=high as i64 {
                let bin = histograms.bin_of(index, value as f64);
                let value = shown(value as f64);
                all.add([value, value], bin.map_or(0.0, |bin| counts[bin] as f64));
            }
            continue;
        }
        let width = (high - low) / counts.len() as f64;
        for (bin, &points) in counts.iter().enumerate() {
            let from = low + width * bin as f64;
            all.add([shown(from), shown(from + width)], points as f64);
        }
    }
    Ok(Some(all))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn values_are_counted_once_and_strays_make_no_bins() {
        let mut values: Vec<f64> = (0..10_000).map(|i| f64::from(i) * 0.01).collect();
        values.push(1e9);
        let all = Histogram::of_values(&values, false).unwrap();
        assert!(all.range[0] >= 0.0 && all.range[1] < 120.0, "{:?}", all.range);
        assert_eq!(all.counts.iter().sum::<f64>(), 10_000.0);
        assert_eq!(all.sample, Some(10_001));
        assert_eq!(Histogram::of_values(&[], false), None);
        assert_eq!(Histogram::of_values(&[7.0], false), None);
    }

    #[test]
    fn whole_numbers_have_equal_bins() {
        let few = Histogram::of_values(&[1.0, 1.0, 2.0, 5.0], true).unwrap();
        assert_eq!((few.range, few.counts), ([0.5, 5.5], vec![2.0, 1.0, 0.0, 0.0, 1.0]));
        let many: Vec<f64> = (0..1000).map(f64::from).collect();
        let many = Histogram::of_values(&many, true).unwrap();
        let inner = &many.counts[1..many.counts.len() - 1];
        assert!(inner.iter().all(|&n| n == inner[0]), "{:?}", many.counts);
    }

    #[test]
    fn spread_points_are_shared_out() {
        let mut four = Histogram::empty([0.0, 4.0], [0.0, 4.0], false).unwrap();
        four.counts = vec![0.0; 4];
        four.add([0.5, 2.5], 20.0);
        assert_eq!(four.counts, [5.0, 10.0, 5.0, 0.0]);
        four.add([-2.0, 2.0], 8.0);
        assert_eq!(four.counts, [7.0, 12.0, 5.0, 0.0]);
        four.add([4.0, 4.0], 3.0);
        assert_eq!(four.counts, [7.0, 12.0, 5.0, 3.0]);
    }
}
