//! Set of wanted ASPRS classes: parsed from numbers, ranges and names, stored as one bit each.

use super::condition::{FilterError, Side};
use std::fmt;
use std::str::FromStr;

/// Names of the classes of LAS 1.4 R15, table 17, from class 0 on.
const NAMES: [&str; 23] = [
    "never-classified",
    "unclassified",
    "ground",
    "low-vegetation",
    "medium-vegetation",
    "high-vegetation",
    "building",
    "low-noise",
    "model-key-point",
    "water",
    "rail",
    "road",
    "overlap",
    "wire-guard",
    "wire-conductor",
    "tower",
    "wire-connector",
    "bridge",
    "high-noise",
    "overhead-structure",
    "ignored-ground",
    "snow",
    "temporal-exclusion",
];

/// Name that stands for a class and a flag.
const OVERLAP: &str = "overlap";
/// Class that the name stands for, too.
const OVERLAP_CLASS: u8 = 12;

/// A set of classes: class `c` is bit `c % 64` of word `c / 64`; and whether it has all points with
/// the flag of overlap, which newer files have in place of class 12.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Classes([u64; 4], bool);

impl Classes {
    /// Name of a class in LAS 1.4 R15; `None` for reserved and user-defined classes.
    pub fn name(class: u8) -> Option<&'static str> {
        NAMES.get(usize::from(class)).copied()
    }

    /// Whether a class is in the set.
    pub fn has(&self, class: u8) -> bool {
        self.0[usize::from(class >> 6)] >> (class & 63) & 1 == 1
    }

    /// Whether points with the flag of overlap are in the set, whatever their class.
    pub fn has_overlap(self) -> bool {
        self.1
    }

    /// Adds a class, or removes it.
    pub fn set(&mut self, class: u8, is_wanted: bool) {
        let word = &mut self.0[usize::from(class >> 6)];
        let bit = 1 << (class & 63);
        *word = if is_wanted { *word | bit } else { *word & !bit };
    }

    /// Side of a node whose points have these classes.
    pub(super) fn side_of(&self, bits: [u64; 4]) -> Side {
        if (0..4).all(|i| bits[i] & self.0[i] == 0) {
            Side::Outside
        } else if (0..4).all(|i| bits[i] & !self.0[i] == 0) {
            Side::Inside
        } else {
            Side::Across
        }
    }
}

impl FromStr for Classes {
    type Err = FilterError;

    /// Parses `2,6`, `3-5`, `ground,building`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let mut classes = Self::default();
        for part in text.split(',').map(str::trim) {
            let number = |word: &str| {
                let named = NAMES.iter().position(|n| n.eq_ignore_ascii_case(word));
                named.map(|n| n as u8).or_else(|| word.parse().ok())
            };
            let range = number(part).map(|n| (n, n)).or_else(|| {
                let (from, to) = part.split_once('-')?;
                Some((number(from)?, number(to)?)).filter(|(from, to)| from <= to)
            });
            let (from, to) = range.ok_or_else(|| {
                let names = NAMES.join(", ");
                FilterError(format!(
                    "`{part}` is no class: 0 to 255, a range such as 3-5, or {names}"
                ))
            })?;
            (from..=to).for_each(|c| classes.set(c, true));
            classes.1 |= part.eq_ignore_ascii_case(OVERLAP);
        }
        Ok(classes)
    }
}

impl fmt::Display for Classes {
    /// Writes the classes as they are parsed: ranges of numbers, and `overlap` where it is meant.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        let mut wanted = *self;
        if self.1 {
            parts.push(OVERLAP.to_owned());
            wanted.0[0] &= !(1 << OVERLAP_CLASS);
        }
        let mut class = 0u16;
        while class <= 255 {
            let run = (class..=255).take_while(|&c| wanted.has(c as u8)).count() as u16;
            match run {
                0 => {}
                1 => parts.push(class.to_string()),
                _ => parts.push(format!("{class}-{}", class + run - 1)),
            }
            class += run + 1;
        }
        f.write_str(&parts.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_ranges_and_names_are_read() {
        let classes: Classes = "2, Building,64-66,255".parse().unwrap();
        let found: Vec<u8> = (0..=255).filter(|&c| classes.has(c)).collect();
        assert_eq!(found, [2, 6, 64, 65, 66, 255]);
        assert!(!classes.has_overlap());
        let mut fewer = classes;
        fewer.set(65, false);
        fewer.set(7, true);
        let found: Vec<u8> = (0..=255).filter(|&c| fewer.has(c)).collect();
        assert_eq!(found, [2, 6, 7, 64, 66, 255]);
        let overlap: Classes = "overlap".parse().unwrap();
        assert!(overlap.has(12) && overlap.has_overlap());
        assert!(!"12".parse::<Classes>().unwrap().has_overlap());
        for wrong in ["", "2,", "256", "trees", "5-3", "-1"] {
            assert!(
                wrong.parse::<Classes>().unwrap_err().to_string().contains("no class"),
                "{wrong}"
            );
        }
    }

    #[test]
    fn classes_are_written_as_they_are_read() {
        for (text, written) in [
            ("2, Building,64-66,255", "2,6,64-66,255"),
            ("overlap,11-13", "overlap,11,13"),
            ("12", "12"),
            ("0-255", "0-255"),
        ] {
            let classes: Classes = text.parse().unwrap();
            assert_eq!(classes.to_string(), written);
            assert_eq!(written.parse(), Ok(classes));
        }
    }

    #[test]
    fn class_bits_decide_the_side_of_a_node() {
        let classes: Classes = "2,200".parse().unwrap();
        let bits = |classes: &str| classes.parse::<Classes>().unwrap().0;
        assert_eq!(classes.side_of(bits("2")), Side::Inside);
        assert_eq!(classes.side_of(bits("2,200")), Side::Inside);
        assert_eq!(classes.side_of(bits("1,200")), Side::Across);
        assert_eq!(classes.side_of(bits("1,199")), Side::Outside);
    }
}
