//! Clip lines of splats (zwicker2004, section 5): at a sharp edge the tangent planes of the splats
//! on both sides meet in a line, and each splat is drawn on its own side only. A line is two points
//! of the lattice, independent of the splat: both splats of a pair share it to the bit, so no crack
//! opens.
//!
//! A splat has up to two lines of two words each. The first word is a point of the line relative to
//! the splat's own *hot* position, the second the vector from there to another point: three signed
//! numbers of 9 bits, in units of `2^k` grains; `k` is in the first word's upper 5 bits. Bit 27 of
//! the second word says which side is kept, and bit 28 in the second line how the two are combined.
//! A vector of length zero means no line.

/// Bytes of a splat's lines.
pub const CLIP_BYTES: usize = 16;

/// Greatest signed number of 9 bits.
const PART_MAX: i64 = 255;
/// Least distance of a line's points in its longest axis, in units: almost the greatest number, so
/// that the points are as exact as splats near the line need them.
const WAY_PARTS: f64 = 200.0;
/// Greatest shift of a unit: a larger one exceeds the size of any splat.
pub const SHIFT_MAX: u32 = 22;
const KEEPS_RIGHT: u32 = 1 << 27;
const EITHER: u32 = 1 << 28;

/// Words of a splat's lines; zeros without lines.
pub type ClipWords = [u32; 4];

/// Length of a grain on each axis, as a power of two of steps: about the same length on all axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Grain(pub [u8; 3]);

impl Grain {
    /// The grain of a lattice with steps of these lengths.
    pub fn new(scale: [f64; 3]) -> Self {
        let longest = scale.into_iter().fold(0.0, f64::max);
        Self(scale.map(|s| (longest / s).log2().round().clamp(0.0, 16.0) as u8))
    }

    /// Shifts of a unit of `2^k` grains; `None` if no line can have them.
    fn shifts(self, k: u32) -> Option<[u32; 3]> {
        let shifts = self.0.map(|g| u32::from(g) + k);
        shifts.iter().all(|&s| s <= SHIFT_MAX).then_some(shifts)
    }
}

/// A line, and the side of it that is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClipLine {
    /// A point of the line, lattice coordinates.
    pub from: [u32; 3],
    /// Vector to another point, steps; of the two directions the one whose first non-zero component
    /// is positive.
    pub along: [i32; 3],
    /// Whether the right side is kept, looking along the vector from the side that the splat's
    /// normal points to.
    pub keeps_right: bool,
    /// Log2 of its unit in grains.
    unit_log2: u8,
}

/// Lines of a splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clip {
    /// The first and the second line.
    pub lines: [Option<ClipLine>; 2],
    /// Whether the union of what the lines keep is kept (an inner corner); otherwise the
    /// intersection.
    pub either: bool,
}

impl ClipLine {
    /// The line through two points, in steps of the lattice. The part to the left of the direction
    /// from `first` to `second` is kept. The points should be about as far apart as the splat is
    /// wide, and at most that far away from it. Swapping them gives the same line. `None` if they
    /// coincide on the lattice, or are off it.
    pub fn through(first: [f64; 3], second: [f64; 3], grain: Grain) -> Option<Self> {
        let apart = |i: usize| (second[i] - first[i]).abs() / f64::from(1u32 << grain.0[i]);
        let longest = apart(0).max(apart(1)).max(apart(2));
        if !first.iter().chain(&second).all(|c| c.is_finite()) {
            return None;
        }
        let k = (longest / WAY_PARTS).max(1.0).log2().ceil();
        let k = if k <= f64::from(SHIFT_MAX) { k as u32 } else { return None };
        let shifts = grain.shifts(k)?;
        let units =
            |p: [f64; 3]| [0, 1, 2].map(|i| (p[i] / f64::from(1u32 << shifts[i])).round() as i64);
        let (first, second) = (units(first), units(second));
        let is_turned = second < first;
        let (from, to) = if is_turned { (second, first) } else { (first, second) };
        let mut line =
            Self { from: [0; 3], along: [0; 3], keeps_right: is_turned, unit_log2: k as u8 };
        for i in 0..3 {
            line.from[i] = u32::try_from(from[i] << shifts[i]).ok()?;
            line.along[i] = i32::try_from((to[i] - from[i]) << shifts[i]).ok()?;
        }
        (line.along != [0; 3]).then_some(line)
    }

