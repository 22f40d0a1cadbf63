//! Reads the coordinate reference system of a LAS file: OGC WKT if a VLR has it, otherwise the
//! GeoTIFF keys in readable form; and its unit of length, if the system names it. Malformed records
//! make a note, never an error: points can be read without them.

use super::header::{f64_at, u16_at};
use super::heights::{name_of_code, plain_name};
use super::vlr::Records;
use crate::source::Crs;
use std::fmt::Write;
use std::str::FromStr;

const PROJECTION: &str = "LASF_Projection";
const WKT: u16 = 2112;
const GEO_KEYS: u16 = 34735;
const GEO_DOUBLES: u16 = 34736;
const GEO_TEXT: u16 = 34737;

/// GeoTIFF's model type of geographic coordinates.
const GEOGRAPHIC: u16 = 2;
/// GeoTIFF's code of user-defined values, which have no number.
const USER_DEFINED: u32 = 32767;
/// Greatest number of bytes of GeoTIFF keys as text; real files take less than one thousand. Many
/// keys may point to the same values, so the size of the file is no bound.
const KEYS_TEXT_BYTES_MAX: usize = 64 << 10;
/// Bytes of a WKT that are parsed for numbers and units; real ones have a few thousand.
const WKT_BYTES_MAX: usize = 1 << 20;

/// Numbers of a CRS in the EPSG register, which do not depend on how it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EpsgCodes {
    /// Number of the projected or geographic system.
    pub horizontal: u32,
    /// Number of the vertical system, if there is one.
    pub vertical: Option<u32>,
    /// Name of the vertical system in plain letters, if it has one that means something.
    pub vertical_name: Option<String>,
    /// Units of the horizontal coordinates and of heights, if they are given.
    pub units: [Option<String>; 2],
}

/// Name of the vertical system in the text of a CRS as it is written, for messages.
pub fn vertical_name(text: &str) -> Option<String> {
    let name = match text.strip_prefix("GeoTIFF:") {
        Some(keys) => geotiff_citation(keys, "VerticalCitation"),
        None => {
            let nodes = &nodes(text)[..];
            let at = systems(nodes).into_iter().find(|&at| nodes[at].is(&VERTICAL))?;
            nodes[at].rest.trim_start().strip_prefix('"')?.split('"').next().map(str::to_owned)
        }
    };
    name.filter(|name| plain_name(name).is_some())
}

/// A citation among GeoTIFF keys in readable form, without its quotes.
fn geotiff_citation(keys: &str, name: &str) -> Option<String> {
    let rest = keys.split_once(&format!(" {name}=\""))?.1;
    let (mut citation, mut chars) = (String::new(), rest.chars());
    loop {
        match chars.next()? {
            '"' => return Some(citation),
            '\\' => citation.extend(chars.next()),
            c => citation.push(c),
        }
    }
}

/// The unit of the horizontal coordinates of a WKT, if it names one.
pub(crate) fn unit_of(wkt: &str) -> Option<String> {
    wkt_unit(wkt)
}

impl EpsgCodes {
    /// Whether both may be the same system. A value that only one of them has is no difference.
    pub fn agree(&self, other: &Self) -> bool {
        self.horizontal == other.horizontal
            && self.agrees_in_heights(other)
            && (0..2).all(|i| same(self.units[i].as_ref(), other.units[i].as_ref()))
    }
}

impl EpsgCodes {
    /// Whether both may have the same vertical system: its numbers decide, or its names if one of
    /// them has no number.
    pub fn agrees_in_heights(&self, other: &Self) -> bool {
        match (self.vertical, other.vertical) {
            (Some(a), Some(b)) => a == b,
            _ => same(self.vertical_name.as_ref(), other.vertical_name.as_ref()),
        }
    }
}

fn same<T: PartialEq>(a: Option<&T>, b: Option<&T>) -> bool {
    a.is_none() || b.is_none() || a == b
}

/// Parses the EPSG numbers from the text of a CRS ([`Crs::text`]); `None` if the horizontal system
/// has no number.
pub fn epsg_codes(text: &str) -> Option<EpsgCodes> {
    match text.strip_prefix("GeoTIFF:") {
        Some(keys) => geotiff_epsg_codes(keys),
        None => wkt_codes(text),
    }
}

