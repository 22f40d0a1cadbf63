//! Finds x, y and z among the names of columns: x y z, easting northing elevation, longitude
//! latitude height, in the spellings of surveying programs, with units behind them. x is the
//! easting or the longitude, whatever the order of the columns.

/// A system of horizontal coordinates; earlier ones are preferred where a file has several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum System {
    /// x and y.
    Cartesian,
    /// Easting and northing.
    Projected,
    /// Longitude and latitude.
    Geographic,
    /// East and north as single letters, which could stand for other things.
    Letters,
}

const SYSTEMS: [System; 4] =
    [System::Cartesian, System::Projected, System::Geographic, System::Letters];

/// The columns of x, y and z.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Axes {
    /// Columns of x, y and z.
    pub columns: [usize; 3],
    /// Whether x and y are longitude and latitude.
    pub is_geographic: bool,
    /// Other columns that could be x, y or z by their names.
    pub rivals: Vec<usize>,
}

/// Finds the columns of x, y and z by `names`.
///
/// # Errors
/// The axes (0 for x) that no name stands for.
pub(crate) fn axes_of<S: AsRef<str>>(names: &[S]) -> Result<Axes, Vec<usize>> {
    let plain: Vec<String> = names.iter().map(|name| plain(name.as_ref())).collect();
    let with = |matches: &dyn Fn(&str) -> bool| -> Vec<usize> {
        (0..plain.len()).filter(|&c| matches(&plain[c])).collect()
    };
    let horizontal = |system: System| {
        [0, 1].map(|axis| with(&|name| horizontal_of(name) == Some((system, axis))))
    };
    // Ranks of heights: z, then elevations and the like, then a single letter.
    let heights: Vec<Vec<usize>> =
        (0..3).map(|rank| with(&|name| height_rank(name) == Some(rank))).collect();
    let pairs = SYSTEMS.map(|system| (system, horizontal(system)));
    let is_pair = |(_, [x, y]): &&(System, [Vec<usize>; 2])| !x.is_empty() && !y.is_empty();
    let pair = pairs.iter().find(is_pair);
    let height = heights.iter().find(|columns| !columns.is_empty());
    let (Some((system, [x, y])), Some(z)) = (pair, height) else {
        let has = |axis: usize| match (pair, axis) {
            (_, 2) => height.is_some(),
            (Some(_), _) => true,
            (None, axis) => pairs[..3].iter().any(|(_, of)| !of[axis].is_empty()),
        };
        let lacking: Vec<usize> = (0..3).filter(|&axis| !has(axis)).collect();
        // An x of one system and a y of another are no pair.
        return Err(if lacking.is_empty() { vec![0, 1] } else { lacking });
    };
    let columns = [x[0], y[0], z[0]];
    let is_exact = *system == System::Cartesian && height_rank(&plain[z[0]]) == Some(0);
    // Beside x, y and z, other coordinates are attributes; but two columns of one name are a doubt.
    let mut rivals: Vec<usize> = [x, y, z].into_iter().flat_map(|all| &all[1..]).copied().collect();
    if !is_exact {
        let others = pairs.iter().filter(|pair| is_pair(pair) && pair.0 != *system);
        rivals.extend(others.flat_map(|(_, [x, y])| x.iter().chain(y)));
        rivals.extend(heights[..2].iter().flatten().filter(|column| **column != columns[2]));
        rivals.sort_unstable();
        rivals.dedup();
    }
    Ok(Axes { columns, is_geographic: *system == System::Geographic, rivals })
}

/// The column that the names suggest for one axis alone, but none of `used`.
pub(crate) fn single<S: AsRef<str>>(names: &[S], axis: usize, used: &[usize]) -> Option<usize> {
    let rank = |name: &str| match axis {
        2 => height_rank(name),
        _ => horizontal_of(name).filter(|of| of.1 == axis).map(|of| of.0 as usize),
    };
    let ranked = names.iter().map(|name| rank(&plain(name.as_ref()))).enumerate();
    let free = ranked.filter(|(column, _)| !used.contains(column));
    free.filter_map(|(column, rank)| Some((rank?, column))).min().map(|(_, column)| column)
}

/// Whether names tell x, y and z.
pub(crate) fn has_axes<S: AsRef<str>>(names: &[S]) -> bool {
    axes_of(names).is_ok()
}

/// The words of a name in lower case, without its unit, in one: `X [m]` and `x_m` become `x`.
fn plain(name: &str) -> String {
    // What looks like a program or like JSON has no names of columns.
    if name.contains(['"', '{', '}', '=', ';', '<', '>']) {
        return String::new();
    }
    let name = match name.find(['[', '(']) {
        Some(0) | None => name,
        Some(at) => &name[..at],
    };
    let lower = name.to_lowercase();
    let is_part = |c: char| c.is_alphanumeric();
    let mut words: Vec<&str> = lower.split(|c| !is_part(c)).filter(|w| !w.is_empty()).collect();
    if let [_, .., "in", unit] = words[..]
        && is_unit(unit)
    {
        words.truncate(words.len() - 2);
    } else if let [_, .., unit] = words[..]
        && is_unit(unit)
    {
        words.pop();
    }
    words.concat()
}

fn is_unit(word: &str) -> bool {
    matches!(
        word,
        "m" | "meter"
            | "meters"
            | "metre"
            | "metres"
            | "mm"
            | "cm"
            | "km"
            | "ft"
            | "foot"
            | "feet"
            | "usft"
            | "ftus"
            | "deg"
            | "degree"
            | "degrees"
            | "dd"
    )
}

