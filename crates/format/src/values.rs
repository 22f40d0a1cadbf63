//! Columns of raw values, interpreted in their own type: least and greatest value, and bins of a
//! histogram. Loops run over plain slices in lanes, so that they are vectorised.

use crate::codec::is_constant;
use crate::layout::PageLayout;
use crate::points::PagePoints;
use esker_points::AttrType;

/// Bins of a histogram.
pub const BINS: usize = 256;
/// Values that are processed in step.
const LANES: usize = 16;

/// Raw values of an attribute of the points that have it: the column itself if all do, otherwise a
/// copy in `scratch`.
pub(crate) fn present<'a>(
    layout: &PageLayout,
    points: &'a PagePoints,
    attribute: usize,
    scratch: &'a mut Vec<u8>,
) -> &'a [u8] {
    let classes = layout.classes().len();
    let column = points.columns[attribute].as_slice();
    let has = |class: usize| layout.has_attribute(class, attribute);
    if classes > 0 && (0..classes).all(has) {
        return column;
    }
    scratch.clear();
    if (0..classes).any(has) {
        let values = column.chunks_exact(layout.schema().attributes[attribute].ty.size());
        for (i, value) in values.enumerate() {
            if has(points.class(i)) {
                scratch.extend_from_slice(value);
            }
        }
    }
    scratch
}

/// A number as stored in a column.
trait Value<const BYTES: usize>: Copy {
    /// Least and greatest of no values.
    const NONE: (Self, Self);
    fn of(bytes: [u8; BYTES]) -> Self;
    fn bytes(self) -> [u8; BYTES];
    /// The value itself if it is finite, otherwise NaN.
    fn finite(self) -> Self;
    /// The lesser value; `self` if the other is NaN.
    fn least(self, other: Self) -> Self;
    /// The greater value; `self` if the other is NaN.
    fn greatest(self, other: Self) -> Self;
    /// The value as `f64`; 64-bit integers round.
    fn real(self) -> f64;
}

macro_rules! value {
    ($t:ty, $none:expr, $finite:expr) => {
        impl Value<{ size_of::<$t>() }> for $t {
            const NONE: (Self, Self) = $none;
            fn of(bytes: [u8; size_of::<$t>()]) -> Self {
                Self::from_le_bytes(bytes)
            }
            fn bytes(self) -> [u8; size_of::<$t>()] {
                self.to_le_bytes()
            }
            fn finite(self) -> Self {
                let finite: fn(Self) -> Self = $finite;
                finite(self)
            }
            fn least(self, other: Self) -> Self {
                if other < self { other } else { self }
            }
            fn greatest(self, other: Self) -> Self {
                if other > self { other } else { self }
            }
            fn real(self) -> f64 {
                self as f64
            }
        }
    };
    ($($t:ty)*) => { $(value!($t, (<$t>::MAX, <$t>::MIN), |v| v);)* };
}
value!(u8 i8 u16 i16 u32 i32 u64 i64);
// Zero times infinity is NaN.
value!(f32, (f32::INFINITY, f32::NEG_INFINITY), |v| v + 0.0 * v);
value!(f64, (f64::INFINITY, f64::NEG_INFINITY), |v| v + 0.0 * v);

/// Calls a function that is generic over the type of a column's values.
macro_rules! by_type {
    ($ty:expr, $function:ident($($argument:expr),*)) => {
        match $ty {
            AttrType::U8 => $function::<u8, 1>($($argument),*),
            AttrType::I8 => $function::<i8, 1>($($argument),*),
            AttrType::U16 => $function::<u16, 2>($($argument),*),
            AttrType::I16 => $function::<i16, 2>($($argument),*),
            AttrType::U32 => $function::<u32, 4>($($argument),*),
            AttrType::I32 => $function::<i32, 4>($($argument),*),
            AttrType::U64 => $function::<u64, 8>($($argument),*),
            AttrType::I64 => $function::<i64, 8>($($argument),*),
            AttrType::F32 => $function::<f32, 4>($($argument),*),
            AttrType::F64 => $function::<f64, 8>($($argument),*),
        }
    };
}

fn range_of<T: Value<N>, const N: usize>(column: &[u8], finite: bool) -> (T, T) {
    let (mut least, mut greatest) = ([T::NONE.0; LANES], [T::NONE.1; LANES]);
    let (rows, rest) = column.as_chunks::<N>().0.as_chunks::<LANES>();
    for row in rows {
        for lane in 0..LANES {
            let v = T::of(row[lane]);
            let v = if finite { v.finite() } else { v };
            least[lane] = least[lane].least(v);
            greatest[lane] = greatest[lane].greatest(v);
        }
    }
    for &bytes in rest {
        let v = T::of(bytes);
        let v = if finite { v.finite() } else { v };
        least[0] = least[0].least(v);
        greatest[0] = greatest[0].greatest(v);
    }
    (least.into_iter().fold(T::NONE.0, T::least), greatest.into_iter().fold(T::NONE.1, T::greatest))
}

fn raw_range_of<T: Value<N>, const N: usize>(column: &[u8]) -> [[u8; 8]; 2] {
    let (least, greatest) = range_of::<T, N>(column, false);
    [least, greatest].map(|v| {
        let mut raw = [0; 8];
        raw[..N].copy_from_slice(&v.bytes());
        raw
    })
}

/// Least and greatest value, raw. NaN is ignored; of no values the least is the type's greatest.
pub(crate) fn raw_range(ty: AttrType, column: &[u8]) -> [[u8; 8]; 2] {
    by_type!(ty, raw_range_of(column))
}

fn finite_range_of<T: Value<N>, const N: usize>(column: &[u8]) -> (f64, f64) {
    let (least, greatest) = range_of::<T, N>(column, true);
    // -0 is +0.
    (least.real() + 0.0, greatest.real() + 0.0)
}

