//! Inputs of one file must lie in one coordinate reference system: else they would stand in each
//! other's places, or worlds apart. In: what the inputs say of theirs; out: nothing, or an error
//! that names two that differ. An input that says nothing is taken to agree; so are two that tell
//! the same numbers of the EPSG register, each in its way.

use crate::error::BuildError;
use esker_scan::{Codes, codes};
use std::collections::HashSet;

/// Letters of a system's name in messages.
const NAME_LETTERS: usize = 120;

/// A system as an input tells it.
struct Told<'a> {
    input: &'a str,
    text: &'a str,
    sense: String,
    codes: Option<Codes>,
}

impl<'a> Told<'a> {
    fn new(input: &'a str, text: &'a str) -> Self {
        Self { input, text, sense: sense_of(text), codes: codes(text) }
    }

    fn is_same(&self, other: &Self) -> bool {
        let agree = |codes: (&Codes, &Codes)| codes.0.agree(codes.1);
        self.sense == other.sense
            || self.codes.as_ref().zip(other.codes.as_ref()).is_some_and(agree)
    }
}

/// Holds that all of these (an input's path, the text of its system) are the same system.
///
/// # Errors
/// With the names of the first two that differ, and of their systems.
pub fn one_system<'a>(
    systems: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<(), BuildError> {
    // Each way of telling it once: inputs are many.
    let (mut texts, mut ways) = (HashSet::new(), Vec::<Told<'_>>::new());
    for (input, text) in systems {
        if !texts.insert(text) {
            continue;
        }
        let told = Told::new(input, text);
        if let Some(first) = ways.iter().find(|way| !way.is_same(&told)) {
            return Err(BuildError::Options(format!(
                "{} and {input} are in different coordinate reference systems, `{}` and `{}`: transform one of them, or take coordinates as they are with --ignore-crs",
                first.input,
                name_of(first.text),
                name_of(text)
            )));
        }
        if ways.iter().all(|way| way.sense != told.sense) {
            ways.push(told);
        }
    }
    Ok(())
}

/// Whether two texts tell of the same system.
pub fn are_same(a: &str, b: &str) -> bool {
    a == b || Told::new("", a).is_same(&Told::new("", b))
}

/// What two writers of the same system have in common: letters without case, no blanks outside of
/// quotes, no citations of GeoTIFF.
fn sense_of(text: &str) -> String {
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

/// The name that WKT begins with, or the keys of GeoTIFF; cut where they are long.
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
    fn the_same_system_by_other_writers_is_the_same() {
        let spaced = LAMBERT.replace(',', ",\n  ").replace("EPSG", "epsg");
        one_system([("a", LAMBERT), ("b", &spaced), ("c", LAMBERT)]).unwrap();
        let keys = [
            r#"GeoTIFF: GTCitation="tile 7" ProjectedCSType=2154"#,
            "GeoTIFF: ProjectedCSType=2154",
        ];
        one_system(keys.map(|k| ("a", k))).unwrap();
        one_system([]).unwrap();
        // Blanks in a name are part of it.
        one_system([("a", r#"LOCAL_CS["a b"]"#), ("b", r#"LOCAL_CS["ab"]"#)]).unwrap_err();
    }

    #[test]
    fn the_same_number_of_the_register_is_the_same_system() {
        let keys = "GeoTIFF: GTModelType=1 ProjectedCSType=2154";
        one_system([("a.las", LAMBERT), ("b.las", keys), ("c.las", LAMBERT)]).unwrap();
        let error = one_system([("a.las", UTM), ("b.las", keys)]).unwrap_err().to_string();
        assert!(error.contains("`WGS 84 / UTM zone 32N`") && error.contains("b.las"), "{error}");
        // The first agrees with both of the others, which do not agree.
        let heights = ["5720", "5703"].map(|code| format!("{keys} VerticalCSType={code}"));
        one_system([("a", LAMBERT), ("b", &heights[0])]).unwrap();
        one_system([("a", LAMBERT), ("b", &heights[0]), ("c", &heights[1])]).unwrap_err();
    }

    #[test]
    fn systems_that_differ_are_named_with_their_inputs() {
        let error = one_system([("a.las", LAMBERT), ("b.las", LAMBERT), ("c.las", UTM)]);
        let error = error.unwrap_err().to_string();
        for word in
            ["a.las", "c.las", "`RGF93 / Lambert-93`", "`WGS 84 / UTM zone 32N`", "--ignore-crs"]
        {
            assert!(error.contains(word), "{error}");
        }
        let error = one_system([
            ("a", "GeoTIFF: ProjectedCSType=2154"),
            ("b", "GeoTIFF: ProjectedCSType=3857"),
        ]);
        assert!(error.unwrap_err().to_string().contains("`GeoTIFF: ProjectedCSType=3857`"));
    }
}
