//! The coordinate reference system of a LAS file: OGC WKT where a VLR has it, else the GeoTIFF keys in
//! readable form; and its unit of length, where that is told. What is malformed makes a note, never an
//! error: points are readable without it.

use super::header::{f64_at, u16_at};
use super::vlr::Records;
use crate::source::Crs;
use std::fmt::Write;

const PROJECTION: &str = "LASF_Projection";
const WKT: u16 = 2112;
const GEO_KEYS: u16 = 34735;
const GEO_DOUBLES: u16 = 34736;
const GEO_TEXT: u16 = 34737;

/// GeoTIFF's model type for geographic coordinates.
const GEOGRAPHIC: u16 = 2;

/// The CRS that the records tell.
pub fn of(records: &Records, notes: &mut Vec<String>) -> Option<Crs> {
    for vlr in records.all(PROJECTION, WKT) {
        match String::from_utf8_lossy(&vlr.data).trim_matches(['\0', ' ', '\r', '\n']) {
            "" => {}
            text if text.contains('[') => {
                return Some(Crs { text: text.to_owned(), unit: wkt_unit(text) });
            }
            _ => notes.push("the WKT of its CRS is malformed and not used".into()),
        }
    }
    let keys = records.find(PROJECTION, GEO_KEYS).filter(|v| !v.data.is_empty())?;
    match geotiff(&keys.data, records, notes) {
        Ok(crs) => crs,
        Err(what) => {
            notes.push(format!("the GeoTIFF keys of its CRS are malformed ({what}) and not used"));
            None
        }
    }
}

/// The key directory: four `u16` of head, then four a key (id, place, count, value).
fn geotiff(keys: &[u8], records: &Records, notes: &mut Vec<String>) -> Result<Option<Crs>, String> {
    let number = usize::from(u16_at(keys, 6));
    if keys.len() < 8 + 8 * number {
        return Err(format!("{number} keys in {} bytes", keys.len()));
    }
    if number == 0 {
        return Ok(None);
    }
    let empty: &[u8] = &[];
    let payload = |id| records.find(PROJECTION, id).map_or(empty, |v| &v.data);
    let (doubles, letters) = (payload(GEO_DOUBLES), payload(GEO_TEXT));
    let (mut text, mut model, mut linear) = ("GeoTIFF:".to_owned(), 0, 0);
    let mut empty_keys = 0;
    for key in keys[8..][..8 * number].chunks_exact(8) {
        let [id, place, count, value] = [0, 2, 4, 6].map(|at| u16_at(key, at));
        if id == 0 {
            empty_keys += 1;
            continue;
        }
        let span = usize::from(value)..usize::from(value) + usize::from(count);
        let shown = match place {
            0 => value.to_string(),
            GEO_DOUBLES => {
                let all = doubles.get(span.start * 8..span.end * 8);
                let all = all.ok_or_else(|| format!("key {id} points past the doubles"))?;
                let all: Vec<_> = (0..span.len()).map(|i| f64_at(all, 8 * i).to_string()).collect();
                all.join(",")
            }
            GEO_TEXT => {
                let letters = letters.get(span);
                let letters = letters.ok_or_else(|| format!("key {id} points past the text"))?;
                let letters = String::from_utf8_lossy(letters);
                format!("{:?}", letters.trim_end_matches(['|', '\0', ' ']))
            }
            _ => return Err(format!("key {id} points to the unknown tag {place}")),
        };
        match id {
            1024 => model = value,
            3076 => linear = value,
            _ => {}
        }
        // Writing to a string cannot fail.
        let _ = match key_name(id) {
            Some(name) => write!(text, " {name}={shown}"),
            None => write!(text, " Key{id}={shown}"),
        };
    }
    if empty_keys > 0 {
        notes.push(format!(
            "{empty_keys} of {number} GeoTIFF keys of its CRS are empty and left out"
        ));
    }
    let unit = match (model, linear) {
        (GEOGRAPHIC, _) => Some("degree"),
        (_, 9001) => Some("metre"),
        (_, 9002) => Some("foot"),
        (_, 9003) => Some("US survey foot"),
        _ => None,
    };
    Ok(Some(Crs { text, unit: unit.map(str::to_owned) }))
}