    /// Its words in a splat at this hot position; `None` if the line is too far away.
    fn words(&self, hot: [u32; 3], grain: Grain) -> Option<[u32; 2]> {
        let shifts = grain.shifts(u32::from(self.unit_log2))?;
        let mut words =
            [u32::from(self.unit_log2) << 27, u32::from(self.keeps_right) * KEEPS_RIGHT];
        for i in 0..3 {
            let at = i64::from(self.from[i] >> shifts[i]) - i64::from(hot[i] >> shifts[i]);
            let way = i64::from(self.along[i]) >> shifts[i];
            for (word, part) in words.iter_mut().zip([at, way]) {
                if part.abs() > PART_MAX {
                    return None;
                }
                *word |= (part as u32 & 0x1ff) << (9 * i);
            }
        }
        Some(words)
    }

    /// The line of two words. Any words give a line or none.
    fn of_words([at, way]: [u32; 2], hot: [u32; 3], grain: Grain) -> Option<Self> {
        let shifts = grain.shifts(at >> 27)?;
        let part = |word: u32, i: usize| (word << (23 - 9 * i)) as i32 >> 23;
        let along = [0, 1, 2].map(|i| part(way, i) << shifts[i]);
        let from =
            [0, 1, 2].map(|i| (hot[i] >> shifts[i]).wrapping_add(part(at, i) as u32) << shifts[i]);
        let (keeps_right, unit_log2) = (way & KEEPS_RIGHT != 0, (at >> 27) as u8);
        (along != [0; 3]).then_some(Self { from, along, keeps_right, unit_log2 })
    }
}

impl Clip {
    /// Whether there is no line.
    pub fn is_none(&self) -> bool {
        self.lines == [None; 2]
    }

    /// The lines for a splat whose normal is reversed.
    pub fn turned(&self) -> Self {
        let turned = |l: ClipLine| ClipLine { keeps_right: !l.keeps_right, ..l };
        Self { lines: self.lines.map(|line| line.map(turned)), ..*self }
    }

    /// Words for a splat at this hot position (its exact one without the dropped bits). Lines that
    /// are too far away are left out; with `either`, both are, since the lost line would keep
    /// everything.
    pub fn words(&self, hot: [u32; 3], grain: Grain) -> ClipWords {
        let words = self.lines.map(|line| line.map(|l| l.words(hot, grain)));
        let lost = words.contains(&Some(None));
        if lost && self.either {
            return [0; 4];
        }
        let mut kept = words.into_iter().flatten().flatten();
        let [a, b] = kept.next().unwrap_or_default();
        let second = kept.next();
        let [c, d] = second.unwrap_or_default();
        let either = if self.either && second.is_some() { EITHER } else { 0 };
        [a, b, c, d | either]
    }

