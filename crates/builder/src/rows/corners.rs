//! Maps by the corners of cells, with a fast hash: it is computed for every point of an unordered
//! scan.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Values by the corners of cells, as numbers.
pub type CornerMap<T> = HashMap<u128, T, BuildHasherDefault<CornerHasher>>;

/// The corner of a cell as a number.
pub fn key([x, y, z]: [u32; 3]) -> u128 {
    u128::from(x) | u128::from(y) << 32 | u128::from(z) << 64
}

/// The corner that is a number.
pub fn corner(key: u128) -> [u32; 3] {
    [0, 32, 64].map(|shift| (key >> shift) as u32)
}

/// Hash of a corner.
#[derive(Default)]
pub struct CornerHasher(u64);

impl Hasher for CornerHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u128(b.into()));
    }

    fn write_u128(&mut self, corner: u128) {
        // Odd numbers without a pattern: the fraction of the golden ratio, and the prime of FNV.
        let mixed = (self.0 ^ corner as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ ((corner >> 64) as u64).wrapping_mul(0x0100_0000_01b3);
        self.0 = (mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(26);
    }
}
