//! What a text file is, told by its first lines: columns of numbers with or without a line of names, a
//! relative that is known but not read (PCD, PTS, PTX), or something else altogether.

use super::naming::{COLUMNS_MAX, NAME_BYTES_MAX, axes};
use super::number::{fields, has_decimal_commas, number};

/// What the first lines of a file say.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Columns of numbers.
    Columns(Layout),
    /// Columns of numbers whose decimal point is a comma; the line that shows it.
    DecimalCommas(u64),
    /// A format that looks like text and is not read.
    Foreign(&'static str),
}

/// How the lines of a file are laid out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    /// Names of the columns, where a line tells them.
    pub names: Option<Vec<String>>,
    /// The line that tells them, where it is not a comment; it holds no point.
    pub names_line: Option<u64>,
    /// Numbers in a line.
    pub columns: usize,
}

/// Whether a line (without blanks around it) is a comment.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b"%")
}

/// Tells what a file is by its first lines; `None` where it is no text that could hold points. A file
/// without any point is only told by its names.
pub(crate) fn classify(head: &[u8]) -> Option<Kind> {
    // A PCD's body may be binary and begin within the head.
    if [&b"# .PCD"[..], b"VERSION .7", b"VERSION 0.7"].iter().any(|m| head.starts_with(m)) {
        return Some(Kind::Foreign("PCD"));
    }
    // Form feeds and the end mark of DOS (0x1A) occur in real files.
    let printable = |b: &u8| *b >= 0x20 || b.is_ascii_whitespace() || *b == 0x1A;
    if !head.iter().all(printable) {
        return None;
    }
    let (mut commented, mut named, mut counts) = (None, None, 0);
    for (n, line) in (1..).zip(head.split(|&b| b == b'\n')) {
        let line = line.trim_ascii();
        if line.is_empty() {
            continue;
        }
        if is_comment(line) {
            commented = names_of(uncommented(line)).filter(|names| has_axes(names)).or(commented);
            continue;
        }
        if has_decimal_commas(line) {
            return Some(Kind::DecimalCommas(n));
        }
        let columns = fields(line).take(COLUMNS_MAX + 1).count();
        let numeric = fields(line).take(COLUMNS_MAX + 1).all(|f| number(f).is_some());
        match (numeric, columns) {
            (true, 1) if counts < 2 && named.is_none() && is_count(line) => counts += 1,
            (true, 3..=COLUMNS_MAX) if counts > 0 => {
                return Some(Kind::Foreign(if counts == 1 { "PTS" } else { "PTX" }));
            }
            (true, 3..=COLUMNS_MAX) => return layout(columns, named, commented),
            (false, _) if counts == 0 && named.is_none() => named = Some((n, names_of(line)?)),
            _ => return None,
        }
    }
    let names = named.as_ref().map(|(_, names)| names).or(commented.as_ref())?;
    (counts == 0 && has_axes(names)).then_some(())?;
    layout(names.len(), named, commented)
}

fn layout(
    columns: usize,
    named: Option<(u64, Vec<String>)>,
    commented: Option<Vec<String>>,
) -> Option<Kind> {
    let (names_line, names) = match named {
        // A line of names that does not fit its numbers is no table of points.
        Some((_, names)) if names.len() != columns => return None,
        Some((line, names)) => (Some(line), Some(names)),
        None => (None, commented.filter(|names| names.len() == columns)),
    };
    Some(Kind::Columns(Layout { names, names_line, columns }))
}

