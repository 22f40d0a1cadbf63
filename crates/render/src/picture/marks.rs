//! Marks: a set of pixels as one bit a pixel. A pass at silhouettes or creases marks the pixels
//! that later ones look at. The marks of a picture fit the caches, and jobs of whole rows set them
//! without sharing a word.

use rayon::prelude::*;
use std::ops::Range;

/// Pixels in a word.
const WORD: usize = u64::BITS as usize;
/// Least number of rows of a job.
const ROWS: usize = 16;

/// A set of pixels of a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    width: usize,
    height: usize,
    words: Vec<u64>,
}

impl Marks {
    /// The empty set, of a picture of `width` x `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, words: vec![0; (width * height).div_ceil(WORD)] }
    }

    /// The pixels that `job` marks; it is called for each row, in parallel.
    pub fn of_rows(width: usize, height: usize, job: impl Fn(usize, &mut Band<'_>) + Sync) -> Self {
        let mut marks = Self::new(width, height);
        let rows = marks.rows_a_band();
        let bands = marks.words.par_chunks_mut((rows * width / WORD).max(1)).enumerate();
        bands.for_each(|(i, words)| {
            let mut band = Band { start: i * rows * width, words };
            (i * rows..height.min((i + 1) * rows)).for_each(|y| job(y, &mut band));
        });
        marks
    }

    /// Marks a pixel.
    #[inline]
    pub fn set(&mut self, pixel: usize) {
        self.words[pixel / WORD] |= 1 << (pixel % WORD);
    }

    /// Whether `pixel` is marked.
    #[inline]
    pub fn has(&self, pixel: usize) -> bool {
        self.words[pixel / WORD] >> (pixel % WORD) & 1 == 1
    }

    /// Marks of `count` pixels (1 to 64) from `pixel` on, the first in the lowest bit; unmarked
    /// beyond the last pixel of the picture.
    #[inline(always)]
    pub fn run(&self, pixel: usize, count: usize) -> u64 {
        let (i, shift) = (pixel / WORD, pixel % WORD);
        let word = |i: usize| self.words.get(i).copied().unwrap_or(0);
        let high = if shift + count > WORD { word(i + 1) << (WORD - shift) } else { 0 };
        (word(i) >> shift | high) & (u64::MAX >> (WORD - count))
    }

    /// Iterates over the marked pixels of a range, in order.
    pub fn among(&self, pixels: Range<usize>) -> impl Iterator<Item = usize> {
        let end = pixels.end;
        let starts = pixels.step_by(WORD);
        starts.flat_map(move |start| {
            let marked = self.run(start, WORD.min(end - start));
            bits(marked).map(move |k| start + k)
        })
    }

    /// Iterates over all marked pixels, in order.
    pub fn pixels(&self) -> impl ParallelIterator<Item = usize> {
        self.bands().flat_map_iter(|pixels| self.among(pixels))
    }

    /// Ranges of pixels of whole rows, one a job, in order.
    pub fn bands(&self) -> impl IndexedParallelIterator<Item = Range<usize>> {
        let size = self.rows_a_band() * self.width.max(1);
        let count = self.width * self.height;
        (0..count).into_par_iter().step_by(size).map(move |start| start..count.min(start + size))
    }

    /// The marked pixels and their neighbours to the left, right, above and below; with `corners`
    /// all eight neighbours.
    pub fn grown(&self, corners: bool) -> Self {
        let Self { width, height, .. } = *self;
        Self::of_rows(width, height, |y, band| {
            for x in (0..width).step_by(WORD) {
                let count = WORD.min(width - x);
                let start = y * width + x;
                let across = |start: usize| {
                    let marked = self.run(start, count);
                    let before = x > 0 && self.has(start - 1);
                    let after = x + count < width && self.has(start + count);
                    marked
                        | marked << 1
                        | marked >> 1
                        | u64::from(before)
                        | u64::from(after) << (count - 1)
                };
                let along = |start| if corners { across(start) } else { self.run(start, count) };
                let above = if y > 0 { along(start - width) } else { 0 };
                let below = if y + 1 < height { along(start + width) } else { 0 };
                band.add(start, count, across(start) | above | below);
            }
        })
    }

    /// Intersection of both sets.
    #[must_use]
    pub fn and(mut self, other: &Self) -> Self {
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a &= b);
        self
    }

    /// The marked pixels that are not in `other`.
    #[must_use]
    pub fn without(mut self, other: &Self) -> Self {
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a &= !b);
        self
    }

    /// Union of both sets.
    #[must_use]
    pub fn or(mut self, other: &Self) -> Self {
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a |= b);
        self
    }

    /// Number of rows of a job, such that jobs begin at whole words.
    fn rows_a_band(&self) -> usize {
        ROWS.max(WORD >> self.width.trailing_zeros().min(WORD.trailing_zeros()))
    }
}

