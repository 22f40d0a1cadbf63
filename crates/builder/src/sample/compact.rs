//! Branch-free compaction: lists the indices of items that satisfy a predicate, 64 at a time. Where
//! the predicate is as good as random, a branch would be mispredicted every second time.

/// Number of items tested together.
pub const GROUP: usize = 64;

/// Returns the indices of the items that match.
pub fn indices_of<T>(items: &[T], matches: impl Fn(&T) -> bool) -> Vec<u32> {
    let mut indices = Vec::new();
    for (start, items) in (0..).step_by(GROUP).zip(items.chunks(GROUP)) {
        push_indices(start, mask_of(items, &matches), &mut indices);
    }
    indices
}

/// Returns a bit for each of up to [`GROUP`] items.
#[inline(always)]
pub fn mask_of<T>(items: &[T], matches: impl Fn(&T) -> bool) -> u64 {
    let mut bytes = [0; GROUP];
    bytes.iter_mut().zip(items).for_each(|(byte, item)| *byte = u8::from(matches(item)));
    let sixteen = bytes.as_chunks::<16>().0.iter().rev().map(|bytes| {
        let signs = wide::u8x16::from(*bytes).simd_eq(wide::u8x16::splat(1));
        u64::from(signs.to_bitmask())
    });
    sixteen.fold(0, |bits, sixteen| bits << 16 | sixteen)
}

/// Appends the indices, from `start` on, of the bits that are set.
#[inline(always)]
pub fn push_indices(start: u32, mut bits: u64, to: &mut Vec<u32>) {
    let mut indices = [0; GROUP];
    let count = bits.count_ones() as usize;
    for index in &mut indices[..count] {
        *index = start + bits.trailing_zeros();
        bits &= bits - 1;
    }
    to.extend_from_slice(&indices[..count]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn indices_are_those_of_a_filter(items in prop::collection::vec(0u8..9, 0..300), least in 0u8..9) {
            let filtered = (0..).zip(&items).filter(|(_, v)| **v >= least).map(|(i, _)| i);
            prop_assert_eq!(indices_of(&items, |v| *v >= least), filtered.collect::<Vec<u32>>());
        }
    }
}
