//! Geographic coordinates: which systems have them, and the lengths of their units. On the
//! ellipsoid of the system, at latitude phi, a radian of latitude is `M = a (1 - e2) / w^3` long
//! and a radian of longitude `N cos(phi) = a cos(phi) / w`, with `w = sqrt(1 - e2 sin(phi)^2)`. In
//! LAS and in tables x is the longitude and y the latitude, whatever the order of axes in a WKT.

use super::crs::{
    ANGLES, DEGREE, DEGREE_RAD, Keys, Node, PLANE, VERTICAL, children, geodetic, nodes, systems,
    unit_in,
};
use crate::source::Crs;

/// Equatorial radius, metres, and inverse flattening of WGS 84.
const WGS84: [f64; 2] = [6_378_137.0, 298.257_223_563];
/// Equatorial radii of bodies that are scanned, metres.
const RADII: std::ops::RangeInclusive<f64> = 1e5..=1e8;
/// Least inverse flattening; 0 stands for a sphere.
const INVERSE_FLATTENING_MIN: f64 = 2.0;
/// Radians of a gon.
const GON_RAD: f64 = std::f64::consts::PI / 200.0;
/// Radians of units of angles.
const UNITS_RAD: std::ops::RangeInclusive<f64> = 1e-7..=1.0;
/// Relative difference from a known unit below which a factor is that unit, with fewer digits.
const ROUNDED: f64 = 0.01;
/// Metres of units of heights.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = 1e-4..=1e4;
/// Greatest latitude at which lengths are taken, degrees: at the pole a degree of longitude has
/// none.
const LATITUDE_MAX_DEG: f64 = 89.0;
/// Slack of the greatest latitude and longitude, degrees.
const SLACK_DEG: f64 = 1e-3;

/// A system of longitudes, latitudes and heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geographic {
    /// Radians of the unit of longitudes and latitudes.
    pub unit_rad: f64,
    /// Metres of the unit of heights, if the system has it.
    pub height_m: Option<f64>,
    /// Equatorial radius, metres, and inverse flattening of the ellipsoid; a sphere has 0.
    pub ellipsoid: [f64; 2],
}

impl Geographic {
    const WGS84: Self = Self { unit_rad: DEGREE_RAD, height_m: None, ellipsoid: WGS84 };

    /// The geographic system that the text and unit of a [`crate::Crs`] stand for, if any.
    pub fn of(text: &str, unit: Option<&str>) -> Option<Self> {
        let of_text = match text.strip_prefix("GeoTIFF:") {
            Some(keys) => Self::of_keys(&Keys::of(keys)),
            None => Self::of_wkt(&nodes(text)),
        };
        of_text.or_else(|| (unit == Some(DEGREE)).then_some(Self::WGS84))
    }

    fn of_keys(keys: &Keys) -> Option<Self> {
        if !keys.are_geographic() {
            return None;
        }
        let unit_rad = match keys.number::<u32>("GeogAngularUnits") {
            Some(9101) => 1.0,
            Some(9105 | 9106) => GON_RAD,
            // The size of a unit of one's own.
            Some(32767) => keys.number("Key2055").unwrap_or(Self::WGS84.unit_rad),
            _ => Self::WGS84.unit_rad,
        };
        let units = ["VerticalUnits", "VerticalCSType"].map(|name| keys.number::<u32>(name));
        let height_m = match units {
            [Some(9001), _] => Some(1.0),
            // NAVD88 height in feet, of either kind.
            [Some(9002), _] | [None, Some(8228)] => Some(0.3048),
            [Some(9003), _] | [None, Some(6360)] => Some(1200.0 / 3937.0),
            _ => None,
        };
        let ellipsoid = match keys.number::<u32>("GeogEllipsoid") {
            Some(7004) => [6_377_397.155, 299.152_812_8],
            Some(7008) => [6_378_206.4, 294.978_698_2],
            Some(7022) => [6_378_388.0, 297.0],
            _ => match (keys.number("Key2057"), keys.number("Key2059")) {
                (Some(radius), Some(inverse)) => [radius, inverse],
                _ => WGS84,
            },
        };
        Some(Self { unit_rad, height_m, ellipsoid }.usable())
    }