/// Names of the keys that are common in LAS files, as GeoTIFF 1.1 spells them less `GeoKey`.
fn key_name(id: u16) -> Option<&'static str> {
    Some(match id {
        1024 => "GTModelType",
        1025 => "GTRasterType",
        1026 => "GTCitation",
        2048 => "GeographicType",
        2049 => "GeogCitation",
        2050 => "GeogGeodeticDatum",
        2052 => "GeogLinearUnits",
        2054 => "GeogAngularUnits",
        2056 => "GeogEllipsoid",
        3072 => "ProjectedCSType",
        3073 => "PCSCitation",
        3074 => "Projection",
        3075 => "ProjCoordTrans",
        3076 => "ProjLinearUnits",
        4096 => "VerticalCSType",
        4097 => "VerticalCitation",
        4098 => "VerticalDatum",
        4099 => "VerticalUnits",
        _ => return None,
    })
}

/// The unit of the horizontal coordinates of a WKT (1 or 2): that of the projected system, else of the
/// geocentric one, else degrees of a geographic one.
fn wkt_unit(wkt: &str) -> Option<String> {
    let nodes = nodes(wkt);
    let child_unit = |parent: usize| {
        nodes.iter().find(|n| n.parent == Some(parent) && is_unit(n.keyword)).map(|n| n.rest)
    };
    let system = |keywords: &[&str]| {
        nodes.iter().position(|n| keywords.iter().any(|k| n.keyword.eq_ignore_ascii_case(k)))
    };
    if let Some(at) = system(&["PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOCCS"]) {
        // WKT 2 may give the unit with each axis instead.
        let axis = |i: &usize| {
            nodes[*i].parent == Some(at) && nodes[*i].keyword.eq_ignore_ascii_case("AXIS")
        };
        let unit = child_unit(at).or_else(|| (0..nodes.len()).filter(axis).find_map(child_unit));
        return unit.and_then(unit_name);
    }
    system(&["GEOGCS", "GEOGCRS", "GEODCRS", "GEOGRAPHICCRS"]).map(|_| "degree".to_owned())
}

fn is_unit(keyword: &str) -> bool {
    ["UNIT", "LENGTHUNIT"].iter().any(|k| keyword.eq_ignore_ascii_case(k))
}

/// The name of a unit given as `"name",factor...`: by its factor where that is known, else as written.
fn unit_name(rest: &str) -> Option<String> {
    let mut parts = rest.split(['"', ',', ']', ')']).map(str::trim).filter(|p| !p.is_empty());
    let name = parts.next()?;
    let factor: f64 = parts.next().and_then(|f| f.parse().ok()).unwrap_or(0.0);
    let near = |metres: f64| (factor - metres).abs() < 1e-9;
    Some(match () {
        () if near(1.0) => "metre".to_owned(),
        () if near(0.3048) => "foot".to_owned(),
        () if near(1200.0 / 3937.0) => "US survey foot".to_owned(),
        () => name.to_owned(),
    })
}

/// One `KEYWORD[...` of a WKT: what follows its bracket, and the node that it lies in.
struct Node<'a> {
    keyword: &'a str,
    rest: &'a str,
    parent: Option<usize>,
}

fn nodes(wkt: &str) -> Vec<Node<'_>> {
    let (mut nodes, mut open) = (Vec::<Node<'_>>::new(), Vec::new());
    let (mut word_start, mut is_quoted) = (0, false);
    for (at, c) in wkt.char_indices() {
        match c {
            '"' => is_quoted = !is_quoted,
            _ if is_quoted => {}
            '[' | '(' => {
                let (keyword, rest) = (wkt[word_start..at].trim(), &wkt[at + 1..]);
                nodes.push(Node { keyword, rest, parent: open.last().copied() });
                open.push(nodes.len() - 1);
                word_start = at + 1;
            }
            ']' | ')' => {
                open.pop();
                word_start = at + 1;
            }
            ',' => word_start = at + 1,
            _ => {}
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_that_of_the_horizontal_system() {
        let projected = r#"COMPD_CS["a, b[",PROJCS["p",GEOGCS["g",UNIT["degree",0.0174]],UNIT["US survey foot",0.3048006096012192]],VERT_CS["v",UNIT["metre",1]]]"#;
        assert_eq!(wkt_unit(projected).as_deref(), Some("US survey foot"));
        let wkt2 = r#"PROJCRS["p",BASEGEOGCRS["g",ANGLEUNIT["degree",0.0174]],CS[Cartesian,2],AXIS["x",east,LENGTHUNIT["m",1.0]]]"#;
        assert_eq!(wkt_unit(wkt2).as_deref(), Some("metre"));
        let odd = r#"PROJCS["p",UNIT["Clarke's link",0.201166195164]]"#;
        assert_eq!(wkt_unit(odd).as_deref(), Some("Clarke's link"));
        assert_eq!(wkt_unit(r#"GEOGCS["g",UNIT["degree",0.0174]]"#).as_deref(), Some("degree"));
        assert_eq!(wkt_unit("nonsense[[[").as_deref(), None);
    }
}