/// Names in a line: separated by commas, else semicolons, else tabs, else blanks; quotes are taken off.
/// `None` where a field does not look like a name; beside x, y and z any word does, and one that is empty
/// gets `column_` and its number.
fn names_of(line: &[u8]) -> Option<Vec<String>> {
    let line = std::str::from_utf8(line).ok()?;
    let mark = [',', ';', '\t'].into_iter().find(|&m| line.contains(m));
    let parts: Vec<&str> = match mark {
        Some(mark) => line.trim_end_matches(mark).split(mark).collect(),
        None => line.split_whitespace().collect(),
    };
    let bare = |part: &str| part.trim().trim_matches(['"', '\'']).trim().to_owned();
    let mut names: Vec<String> = parts.into_iter().map(bare).collect();
    let are_axes_named = has_axes(&names);
    for (n, name) in (1..).zip(&mut names) {
        if are_axes_named && name.is_empty() {
            *name = format!("column_{n}");
        }
    }
    let begins_name = |c: char| c.is_alphabetic() || c == '_';
    let is_name = |name: &String| {
        name.len() <= NAME_BYTES_MAX && (are_axes_named || name.starts_with(begins_name))
    };
    ((3..=COLUMNS_MAX).contains(&names.len()) && names.iter().all(is_name)).then_some(names)
}

fn has_axes(names: &[String]) -> bool {
    axes(names.iter().map(String::as_str)).is_some()
}

fn is_count(line: &[u8]) -> bool {
    line.len() <= 20 && line.iter().all(u8::is_ascii_digit)
}

/// A comment without its marks.
fn uncommented(line: &[u8]) -> &[u8] {
    let marks = line.iter().position(|b| !matches!(b, b'#' | b'/' | b'%')).unwrap_or(line.len());
    line[marks..].trim_ascii()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(text: &str) -> Option<(usize, Option<Vec<String>>)> {
        match classify(text.as_bytes()) {
            Some(Kind::Columns(layout)) => Some((layout.columns, layout.names)),
            _ => None,
        }
    }

    fn names(line: &str) -> Option<Vec<String>> {
        Some(line.split(' ').map(str::to_owned).collect())
    }

    #[test]
    fn columns_with_and_without_names_are_told() {
        for (text, want) in [
            ("1 2 3\n4 5 6\n", (3, None)),
            ("\n# made by hand\n1.5,2,3,4\n", (4, None)),
            ("x,y,z\n1,2,3\n", (3, names("x y z"))),
            ("\"X\";\"Y\";\"Z\"\n1;2;3\n", (3, names("X Y Z"))),
            ("//X Y Z R G B\n1 2 3 4 5 6\n", (6, names("X Y Z R G B"))),
            ("# x y z\r\n1 2 3\r\n", (3, names("x y z"))),
            ("# x y z are metres\n1 2 3\n", (3, None)),
            ("x y z\n", (3, names("x y z"))),
            (",x,y,z,1st,(m)\n0,1,2,3,4,5\n", (6, names("column_1 x y z 1st (m)"))),
        ] {
            assert_eq!(columns(text), Some(want), "{text}");
        }
    }

    #[test]
    fn other_texts_are_not_taken_for_points() {
        for text in [
            "",
            "# nothing here",
            "v 1 2 3\nv 4 5 6\n",
            "o thing\nv 1 2 3\n",
            "[1, 2, 3]",
            "{\"x\": 1}",
            "<?xml version=\"1.0\"?>",
            "OFF\n8 6 12\n1 2 3\n",
            "solid a b\nfacet normal 0 0 1\n",
            "1 2\n3 4\n",
            "easting northing height\n",
            "x,y,z\n1,2\n",
            "1 2 3\u{0}",
            "42\n",
            "Once upon a time\nthere was 1 cloud",
        ] {
            assert_eq!(classify(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn relatives_are_known_by_name() {
        for (text, want) in [
            ("# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\n", "PCD"),
            ("VERSION .7\nFIELDS x y z\n", "PCD"),
            ("2\n1 2 3 4\n", "PTS"),
            ("2\r\n3\r\n0 0 0\r\n", "PTX"),
        ] {
            assert_eq!(classify(text.as_bytes()), Some(Kind::Foreign(want)), "{text}");
        }
        assert_eq!(classify(b"x;y;z\n1,5;2,5;3,5\n"), Some(Kind::DecimalCommas(2)));
    }
}
