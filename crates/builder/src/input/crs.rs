//! Inputs of one file must be in one coordinate reference system, or their points would be at
//! wrong places. In: the systems that inputs state; out: an error that names two that differ.
//! An input that states no system is assumed to agree, and so are two with the same EPSG
//! codes in different notations.

use crate::error::BuildError;
use esker_scan::{EpsgCodes, epsg_codes, vertical_name};
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
        // Texts that are equal but for citations may still cite different systems of heights.
        let heights = self.codes.as_ref().zip(other.codes.as_ref());
        (self.normalized == other.normalized && heights.is_none_or(|(a, b)| a.agrees_in_heights(b)))
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
        if text.is_empty() || !texts.insert(text) {
            continue;
        }
        let system = System::new(input, text);
        if let Some(first) = distinct.iter().find(|other| !other.is_same(&system)) {
            return Err(BuildError::Options(format!(
                "{} and {input} are in different coordinate reference systems, {}: transform one of them, or take coordinates as they are with --ignore-crs",
                first.input,
                difference(first, &system)
            )));
        }
        if distinct.iter().all(|other| other.normalized != system.normalized) {
            distinct.push(system);
        }
    }
    Ok(())
}

/// What differs between two systems: their heights or units, if the horizontal system is the same,
/// otherwise their names.
fn difference(a: &System<'_>, b: &System<'_>) -> String {
    let names = [a, b].map(|system| name_of(system.text));
    if let (Some(x), Some(y)) = (&a.codes, &b.codes)
        && x.horizontal == y.horizontal
    {
        let number = x.horizontal;
        let heights = |system: &System<'_>, codes: &EpsgCodes| {
            let name = vertical_name(system.text).unwrap_or_else(|| "heights".into());
            match codes.vertical {
                Some(code) => format!("`{}` (EPSG {code})", short(&name)),
                None => format!("`{}`", short(&name)),
            }
        };
        if !x.agrees_in_heights(y) {
            let (x, y) = (heights(a, x), heights(b, y));
            return format!("both horizontally in EPSG {number}, but with heights in {x} and {y}");
        }
        let units = (0..2).find_map(|i| {
            let (x, y) = x.units[i].as_ref().zip(y.units[i].as_ref())?;
            (x != y).then(|| (["coordinates", "heights"][i], short(x), short(y)))
        });
        if let Some((what, x, y)) = units {
            return format!("both in EPSG {number}, but with {what} in {x} and in {y}");
        }
    }
    let [x, y] = &names;
    if x == y {
        return format!("both named `{x}`, but defined differently");
    }
    format!("`{x}` and `{y}`")
}

/// A note if some of the inputs state a system and others do not. In: path of each, and whether it
/// states one.
pub fn note_unstated(inputs: impl IntoIterator<Item = (String, bool)>) -> Option<String> {
    let (stated, unstated): (Vec<_>, Vec<_>) = inputs.into_iter().partition(|(_, states)| *states);
    let (first, _) = unstated.first().filter(|_| !stated.is_empty())?;
    let which = match unstated.len() {
        1 => first.clone(),
        n => format!("{n} inputs, first {first}"),
    };
    Some(format!(
        "{which}: the coordinate reference system is not stated; it is taken to be that of {}",
        stated[0].0
    ))
}

/// Whether two texts describe the same system.
pub fn are_same(a: &str, b: &str) -> bool {
    a == b || a.is_empty() || b.is_empty() || System::new("", a).is_same(&System::new("", b))
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
    short(quoted.unwrap_or(text))
}

/// The first `NAME_LETTERS` of a text, in one line.
fn short(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(NAME_LETTERS).collect()
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
    fn a_refusal_names_what_differs() {
        let compound = |heights: &str| format!(r#"COMPD_CS["c",{LAMBERT},{heights}]"#);
        let error =
            |a: &str, b: &str| check_same_system([("a", a), ("b", b)]).unwrap_err().to_string();
        let [ngf, ellipsoid, feet] = [
            r#"VERT_CS["NGF-IGN69 height",UNIT["metre",1]]"#,
            r#"VERT_CS["Ellipsoidal height",UNIT["metre",1]]"#,
            r#"VERT_CS["NGF-IGN69 height",UNIT["foot",0.3048]]"#,
        ]
        .map(compound);
        let text = error(&ngf, &ellipsoid);
        let want = "both horizontally in EPSG 2154, but with heights in `NGF-IGN69 height` and \
            `Ellipsoidal height`";
        assert!(text.contains(want), "{text}");
        let text = error(&ngf, &feet);
        assert!(
            text.contains("both in EPSG 2154, but with heights in metre and in foot"),
            "{text}"
        );
        let text = error(r#"PROJCS["A",P[1]]"#, r#"PROJCS["A",P[2]]"#);
        assert!(text.contains("both named `A`, but defined differently"), "{text}");
        // Keys that differ in the citation of heights alone.
        let keys = |name: &str| {
            format!(
                r#"GeoTIFF: ProjectedCSType=2154 VerticalCSType=32767 VerticalCitation="{name}""#
            )
        };
        assert!(error(&keys("NGF"), &keys("Ellipsoid")).contains("`NGF` and `Ellipsoid`"));
        check_same_system([("a", keys("NGF").as_str()), ("b", LAMBERT), ("c", "")]).unwrap();
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