    fn of_wkt(nodes: &[Node<'_>]) -> Option<Self> {
        let (at, is_cartesian) = geodetic(nodes)?;
        if is_cartesian || nodes.iter().any(|node| node.is(&PLANE)) {
            return None;
        }
        let unit = |at, keywords: &[&str]| {
            unit_in(nodes, at, keywords).and_then(|i| numbers(nodes[i].rest).first().copied())
        };
        let datum = nodes.iter().find(|node| node.is(&["SPHEROID", "ELLIPSOID"]));
        let ellipsoid = datum.and_then(|node| numbers(node.rest).first_chunk::<2>().copied());
        let vertical = systems(nodes).into_iter().find(|&at| nodes[at].is(&VERTICAL));
        // A system of three axes has the unit of heights with the third.
        let third = children(nodes, at).filter(|&i| nodes[i].is(&["AXIS"])).nth(2);
        let height_m = vertical.and_then(|at| unit(at, &["UNIT", "LENGTHUNIT"]));
        let height_m = height_m.or_else(|| third.and_then(|at| unit(at, &["LENGTHUNIT"])));
        let system = Self {
            unit_rad: unit(at, &ANGLES).unwrap_or(Self::WGS84.unit_rad),
            height_m,
            ellipsoid: ellipsoid.unwrap_or(WGS84),
        };
        Some(system.usable())
    }

    /// The system with usual values in place of numbers that no system has.
    fn usable(self) -> Self {
        let Self { unit_rad, height_m, ellipsoid: [radius, inverse] } = self;
        let is_body =
            RADII.contains(&radius) && (inverse == 0.0 || inverse >= INVERSE_FLATTENING_MIN);
        let known = [DEGREE_RAD, GON_RAD, 1.0];
        let named = known.into_iter().find(|rad| (unit_rad / rad - 1.0).abs() < ROUNDED);
        let unit_rad = named.unwrap_or(unit_rad);
        Self {
            unit_rad: if UNITS_RAD.contains(&unit_rad) { unit_rad } else { DEGREE_RAD },
            height_m: height_m.filter(|metres| HEIGHTS_M.contains(metres)),
            ellipsoid: if is_body && inverse.is_finite() { [radius, inverse] } else { WGS84 },
        }
    }

    /// What is known of two systems of the same coordinates; `None` if their units differ.
    pub fn joined(&self, other: &Self) -> Option<Self> {
        let are_apart = self.height_m.zip(other.height_m).is_some_and(|(a, b)| a != b);
        let is_same = self.unit_rad == other.unit_rad && !are_apart;
        is_same.then(|| Self { height_m: self.height_m.or(other.height_m), ..*self })
    }

    /// Name of the unit of longitudes and latitudes, in the plural.
    pub fn unit_name(&self) -> &'static str {
        match self.unit_rad {
            DEGREE_RAD => "degrees",
            GON_RAD => "gons",
            1.0 => "radians",
            _ => "angles",
        }
    }

    /// Whether coordinates between `low` and `high` may be longitudes and latitudes.
    pub fn may_have(&self, [low, high]: [[f64; 3]; 2]) -> bool {
        let within = |axis: usize, most: f64| {
            let most = (most + SLACK_DEG).to_radians() / self.unit_rad;
            low[axis] >= -most && high[axis] <= most
        };
        // Longitudes from 0 to 360 degrees occur.
        within(0, 360.0) && within(1, 90.0)
    }