/// The rows of a job.
pub struct Band<'a> {
    start: usize,
    words: &'a mut [u64],
}

impl Band<'_> {
    /// Marks a pixel.
    #[inline]
    pub fn set(&mut self, pixel: usize) {
        let at = pixel - self.start;
        self.words[at / WORD] |= 1 << (at % WORD);
    }

    /// Adds marks of `count` pixels (1 to 64) from `pixel` on, the first in the lowest bit.
    #[inline(always)]
    pub fn add(&mut self, pixel: usize, count: usize, marks: u64) {
        let marks = marks & (u64::MAX >> (WORD - count));
        let (i, shift) = ((pixel - self.start) / WORD, (pixel - self.start) % WORD);
        self.words[i] |= marks << shift;
        if shift + count > WORD {
            self.words[i + 1] |= marks >> (WORD - shift);
        }
    }
}

/// Indices of the set bits of a word, in order.
#[inline(always)]
pub fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (bit < WORD).then_some(bit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sizes with rows that end inside words, at their ends, or are shorter than a word.
    const SIZES: [[usize; 2]; 6] = [[1, 1], [7, 90], [64, 5], [65, 40], [130, 33], [48, 70]];

    fn some([width, height]: [usize; 2], every: usize) -> Marks {
        let mut marks = Marks::new(width, height);
        (0..width * height).filter(|p| (p * p + p / 3) % every == 0).for_each(|p| marks.set(p));
        marks
    }

    #[test]
    fn pixels_are_those_that_were_marked_in_their_order() {
        for size @ [width, height] in SIZES {
            let marks = some(size, 5);
            let expected: Vec<_> = (0..width * height).filter(|&p| marks.has(p)).collect();
            assert_eq!(marks.pixels().collect::<Vec<_>>(), expected);
            let of_rows = Marks::of_rows(width, height, |y, band| {
                for x in (0..width).step_by(8) {
                    let count = 8.min(width - x);
                    band.add(y * width + x, count, marks.run(y * width + x, count));
                }
            });
            assert_eq!(of_rows, marks);
            for start in 0..width * height {
                let expected =
                    (0..8).filter(|k| start + k < width * height && marks.has(start + k));
                assert_eq!(
                    bits(marks.run(start, 8)).collect::<Vec<_>>(),
                    expected.collect::<Vec<_>>()
                );
            }
        }
    }

    #[test]
    fn grown_marks_have_their_neighbours_and_no_others() {
        for size @ [width, height] in SIZES {
            for corners in [false, true] {
                let marks = some(size, 23);
                let grown = marks.grown(corners);
                for pixel in 0..width * height {
                    let [x, y] = [pixel % width, pixel / width];
                    let is_beside = |other: usize| {
                        let [dx, dy] = [x.abs_diff(other % width), y.abs_diff(other / width)];
                        dx.max(dy) <= 1 && (corners || dx + dy <= 1)
                    };
                    let expected = marks.pixels().any(is_beside);
                    assert_eq!(grown.has(pixel), expected, "{pixel} of {size:?}");
                }
                let beside = grown.clone().without(&marks);
                assert_eq!(beside.clone().or(&marks), grown);
                assert_eq!(beside.and(&marks), Marks::new(width, height));
            }
        }
    }
}
