//! What the name of a column means: the names of LAS fields as PDAL, CloudCompare, LAStools, laspy
//! and Esker write them, of colours and of normals. Case, blanks, underscores, units in brackets,
//! the prefix `scalar_` and numbers appended to equal names are ignored.

use esker_points::attribute::names;

/// Opacity of a colour; LAS has no such field.
pub(crate) const ALPHA: &str = "alpha";

/// A part of `returns` or `flags`, the bytes in which Esker packs what LAS packs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Part {
    /// The packed attribute.
    pub whole: &'static str,
    /// First bit.
    pub shift: u32,
    /// Number of bits.
    pub bits: u32,
}

/// What a name means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Meaning {
    /// The attribute of this name.
    Field(&'static str),
    /// Bits of a packed attribute.
    Part(Part),
    /// Angle of the scan under Esker's name for steps of 0.006 degrees.
    Angle,
    /// Angle of the scan under any other name.
    OtherAngle,
}

const fn returns(shift: u32) -> Meaning {
    Meaning::Part(Part { whole: names::RETURNS, shift, bits: 4 })
}

const fn flags(shift: u32, bits: u32) -> Meaning {
    Meaning::Part(Part { whole: names::FLAGS, shift, bits })
}

/// The number of a return.
pub(crate) const RETURN_NUMBER: Meaning = returns(0);
/// The number of returns of a pulse.
pub(crate) const RETURN_COUNT: Meaning = returns(4);
/// The four class flags in one number: synthetic, key point, withheld, overlap.
pub(crate) const CLASS_FLAGS: Meaning = flags(0, 4);

/// Units that may stand in brackets behind a time or an angle without changing what is meant.
const PLAIN_UNITS: [&str; 8] = ["s", "sec", "seconds", "deg", "degree", "degrees", "°", "-"];

/// What `name` means; `None` for a name that no scan format or program uses for a field.
pub(crate) fn meaning(name: &str) -> Option<Meaning> {
    let (bare, unit) = without_unit(name.trim());
    let found = of_plain(&plain(bare)).or_else(|| of_plain(&plain(without_number(bare)?)))?;
    let has_unit = matches!(found, Meaning::Angle | Meaning::OtherAngle)
        || found == Meaning::Field(names::GPS_TIME);
    let is_other = |unit: &str| !PLAIN_UNITS.contains(&unit.to_lowercase().as_str());
    match (found, unit) {
        _ if has_unit && unit.is_some_and(is_other) => None,
        (Meaning::Angle, _) if name != names::SCAN_ANGLE => Some(Meaning::OtherAngle),
        _ => Some(found),
    }
}

/// Splits off what stands in brackets at the end of a name, if it is no number.
fn without_unit(name: &str) -> (&str, Option<&str>) {
    let pairs = [('[', ']'), ('(', ')')];
    let split = pairs.into_iter().find_map(|(open, close)| {
        let (before, unit) = name.strip_suffix(close)?.rsplit_once(open)?;
        (!before.trim().is_empty()).then(|| (before.trim(), unit.trim()))
    });
    match split {
        Some((before, unit)) if unit.bytes().all(|b| b.is_ascii_digit()) => (before, None),
        Some((before, unit)) => (before, Some(unit)),
        None => (name, None),
    }
}

/// A name without the number that was appended to an equal one (`Intensity #2`, `Intensity_2`);
/// `None` if it ends with no number or is too short to be sure.
fn without_number(name: &str) -> Option<&str> {
    const LETTERS_MIN: usize = 5;
    let bare = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let bare = if bare.len() < name.len() { bare.strip_suffix(['#', '_', ' '])? } else { bare };
    let bare = bare.trim_end_matches(['#', '_', ' ']);
    (bare.len() < name.len() && bare.len() >= LETTERS_MIN).then_some(bare)
}

/// The letters and digits of a name, in lower case, without the prefix of CloudCompare.
fn plain(name: &str) -> String {
    let letters = name.chars().filter(|c| c.is_alphanumeric());
    let plain: String = letters.flat_map(char::to_lowercase).collect();
    plain.strip_prefix("scalar").filter(|rest| !rest.is_empty()).map(str::to_owned).unwrap_or(plain)
}