    /// Metres of a unit of each axis at a latitude in the unit of the system; heights of an unknown
    /// unit are taken for metres.
    pub fn metres(&self, latitude: f64) -> [f64; 3] {
        let [radius, inverse] = self.ellipsoid;
        let flattening = if inverse == 0.0 { 0.0 } else { 1.0 / inverse };
        let e2 = flattening * (2.0 - flattening);
        let most = LATITUDE_MAX_DEG.to_radians();
        let (sin, cos) = (latitude * self.unit_rad).clamp(-most, most).sin_cos();
        let w = (1.0 - e2 * sin * sin).sqrt();
        let (meridian, parallel) = (radius * (1.0 - e2) / (w * w * w), radius * cos / w);
        [parallel * self.unit_rad, meridian * self.unit_rad, self.height_m.unwrap_or(1.0)]
    }
}

/// What is known of coordinates that are called longitudes and latitudes: they are degrees, unless
/// their `bounds` are wider.
pub(crate) fn in_degrees(bounds: Option<[[f64; 3]; 2]>) -> Option<Crs> {
    let may_be = bounds.is_none_or(|bounds| Geographic::WGS84.may_have(bounds));
    may_be.then(|| Crs { text: String::new(), unit: Some(DEGREE.into()) })
}

/// The numbers after the name in a `KEYWORD["name",number,number...`, up to the first word.
fn numbers(rest: &str) -> Vec<f64> {
    let after = rest.trim_start().strip_prefix('"').and_then(|rest| rest.split_once('"'));
    let parts = after.map_or("", |(_, after)| after).split([',', ']', ')']).map(str::trim);
    parts.skip(1).map_while(|part| part.parse().ok()).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    const WKT: &str = r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AXIS["Latitude",NORTH],AXIS["Longitude",EAST]]"#;

    fn near(found: f64, wanted: f64) {
        assert!((found / wanted - 1.0).abs() < 1e-6, "{found} {wanted}");
    }

    /// Lengths of a degree from published tables of WGS 84.
    #[test]
    fn a_degree_is_as_long_as_tables_have_it() {
        let system = Geographic::of("GeoTIFF: GTModelType=2 GeographicType=4326", None).unwrap();
        for (latitude, longitude_m, latitude_m) in [
            (0.0, 111_319.49, 110_574.28),
            (45.0, 78_846.81, 111_131.78),
            (-60.0, 55_800.0, 111_412.24),
        ] {
            let [x, y, z] = system.metres(latitude);
            assert!((x - longitude_m).abs() < 0.05 && (y - latitude_m).abs() < 0.05, "{x} {y}");
            assert_eq!(z, 1.0);
        }
        // Near the poles lengths stay usable.
        assert_eq!(system.metres(90.0), system.metres(89.5));
        assert!(system.metres(-90.0)[0] > 1000.0);
    }

    /// A small step on the ellipsoid, by its parametric form, is as long as the factors say.
    #[test]
    fn factors_are_the_derivatives_of_places_on_the_ellipsoid() {
        for ellipsoid in [WGS84, [6_377_397.155, 299.152_812_8], [1_737_400.0, 0.0]] {
            let system = Geographic { ellipsoid, ..Geographic::WGS84 };
            let f = if ellipsoid[1] == 0.0 { 0.0 } else { 1.0 / ellipsoid[1] };
            let place = |longitude: f64, latitude: f64| {
                let (sin, cos) = latitude.to_radians().sin_cos();
                let e2 = f * (2.0 - f);
                let n = ellipsoid[0] / (1.0 - e2 * sin * sin).sqrt();
                let (east, north) = longitude.to_radians().sin_cos();
                [n * cos * north, n * cos * east, n * (1.0 - e2) * sin]
            };
            let distance = |a: [f64; 3], b: [f64; 3]| {
                (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
            };
            for latitude in [-80.0, -33.0, 0.0, 12.0, 47.0, 88.0] {
                let [x, y, _] = system.metres(latitude);
                let step = 1e-4;
                near(distance(place(step, latitude), place(-step, latitude)) / (2.0 * step), x);
                near(
                    distance(place(7.0, latitude + step), place(7.0, latitude - step))
                        / (2.0 * step),
                    y,
                );
            }
        }
    }

    #[test]
    fn units_and_ellipsoids_are_those_of_the_system() {
        let of = |text: &str| Geographic::of(text, None);
        assert_eq!(of(WKT).unwrap().ellipsoid, WGS84);
        near(of(WKT).unwrap().unit_rad, 1.0_f64.to_radians());
        let feet = format!(
            r#"COMPD_CS["both",{WKT},VERT_CS["v",VERT_DATUM["d",2005],UNIT["foot",0.3048]]]"#
        );
        assert_eq!(of(&feet).unwrap().height_m, Some(0.3048));
        let gon = WKT
            .replace(r#"UNIT["degree",0.0174532925199433]"#, r#"UNIT["grad",0.015707963267949]"#);
        assert_eq!(of(&gon).unwrap().unit_name(), "gons");
        let wkt2 = r#"GEOGCRS["g",DATUM["d",ELLIPSOID["Bessel",6377397.155,299.1528128,LENGTHUNIT["metre",1]]],CS[ellipsoidal,3],AXIS["lat",north,ANGLEUNIT["degree",0.0174532925199433]],AXIS["lon",east,ANGLEUNIT["degree",0.0174532925199433]],AXIS["h",up,LENGTHUNIT["foot",0.3048]]]"#;
        let found = of(wkt2).unwrap();
        assert_eq!(
            (found.ellipsoid, found.height_m),
            ([6_377_397.155, 299.152_812_8], Some(0.3048))
        );
        let keys =
            "GeoTIFF: GTModelType=2 GeogAngularUnits=9101 GeogEllipsoid=7004 VerticalUnits=9003";
        let found = of(keys).unwrap();
        assert_eq!((found.unit_rad, found.ellipsoid[0]), (1.0, 6_377_397.155));
        let us_foot = Some(1200.0 / 3937.0);
        assert_eq!(found.height_m, us_foot);
        let degrees = of("GeoTIFF: GTModelType=2 VerticalCSType=6360").unwrap();
        assert_eq!(degrees.height_m, us_foot);
        assert_eq!(Geographic::WGS84.joined(&degrees), Some(degrees));
        assert_eq!(degrees.joined(&of(&feet).unwrap()), None, "feet of two kinds");
        assert_eq!(degrees.joined(&found), None, "angles of two kinds");
        assert_eq!(Geographic::of("", Some("degree")), Some(Geographic::WGS84));
        let named = in_degrees(Some([[8.0, 47.0, 0.0], [8.1, 47.1, 900.0]])).unwrap();
        assert_eq!(Geographic::of(&named.text, named.unit.as_deref()), Some(Geographic::WGS84));
        assert_eq!(in_degrees(Some([[8.0, 47.0, 0.0], [2.6e6, 1.2e6, 900.0]])), None);
        for other in [
            "",
            "GeoTIFF: GTModelType=1 ProjectedCSType=2154 GeogAngularUnits=9102",
            &format!(r#"PROJCS["p",{WKT},UNIT["metre",1]]"#),
            r#"GEOCCS["g",UNIT["metre",1]]"#,
            r#"GEODCRS["g",CS[Cartesian,3],AXIS["x",geocentricX],LENGTHUNIT["m",1]]"#,
            "nonsense[[[",
        ] {
            assert_eq!(Geographic::of(other, Some("metre")), None, "{other}");
        }
    }

    #[test]
    fn damaged_numbers_are_replaced() {
        let bad = WKT.replace("6378137,298.257223563", "-1,nan").replace("0.0174532925199433", "0");
        let found = Geographic::of(&bad, None).unwrap();
        assert_eq!(found, Geographic::WGS84);
        let [x, y, _] = found.metres(f64::MAX);
        assert!(x.is_normal() && y.is_normal());
    }

    #[test]
    fn coordinates_beyond_the_globe_are_none() {
        let system = Geographic::WGS84;
        assert!(system.may_have([[-180.0, -90.0, -1e9], [360.0, 90.0, 1e9]]));
        assert!(!system.may_have([[0.0, 0.0, 0.0], [10.0, 91.0, 0.0]]));
        assert!(!system.may_have([[500_000.0, 47.0, 0.0], [500_100.0, 48.0, 0.0]]));
    }
}
