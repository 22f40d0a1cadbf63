//! Coordinates of a place of the picture in those of the scan, with unit and coordinate reference
//! system, and no digits that neither the scan nor the picture has.

use esker_engine::calls::info;
use esker_engine::{Forest, Lattice};
use glam::DVec3;

/// Most digits behind the decimal point.
const DIGITS_MAX: f64 = 12.0;
/// Most letters of the name of a coordinate reference system.
const NAME_MAX: usize = 36;

/// How the coordinates of a file are written.
pub struct Coordinates {
    lattice: Lattice,
    unit: Option<String>,
    system: Option<String>,
}

impl Coordinates {
    /// How those of this file are written.
    pub fn new(file: &Forest) -> Self {
        let unit = info::unit(file).map(|unit| short_unit(&unit).to_owned());
        let system = info::crs(file).and_then(|text| name_of(&text));
        Self { lattice: *file.lattice(), unit, system }
    }

    /// How those of a lattice are written, without unit and system.
    #[cfg(test)]
    pub fn of(lattice: Lattice) -> Self {
        Self { lattice, unit: None, system: None }
    }

    /// Unit of lengths, short, if the file names one.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Coordinates of a place on the metric lattice, which is known to the length `pixel`.
    pub fn text(&self, place: DVec3, pixel: f64) -> String {
        let world = self.lattice.unmeasure(place.to_array());
        let axes = [0, 1, 2].map(|axis| {
            let factor = self.lattice.factor[axis];
            let digits = digits(self.lattice.scale[axis].max(pixel / factor));
            let degree = if factor == 1.0 { "" } else { "\u{b0}" };
            format!("{} {:.digits$}{degree}", ["x", "y", "z"][axis], world[axis])
        });
        let unit = self.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
        let system = self.system.as_ref().map_or(String::new(), |name| format!("  {name}"));
        format!("{}{unit}{system}", axes.join("  "))
    }
}

/// Digits behind the decimal point whose last one is no finer than `step`.
fn digits(step: f64) -> usize {
    if !(step.is_normal() && step > 0.0) {
        return 0;
    }
    // A step of 0.01 has two digits, whatever its logarithm is rounded to.
    (-step.log10() + 1e-9).floor().clamp(0.0, DIGITS_MAX) as usize
}

/// Abbreviation of a unit of length.
fn short_unit(unit: &str) -> &str {
    let word = unit.to_ascii_lowercase();
    match word.as_str() {
        "metre" | "meter" | "metres" | "meters" => "m",
        _ if word.contains("foot") || word.contains("feet") => "ft",
        _ => unit,
    }
}

/// Name of a coordinate reference system given by GeoTIFF keys or WKT.
fn name_of(text: &str) -> Option<String> {
    let key = |key: &str| text.split_whitespace().find_map(|word| word.strip_prefix(key));
    let code = key("ProjectedCSType=").or_else(|| key("GeographicType="));
    let code = code.filter(|code| code.bytes().all(|b| b.is_ascii_digit()));
    let name = match code {
        Some(code) => format!("EPSG:{code}"),
        None => text.split('"').nth(1)?.trim().to_owned(),
    };
    let is_long = name.chars().count() > NAME_MAX;
    let name: String = name.chars().filter(|c| !c.is_control()).take(NAME_MAX).collect();
    let name = if is_long { format!("{name}\u{2026}") } else { name };
    Some(name).filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coordinates(scale: f64, factor: [f64; 3]) -> Coordinates {
        let lattice = Lattice { scale: [scale; 3], offset: [0.0; 3], shift: [0; 3], factor };
        Coordinates { lattice, unit: Some("m".into()), system: Some("EPSG:2154".into()) }
    }

    #[test]
    fn no_digit_is_finer_than_the_lattice_or_a_pixel() {
        let place = DVec3::new(600_000.123_456, -2.987_654, 31.55);
        let fine = coordinates(0.001, [1.0; 3]);
        assert_eq!(fine.text(place, 1e-6), "x 600000.123  y -2.988  z 31.550 m  EPSG:2154");
        assert_eq!(fine.text(place, 0.01), "x 600000.12  y -2.99  z 31.55 m  EPSG:2154");
        assert_eq!(fine.text(place, 0.03), "x 600000.1  y -3.0  z 31.6 m  EPSG:2154");
        assert_eq!(fine.text(place, 7.0), "x 600000  y -3  z 32 m  EPSG:2154");
        let coarse = coordinates(0.1, [1.0; 3]);
        assert_eq!(coarse.text(place, 1e-6), "x 600000.1  y -3.0  z 31.6 m  EPSG:2154");
    }

    #[test]
    fn degrees_have_the_digits_of_their_metres() {
        let metres = 111_000.0;
        let degrees = coordinates(1e-7, [metres, metres, 1.0]);
        let place = DVec3::new(5.123_456_7 * metres, 50.0 * metres, 31.55);
        assert_eq!(
            degrees.text(place, 1.1),
            "x 5.12346\u{b0}  y 50.00000\u{b0}  z 32 m  EPSG:2154"
        );
    }

    #[test]
    fn systems_have_short_names() {
        let name = |text| name_of(text).unwrap_or_default();
        assert_eq!(name("GTModelType=1 ProjectedCSType=2154 VerticalCSType=5720"), "EPSG:2154");
        assert_eq!(name("PROJCS[\"RGF93 / Lambert-93\",GEOGCS[\"RGF93\"]]"), "RGF93 / Lambert-93");
        assert_eq!(name("no name"), "");
        let long = format!("PROJCS[\"{}\"]", "a".repeat(80));
        assert_eq!(name(&long).chars().count(), NAME_MAX + 1);
        for (unit, short) in [("metre", "m"), ("US survey foot", "ft"), ("link", "link")] {
            assert_eq!(short_unit(unit), short);
        }
    }
}