/// Least and greatest finite value; the least is above the greatest if there is none.
pub(crate) fn finite_range(ty: AttrType, column: &[u8]) -> (f64, f64) {
    if column.len() < ty.size() {
        return (f64::INFINITY, f64::NEG_INFINITY);
    }
    by_type!(ty, finite_range_of(column))
}

/// Bins of a range: [`BINS`] of equal width. Computed with halves, so that the widest range does
/// not overflow.
#[derive(Clone, Copy)]
pub(crate) struct Bins {
    least: f64,
    greatest: f64,
    half_least: f64,
    bins_per_half: f64,
}

impl Bins {
    pub fn new(least: f64, greatest: f64) -> Self {
        let bins_per_half = BINS as f64 / (greatest * 0.5 - least * 0.5);
        Self { least, greatest, half_least: least * 0.5, bins_per_half }
    }

    /// Bin of a value; [`BINS`] for a value outside the range or NaN.
    pub fn of(&self, v: f64) -> usize {
        if !(v >= self.least && v <= self.greatest) {
            return BINS;
        }
        // Zero times infinity, if there is only one value, is NaN, which becomes 0.
        let bin = ((v * 0.5 - self.half_least) * self.bins_per_half) as u32;
        bin.min(BINS as u32 - 1) as usize
    }

    /// Number of values in each bin.
    pub fn counts(&self, ty: AttrType, column: &[u8]) -> [u64; BINS] {
        if is_constant(column, ty.size()) {
            let mut counts = [0; BINS + 1];
            counts[self.of(ty.to_f64(column))] = (column.len() / ty.size()) as u64;
            return within(counts);
        }
        if ty.size() > 1 {
            return by_type!(ty, counts_of(self, column));
        }
        let mut counts = [0; BINS + 1];
        for (byte, n) in (0..=255u8).zip(count_bytes(column)) {
            counts[self.of(ty.to_f64(&[byte]))] += n;
        }
        within(counts)
    }
}

fn counts_of<T: Value<N>, const N: usize>(bins: &Bins, column: &[u8]) -> [u64; BINS] {
    // Several tables, since neighbours often fall into one bin, and each count depends on the
    // previous one.
    let mut tables = [[0u32; BINS + 1]; 4];
    let (rows, rest) = column.as_chunks::<N>().0.as_chunks::<4>();
    for row in rows {
        for lane in 0..4 {
            tables[lane][bins.of(T::of(row[lane]).real())] += 1;
        }
    }
    rest.iter().for_each(|&bytes| tables[0][bins.of(T::of(bytes).real())] += 1);
    within(sum(&tables))
}

fn sum<const N: usize>(tables: &[[u32; N]; 4]) -> [u64; N] {
    std::array::from_fn(|i| tables.iter().map(|t| u64::from(t[i])).sum())
}

fn within(counts: [u64; BINS + 1]) -> [u64; BINS] {
    std::array::from_fn(|i| counts[i])
}

/// Number of occurrences of each byte.
pub(crate) fn count_bytes(bytes: &[u8]) -> [u64; 256] {
    let mut tables = [[0u32; 256]; 4];
    let (rows, rest) = bytes.as_chunks::<4>();
    for row in rows {
        for lane in 0..4 {
            tables[lane][usize::from(row[lane])] += 1;
        }
    }
    rest.iter().for_each(|&byte| tables[0][usize::from(byte)] += 1);
    sum(&tables)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_value_or_the_widest_range_fill_bins_that_exist() {
        assert_eq!(Bins::new(5.0, 5.0).of(5.0), 0);
        let widest = Bins::new(f64::MIN, f64::MAX);
        assert_eq!([f64::MIN, 0.0, f64::MAX].map(|v| widest.of(v)), [0, 128, 255]);
        assert_eq!([f64::NAN, f64::INFINITY].map(|v| widest.of(v)), [BINS; 2]);
        let least = Bins::new(0.0, f64::from_bits(1));
        assert!(least.of(0.0) < BINS && least.of(f64::from_bits(1)) < BINS);
    }

    proptest! {
        #[test]
        fn ranges_and_counts_are_those_of_a_plain_loop(
            column in prop::collection::vec(any::<u8>(), 0..600), narrow: bool,
            runs in 0usize..3,
        ) {
            // Also runs of one value, including NaN.
            let column = match runs {
                0 => column,
                1 => column.repeat(3),
                _ => [&[255; 64][..], &vec![7; column.len()]].concat(),
            };
            use AttrType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
            for ty in [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64] {
                let values = || column.chunks_exact(ty.size()).map(|v| ty.to_f64(v) + 0.0);
                let fold = |f: fn(f64, f64) -> f64, keep: fn(&f64) -> bool| {
                    values().filter(keep).reduce(f)
                };
                let [least, greatest] = raw_range(ty, &column).map(|v| ty.to_f64(&v) + 0.0);
                let range = fold(f64::min, |v| !v.is_nan()).zip(fold(f64::max, |v| !v.is_nan()));
                prop_assert_eq!((least <= greatest).then_some((least, greatest)), range);
                let (least, greatest) = finite_range(ty, &column);
                let range = fold(f64::min, |v| v.is_finite()).zip(fold(f64::max, |v| v.is_finite()));
                prop_assert_eq!((least <= greatest).then_some((least, greatest)), range);
                let bins = Bins::new(least, if narrow { least / 2.0 + greatest / 2.0 } else { greatest });
                let mut counts = [0; BINS + 1];
                values().for_each(|v| counts[bins.of(v)] += 1);
                prop_assert_eq!(&bins.counts(ty, &column)[..], &counts[..BINS]);
            }
        }
    }
}
