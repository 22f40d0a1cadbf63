//! What is open, for a list: the scans that a file was built from, its extent and its coordinate
//! system.

use esker_engine::Forest;
use esker_engine::calls::info;

/// A scan that a file was built from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cloud {
    /// Name of its file.
    pub name: String,
    /// Path, as it was given to the build.
    pub path: String,
    /// Format, version and variant.
    pub format: String,
    /// Points that were taken from it.
    pub points: u64,
}

/// What a file has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clouds {
    /// The scans.
    pub scans: Vec<Cloud>,
    /// Least and greatest coordinate along each axis, if there are points.
    pub extent: Option<[[f64; 2]; 3]>,
    /// Name of the coordinate reference system of the first scan that has one.
    pub crs: Option<String>,
    /// Whether horizontal coordinates are degrees.
    pub has_degrees: bool,
    /// Whether points have flags, such as those of overlap.
    pub has_flags: bool,
}

impl Clouds {
    /// What `file` has.
    pub fn of(file: &Forest) -> Self {
        let records = || file.files().flat_map(|tree| &tree.metadata().sources);
        let scans = records().map(|record| Cloud {
            name: last_part(&record.path),
            path: record.path.clone(),
            format: record.format.clone(),
            points: record.points,
        });
        let crs = records().find_map(|record| record.crs.as_ref());
        let bounds = info::world_bounds(file);
        Self {
            scans: scans.collect(),
            extent: bounds.map(|[low, high]| [0, 1, 2].map(|i| [low[i], high[i]])),
            crs: crs.map(|crs| name_of(&crs.text)).filter(|name| !name.is_empty()),
            has_degrees: file.lattice().is_scaled() || info::mixes_degrees(file),
            has_flags: file.schema().find("flags").is_some(),
        }
    }
}

/// Name of the file at a path of any system.
fn last_part(path: &str) -> String {
    let parts = path.rsplit(['/', '\\']);
    parts.into_iter().find(|part| !part.is_empty()).unwrap_or(path).to_owned()
}

/// Name of a system: the first quoted text of WKT; otherwise the beginning of the text.
fn name_of(text: &str) -> String {
    /// Most characters of a text that is not WKT.
    const CHARS_MAX: usize = 120;
    match text.split('"').nth(1) {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => {
            text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(CHARS_MAX).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_systems_have_short_names() {
        assert_eq!(last_part("scans/town.laz"), "town.laz");
        assert_eq!(last_part(r"C:\scans\town.e57"), "town.e57");
        assert_eq!(last_part("scans/folder/"), "folder");
        let wkt = r#"COMPD_CS["NAD83 / UTM 15N + NAVD88",PROJCS["NAD83"]]"#;
        assert_eq!(name_of(wkt), "NAD83 / UTM 15N + NAVD88");
        assert_eq!(name_of("EPSG  2193\n"), "EPSG 2193");
    }
}
