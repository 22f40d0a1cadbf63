//! Trains a palette on the colours of a cloud: median cut of their histogram, boxes of greatest
//! variance first (after heckbert1982), then rounds of Lloyd's algorithm (lloyd1982). The result is
//! a function of the number of points of each colour: the same for any order of points and any
//! number of threads.

use super::{COLOURS_MAX, Palette, apart};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Bits of a channel in the bins that a palette is trained on, and rounds of Lloyd's algorithm.
/// Fewer bits with fewer rounds leave colours some percent farther off; more rounds change less
/// than 1 %.
const BITS: u32 = 6;
const ROUNDS: usize = 12;
/// Greatest count of a colour; threads that count at once may pass it slightly, and the excess is
/// cut off.
const COUNT_MAX: u32 = 1 << 31;

/// Number of points of each colour of 8 bits a channel. Counted by any number of threads.
pub struct Histogram(Vec<AtomicU32>);

impl Default for Histogram {
    fn default() -> Self {
        Self((0..1 << 24).map(|_| AtomicU32::new(0)).collect())
    }
}

/// Distances of colours from those of a palette, in the cube of red, green and blue, in steps of
/// 255.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Misfit {
    /// Mean over all points.
    pub mean: f64,
    /// 99th percentile.
    pub most: f64,
    /// Maximum.
    pub worst: f64,
}

impl Histogram {
    /// Counts a point.
    #[inline]
    pub fn add(&self, [red, green, blue]: [u8; 3]) {
        let at = usize::from(red) << 16 | usize::from(green) << 8 | usize::from(blue);
        if self.0[at].load(Relaxed) < COUNT_MAX {
            self.0[at].fetch_add(1, Relaxed);
        }
    }

    /// Adds the points of a colour that were counted elsewhere.
    pub fn add_count(&self, [red, green, blue]: [u8; 3], points: u32) {
        let at = usize::from(red) << 16 | usize::from(green) << 8 | usize::from(blue);
        let sum = |count: u32| Some(count.saturating_add(points).min(COUNT_MAX));
        let _ = self.0[at].fetch_update(Relaxed, Relaxed, sum);
    }

    /// Colours that occur, in order, with their counts.
    pub fn colours(&self) -> impl Iterator<Item = ([u8; 3], u64)> + '_ {
        self.0.iter().enumerate().filter_map(|(at, count)| {
            let count = u64::from(count.load(Relaxed).min(COUNT_MAX));
            (count > 0).then_some(([(at >> 16) as u8, (at >> 8) as u8, at as u8], count))
        })
    }

    /// A palette for the counted colours: the colours themselves if there are few. `None` if there
    /// is only black, as in fields that were never written.
    pub fn palette(&self) -> Option<Palette> {
        let first: Vec<_> = self.colours().map(|(rgb, _)| rgb).take(COLOURS_MAX + 1).collect();
        if first.len() <= COLOURS_MAX {
            return Palette::new(first).filter(|palette| palette.colours() != [[0; 3]]);
        }
        let mut bins = vec![Bin::default(); 1 << (3 * BITS)];
        for (rgb, count) in self.colours() {
            let bin = rgb.iter().fold(0, |bin, &c| bin << BITS | usize::from(c >> (8 - BITS)));
            bins[bin].add(&Bin { count, sums: rgb.map(|c| count * u64::from(c)) });
        }
        bins.retain(|bin| bin.count > 0);
        let mut colours: Vec<_> = boxes(bins.clone()).iter().map(|b| total(b).mean()).collect();
        for _ in 0..ROUNDS {
            let mut next = vec![Bin::default(); colours.len()];
            bins.iter().for_each(|bin| next[nearest(&colours, bin.mean())].add(bin));
            for (colour, bin) in colours.iter_mut().zip(&next).filter(|(_, bin)| bin.count > 0) {
                *colour = bin.mean();
            }
        }
        let mut colours: Vec<_> =
            colours.iter().map(|colour| colour.map(|c| c.round() as u8)).collect();
        colours.sort_unstable();
        colours.dedup();
        Palette::new(colours)
    }

    /// Error of a palette for the counted colours.
    pub fn misfit(&self, palette: &Palette) -> Misfit {
        let mut by_square = std::collections::BTreeMap::<i32, u64>::new();
        for (rgb, count) in self.colours() {
            let entry = palette.colours()[usize::from(palette.nearest(rgb))];
            *by_square.entry(apart(rgb.map(i32::from), entry.map(i32::from))).or_default() += count;
        }
        let points: u64 = by_square.values().sum();
        let off = |square: i32| f64::from(square).sqrt();
        let sum: f64 = by_square.iter().map(|(&square, &count)| off(square) * count as f64).sum();
        let mut within = 0;
        let most = by_square.iter().find(|&(_, &count)| {
            within += count;
            within as f64 >= 0.99 * points as f64
        });
        Misfit {
            mean: sum / points.max(1) as f64,
            most: most.map_or(0.0, |(&square, _)| off(square)),
            worst: by_square.keys().next_back().map_or(0.0, |&square| off(square)),
        }
    }
}

