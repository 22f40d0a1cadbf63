//! Names of systems of heights: which names, or numbers, mean the same system, however writers of
//! files spell them. Serves the comparison of systems whose heights have no EPSG number.

/// Names of common vertical systems in the EPSG register: files that give the number alone are
/// compared by them with those that give the name alone.
const VERTICAL_NAMES: [(u32, &str); 20] = [
    (3855, "EGM2008"),
    (5613, "RH2000"),
    (5621, "EVRF2007"),
    (5701, "ODN"),
    (5702, "NGVD29"),
    (5703, "NAVD88"),
    (5709, "NAP"),
    (5710, "Ostend"),
    (5711, "AHD"),
    (5720, "NGF-IGN69"),
    (5721, "NGF-IGN78"),
    (5728, "LN02"),
    (5729, "LHN95"),
    (5773, "EGM96"),
    (5778, "GHA"),
    (5783, "DHHN92"),
    (5799, "DVR90"),
    (5941, "NN2000"),
    (6360, "NAVD88"),
    (7837, "DHHN2016"),
];

/// Name of a vertical system in lower-case letters and digits, without what writers add to it: the
/// word for heights, the geoid, units in brackets. `None` if it means nothing.
pub(super) fn plain_name(name: &str) -> Option<String> {
    let name = name.split(['(', '[']).next().unwrap_or(name).to_lowercase();
    let words = name.split(|c: char| !c.is_alphanumeric());
    let is_added =
        |word: &&str| word.starts_with("height") || word.starts_with("geoid") || *word == "depth";
    let plain: String = words.filter(|word| !is_added(word)).collect();
    if plain.starts_with("ellipsoid") {
        return Some("ellipsoid".into());
    }
    let is_none = ["", "unknown", "unnamed", "none", "undefined", "userdefined", "vertcs"];
    (!is_none.contains(&plain.as_str())).then_some(plain)
}

/// Name of the vertical system of this number, if it is a common one.
pub(super) fn name_of_code(code: Option<u32>) -> Option<String> {
    let (_, name) = VERTICAL_NAMES.iter().find(|(number, _)| Some(*number) == code)?;
    plain_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_compared_without_what_writers_add() {
        for (name, want) in [
            ("NAVD88 height - Geoid12B (Meters)", Some("navd88")),
            ("NGF-IGN69 height", Some("ngfign69")),
            ("Ellipsoidal height", Some("ellipsoid")),
            ("Height", None),
            ("unknown", None),
        ] {
            assert_eq!(plain_name(name).as_deref(), want, "{name}");
        }
        assert_eq!(name_of_code(Some(5720)).as_deref(), Some("ngfign69"));
        assert_eq!((name_of_code(Some(1)), name_of_code(None)), (None, None));
    }
}
