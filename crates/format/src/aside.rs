//! Points that are kept beside the tree: those far from nearly all others, which the lattice does
//! not hold. The metadata list them exactly, with a hash of their own (`data-format/SPEC.md`).

use crate::error::Fault;
use crate::strict::objects;
use esker_points::MultisetHash;
use serde::{Deserialize, Serialize};

/// Greatest number of points that a file keeps beside its tree.
pub const SET_ASIDE_MAX: usize = 1 << 16;

/// A point that is kept beside the tree.
#[derive(Clone, Debug, PartialEq)]
pub struct SetAside {
    /// Index of its source.
    pub source: u32,
    /// World coordinates, finite.
    pub place: [f64; 3],
    /// Values of the attributes of its source's class, in the order of the schema, little-endian.
    pub values: Vec<u8>,
}

impl SetAside {
    /// Adds the point to a hash: the bytes of its coordinates (`f64`) and its values, under the
    /// seed of its class.
    pub fn add_to(&self, hash: &mut MultisetHash, seed: u64) {
        let mut record: Vec<u8> = self.place.iter().flat_map(|c| c.to_le_bytes()).collect();
        record.extend_from_slice(&self.values);
        hash.add(seed, &record);
    }
}

/// The list in JSON.
#[derive(Serialize, Deserialize)]
pub(crate) struct SetAsideJson {
    hash: String,
    #[serde(deserialize_with = "objects")]
    points: Vec<PointJson>,
}

#[derive(Serialize, Deserialize)]
struct PointJson {
    source: u32,
    place: [f64; 3],
    /// Hexadecimal.
    values: String,
}

impl SetAsideJson {
    /// The list of `points` with this hash; `None` if it is empty.
    pub(crate) fn of(points: &[SetAside], hash: MultisetHash) -> Option<Self> {
        let point = |p: &SetAside| PointJson {
            source: p.source,
            place: p.place,
            values: p.values.iter().map(|byte| format!("{byte:02x}")).collect(),
        };
        (!points.is_empty())
            .then(|| Self { hash: hash.to_string(), points: points.iter().map(point).collect() })
    }

    /// The points, and the hash that they should have.
    pub(crate) fn points(self) -> Result<(Vec<SetAside>, String), Fault> {
        if self.points.len() > SET_ASIDE_MAX {
            return Err(Fault::new("metadata", "more points are set aside than a file can have"));
        }
        let point = |p: PointJson| {
            let values = bytes(&p.values)
                .ok_or_else(|| Fault::new("metadata", "a value of a point is not hexadecimal"))?;
            Ok(SetAside { source: p.source, place: p.place, values })
        };
        Ok((self.points.into_iter().map(point).collect::<Result<_, Fault>>()?, self.hash))
    }
}

/// The bytes of hexadecimal digits.
fn bytes(digits: &str) -> Option<Vec<u8>> {
    let (pairs, rest) = digits.as_bytes().as_chunks::<2>();
    let digit = |c: u8| match c {
        b'0'..=b'9' => Some(c - b'0'),
        b'a'..=b'f' => Some(c - b'a' + 10),
        _ => None,
    };
    let pairs = pairs.iter().map(|&[high, low]| Some(digit(high)? << 4 | digit(low)?));
    rest.is_empty().then(|| pairs.collect::<Option<_>>())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pairs_of_lower_case_digits_are_bytes() {
        assert_eq!(bytes("00ff7a"), Some(vec![0, 255, 0x7a]));
        assert_eq!(bytes(""), Some(vec![]));
        for wrong in ["0", "0g", "FF", "é"] {
            assert_eq!(bytes(wrong), None, "{wrong}");
        }
    }
}
