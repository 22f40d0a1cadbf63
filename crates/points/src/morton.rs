//! Morton codes: interleaved bits, so that points with near codes are near in space. Axis 0 has the
//! lowest bit of each group, so that the child `octant` of a cell is `x | y << 1 | z << 2`.

/// Interleaves three 32-bit coordinates into 96 bits.
pub fn encode3(p: [u32; 3]) -> u128 {
    let low =
        spread3(p[0] & 0x1f_ffff) | spread3(p[1] & 0x1f_ffff) << 1 | spread3(p[2] & 0x1f_ffff) << 2;
    let high = spread3(p[0] >> 21) | spread3(p[1] >> 21) << 1 | spread3(p[2] >> 21) << 2;
    u128::from(low) | u128::from(high) << 63
}

/// The inverse of [`encode3`].
pub fn decode3(code: u128) -> [u32; 3] {
    let low = (code & ((1 << 63) - 1)) as u64;
    let high = (code >> 63) as u64;
    [0, 1, 2].map(|axis| (gather3(low >> axis) | gather3(high >> axis) << 21) as u32)
}

/// Interleaves three coordinates of at most 21 bits into 63.
pub fn encode3_21(p: [u32; 3]) -> u64 {
    spread3(p[0]) | spread3(p[1]) << 1 | spread3(p[2]) << 2
}

/// Spreads 21 bits, with two zero bits between neighbours.
fn spread3(v: u32) -> u64 {
    let mut x = u64::from(v) & 0x1f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// The inverse of [`spread3`].
fn gather3(v: u64) -> u64 {
    let mut x = v & 0x1249_2492_4924_9249;
    x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    (x | x >> 32) & 0x1f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decoding_undoes_encoding(p: [u32; 3]) {
            prop_assert_eq!(decode3(encode3(p)), p);
        }

        #[test]
        fn codes_equal_bit_by_bit_interleaving(p: [u32; 3]) {
            let mut plain = 0u128;
            for bit in 0..32 {
                for (axis, c) in p.iter().enumerate() {
                    plain |= u128::from(c >> bit & 1) << (3 * bit + axis);
                }
            }
            prop_assert_eq!(encode3(p), plain);
            let small = p.map(|c| c & 0x1f_ffff);
            prop_assert_eq!(u128::from(encode3_21(small)), encode3(small));
        }
    }
}