    /// The lines of a splat at this hot position. Any words give some or none.
    pub fn of_words(words: ClipWords, hot: [u32; 3], grain: Grain) -> Self {
        let [a, b, c, d] = words;
        let first = ClipLine::of_words([a, b], hot, grain);
        let second = first.and_then(|_| ClipLine::of_words([c, d], hot, grain));
        Self { lines: [first, second], either: second.is_some() && d & EITHER != 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points around one in the middle of the lattice.
    fn about(middle: [f64; 3], reach: f64) -> impl Strategy<Value = [f64; 3]> {
        [0, 1, 2].map(|i| middle[i] - reach..middle[i] + reach)
    }

    const MIDDLE: [f64; 3] = [2.1e9, 1.7e9, 2.5e9];

    proptest! {
        #[test]
        fn two_splats_of_a_pair_share_their_line_to_the_bit(
            first in about(MIDDLE, 4000.0), second in about(MIDDLE, 4000.0),
            splats in [about(MIDDLE, 3000.0), about(MIDDLE, 3000.0)], dropped in [0u8..8, 0u8..8],
        ) {
            let grain = Grain::new([0.001, 0.001, 0.0005]);
            prop_assert_eq!(grain.0, [0, 0, 1]);
            let hot = |i: usize| splats[i].map(|c| c as u32 >> dropped[i] << dropped[i]);
            let line = |a, b| ClipLine::through(a, b, grain).unwrap();
            let clip = |line| Clip { lines: [Some(line), None], either: false };
            let pair = [line(first, second), line(second, first)];
            let words = [0, 1].map(|i| clip(pair[i]).words(hot(i), grain));
            prop_assume!(!words.contains(&[0; 4]));
            let [a, b] = [0, 1].map(|i| Clip::of_words(words[i], hot(i), grain).lines[0].unwrap());
            prop_assert_eq!((a.from, a.along), (b.from, b.along));
            prop_assert_eq!(a.keeps_right, !b.keeps_right);
            // Within half a unit of the requested line, at both ends.
            let unit = f64::from(1u32 << a.unit_log2);
            let ends = [a.from.map(f64::from), [0, 1, 2].map(|i| f64::from(a.from[i]) + f64::from(a.along[i]))];
            let [low, high] = if a.keeps_right { [second, first] } else { [first, second] };
            for (end, wanted) in ends.iter().zip([low, high]) {
                for i in 0..3 {
                    prop_assert!((end[i] - wanted[i]).abs() <= unit * f64::from(1u32 << grain.0[i]) * 0.500_001);
                }
            }
        }

        #[test]
        fn any_words_are_lines_or_none(words: [u32; 4], hot: [u32; 3], grain in [0u8..=16, 0u8..=16, 0u8..=16]) {
            let clip = Clip::of_words(words, hot, Grain(grain));
            prop_assert!(clip.lines.iter().flatten().all(|l| l.along != [0; 3]));
            if clip.lines[1].is_some() {
                prop_assert!(clip.lines[0].is_some());
            }
        }
    }

    #[test]
    fn both_lines_and_how_they_join_come_back() {
        let (grain, hot) = (Grain::default(), [1 << 31; 3]);
        let at = |x: f64, y: f64| [x, y, 0.0].map(|c| c + f64::from(1u32 << 31));
        let line = |a, b| ClipLine::through(a, b, grain);
        let lines = [line(at(0.0, -30.0), at(0.0, 30.0)), line(at(40.0, 1.0), at(-40.0, 1.0))];
        for either in [false, true] {
            let clip = Clip { lines, either };
            assert_eq!(Clip::of_words(clip.words(hot, grain), hot, grain), clip);
        }
        assert_eq!(lines.map(|l| l.unwrap().keeps_right), [false, true]);
        assert!(Clip::of_words([0; 4], hot, grain).is_none());
    }

    #[test]
    fn a_line_out_of_reach_is_left_out_and_either_takes_both_along() {
        let (grain, hot) = (Grain::default(), [1 << 31; 3]);
        let at = |x: f64, y: f64| [x, y, 0.0].map(|c| c + f64::from(1u32 << 31));
        let near = ClipLine::through(at(0.0, -30.0), at(0.0, 30.0), grain);
        let far = ClipLine::through(at(900.0, -30.0), at(900.0, 30.0), grain);
        let both = Clip { lines: [far, near], either: false };
        let left = Clip::of_words(both.words(hot, grain), hot, grain);
        assert_eq!(left.lines, [near, None]);
        assert_eq!(Clip { either: true, ..both }.words(hot, grain), [0; 4]);
        assert_eq!(ClipLine::through(at(0.0, 0.1), at(0.2, 0.0), grain), None, "one point");
        assert_eq!(ClipLine::through([-900.0; 3], [5.0; 3], grain), None, "off the lattice");
        assert_eq!(ClipLine::through([f64::NAN; 3], [5.0; 3], grain), None);
    }
}