fn geotiff_epsg_codes(keys: &str) -> Option<EpsgCodes> {
    let vertical_name = geotiff_citation(keys, "VerticalCitation");
    let keys = Keys::of(keys);
    let key = |name: &str| keys.number::<u32>(name);
    let is_geographic = keys.are_geographic();
    let name = if is_geographic { "GeographicType" } else { "ProjectedCSType" };
    let is_registered = |code: &u32| *code != 0 && *code != USER_DEFINED;
    let vertical = key("VerticalCSType").filter(is_registered);
    let unit = |name| key(name).and_then(unit_of_code).map(str::to_owned);
    Some(EpsgCodes {
        horizontal: key(name).filter(is_registered)?,
        vertical,
        vertical_name: name_of_code(vertical).or(vertical_name.and_then(|name| plain_name(&name))),
        units: [
            if is_geographic { Some("degree".into()) } else { unit("ProjLinearUnits") },
            unit("VerticalUnits"),
        ],
    })
}

/// GeoTIFF keys in readable form, without citations.
pub(super) struct Keys(Vec<String>);

impl Keys {
    /// The keys in a text, which may begin with `GeoTIFF:`.
    pub(super) fn of(text: &str) -> Self {
        // A citation may hold anything, but within quotes; quotes in it are escaped.
        let text = text.replace(r"\\", "").replace(r#"\""#, "");
        Self(text.split('"').step_by(2).flat_map(str::split_whitespace).map(Into::into).collect())
    }

    /// The first number that a key has.
    pub(super) fn number<T: FromStr>(&self, name: &str) -> Option<T> {
        let values = self.0.iter().filter_map(|word| word.strip_prefix(name)?.strip_prefix('='));
        values.filter_map(|value| value.parse().ok()).next()
    }

    /// Whether they are of a geographic system.
    pub(super) fn are_geographic(&self) -> bool {
        self.number("GTModelType") == Some(GEOGRAPHIC)
    }
}

fn unit_of_code(code: u32) -> Option<&'static str> {
    match code {
        9001 => Some("metre"),
        9002 => Some("foot"),
        9003 => Some("US survey foot"),
        _ => None,
    }
}

fn wkt_codes(wkt: &str) -> Option<EpsgCodes> {
    let nodes = &nodes(wkt)[..];
    let is = |at: usize, names: &[&str]| nodes[at].is(names);
    let children = |parent| children(nodes, parent);
    let code = |at: usize| {
        let id = children(at).find(|&i| is(i, &["AUTHORITY", "ID"]))?;
        let mut parts = nodes[id].rest.split([',', ']', ')']).map(|p| p.trim().trim_matches('"'));
        let is_epsg = parts.next()?.eq_ignore_ascii_case("EPSG");
        parts.next().filter(|_| is_epsg)?.parse().ok()
    };
    let systems = systems(nodes);
    let find = |names: &[&str]| systems.iter().copied().find(|&at| is(at, names));
    let horizontal = find(&HORIZONTAL)?;
    let vertical = find(&VERTICAL);
    let unit_of_heights = |at| {
        let axes = children(at).filter(|&i| is(i, &["AXIS"]));
        let units = std::iter::once(at).chain(axes).flat_map(children);
        units.filter(|&i| is(i, &UNITS)).find_map(|i| unit_name(nodes[i].rest))
    };
    Some(EpsgCodes {
        horizontal: code(horizontal)?,
        vertical: vertical.and_then(code),
        vertical_name: name_of_code(vertical.and_then(code))
            .or_else(|| vertical_name(wkt).and_then(|name| plain_name(&name))),
        units: [wkt_unit(wkt), vertical.and_then(unit_of_heights)],
    })
}

