//! Inputs of one file must be in one coordinate reference system, or their points would be at
//! wrong places. In: the systems that inputs state; out: an error that names two that differ.
//! An input that states no system is assumed to agree, and so are two with the same EPSG
//! codes in different notations.

use crate::error::BuildError;
use esker_scan::{EpsgCodes, epsg_codes};
use std::collections::HashSet;

/// Most characters of a system's name in messages.
const NAME_LETTERS: usize = 120;

/// A coordinate reference system as an input states it.
struct System<'a> {
    input: &'a str,
    text: &'a str,
    normalized: String,
    codes: Option<EpsgCodes>,
}

impl<'a> System<'a> {
    fn new(input: &'a str, text: &'a str) -> Self {
        Self { input, text, normalized: normalized(text), codes: epsg_codes(text) }
    }

    fn is_same(&self, other: &Self) -> bool {
        let agree = |codes: (&EpsgCodes, &EpsgCodes)| codes.0.agree(codes.1);
        self.normalized == other.normalized
            || self.codes.as_ref().zip(other.codes.as_ref()).is_some_and(agree)
    }
}

/// Checks that all `systems` (path of an input, text of its system) are the same.
///
/// # Errors
/// If two differ; the message names the first two such inputs and their systems.
pub fn check_same_system<'a>(
    systems: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<(), BuildError> {
    // Each notation is compared once, since there may be many inputs.
    let (mut texts, mut distinct) = (HashSet::new(), Vec::<System<'_>>::new());
    for (input, text) in systems {
        if !texts.insert(text) {
            continue;
        }
        let system = System::new(input, text);
        if let Some(first) = distinct.iter().find(|other| !other.is_same(&system)) {
            return Err(BuildError::Options(format!(
                "{} and {input} are in different coordinate reference systems, `{}` and `{}`: transform one of them, or take coordinates as they are with --ignore-crs",
                first.input,
                name_of(first.text),
                name_of(text)
            )));
        }
        if distinct.iter().all(|other| other.normalized != system.normalized) {
            distinct.push(system);
        }
    }
    Ok(())
}

/// Whether two texts describe the same system.
pub fn are_same(a: &str, b: &str) -> bool {
    a == b || System::new("", a).is_same(&System::new("", b))
}

/// Removes what differs between writers of the same system: case, blanks outside of quotes, and
/// citations of GeoTIFF.
fn normalized(text: &str) -> String {
    let mut quoted = false;
    let mut words = vec![String::new()];
    for c in text.chars() {
        quoted ^= c == '"';
        match words.last_mut() {
            _ if !quoted && c.is_whitespace() => words.push(String::new()),
            Some(word) => word.extend(c.to_lowercase()),
            None => {}
        }
    }
    words.retain(|word| !word.contains("citation="));
    words.concat()
}

/// The name that WKT begins with, or the keys of GeoTIFF, shortened to `NAME_LETTERS`.
fn name_of(text: &str) -> String {
    let quoted = text.split('"').nth(1).filter(|_| !text.starts_with("GeoTIFF"));
    quoted
        .unwrap_or(text)
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .chars()
        .take(NAME_LETTERS)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAMBERT: &str =
        r#"PROJCS["RGF93 / Lambert-93",GEOGCS["RGF93"],AUTHORITY["EPSG","2154"]]"#;
    const UTM: &str = r#"PROJCS["WGS 84 / UTM zone 32N",AUTHORITY["EPSG","32632"]]"#;

    #[test]
    fn the_same_system_by_different_writers_is_recognised() {
        let spaced = LAMBERT.replace(',', ",\n  ").replace("EPSG", "epsg");
        check_same_system([("a", LAMBERT), ("b", &spaced), ("c", LAMBERT)]).unwrap();
        let keys = [
            r#"GeoTIFF: GTCitation="tile 7" ProjectedCSType=2154"#,
            "GeoTIFF: ProjectedCSType=2154",
        ];
        check_same_system(keys.map(|k| ("a", k))).unwrap();
        check_same_system([]).unwrap();
        // Blanks in a name are part of it.
        check_same_system([("a", r#"LOCAL_CS["a b"]"#), ("b", r#"LOCAL_CS["ab"]"#)]).unwrap_err();
    }

    #[test]
    fn systems_with_the_same_epsg_code_are_the_same() {
        let keys = "GeoTIFF: GTModelType=1 ProjectedCSType=2154";
        check_same_system([("a.las", LAMBERT), ("b.las", keys), ("c.las", LAMBERT)]).unwrap();
        let error = check_same_system([("a.las", UTM), ("b.las", keys)]).unwrap_err().to_string();
        assert!(error.contains("`WGS 84 / UTM zone 32N`") && error.contains("b.las"), "{error}");
        // The first agrees with both of the others, which differ.
        let heights = ["5720", "5703"].map(|code| format!("{keys} VerticalCSType={code}"));
        check_same_system([("a", LAMBERT), ("b", &heights[0])]).unwrap();
        check_same_system([("a", LAMBERT), ("b", &heights[0]), ("c", &heights[1])]).unwrap_err();
    }

    #[test]
    fn systems_that_differ_are_named_with_their_inputs() {
        let error = check_same_system([("a.las", LAMBERT), ("b.las", LAMBERT), ("c.las", UTM)]);
        let error = error.unwrap_err().to_string();
        for word in
            ["a.las", "c.las", "`RGF93 / Lambert-93`", "`WGS 84 / UTM zone 32N`", "--ignore-crs"]
        {
            assert!(error.contains(word), "{error}");
        }
        let error = check_same_system([
            ("a", "GeoTIFF: ProjectedCSType=2154"),
            ("b", "GeoTIFF: ProjectedCSType=3857"),
        ]);
        assert!(error.unwrap_err().to_string().contains("`GeoTIFF: ProjectedCSType=3857`"));
    }
}
