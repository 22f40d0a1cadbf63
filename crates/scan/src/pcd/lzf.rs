//! Decompresses LZF (by Marc Lehmann), the compression of PCD: runs of literal bytes, and copies of
//! earlier output.

/// Greatest number of bytes that a copy, three bytes, can stand for; larger claims are refused.
pub(crate) const BYTES_A_COPY: u64 = 264;

/// Decompresses exactly `bytes` bytes; `None` if `packed` is damaged.
pub(crate) fn unpack(packed: &[u8], bytes: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(bytes);
    let mut packed = packed;
    let next = |packed: &mut &[u8]| packed.split_off_first().map(|&byte| usize::from(byte));
    while let Some(control) = next(&mut packed) {
        if control < 32 {
            out.extend_from_slice(packed.split_off(..control + 1)?);
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                length += next(&mut packed)?;
            }
            let back = ((control & 31) << 8 | next(&mut packed)?) + 1;
            let from = out.len().checked_sub(back)?;
            if back >= length {
                out.extend_from_within(from..from + length);
            } else {
                // A copy may overlap the bytes that it has just written.
                (from..from + length).for_each(|i| out.push(out[i]));
            }
        }
        if out.len() > bytes {
            return None;
        }
    }
    (out.len() == bytes).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Compresses with the shortest runs and the nearest copies, so that all codes of the format
    /// occur.
    pub fn pack(bytes: &[u8]) -> Vec<u8> {
        let (mut out, mut at, mut literal) = (Vec::new(), 0, Vec::new());
        let flush = |literal: &mut Vec<u8>, out: &mut Vec<u8>| {
            for run in literal.chunks(32) {
                out.push(run.len() as u8 - 1);
                out.extend_from_slice(run);
            }
            literal.clear();
        };
        while at < bytes.len() {
            let length_of = |from: usize| {
                (0..264.min(bytes.len() - at))
                    .take_while(|&i| bytes[from + i] == bytes[at + i])
                    .count()
            };
            let copy = (at.saturating_sub(8192)..at).map(|from| (length_of(from), from)).max();
            match copy {
                Some((length, from)) if length >= 3 => {
                    flush(&mut literal, &mut out);
                    let (back, code) = (at - from - 1, length - 2);
                    out.push((code.min(7) as u8) << 5 | (back >> 8) as u8);
                    if code >= 7 {
                        out.push((code - 7) as u8);
                    }
                    out.push(back as u8);
                    at += length;
                }
                _ => {
                    literal.push(bytes[at]);
                    at += 1;
                }
            }
        }
        flush(&mut literal, &mut out);
        out
    }

    proptest! {
        #[test]
        fn what_was_packed_comes_back(bytes in prop::collection::vec(0u8..4, 0..600), far in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut all = far.clone();
            all.extend(&bytes);
            all.extend(&far);
            prop_assert_eq!(unpack(&pack(&all), all.len()), Some(all));
        }

        #[test]
        fn damaged_bytes_are_refused_or_some_bytes(packed in prop::collection::vec(any::<u8>(), 0..200), bytes in 0usize..2000) {
            prop_assert!(unpack(&packed, bytes).is_none_or(|out| out.len() == bytes));
        }
    }

    #[test]
    fn what_is_too_long_or_too_short_is_refused() {
        let packed = pack(b"abcabcabcabcabcabcabcabc");
        assert!(unpack(&packed, 24).is_some());
        for (packed, bytes) in [(&packed[..], 23), (&packed, 25), (&packed[..packed.len() - 1], 24)]
        {
            assert_eq!(unpack(packed, bytes), None);
        }
        // A copy from before the beginning.
        assert_eq!(unpack(&[0, b'a', 0x20, 5], 4), None);
    }
}
