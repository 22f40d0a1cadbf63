//! Lists which of many are as asked, without a branch for each: where that is as good as chance, half the guesses of a processor
//! would go wrong.

/// How many are looked at together.
pub const TOGETHER: usize = 64;

/// The places of those that are as asked.
pub fn places_of<T>(of: &[T], is_so: impl Fn(&T) -> bool) -> Vec<u32> {
    let mut places = Vec::new();
    for (start, of) in (0..).step_by(TOGETHER).zip(of.chunks(TOGETHER)) {
        list(start, bits_of(of, &is_so), &mut places);
    }
    places
}

/// A bit for each of up to [`TOGETHER`].
#[inline(always)]
pub fn bits_of<T>(of: &[T], is_so: impl Fn(&T) -> bool) -> u64 {
    let mut bytes = [0; TOGETHER];
    bytes.iter_mut().zip(of).for_each(|(byte, of)| *byte = u8::from(is_so(of)));
    let sixteen = bytes.as_chunks::<16>().0.iter().rev().map(|bytes| {
        let signs = wide::u8x16::from(*bytes).simd_eq(wide::u8x16::splat(1));
        u64::from(signs.to_bitmask())
    });
    sixteen.fold(0, |bits, sixteen| bits << 16 | sixteen)
}

/// Adds the places, from `start` on, of the bits that are set.
#[inline(always)]
pub fn list(start: u32, mut bits: u64, to: &mut Vec<u32>) {
    let mut places = [0; TOGETHER];
    let count = bits.count_ones() as usize;
    for place in &mut places[..count] {
        *place = start + bits.trailing_zeros();
        bits &= bits - 1;
    }
    to.extend_from_slice(&places[..count]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn places_are_those_of_a_filter(of in prop::collection::vec(0u8..9, 0..300), least in 0u8..9) {
            let filtered = (0..).zip(&of).filter(|(_, v)| **v >= least).map(|(i, _)| i);
            prop_assert_eq!(places_of(&of, |v| *v >= least), filtered.collect::<Vec<u32>>());
        }
    }
}