/// The systems that a WKT joins, or the one that it is.
pub(super) fn systems(nodes: &[Node<'_>]) -> Vec<usize> {
    let is_compound = nodes.first().is_some_and(|node| node.is(&["COMPD_CS", "COMPOUNDCRS"]));
    if is_compound { children(nodes, 0).collect() } else { (0..nodes.len().min(1)).collect() }
}

/// WKT 1 and 2 keywords of systems of heights.
pub(super) const VERTICAL: [&str; 3] = ["VERT_CS", "VERTCRS", "VERTICALCRS"];
/// WKT 1 and 2 keywords of systems with horizontal coordinates.
const HORIZONTAL: [&str; 9] = [
    "PROJCS",
    "PROJCRS",
    "PROJECTEDCRS",
    "GEOGCS",
    "GEOGCRS",
    "GEODCRS",
    "GEODETICCRS",
    "GEOGRAPHICCRS",
    "GEOCCS",
];

/// The CRS in the records of a file.
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

/// Formats the key directory: four `u16` of head, then four per key (id, location, count, value).
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
        if text.len() > KEYS_TEXT_BYTES_MAX {
            return Err(format!("more than {} KiB as text", KEYS_TEXT_BYTES_MAX >> 10));
        }
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

/// The key directory of a text of GeoTIFF keys that are all numbers; `None` for any other text.
pub(crate) fn geo_keys(text: &str) -> Option<Vec<u8>> {
    let mut keys = Vec::new();
    for word in text.strip_prefix("GeoTIFF:")?.split_whitespace() {
        let (name, value) = word.split_once('=')?;
        let id = (1024..=4099).find(|&id| key_name(id) == Some(name))?;
        keys.push([id, 0, 1, value.parse().ok()?]);
    }
    keys.sort_unstable();
    keys.insert(0, [1, 1, 0, u16::try_from(keys.len()).ok()?]);
    Some(keys.iter().flatten().flat_map(|word: &u16| word.to_le_bytes()).collect())
}

/// Names of the keys that are common in LAS files, as in GeoTIFF 1.1 without `GeoKey`.
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

/// The unit of the horizontal coordinates of a WKT (1 or 2): that of the projected system, else of
/// the geocentric one, else degrees of a geographic one.
pub(crate) fn wkt_unit(wkt: &str) -> Option<String> {
    let nodes = &nodes(wkt)[..];
    let system = |keywords: &[&str]| nodes.iter().position(|n| n.is(keywords));
    let at = match system(&PLANE) {
        Some(at) => at,
        None => match geodetic(nodes)? {
            (at, true) => at,
            (at, false) => {
                let unit = unit_in(nodes, at, &ANGLES).and_then(|i| unit_name(nodes[i].rest));
                return Some(unit.unwrap_or_else(|| DEGREE.into()));
            }
        },
    };
    unit_in(nodes, at, &UNITS).and_then(|i| unit_name(nodes[i].rest))
}

/// A unit of a system: its own, or that of its first axis that has one, as in WKT 2.
pub(super) fn unit_in(nodes: &[Node<'_>], at: usize, keywords: &[&str]) -> Option<usize> {
    let child_unit = |parent| children(nodes, parent).find(|&i| nodes[i].is(keywords));
    let mut axes = children(nodes, at).filter(|&i| nodes[i].is(&["AXIS"]));
    child_unit(at).or_else(|| axes.find_map(child_unit))
}

/// The geodetic system of a WKT, and whether its coordinates are Cartesian: WKT 2 has one keyword
/// for angles and for geocentric lengths.
pub(super) fn geodetic(nodes: &[Node<'_>]) -> Option<(usize, bool)> {
    let at = nodes.iter().position(|n| n.is(&GEODETIC))?;
    let is_cartesian = children(nodes, at).any(|i| {
        nodes[i].is(&["CS"]) && nodes[i].rest.to_ascii_uppercase().starts_with("CARTESIAN")
    });
    Some((at, is_cartesian))
}

/// WKT 1 and 2 keywords of systems on an ellipsoid.
const GEODETIC: [&str; 5] = ["GEOGCS", "GEOGCRS", "GEODCRS", "GEODETICCRS", "GEOGRAPHICCRS"];
/// WKT 1 and 2 keywords of systems with a unit of length: projected, geocentric, local.
pub(super) const PLANE: [&str; 7] =
    ["PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOCCS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"];
/// WKT 1 and 2 keywords of units of length.
const UNITS: [&str; 2] = ["UNIT", "LENGTHUNIT"];
/// WKT 1 and 2 keywords of units of angles.
pub(super) const ANGLES: [&str; 2] = ["UNIT", "ANGLEUNIT"];

/// Name of the usual unit of angles.
pub(crate) const DEGREE: &str = "degree";
/// Radians of a degree.
pub(super) const DEGREE_RAD: f64 = std::f64::consts::PI / 180.0;

/// The name of a unit given as `"name",factor...`: by its factor if that is known, otherwise as
/// written.
fn unit_name(rest: &str) -> Option<String> {
    let mut parts = rest.split(['"', ',', ']', ')']).map(str::trim).filter(|p| !p.is_empty());
    let name = parts.next()?;
    let factor: f64 = parts.next().and_then(|f| f.parse().ok()).unwrap_or(0.0);
    let near = |metres: f64| (factor - metres).abs() < 1e-9;
    Some(match () {
        () if near(1.0) => "metre".to_owned(),
        () if near(0.3048) => "foot".to_owned(),
        () if near(1200.0 / 3937.0) => "US survey foot".to_owned(),
        () if (factor / DEGREE_RAD - 1.0).abs() < 0.01 => DEGREE.to_owned(),
        () => name.to_owned(),
    })
}

/// One `KEYWORD[...` of a WKT.
pub(super) struct Node<'a> {
    keyword: &'a str,
    /// Text after the opening bracket.
    pub(super) rest: &'a str,
    /// Index after the last node nested in this one.
    end: usize,
}

impl Node<'_> {
    pub(super) fn is(&self, keywords: &[&str]) -> bool {
        keywords.iter().any(|k| self.keyword.eq_ignore_ascii_case(k))
    }
}

/// Parses the nodes in the first [`WKT_BYTES_MAX`] bytes; each is followed by the nodes nested in
/// it.
pub(super) fn nodes(wkt: &str) -> Vec<Node<'_>> {
    let (mut nodes, mut open) = (Vec::<Node<'_>>::new(), Vec::<usize>::new());
    let (mut word_start, mut is_quoted) = (0, false);
    for (at, c) in wkt.char_indices().take_while(|&(at, _)| at < WKT_BYTES_MAX) {
        match c {
            '"' => is_quoted = !is_quoted,
            _ if is_quoted => {}
            '[' | '(' => {
                let (keyword, rest) = (wkt[word_start..at].trim(), &wkt[at + 1..]);
                open.push(nodes.len());
                // A node that is never closed contains everything after it.
                nodes.push(Node { keyword, rest, end: usize::MAX });
                word_start = at + 1;
            }
            ']' | ')' => {
                if let Some(closed) = open.pop() {
                    nodes[closed].end = nodes.len();
                }
                word_start = at + 1;
            }
            ',' => word_start = at + 1,
            _ => {}
        }
    }
    nodes
}

/// The direct children of a node. Takes one step for each.
pub(super) fn children<'a>(
    nodes: &'a [Node<'_>],
    parent: usize,
) -> impl Iterator<Item = usize> + use<'a> {
    let end = nodes[parent].end.min(nodes.len());
    let first = Some(parent + 1).filter(|&i| i < end);
    std::iter::successors(first, move |&i| Some(nodes[i].end).filter(|&next| next < end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_known_by_its_numbers_however_it_is_written() {
        let wkt = r#"PROJCS["RGF93 / Lambert-93",GEOGCS["RGF93",AUTHORITY["EPSG","4171"]],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","2154"]]"#;
        let of = |text: &str| epsg_codes(text).unwrap();
        assert_eq!((of(wkt).horizontal, of(wkt).vertical), (2154, None));
        let wkt2 = r#"PROJCRS["RGF93 v1 / Lambert-93",BASEGEOGCRS["RGF93 v1",ID["EPSG",4171]],CS[Cartesian,2],AXIS["x",east],LENGTHUNIT["metre",1],ID["EPSG",2154]]"#;
        let keys = r#"GeoTIFF: GTModelType=1 GTCitation="\\\" ProjectedCSType=1 \\" ProjectedCSType=2154 GeographicType=4171 ProjLinearUnits=9001"#;
        assert!(of(wkt).agree(&of(wkt2)) && of(wkt2).agree(&of(keys)) && of(keys).agree(&of(wkt)));
        // Heights in another system, or in other units, make another system; absent ones make no
        // difference.
        let compound =
            |vertical: &str| format!(r#"COMPD_CS["both",{wkt},{vertical},AUTHORITY["EPSG","1"]]"#);
        let metres = compound(r#"VERT_CS["NGF",UNIT["metre",1],AUTHORITY["EPSG","5720"]]"#);
        let feet = compound(r#"VERT_CS["NGF",UNIT["foot",0.3048]]"#);
        assert_eq!((of(&metres).horizontal, of(&metres).vertical), (2154, Some(5720)));
        assert!(of(&metres).agree(&of(wkt)) && of(&metres).agree(&of(keys)));
        assert!(!of(&metres).agree(&of(&feet)));
        // Systems of heights without a number count by their names.
        let named = |name: &str| compound(&format!(r#"VERT_CS["{name}",UNIT["metre",1]]"#));
        let [ngf, ellipsoid, unknown] =
            ["NGF-IGN69 height", "Ellipsoidal height", "unknown"].map(|name| of(&named(name)));
        assert!(!ngf.agree(&ellipsoid) && ngf.agree(&of(&named("ngf ign69 HEIGHT"))));
        assert!(ngf.agree(&unknown) && ngf.agree(&of(wkt)) && ngf.agree(&of(&metres)));
        assert_eq!(vertical_name(&named("a (b)")).as_deref(), Some("a (b)"));
        let cited =
            |name: &str| of(&format!(r#"{keys} VerticalCSType=32767 VerticalCitation="{name}""#));
        assert!(cited("NGF-IGN69 height").agree(&ngf) && !cited("other").agree(&ngf));
        let heights = |more: &str| of(&format!("{keys} {more}"));
        assert!(ngf.agree(&heights("VerticalCSType=5720")));
        assert!(
            !ngf.agree(&heights("VerticalCSType=5703")) && ngf.agree(&heights("VerticalCSType=99"))
        );
        let geoid = of(&named("NAVD88 height - Geoid12B (Meters)"));
        assert!(geoid.agree(&heights("VerticalCSType=5703")) && !geoid.agree(&ngf));
        assert!(ellipsoid.agree(&of(&named("Ellipsoid (WGS 84)"))));
        assert!(of(&metres).agree(&heights("VerticalCSType=5720 VerticalUnits=9001")));
        assert!(!of(&metres).agree(&heights("VerticalCSType=5703")));
        assert!(!of(&metres).agree(&heights("VerticalUnits=9003")));
        let degrees = of("GeoTIFF: GTModelType=2 GeographicType=4326");
        assert!(
            degrees
                .agree(&of(r#"GEOGCS["WGS 84",UNIT["degree",0.0174],AUTHORITY["EPSG","4326"]]"#))
        );
        for none in [
            "",
            "nonsense[[[",
            r#"LOCAL_CS["x",AUTHORITY["EPSG","2154"]]"#,
            r#"PROJCS["x",GEOGCS["y",AUTHORITY["EPSG","4171"]]]"#,
            r#"PROJCS["x",AUTHORITY["ESRI","102110"]]"#,
            "GeoTIFF: ProjectedCSType=32767 GeographicType=4171",
        ] {
            assert_eq!(epsg_codes(none), None, "{none}");
        }
    }

    #[test]
    fn numbers_of_keys_become_the_directory_that_says_them() {
        let keys = geo_keys("GeoTIFF: GTModelType=1 ProjectedCSType=2154").unwrap();
        let words: Vec<u16> = keys.chunks(2).map(|w| u16::from_le_bytes([w[0], w[1]])).collect();
        assert_eq!(words, [1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2154]);
        for other in ["GeoTIFF: GTCitation=\"a b\"", "GeoTIFF: Key7=1", "PROJCS[1]", ""] {
            assert_eq!(geo_keys(other), None);
        }
    }

    #[test]
    fn the_unit_is_that_of_the_horizontal_system() {
        let projected = r#"COMPD_CS["a, b[",PROJCS["p",GEOGCS["g",UNIT["degree",0.0174]],UNIT["US survey foot",0.3048006096012192]],VERT_CS["v",UNIT["metre",1]]]"#;
        assert_eq!(wkt_unit(projected).as_deref(), Some("US survey foot"));
        let wkt2 = r#"PROJCRS["p",BASEGEOGCRS["g",ANGLEUNIT["degree",0.0174]],CS[Cartesian,2],AXIS["x",east,LENGTHUNIT["m",1.0]]]"#;
        assert_eq!(wkt_unit(wkt2).as_deref(), Some("metre"));
        let odd = r#"PROJCS["p",UNIT["Clarke's link",0.201166195164]]"#;
        assert_eq!(wkt_unit(odd).as_deref(), Some("Clarke's link"));
        assert_eq!(wkt_unit(r#"GEOGCS["g",UNIT["degree",0.0174]]"#).as_deref(), Some("degree"));
        let geocentric = r#"GEODCRS["g",CS[Cartesian,3],AXIS["x",geocentricX],LENGTHUNIT["m",1]]"#;
        assert_eq!(wkt_unit(geocentric).as_deref(), Some("metre"));
        assert_eq!(wkt_unit("nonsense[[[").as_deref(), None);
    }

    #[test]
    fn many_nodes_take_a_step_each() {
        // A quadratic search would take minutes.
        let axes = "AXIS[],".repeat(140_000);
        let wkt = format!(
            r#"PROJCS["p",{axes}AXIS["z",up,UNIT["foot",0.3048]],AUTHORITY["EPSG","2154"]]"#
        );
        let codes = epsg_codes(&wkt).unwrap();
        assert_eq!((codes.horizontal, codes.units[0].as_deref()), (2154, Some("foot")));
        assert_eq!(wkt_unit(&"PROJCS[AXIS[".repeat(1 << 20)), None);
    }
}
