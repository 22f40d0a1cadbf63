//! Coordinate reference systems from outside of a scan: a `.prj` file beside it, or what the user
//! says of inputs that state none, and of units. Wraps a source, whose description then has them.
//!
//! A system is given as WKT, or by EPSG numbers, which are kept as the GeoTIFF keys that say the
//! same, since there is no register of systems here to look WKT up in.

use crate::error::ScanError;
use crate::las::crs::unit_of;
use crate::las::geodetic::Geographic;
use crate::packed::ENDINGS;
use crate::source::{Crs, Guess, OpenOptions, ReadReport, Sink, Source, SourceInfo};
use esker_points::lattice::Placement;
use esker_points::{AttrType, Spread, Task};
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

/// Greatest size of a file with a system, in bytes.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Numbers of geographic systems that lie outside the range that the register once had for them.
const GEOGRAPHIC: [u32; 14] =
    [5332, 6318, 6319, 6783, 7844, 7843, 7789, 7912, 8999, 9000, 9057, 9755, 10176, 10177];

/// Units that the user can state: the word for it, and the name that systems have it by.
pub const UNITS: [(&str, &str); 4] =
    [("metre", "metre"), ("foot", "foot"), ("us-foot", "US survey foot"), ("degree", "degree")];

impl FromStr for Crs {
    type Err = String;

    /// Parses `EPSG:2154`, `EPSG:2154+5720` (with the system of heights) or WKT.
    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim_start_matches('\u{feff}').trim();
        let wrong = |what: &str| format!("{what}: give EPSG:NUMBER, EPSG:NUMBER+HEIGHTS or WKT");
        if text.starts_with('{') {
            return Err(wrong("is JSON, which is not read"));
        }
        if text.contains('[') {
            let keyword = text.split('[').next().unwrap_or_default().trim();
            let is_keyword = !keyword.is_empty()
                && keyword.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
            return match is_keyword {
                true => Ok(Self { text: text.to_owned(), unit: unit_of(text) }),
                false => Err(wrong("is no WKT")),
            };
        }
        let codes = text.get(..5).filter(|word| word.eq_ignore_ascii_case("EPSG:"));
        let codes = codes.map(|_| &text[5..]).ok_or_else(|| wrong("is no system"))?;
        let mut numbers = codes.split('+').map(|word| word.trim().parse::<u16>());
        let (horizontal, vertical) = match (numbers.next(), numbers.next(), numbers.next()) {
            (Some(Ok(horizontal)), None, None) => (horizontal, None),
            (Some(Ok(horizontal)), Some(Ok(vertical)), None) => (horizontal, Some(vertical)),
            _ => return Err(wrong("has no EPSG number below 65536")),
        };
        let number = u32::from(horizontal);
        let is_geographic = (4001..=4999).contains(&number) || GEOGRAPHIC.contains(&number);
        let (model, key) =
            if is_geographic { (2, "GeographicType") } else { (1, "ProjectedCSType") };
        let mut text = format!("GeoTIFF: GTModelType={model} {key}={horizontal}");
        if let Some(vertical) = vertical {
            text += &format!(" VerticalCSType={vertical}");
        }
        Ok(Self { text, unit: is_geographic.then(|| "degree".into()) })
    }
}

/// The system in a text file: WKT, or EPSG numbers.
///
/// # Errors
/// If the file cannot be read, or holds no system.
pub fn read_crs(path: &Path) -> Result<Crs, ScanError> {
    let io = |e| ScanError::io(path, e);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(io)?;
    file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(ScanError::damaged(path, "is longer than 1 MiB, and so no system"));
    }
    let text = String::from_utf8_lossy(&bytes);
    text.parse().map_err(|what: String| ScanError::damaged(path, what))
}

/// A source with a system or unit that it does not state itself.
struct Located {
    source: Box<dyn Source>,
    info: SourceInfo,
}