/// A set of similar colours: number of points, and sums of their channels.
#[derive(Clone, Copy, Default)]
struct Bin {
    count: u64,
    sums: [u64; 3],
}

impl Bin {
    fn mean(&self) -> [f32; 3] {
        self.sums.map(|sum| sum as f32 / self.count.max(1) as f32)
    }

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        (0..3).for_each(|i| self.sums[i] += other.sums[i]);
    }
}

fn total(bins: &[Bin]) -> Bin {
    bins.iter().fold(Bin::default(), |mut sum, bin| {
        sum.add(bin);
        sum
    })
}

/// Channel of the greatest variance in some bins, and the sum of its squared deviations.
fn widest(bins: &[Bin]) -> (usize, f32) {
    let mean = total(bins).mean();
    let spread = |i: usize| {
        bins.iter().map(|bin| bin.count as f32 * (bin.mean()[i] - mean[i]).powi(2)).sum::<f32>()
    };
    (0..3).map(|i| (i, spread(i))).max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

/// Divides the filled bins into as many boxes as a palette has colours.
fn boxes(filled: Vec<Bin>) -> Vec<Vec<Bin>> {
    let mut boxes = vec![(widest(&filled), filled)];
    while boxes.len() < COLOURS_MAX {
        let divisible = boxes.iter().enumerate().filter(|(_, (_, bins))| bins.len() > 1);
        let Some((at, _)) = divisible.max_by(|a, b| a.1.0.1.total_cmp(&b.1.0.1)) else { break };
        let ((channel, _), mut bins) = boxes.swap_remove(at);
        bins.sort_by(|a, b| a.mean()[channel].total_cmp(&b.mean()[channel]));
        let half = total(&bins).count / 2;
        let mut below = 0;
        let cut = bins.iter().position(|bin| {
            below += bin.count;
            below > half
        });
        let upper = bins.split_off(cut.unwrap_or(0).clamp(1, bins.len() - 1));
        boxes.extend([bins, upper].map(|bins| (widest(&bins), bins)));
    }
    boxes.into_iter().map(|(_, bins)| bins).collect()
}

fn nearest(colours: &[[f32; 3]], rgb: [f32; 3]) -> usize {
    let away = |c: &[f32; 3]| (0..3).map(|i| (c[i] - rgb[i]).powi(2)).sum::<f32>();
    let by_distance = |a: &(usize, f32), b: &(usize, f32)| a.1.total_cmp(&b.1);
    colours.iter().map(away).enumerate().min_by(by_distance).map_or(0, |(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(colours: impl Iterator<Item = [u8; 3]>) -> Histogram {
        let histogram = Histogram::default();
        colours.for_each(|rgb| histogram.add(rgb));
        histogram
    }

    #[test]
    fn few_colours_stay_as_they_are() {
        let colours = [[0u8, 0, 0], [255, 255, 255], [200, 30, 30], [200, 30, 31]];
        let histogram = counted(colours.into_iter());
        let palette = histogram.palette().unwrap();
        assert!(colours.iter().all(|&c| palette.table()[usize::from(palette.nearest(c))] == c));
        assert_eq!(histogram.misfit(&palette), Misfit::default());
    }

    #[test]
    fn empty_fields_have_no_palette() {
        assert_eq!(counted(std::iter::empty()).palette(), None);
        assert_eq!(counted([[0; 3]; 9].into_iter()).palette(), None);
    }

    #[test]
    fn many_colours_come_near_in_any_order() {
        let colour = |i: u32| [(i >> 7) as u8, (i >> 3) as u8, (i * 7) as u8];
        let (forth, back) = (0..1u32 << 15, (0..1u32 << 15).rev());
        let histogram = counted(forth.map(colour));
        let palette = histogram.palette().unwrap();
        assert_eq!(counted(back.map(colour)).palette().unwrap(), palette);
        // Error of uniform boxes, 8 x 8 x 4 of them (root mean square; the mean is 0.96 of it).
        let even = ((32f64.powi(2) * 2.0 + 64f64.powi(2)) / 12.0).sqrt();
        let Misfit { mean, most, worst } = histogram.misfit(&palette);
        assert!(
            mean < even * 0.95 && mean < most && most <= worst,
            "{mean} {most} {worst} of {even}"
        );
    }
}
