//! Conditions on the classification flags of LAS: withheld, synthetic, key point, overlap. Files of
//! LAS 1.0 to 1.3 mark overlap and key points as classes 12 and 8 as well, which count as the flag.

use super::condition::FilterError;
use std::fmt;
use std::str::FromStr;

/// Names of the flags, with their bits in the attribute `flags` and the class that older files
/// have instead.
const NAMED: [(&str, u8, Option<u8>); 4] = [
    ("synthetic", 1, None),
    ("key-point", 1 << 1, Some(8)),
    ("withheld", 1 << 2, None),
    ("overlap", OVERLAP, Some(12)),
];
/// Bit of the overlap flag.
const OVERLAP: u8 = 1 << 3;

/// A set of classification flags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(u8);

impl Flags {
    /// The overlap flag alone.
    pub(super) const OVERLAP: Self = Self(OVERLAP);

    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Names of the flags whose bits the attribute `flags` of a point has.
    pub fn names_of(bits: u8) -> impl Iterator<Item = &'static str> {
        NAMED.iter().filter(move |(_, bit, _)| bits & bit != 0).map(|(name, ..)| *name)
    }

    /// Whether a point has any of these flags, by its flags and its class, if it has them.
    pub fn any(self, flags: Option<u8>, class: Option<u8>) -> bool {
        let by_class = |&(_, bit, older): &(_, u8, Option<u8>)| {
            self.0 & bit != 0 && older.is_some() && older == class
        };
        flags.unwrap_or(0) & self.0 != 0 || NAMED.iter().any(by_class)
    }
}

impl FromStr for Flags {
    type Err = FilterError;

    /// Parses `withheld,overlap`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let mut flags = Self::default();
        for part in text.split(',').map(str::trim) {
            let named = NAMED.iter().find(|(name, ..)| name.eq_ignore_ascii_case(part));
            let (_, bit, _) = named.ok_or_else(|| {
                let names = NAMED.map(|(name, ..)| name).join(", ");
                FilterError(format!("`{part}` is no flag: {names}"))
            })?;
            flags.0 |= bit;
        }
        Ok(flags)
    }
}

impl fmt::Display for Flags {
    /// Writes the flags as they are parsed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = NAMED.iter().filter(|(_, bit, _)| self.0 & bit != 0).map(|(name, ..)| *name);
        f.write_str(&names.collect::<Vec<_>>().join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_parsed_and_older_classes_count() {
        let flags: Flags = "Withheld, overlap".parse().unwrap();
        assert!(flags.any(Some(0b0100), None) && flags.any(Some(0b1000), Some(2)));
        assert!(flags.any(Some(0), Some(12)) && flags.any(None, Some(12)));
        // Synthetic, the scan direction, key points and other classes are not among them.
        assert!(!flags.any(Some(0b0100_0011), Some(8)) && !flags.any(None, None));
        assert_eq!(
            (flags.to_string().as_str(), flags.to_string().parse()),
            ("withheld,overlap", Ok(flags))
        );
        assert!("key-point".parse::<Flags>().unwrap().any(None, Some(8)));
        for wrong in ["", "hidden", "withheld,"] {
            let error = wrong.parse::<Flags>().unwrap_err().to_string();
            assert!(error.contains("is no flag: synthetic, key-point"), "{error}");
        }
    }
}