/// The system and the axis (0 for x, 1 for y) of a plain name.
fn horizontal_of(name: &str) -> Option<(System, usize)> {
    use System::{Cartesian, Geographic, Letters, Projected};
    Some(match name {
        "x" | "pointx" | "xpoint" | "coordx" | "xcoord" | "xcoordinate" | "coordinatex"
        | "cartesianx" | "posx" | "xpos" | "positionx" | "xposition" | "points0" | "utmx"
        | "xutm" | "xyz0" => (Cartesian, 0),
        "y" | "pointy" | "ypoint" | "coordy" | "ycoord" | "ycoordinate" | "coordinatey"
        | "cartesiany" | "posy" | "ypos" | "positiony" | "yposition" | "points1" | "utmy"
        | "yutm" | "xyz1" => (Cartesian, 1),
        "easting" | "eastings" | "east" | "eastcoordinate" | "utmeasting" | "utmeast"
        | "eastingutm" | "gridx" | "rechtswert" | "ostwert" | "estx" => (Projected, 0),
        "northing" | "northings" | "north" | "northcoordinate" | "utmnorthing" | "utmnorth"
        | "northingutm" | "gridy" | "hochwert" | "nordwert" | "nordy" => (Projected, 1),
        "lon" | "long" | "lng" | "longitude" | "gpslongitude" | "gpslon" | "longitudewgs84"
        | "wgs84longitude" | "wgs84lon" | "lonwgs84" => (Geographic, 0),
        "lat" | "latitude" | "gpslatitude" | "gpslat" | "latitudewgs84" | "wgs84latitude"
        | "wgs84lat" | "latwgs84" => (Geographic, 1),
        "e" => (Letters, 0),
        "n" => (Letters, 1),
        _ => return None,
    })
}

/// The rank of a plain name as a height; lower ranks are preferred.
fn height_rank(name: &str) -> Option<usize> {
    Some(match name {
        "z" | "pointz" | "zpoint" | "coordz" | "zcoord" | "zcoordinate" | "coordinatez"
        | "cartesianz" | "posz" | "zpos" | "positionz" | "zposition" | "points2" | "utmz"
        | "xyz2" => 0,
        "elevation" | "elev" | "height" | "hgt" | "altitude" | "alt" | "ellipsoidalheight"
        | "ellipsoidheight" | "heightellipsoidal" | "orthometricheight" | "orthoheight"
        | "orthoht" | "ellht" | "gridz" | "höhe" | "hoehe" | "altitudemsl" | "heightmsl"
        | "elevationmsl" | "gpsaltitude" | "gpsheight" => 1,
        "h" | "u" | "up" => 2,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(names: &str) -> Result<Axes, Vec<usize>> {
        axes_of(&names.split('|').collect::<Vec<_>>())
    }

    #[test]
    fn axes_are_found_in_many_spellings() {
        for (names, want) in [
            ("x|y|z", [0, 1, 2]),
            ("Z|Intensity|Y|X", [3, 2, 0]),
            ("id|easting|northing|elevation", [1, 2, 3]),
            ("Point ID|X [m]|Y [m]|Z [m]|Intensity", [1, 2, 3]),
            ("Time|Latitude|Longitude|Elevation|Amplitude", [2, 1, 3]),
            ("Northing|Easting|Height", [1, 0, 2]),
            ("lat|lon|height", [1, 0, 2]),
            ("N|E|Z", [1, 0, 2]),
            ("E|N|H", [0, 1, 2]),
            ("OBJECTID|POINT_X|POINT_Y|POINT_Z", [1, 2, 3]),
            ("Points:0|Points:1|Points:2", [0, 1, 2]),
            ("X (m)|Y (m)|Height above sea|Z in m", [0, 1, 3]),
            ("x_m|y_m|z_m", [0, 1, 2]),
            ("coord. X|coord. Y|coord. Z", [0, 1, 2]),
            ("Rechtswert|Hochwert|Höhe", [0, 1, 2]),
            ("r|g|b|n|e|x|y|z", [5, 6, 7]),
            ("Longitude|Latitude|Altitude|X|Y|Z", [3, 4, 5]),
            ("North|East|Elev.", [1, 0, 2]),
        ] {
            let axes = found(names).unwrap();
            assert_eq!((axes.columns, axes.rivals), (want, vec![]), "{names}");
            assert_eq!(
                axes.is_geographic,
                names.to_lowercase().starts_with("lat") || names.starts_with("Time")
            );
        }
    }

    #[test]
    fn columns_of_contradictory_names_are_rivals() {
        for (names, want, rivals) in [
            ("x|y|z|x", [0, 1, 2], vec![3]),
            ("lat|lon|height|altitude", [1, 0, 2], vec![3]),
            ("x|y|easting|northing|elevation", [0, 1, 4], vec![2, 3]),
            ("easting|northing|elevation|lat|lon", [0, 1, 2], vec![3, 4]),
        ] {
            let axes = found(names).unwrap();
            assert_eq!((axes.columns, axes.rivals), (want, rivals), "{names}");
        }
    }

    #[test]
    fn lacking_axes_are_told() {
        for (names, want) in [
            ("a|b|c", vec![0, 1, 2]),
            ("x|y|i", vec![2]),
            ("x|z|i", vec![1]),
            ("x|latitude|height", vec![0, 1]),
            ("e|i|z", vec![0, 1]),
            ("|[m]|", vec![0, 1, 2]),
        ] {
            assert_eq!(found(names), Err(want), "{names}");
        }
    }
}
