//! Attributes by the names that users give: exact names, names in any case, short names, and the
//! two numbers that share the byte of returns. Colours and filters find attributes alike by them.

use crate::attribute::{AttrType, names};
use crate::schema::Schema;

/// The number of a return, which shares a byte with the number of returns.
pub const RETURN_NUMBER: &str = "return_number";
/// The number of returns of a pulse.
pub const NUMBER_OF_RETURNS: &str = "number_of_returns";
/// Mask of either number.
pub const RETURN_NUMBER_MASK: u8 = 15;
/// Bits below the number of returns.
pub const NUMBER_OF_RETURNS_SHIFT: u8 = 4;

/// Short names of attributes.
const SHORT_NAMES: [(&str, &str); 6] = [
    ("class", names::CLASSIFICATION),
    ("source", names::POINT_SOURCE_ID),
    ("source_id", names::POINT_SOURCE_ID),
    ("time", names::GPS_TIME),
    // Files have the scan angle in steps, or in whole degrees.
    (names::SCAN_ANGLE, names::SCAN_ANGLE_RANK),
    (names::SCAN_ANGLE_RANK, names::SCAN_ANGLE),
];

/// Part of an attribute's values that a name stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// All of a value.
    #[default]
    Whole,
    /// The number of a return, of bytes of returns.
    ReturnNumber,
    /// The number of returns, of bytes of returns.
    ReturnCount,
}

impl Part {
    /// The part of a byte.
    pub fn of_byte(self, byte: u8) -> u8 {
        match self {
            Self::Whole => byte,
            Self::ReturnNumber => byte & RETURN_NUMBER_MASK,
            Self::ReturnCount => byte >> NUMBER_OF_RETURNS_SHIFT,
        }
    }
}

/// An attribute that a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedAttribute {
    /// Its index in the schema.
    pub index: usize,
    /// Part of its values.
    pub part: Part,
}

impl Schema {
    /// Finds the attribute that `name` stands for: by its exact name, in any case, or by its short
    /// name. `None` if there is none.
    pub fn find_named(&self, name: &str) -> Option<NamedAttribute> {
        let is = |other: &str| other.eq_ignore_ascii_case(name);
        let part = match name {
            _ if is("return") || is(RETURN_NUMBER) => Part::ReturnNumber,
            _ if is(NUMBER_OF_RETURNS) => Part::ReturnCount,
            _ => Part::Whole,
        };
        let returns = (part != Part::Whole).then(|| self.find(names::RETURNS)).flatten();
        if let Some(index) = returns {
            return Some(NamedAttribute { index, part });
        }
        let in_any_case = || self.attributes.iter().position(|a| is(&a.name));
        let short = || {
            let (_, full) = SHORT_NAMES.iter().find(|(short, _)| is(short))?;
            self.find(full)
        };
        let index = self.find(name).or_else(in_any_case).or_else(short)?;
        Some(NamedAttribute { index, part: Part::Whole })
    }

    /// Names of all attributes in the order of the schema, each once; both numbers of bytes of
    /// returns in place of their own name.
    pub fn names(&self) -> Vec<&str> {
        let mut all: Vec<&str> = Vec::new();
        for attribute in &self.attributes {
            match attribute.key() {
                (names::RETURNS, AttrType::U8) => all.extend([RETURN_NUMBER, NUMBER_OF_RETURNS]),
                (name, _) if all.contains(&name) => {}
                (name, _) => all.push(name),
            }
        }
        all
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;
    use crate::attribute::Attribute;

    #[test]
    fn names_are_found_exactly_in_any_case_and_in_short() {
        let attributes = [
            ("returns", AttrType::U8),
            ("scan_angle_rank", AttrType::I8),
            ("gps_time", AttrType::F64),
            ("Time", AttrType::F32),
        ];
        let schema = Schema::new(attributes.map(|(n, ty)| Attribute::new(n, ty)).into());
        let found = |name: &str| {
            let NamedAttribute { index, part } = schema.find_named(name)?;
            Some((schema.attributes[index].name.as_str(), part))
        };
        assert_eq!(found("gps_time"), Some(("gps_time", Part::Whole)));
        assert_eq!(found("GPS_Time"), Some(("gps_time", Part::Whole)));
        assert_eq!(found("time"), Some(("Time", Part::Whole)));
        assert_eq!(found("scan_angle"), Some(("scan_angle_rank", Part::Whole)));
        assert_eq!(found("Return"), Some(("returns", Part::ReturnNumber)));
        assert_eq!(found("number_of_returns"), Some(("returns", Part::ReturnCount)));
        assert_eq!(found("returns"), Some(("returns", Part::Whole)));
        assert_eq!(found("class"), None);
        let names = ["Time", "gps_time", "return_number", "number_of_returns", "scan_angle_rank"];
        assert_eq!(schema.names(), names);
        let own = Schema::new(vec![Attribute::new(RETURN_NUMBER, AttrType::U16)]);
        assert_eq!(own.find_named("return_number").unwrap().part, Part::Whole);
    }
}
