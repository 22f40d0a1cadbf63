//! Coordinates in degrees: the lengths of a degree at the latitude of the points, by which the
//! lattice's coordinates are scaled to metres ([`Lattice::metric`](esker_points::Lattice::metric)).
//! In: systems and bounds of the sources.

use esker_points::InputGrid;
use esker_points::lattice::GridKind;
use esker_points::spread::Corners;
use esker_scan::{Geographic, Source};

/// Latitudes further apart than this are measured without strays: the length of a degree of
/// longitude differs by over one percent.
const WIDE_DEG: f64 = 1.0;

/// Steps of integers from which on they are no degrees, in degrees: a hundred metres. Scans of
/// rooms may carry the geographic system of their device, and coordinates that angles could have.
const COARSE_DEG: f64 = 1e-3;

/// The geographic system of the sources: all that state a system or unit state this one, and none
/// has steps of lengths.
pub fn system_of(sources: &[Box<dyn Source>]) -> Option<Geographic> {
    let mut known: Option<Geographic> = None;
    for info in sources.iter().map(|source| source.info()) {
        let Some(crs) = &info.crs else { continue };
        let system = Geographic::of(&crs.text, crs.unit.as_deref());
        if system.is_some_and(|system| is_coarse(&system, &info.grid)) {
            return None;
        }
        match (system, known) {
            (Some(first), None) => known = Some(first),
            (Some(next), Some(first)) => known = Some(first.joined(&next)?),
            (None, _) if crs.text.is_empty() && crs.unit.is_none() => {}
            (None, _) => return None,
        }
    }
    known
}

fn is_coarse(system: &Geographic, grid: &InputGrid) -> bool {
    let coarse = COARSE_DEG.to_radians() * (1.0 - 1e-9);
    grid.kind == GridKind::Integer
        && grid.grid.scale[..2].iter().all(|step| step * system.unit_rad >= coarse)
}

/// Metres per unit of each axis for points within `bounds`; 1 where these are not those of
/// longitudes and latitudes. Where y exceeds all latitudes and x does not, x is the latitude.
pub fn factor(system: &Geographic, bounds: Option<Corners>) -> [f64; 3] {
    let Some(bounds) = bounds else { return [1.0; 3] };
    let swapped = bounds.map(|[x, y, z]| [y, x, z]);
    let middle = |axis: usize| bounds[0][axis] / 2.0 + bounds[1][axis] / 2.0;
    match (system.may_have(bounds), system.may_have(swapped)) {
        (true, _) => system.metres(middle(1)),
        (false, true) => {
            let [longitude, latitude, height] = system.metres(middle(0));
            [latitude, longitude, height]
        }
        (false, false) => [1.0; 3],
    }
}

/// Whether the points must be read for their latitude: `bounds` may be those of strays, or of a
/// header that has none.
pub fn must_be_measured(system: &Geographic, bounds: Option<Corners>) -> bool {
    let Some([low, high]) = bounds else { return true };
    let is_wide = |axis: usize| (high[axis] - low[axis]) * system.unit_rad > WIDE_DEG.to_radians();
    is_wide(1) || low[..2] == high[..2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn system() -> Geographic {
        Geographic::of("", Some("degree")).unwrap()
    }

    #[test]
    fn factors_are_those_of_the_middle_latitude() {
        let bounds = [[8.0, 46.0, 400.0], [8.5, 48.0, 4000.0]];
        assert_eq!(factor(&system(), Some(bounds)), system().metres(47.0));
        let swapped = [[46.0, 108.0, 0.0], [48.0, 108.5, 9.0]];
        let [x, y, z] = system().metres(47.0);
        assert_eq!(factor(&system(), Some(swapped)), [y, x, z]);
        for none in [None, Some([[5e5, 5e6, 0.0], [5.1e5, 5.1e6, 9.0]])] {
            assert_eq!(factor(&system(), none), [1.0; 3]);
        }
    }

    #[test]
    fn bounds_that_strays_may_have_are_measured() {
        let of = |low: f64, high: f64| Some([[8.0, low, 0.0], [8.1, high, 0.0]]);
        assert!(!must_be_measured(&system(), of(47.0, 47.1)));
        assert!(must_be_measured(&system(), of(0.0, 47.1)));
        assert!(must_be_measured(&system(), Some([[0.0; 3]; 2])));
        assert!(must_be_measured(&system(), None));
    }
}
