//! First lines of a text file in a folder: the names of its columns and some rows. Tables that are
//! no points by themselves, whatever lies beside them, are recognised here.

use crate::text::number::{fields, number};
use crate::text::start::first_lines;
use std::path::Path;

/// Greatest number of rows that are looked at.
const ROWS_MAX: usize = 200;
/// Names of columns that only trajectories have: angles of the platform.
const ANGLES: [&str; 8] = ["roll", "pitch", "yaw", "heading", "omega", "phi", "kappa", "course"];
/// Beginnings of the names of columns with times.
const TIMES: [&str; 5] = ["time", "gps_time", "gpstime", "gps time", "sow"];
/// Endings of files that lists of files name.
const FILES: [&str; 14] = [
    ".las", ".laz", ".e57", ".ply", ".pcd", ".ptx", ".pts", ".xyz", ".txt", ".csv", ".asc", ".jpg",
    ".tif", ".png",
];

/// What tables are that name scans or pictures.
pub(super) const LISTS_OF_FILES: &str = "lists of files";

/// First lines of a table.
pub(super) struct Table {
    /// Names of the columns, in lower case.
    pub names: Option<Vec<String>>,
    /// The numbers of some rows, all of the same length.
    pub rows: Vec<Vec<f64>>,
    /// Size of the file, in bytes.
    pub bytes: u64,
}

impl Table {
    /// The table that a file begins with; the error says what it is instead of points.
    pub fn of(head: &[u8], path: &Path) -> Result<Self, &'static str> {
        let lines = first_lines(head);
        let (mut names, mut rows, mut others) = (None, Vec::new(), 0usize);
        for line in lines.split(|&b| b == b'\n').map(|line| line.trim_ascii()) {
            if rows.len() + others >= ROWS_MAX {
                break;
            }
            let words: Vec<&[u8]> = fields(line).collect();
            let numbers = words.iter().filter(|word| number(word).is_some()).count();
            let is_word = |word: &&[u8]| !word.is_empty() && number(word).is_none();
            match words.iter().any(is_word) {
                // Names come before the rows.
                true if rows.is_empty() && numbers == 0 && others == 0 => {
                    names = names_of(line).or(names);
                }
                true if !rows.is_empty() && is_comment(line) => {}
                true => {
                    if names_a_file(&words) {
                        return Err(LISTS_OF_FILES);
                    }
                    others += 1;
                }
                false if numbers < 3 => {}
                false => rows
                    .push(words.into_iter().map(|word| number(word).unwrap_or(f64::NAN)).collect()),
            }
        }
        if others > rows.len() {
            return Err("tables of words");
        }
        let columns = rows.iter().map(Vec::len).min().unwrap_or(0);
        rows.iter_mut().for_each(|row: &mut Vec<f64>| row.truncate(columns));
        let bytes = path.metadata().map_or(0, |file| file.len());
        let table = Self { names, rows, bytes };
        if table.has_angles() { Err("trajectories") } else { Ok(table) }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.rows.first().map_or(0, Vec::len)
    }

    /// Whether columns have the names of an orientation.
    fn has_angles(&self) -> bool {
        let is_angle = |name: &&String| ANGLES.iter().any(|angle| name.starts_with(angle));
        self.names.iter().flatten().filter(is_angle).count() >= 2
    }

    /// Whether the columns are named and have no more than a position, times and a number, as a
    /// path has.
    pub fn is_path(&self) -> bool {
        let Some(names) = &self.names else { return false };
        let is_time = |name: &String| TIMES.iter().any(|time| name.starts_with(time));
        let others = names.iter().filter(|name| !is_time(name) && place(name).is_none());
        names.iter().any(is_time) && others.count() == 0
    }

    /// Whether the columns are named, and x, y and z, or their like, are among them.
    pub fn names_places(&self) -> bool {
        let named = |axis| self.names.iter().flatten().any(|name| place(name) == Some(axis));
        named(0) && named(1) && named(2)
    }

    /// Whether the columns after the position are what text scans have there: nothing, one number,
    /// or colours.
    pub fn is_usual(&self) -> bool {
        let is_byte = |v: f64| v.fract() == 0.0 && (0.0..=65_535.0).contains(&v);
        let are_colours = |from: usize| {
            self.rows.iter().all(|row| row[from..from + 3].iter().all(|&v| is_byte(v)))
        };
        match self.columns() {
            3 | 4 => true,
            5 => self.rows.iter().all(|row| row[3..].iter().all(|&v| is_byte(v))),
            6 => are_colours(3),
            _ => are_colours(3) || are_colours(4),
        }
    }
}

/// Axis that a column of this name, in lower case, has.
fn place(name: &str) -> Option<usize> {
    let word = name.split(['(', '[']).next().unwrap_or(name).trim();
    let axes: [&[&str]; 3] = [
        &["x", "east", "easting", "lon", "longitude", "point_x", "rechtswert"],
        &["y", "north", "northing", "lat", "latitude", "point_y", "hochwert"],
        &["z", "height", "elevation", "elev", "alt", "altitude", "h", "point_z", "hoehe"],
    ];
    axes.iter().position(|names| names.contains(&word))
}

fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b"%")
}

/// The names in a line, in lower case; `None` for fewer than three.
fn names_of(line: &[u8]) -> Option<Vec<String>> {
    let line = String::from_utf8_lossy(line).to_lowercase();
    let line = line.trim_start_matches(['#', '/', '%']).trim();
    let mark = [',', ';', '\t'].into_iter().find(|&mark| line.contains(mark));
    let bare = |part: &str| part.trim().trim_matches(['"', '\'']).trim().to_owned();
    let names: Vec<String> = match mark {
        Some(mark) => line.split(mark).map(bare).collect(),
        None => line.split_whitespace().map(bare).collect(),
    };
    (names.len() >= 3).then_some(names)
}

/// Whether a word is the name of a scan or a picture.
fn names_a_file(words: &[&[u8]]) -> bool {
    words.iter().any(|word| {
        let word = String::from_utf8_lossy(word).to_ascii_lowercase();
        FILES.iter().any(|ending| word.trim_matches(['"', '\'']).ends_with(ending))
    })
}
