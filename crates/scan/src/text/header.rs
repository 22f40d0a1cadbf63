//! Reads the names of columns in a line before the points: separated by commas, semicolons, tabs or
//! blanks, with or without quotes, in any encoding.

use super::axes::has_axes;
use super::cells::{Separator, Style};
use super::encoding::decoded;
use super::naming::{COLUMNS_MAX, NAME_BYTES_MAX};

/// The names of columns in a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Names {
    /// The names, without the empty ones at the end of the line.
    pub names: Vec<String>,
    /// Number of names with the empty ones at the end of the line.
    pub cells: usize,
}

/// The names in a line: `wanted` many if a separator gives as many, else by the first separator of
/// comma, semicolon, tab and blank that gives names. `None` if there is none: a field does not look
/// like a name. Beside x, y and z any word is a name, and an empty field gets `column_` and its
/// number.
pub(crate) fn names_of(line: &[u8], wanted: Option<usize>) -> Option<Names> {
    let marks = [b',', b';', b'\t'].into_iter().filter(|mark| line.contains(mark));
    let split = marks.map(|mark| by_mark(line, mark)).chain([by_blanks(line)]);
    let mut all = split.map(bounded).filter_map(checked);
    let first = all.next()?;
    let is_wanted = |names: &Names| Some(names.names.len()) == wanted;
    if is_wanted(&first) { Some(first) } else { all.find(is_wanted).or(Some(first)) }
}

fn bounded(mut names: Vec<String>) -> Names {
    let cells = names.len();
    names.truncate(names.iter().rposition(|name| !name.is_empty()).map_or(0, |last| last + 1));
    Names { names, cells }
}

fn checked(mut found: Names) -> Option<Names> {
    let names = &mut found.names;
    if !(3..=COLUMNS_MAX).contains(&names.len()) {
        return None;
    }
    let are_axes_named = has_axes(names);
    for (n, name) in (1..).zip(names.iter_mut()) {
        if are_axes_named && name.is_empty() {
            *name = format!("column_{n}");
        }
    }
    let begins_name = |c: char| c.is_alphabetic() || c == '_';
    let is_name = |name: &String| {
        name.len() <= NAME_BYTES_MAX && (are_axes_named || name.starts_with(begins_name))
    };
    names.iter().all(is_name).then_some(found)
}

fn by_mark(line: &[u8], mark: u8) -> Vec<String> {
    let style = Style { separator: Separator::Mark(mark), has_decimal_commas: false };
    style.cells(line).take(COLUMNS_MAX + 1).map(bare).collect()
}

/// Names between blanks; a unit in brackets belongs to the name before it.
fn by_blanks(line: &[u8]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for cell in Style::ANY.cells(line).take(COLUMNS_MAX + 1) {
        let name = bare(cell);
        match names.last_mut() {
            Some(last) if name.starts_with('[') && name.ends_with(']') => {
                last.push(' ');
                last.push_str(&name);
            }
            _ => names.push(name),
        }
    }
    names
}

/// A name without the quotes around it; doubled quotes in it become one.
fn bare(cell: &[u8]) -> String {
    let text = decoded(cell);
    let text = text.trim();
    match text.strip_prefix('"').and_then(|text| text.strip_suffix('"')) {
        Some(inner) => inner.replace("\"\"", "\"").trim().to_owned(),
        None => text.trim_matches(['"', '\'']).trim().to_owned(),
    }
}

/// A comment without its marks.
pub(crate) fn uncommented(line: &[u8]) -> &[u8] {
    let marks = line.iter().position(|b| !matches!(b, b'#' | b'/' | b'%')).unwrap_or(line.len());
    line[marks..].trim_ascii()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(line: &str, wanted: Option<usize>) -> Option<String> {
        names_of(line.as_bytes(), wanted).map(|found| found.names.join("|"))
    }

    #[test]
    fn names_are_separated_as_in_the_file() {
        for (line, wanted, want) in [
            ("x y z", None, "x|y|z"),
            ("\"X\";\"Y\";\"Z\"", None, "X|Y|Z"),
            ("x,y,z,\"echo, of how many\",a", None, "x|y|z|echo, of how many|a"),
            ("x,y,z,\"say \"\"a\"\"\"", None, "x|y|z|say \"a\""),
            ("Point ID;X [m];Y [m];Z [m]", None, "Point ID|X [m]|Y [m]|Z [m]"),
            ("X [m] Y [m] Z [m]", None, "X [m]|Y [m]|Z [m]"),
            ("x,y,z,,", None, "x|y|z"),
            (",x,y,z,1st,(m)", None, "column_1|x|y|z|1st|(m)"),
            ("x;y;height, in m", Some(3), "x|y|height, in m"),
            ("x y z\ta b", Some(5), "x|y|z|a|b"),
            ("x y z\ta b", None, "x|y|z|a|b"),
        ] {
            assert_eq!(names(line, wanted).as_deref(), Some(want), "{line}");
        }
        for line in ["x y", "1 2 3", "v 1 2 3", "", ",,,", "a,,b"] {
            assert_eq!(names(line, None), None, "{line}");
        }
        assert_eq!(names_of(b"x,y,z,,", None).unwrap().cells, 5);
    }
}
