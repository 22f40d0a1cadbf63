//! The multiset hash: the sum modulo 2^128 of XXH3-128 over the raw record of each point. The order
//! of points does not matter, and duplicates count (XOR would cancel them). Attributes that a point
//! lacks are not hashed, so the hashes of parts add up to the hash of their union.
//!
//! A record is x, y, z of the lattice (`u32`) and the attributes that the point has, in canonical
//! order (name, then type), all little-endian. The seed is FNV-1a (64 bits) over the list of names
//! and types, each written `name:type\n`.

use crate::attribute::AttrType;
use std::fmt;
use std::ops::AddAssign;
use xxhash_rust::xxh3::xxh3_128_with_seed;

/// Commutative hash of a multiset of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MultisetHash(pub u128);

impl MultisetHash {
    /// Adds one point's raw record under its layout's seed.
    pub fn add(&mut self, seed: u64, record: &[u8]) {
        self.0 = self.0.wrapping_add(xxh3_128_with_seed(record, seed));
    }
}

impl AddAssign for MultisetHash {
    fn add_assign(&mut self, other: Self) {
        self.0 = self.0.wrapping_add(other.0);
    }
}

impl fmt::Display for MultisetHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

/// Seed for points that have exactly these attributes, given in canonical order.
pub fn layout_seed<'a>(attributes: impl IntoIterator<Item = (&'a str, AttrType)>) -> u64 {
    let mut seed = 0xcbf2_9ce4_8422_2325u64;
    let mut eat = |bytes: &[u8]| {
        for &b in bytes {
            seed = (seed ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for (name, ty) in attributes {
        eat(name.as_bytes());
        eat(b":");
        eat(ty.name().as_bytes());
        eat(b"\n");
    }
    seed
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn duplicates_do_not_cancel() {
        let mut once = MultisetHash::default();
        once.add(1, b"point");
        let mut twice = once;
        twice.add(1, b"point");
        assert_ne!(twice, MultisetHash::default());
        assert_ne!(twice, once);
    }

    #[test]
    fn name_and_type_boundaries_matter() {
        use AttrType::{U8, U16};
        assert_ne!(layout_seed([("a", U8)]), layout_seed([("a", U16)]));
        assert_ne!(layout_seed([("ab", U8)]), layout_seed([("a", U8), ("b", U8)]));
        assert_eq!(layout_seed([]), 0xcbf2_9ce4_8422_2325);
    }

    proptest! {
        #[test]
        fn order_and_grouping_do_not_matter(records in prop::collection::vec(prop::collection::vec(any::<u8>(), 12..40), 0..50), cut in 0usize..50) {
            let mut forward = MultisetHash::default();
            for r in &records { forward.add(7, r); }
            let cut = cut.min(records.len());
            let (mut a, mut b) = (MultisetHash::default(), MultisetHash::default());
            for r in records[..cut].iter().rev() { a.add(7, r); }
            for r in records[cut..].iter().rev() { b.add(7, r); }
            b += a;
            prop_assert_eq!(forward, b);
        }
    }
}