fn of_plain(plain: &str) -> Option<Meaning> {
    Some(match plain {
        "returnnumber" | "returnnum" | "returnno" => RETURN_NUMBER,
        "numberofreturns" | "numreturns" | "numofreturns" | "numberofreturnsofgivenpulse" => {
            RETURN_COUNT
        }
        "synthetic" | "syntheticflag" => flags(0, 1),
        "keypoint" | "keypointflag" | "modelkeypoint" => flags(1, 1),
        "withheld" | "withheldflag" => flags(2, 1),
        "overlap" | "overlapflag" => flags(3, 1),
        "classflags" | "classificationflags" => CLASS_FLAGS,
        "scanchannel" | "scannerchannel" => flags(4, 2),
        "scandirectionflag" | "scandirection" => flags(6, 1),
        "edgeofflightline" | "edgeofflightlineflag" | "edgeflightline" => flags(7, 1),
        "scanangle" | "scananglescaled" => Meaning::Angle,
        "scananglerank" => Meaning::OtherAngle,
        _ => Meaning::Field(field(plain)?),
    })
}

/// Esker's name of an attribute that is stored as a whole.
fn field(plain: &str) -> Option<&'static str> {
    Some(match plain {
        "nx" | "normalx" => names::NX,
        "ny" | "normaly" => names::NY,
        "nz" | "normalz" => names::NZ,
        "red" | "r" | "rf" | "diffusered" => names::RED,
        "green" | "g" | "gf" | "diffusegreen" => names::GREEN,
        "blue" | "b" | "bf" | "diffuseblue" => names::BLUE,
        "alpha" | "a" | "diffusealpha" => ALPHA,
        "nir" | "infrared" | "nearinfrared" => names::NIR,
        "intensity" => names::INTENSITY,
        "returns" => names::RETURNS,
        "flags" => names::FLAGS,
        "classification" | "class" => names::CLASSIFICATION,
        "gpstime" => names::GPS_TIME,
        "pointsourceid" | "pointsource" | "ptsrcid" => names::POINT_SOURCE_ID,
        "userdata" => names::USER_DATA,
        "wavepacketdescriptorindex" => names::WAVE_DESCRIPTOR,
        "wavepacketoffset" => names::WAVE_OFFSET,
        "wavepacketsize" => names::WAVE_SIZE,
        "wavereturnpointlocation" => names::WAVE_RETURN_POINT,
        "wavext" => names::WAVE_X_T,
        "waveyt" => names::WAVE_Y_T,
        "wavezt" => names::WAVE_Z_T,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_writers_mean_the_same_field() {
        for (name, want) in [
            ("ReturnNumber", RETURN_NUMBER),
            ("scalar_Return_Number", RETURN_NUMBER),
            ("Return Number", RETURN_NUMBER),
            ("return_number", RETURN_NUMBER),
            ("NumberOfReturns", RETURN_COUNT),
            ("scalar_Number_Of_Returns", RETURN_COUNT),
            ("number_of_returns", RETURN_COUNT),
            ("ScanDirectionFlag", flags(6, 1)),
            ("scan_direction", flags(6, 1)),
            ("EdgeOfFlightLine", flags(7, 1)),
            ("ClassFlags", CLASS_FLAGS),
            ("ScanChannel", flags(4, 2)),
            ("Scan Angle Rank", Meaning::OtherAngle),
            ("scan_angle_rank", Meaning::OtherAngle),
            ("scan_angle", Meaning::Angle),
            ("ScanAngle", Meaning::OtherAngle),
            ("Scan Angle (deg)", Meaning::OtherAngle),
            ("scalar_Intensity_#2", Meaning::Field(names::INTENSITY)),
            ("Intensity (2)", Meaning::Field(names::INTENSITY)),
            ("Intensity [%]", Meaning::Field(names::INTENSITY)),
            ("scalar_GPS_Time", Meaning::Field(names::GPS_TIME)),
            ("Gps Time [s]", Meaning::Field(names::GPS_TIME)),
            ("Point Source ID", Meaning::Field(names::POINT_SOURCE_ID)),
            ("diffuse_red", Meaning::Field(names::RED)),
        ] {
            assert_eq!(meaning(name), Some(want), "{name}");
        }
        for name in ["Scan Angle [rad]", "GpsTime [us]", "r_1", "echo", "scalar", "", "()", "x"] {
            assert_eq!(meaning(name), None, "{name}");
        }
    }
}
