//! The object of a job that builds parts: for each part its pages, then its record; behind them, as
//! the tail, the places of all these.

use crate::rows::journal_record::{Kind, Record, unsealed};
use std::ops::Range;

/// Places in the object of a job, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BuiltPart {
    /// The pages of a part, in the order of the file.
    pub pages: Range<u64>,
    /// Its record.
    pub record: Range<u64>,
}

/// The tail of the object with these parts.
pub fn seal_parts(parts: &[BuiltPart]) -> Vec<u8> {
    let mut record = Record::new(Kind::Built);
    let places = parts
        .iter()
        .map(|BuiltPart { pages, record }| [pages.start, pages.end, record.start, record.end]);
    record.put_all(&places.collect::<Vec<[u64; 4]>>());
    record.seal()
}

/// Reads the tail; `None` if it is damaged, or places lie behind `end`.
pub fn unsealed_parts(tail: &[u8], end: u64) -> Option<Vec<BuiltPart>> {
    let places: Vec<[u64; 4]> = unsealed(tail, Kind::Built)?.get_all()?;
    let is_sound = |at: &[u64; 4]| at.is_sorted() && at[3] <= end;
    let part = |[a, b, c, d]: [u64; 4]| BuiltPart { pages: a..b, record: c..d };
    places.iter().all(is_sound).then(|| places.into_iter().map(part).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_read_back_and_damaged_ones_are_refused() {
        let parts = vec![
            BuiltPart { pages: 0..640, record: 640..700 },
            BuiltPart { pages: 700..764, record: 764..900 },
        ];
        let tail = seal_parts(&parts);
        assert_eq!(unsealed_parts(&tail, 900), Some(parts));
        assert_eq!(unsealed_parts(&tail, 899), None);
        for at in 0..tail.len() {
            let mut damaged = tail.clone();
            damaged[at] ^= 1;
            assert_eq!(unsealed_parts(&damaged, 900), None, "{at}");
            assert_eq!(unsealed_parts(&tail[..at], 900), None, "{at}");
        }
    }
}