/// Completes what `source` says of its system and unit.
pub(crate) fn located(source: Box<dyn Source>, options: &OpenOptions) -> Box<dyn Source> {
    let mut info = source.info().clone();
    if info.crs.as_ref().is_none_or(|crs| crs.text.is_empty()) {
        let unit = info.crs.take().and_then(|crs| crs.unit);
        let beside = crs_beside(&info.path, &mut info.notes);
        let crs = beside.or_else(|| options.crs.clone());
        info.crs = match (crs, unit) {
            (Some(crs), unit) => Some(Crs { unit: crs.unit.or(unit), ..crs }),
            (None, Some(unit)) => Some(Crs { text: String::new(), unit: Some(unit) }),
            (None, None) => None,
        };
    }
    if let Some(unit) = &options.unit {
        let crs = info.crs.get_or_insert(Crs { text: String::new(), unit: None });
        match &crs.unit {
            None => crs.unit = Some(unit.clone()),
            Some(stated) if stated != unit => {
                info.notes.push(format!("its unit is {stated}, as it states; --unit is not used"));
            }
            Some(_) => {}
        }
    }
    let geographic =
        info.crs.as_ref().and_then(|crs| Geographic::of(&crs.text, crs.unit.as_deref()));
    if let Some(geographic) = geographic {
        let unit = geographic.unit_name();
        info.notes.push(format!("x and y are {unit}"));
    }
    Box::new(Located { source, info })
}

/// The system in the `.prj` file beside a scan, with a note.
fn crs_beside(path: &Path, notes: &mut Vec<String>) -> Option<Crs> {
    let is_packing = |ending: &str| ENDINGS.iter().any(|e| ending.eq_ignore_ascii_case(e));
    let is_packed = path.extension().and_then(|e| e.to_str()).is_some_and(is_packing);
    let path = if is_packed { path.with_extension("") } else { path.to_owned() };
    let beside = ["prj", "PRJ"].map(|ending| path.with_extension(ending));
    let beside = beside.into_iter().find(|beside| beside.is_file())?;
    let name = beside.file_name().unwrap_or_default().to_string_lossy();
    match read_crs(&beside) {
        Ok(crs) => {
            notes.push(format!("its coordinate reference system is that of {name} beside it"));
            Some(crs)
        }
        Err(_) => {
            notes.push(format!("{name} beside it holds no system that is understood"));
            None
        }
    }
}

impl Source for Located {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        self.source.read(placement, task, sink)
    }

    fn begin_near(&self, point: u64) -> u64 {
        self.source.begin_near(point)
    }

    fn read_range(
        &self,
        points: Range<u64>,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        self.source.read_range(points, placement, task, sink)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.source.survey(task)
    }

    fn guess(&self) -> Option<&Guess> {
        self.source.guess()
    }

    fn typed_by_values(&self) -> Vec<usize> {
        self.source.typed_by_values()
    }

    fn widen(&mut self, attribute: usize, ty: AttrType) {
        self.source.widen(attribute, ty);
        self.info.schema = Arc::clone(&self.source.info().schema);
    }

    fn is_text(&self) -> bool {
        self.source.is_text()
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_parsed_from_numbers_and_wkt() {
        let parse = |text: &str| text.parse::<Crs>();
        let lambert = parse("epsg:2154+5720").unwrap();
        assert_eq!(lambert.text, "GeoTIFF: GTModelType=1 ProjectedCSType=2154 VerticalCSType=5720");
        assert_eq!((lambert.unit, parse("EPSG:4326").unwrap().unit), (None, Some("degree".into())));
        let wkt = r#" PROJCS["x",UNIT["metre",1]] "#;
        assert_eq!(
            parse(wkt).unwrap(),
            Crs { text: wkt.trim().into(), unit: Some("metre".into()) }
        );
        for wrong in
            ["", "2154", "EPSG:", "EPSG:99999", "EPSG:1+2+3", "{\"type\": 1}", "[1]", "ESRI:1"]
        {
            assert!(parse(wrong).unwrap_err().contains("EPSG:NUMBER"), "{wrong}");
        }
    }
}
