//! Words of the panel for what files and the engine call by short names: sources of colours, units
//! of length, lengths.

/// Names of sources of colours, and what they are.
const SOURCES: [(&str, &str); 26] = [
    ("rgb", "colours of the scan"),
    ("normal", "direction of the surface"),
    ("elevation", "height"),
    ("depth", "distance from the camera"),
    ("level", "level of detail"),
    ("plain", "one colour"),
    ("intensity", "intensity"),
    ("classification", "class"),
    ("return_number", "return"),
    ("number_of_returns", "returns of the pulse"),
    ("returns", "returns"),
    ("point_source_id", "scan number"),
    ("scan_id", "scan number"),
    ("scan", "scan number"),
    ("scan_angle", "scan angle"),
    ("scan_angle_rank", "scan angle, degrees"),
    ("scan_direction_flag", "scan direction"),
    ("scanner_channel", "channel of the scanner"),
    ("user_data", "user data"),
    ("gps_time", "time"),
    ("flags", "flags"),
    ("edge_of_flight_line", "edge of the flight line"),
    ("nir", "near infrared"),
    ("red", "red"),
    ("green", "green"),
    ("blue", "blue"),
];

/// What a source of colours or an attribute is called in the window.
pub fn source(name: &str) -> String {
    let known = SOURCES.iter().find(|(own, _)| *own == name);
    known.map_or_else(|| name.replace('_', " "), |(_, words)| (*words).to_owned())
}

/// What the sources are called, each by a name of its own.
pub fn sources(names: &[String]) -> Vec<String> {
    let words: Vec<String> = names.iter().map(|name| source(name)).collect();
    let is_shared = |word: &String| words.iter().filter(|other| *other == word).count() > 1;
    let own = names.iter().zip(&words).map(|(name, word)| match is_shared(word) {
        true => format!("{word} ({name})"),
        false => word.clone(),
    });
    own.collect()
}

/// The plural of a unit of length.
pub fn plural(unit: &str) -> String {
    match unit.strip_suffix("foot") {
        Some(kind) => format!("{kind}feet"),
        None if unit.ends_with('s') => unit.to_owned(),
        None if unit.ends_with("inch") => format!("{unit}es"),
        None => format!("{unit}s"),
    }
}

/// Formats a length with few digits, and its unit if there is one.
pub fn length(value: f64, unit: Option<&str>) -> String {
    let number = match value.abs() {
        v if v >= 100.0 => format!("{value:.0}"),
        v if v >= 1.0 => format!("{value:.1}"),
        _ => format!("{value:.3}"),
    };
    match unit {
        Some(unit) => format!("{number} {}", plural(unit)),
        None => number,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_have_plain_names_of_their_own() {
        for (name, words) in [
            ("point_source_id", "scan number"),
            ("number_of_returns", "returns of the pulse"),
            ("Amplitude_2", "Amplitude 2"),
        ] {
            assert_eq!(source(name), words);
        }
        let names = ["point_source_id", "intensity", "scan"].map(String::from);
        let words = sources(&names);
        assert_eq!(words, ["scan number (point_source_id)", "intensity", "scan number (scan)"]);
        assert!(SOURCES.iter().all(|(_, words)| !words.contains('_')));
    }

    #[test]
    fn units_have_plurals() {
        for (unit, many) in [
            ("metre", "metres"),
            ("foot", "feet"),
            ("US survey foot", "US survey feet"),
            ("inch", "inches"),
        ] {
            assert_eq!(plural(unit), many);
        }
        assert_eq!(length(3344.4, Some("foot")), "3344 feet");
        assert_eq!(length(0.25, None), "0.250");
    }
}
