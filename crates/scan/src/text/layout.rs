//! Classifies a text file by its first lines: columns of numbers, with or without a line of names,
//! or with counts of lines before them (PTS), or something else altogether.

use super::naming::{COLUMNS_MAX, NAME_BYTES_MAX, axes};
use super::number::{fields, has_decimal_commas, number};
use esker_points::attribute::names;

/// Class of a text file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Columns of numbers.
    Columns(Layout),
    /// Columns of numbers with a decimal comma; the number of the line that has one.
    DecimalCommas(u64),
    /// A table, but not of points; the message names the line and the reason.
    NoPoints(String),
}

/// How the lines of a file are laid out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    /// Names of the columns, if a line has them.
    pub names: Option<Vec<String>>,
    /// Number of the line with names if it is not a comment; it holds no point.
    pub names_line: Option<u64>,
    /// Numbers in a line.
    pub columns: usize,
    /// Whether lines with only a count precede the lines that they count.
    pub has_counts: bool,
}

impl Layout {
    /// Whether a line (without blanks around it) of this number is not meant as a point.
    pub fn is_beside(&self, number: u64, line: &[u8]) -> bool {
        is_comment(line)
            || Some(number) == self.names_line
            || self.has_counts && count(line).is_some()
    }
}

/// Names of the columns of a PTS file, by their number; the file does not name them.
const PTS_COLUMNS: [&[&str]; 5] = [
    &[],
    &[names::INTENSITY],
    &[names::RED, names::GREEN, names::BLUE],
    &[names::INTENSITY, names::RED, names::GREEN, names::BLUE],
    &[names::INTENSITY, names::RED, names::GREEN, names::BLUE, names::NX, names::NY, names::NZ],
];

/// Whether a line (without blanks around it) is a comment.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b"%")
}

/// Whether only empty fields or a comment follow the numbers of a line: `field` is the first that
/// is no number, `behind` the fields after it.
pub(crate) fn is_end<'a>(field: &'a [u8], behind: impl Iterator<Item = &'a [u8]>) -> bool {
    std::iter::once(field).chain(behind).find(|f| !f.is_empty()).is_none_or(is_comment)
}

/// The beginning of a line, or of a part of one, for a message.
pub(crate) fn excerpt(line: &[u8]) -> String {
    String::from_utf8_lossy(&line[..line.len().min(40)]).escape_debug().to_string()
}

/// Classifies a file by its first lines; `None` if it is not text that could hold points. A file
/// without any point is recognised only by its names.
pub(crate) fn classify(head: &[u8]) -> Option<Kind> {
    // Form feeds and the end mark of DOS (0x1A) occur in real files.
    let printable = |b: &u8| *b >= 0x20 || b.is_ascii_whitespace() || *b == 0x1A;
    if !head.iter().all(printable) {
        return None;
    }
    let (mut commented, mut named, mut has_count) = (None, None, false);
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
        let (columns, stray) = numbers_of(line);
        let names = if !has_count && named.is_none() { names_of(line) } else { None };
        match (stray, columns) {
            (None, 1) if !has_count && named.is_none() && count(line).is_some() => has_count = true,
            (None, 3..=COLUMNS_MAX) if has_count => return Some(Kind::Columns(pts(columns))),
            (None, 3..=COLUMNS_MAX) => return Some(layout(n, columns, named, commented)),
            (Some(_), _) if names.is_some() => named = names.map(|names| (n, names)),
            _ => {
                let names = named.as_ref().map(|(_, names)| names).or(commented.as_ref());
                let is_table = columns > 0 || names.is_some_and(|names| has_axes(names));
                return is_table.then(|| Kind::NoPoints(why_no_point(n, columns, stray)));
            }
        }
    }
    let names_line = named.as_ref().map(|(line, _)| *line);
    let names = named.map(|(_, names)| names).or(commented)?;
    let is_table = !has_count && has_axes(&names);
    let columns = names.len();
    let layout = Layout { columns, names: Some(names), names_line, has_counts: false };
    is_table.then_some(Kind::Columns(layout))
}

/// The layout of a file whose line `n` is the first with numbers.
fn layout(
    n: u64,
    columns: usize,
    named: Option<(u64, Vec<String>)>,
    commented: Option<Vec<String>>,
) -> Kind {
    let (names_line, names) = match named {
        Some((line, names)) if names.len() != columns => {
            let named = names.len();
            return Kind::NoPoints(format!(
                "line {n} has {columns} numbers, but line {line} names {named} columns"
            ));
        }
        Some((line, names)) => (Some(line), Some(names)),
        None => (None, commented.filter(|names| names.len() == columns)),
    };
    Kind::Columns(Layout { names, names_line, columns, has_counts: false })
}

/// The layout of a PTS file with this number of columns.
fn pts(columns: usize) -> Layout {
    let more = PTS_COLUMNS.into_iter().find(|more| more.len() + 3 == columns);
    let names = more.map(|more| ["x", "y", "z"].iter().chain(more).map(|n| (*n).into()).collect());
    Layout { names, names_line: None, columns, has_counts: true }
}

/// Counts the numbers that a line begins with; also returns the field after them, if it is neither
/// empty nor a comment.
fn numbers_of(line: &[u8]) -> (usize, Option<&[u8]>) {
    let mut fields = fields(line);
    let mut numbers = 0;
    while let Some(field) = fields.next() {
        if number(field).is_none() {
            return (numbers, (!is_end(field, fields)).then_some(field));
        }
        numbers += 1;
    }
    (numbers, None)
}

/// Why line `n`, which begins with `numbers` numbers, is no point.
fn why_no_point(n: u64, numbers: usize, stray: Option<&[u8]>) -> String {
    match stray {
        Some(b"") => format!("line {n} has an empty field; write a number there"),
        Some(word) => format!("line {n} has `{}`, which is no number", excerpt(word)),
        None if numbers > COLUMNS_MAX => {
            format!("line {n} has more than {COLUMNS_MAX} numbers, which are read at most")
        }
        None => format!("line {n} has fewer than three numbers"),
    }
}

/// Names in a line, separated by commas, else semicolons, else tabs, else blanks; quotes are
/// removed. `None` if a field does not look like a name. Beside x, y and z any word is a name, and
/// an empty field gets `column_` and its number.
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

/// The number in a line that has only a count.
pub(crate) fn count(line: &[u8]) -> Option<u64> {
    let is_one = !line.is_empty() && line.iter().all(u8::is_ascii_digit);
    std::str::from_utf8(line).ok().filter(|_| is_one)?.parse().ok()
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
    fn columns_with_and_without_names_are_recognised() {
        for (text, want) in [
            ("1 2 3\n4 5 6\n", (3, None)),
            ("\n# made by hand\n1.5,2,3,4\n", (4, None)),
            ("x,y,z\n1,2,3\n", (3, names("x y z"))),
            ("\"X\";\"Y\";\"Z\"\n1;2;3\n", (3, names("X Y Z"))),
            ("//X Y Z R G B\n1 2 3 4 5 6\n", (6, names("X Y Z R G B"))),
            ("# x y z\r\n1 2 3\r\n", (3, names("x y z"))),
            ("# x y z are metres\n1 2 3\n", (3, None)),
            ("x,y,z,,\n1,2,3,,\n", (3, names("x y z"))),
            ("\"1\",\"2\",\"3\" # quoted\n", (3, None)),
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
            "easting northing height\n",
            "1 2 3\u{0}",
            "42\n",
            "Once upon a time\nthere was 1 cloud",
        ] {
            assert_eq!(classify(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn tables_without_points_are_refused_with_the_line() {
        for (text, want) in [
            ("x,y,z\n1,,3\n", "line 2 has an empty field"),
            ("1,,3\n", "line 1 has an empty field"),
            ("x,y,z,name\n\n1,2,3,tree\n", "line 3 has `tree`, which is no number"),
            ("1 2 3 tree\n", "line 1 has `tree`, which is no number"),
            ("x,y,z\n\"1,2,3\n", "line 2 has `\\\"1`, which is no number"),
            ("1 2\n3 4\n", "line 1 has fewer than three numbers"),
            ("x,y,z\n1,2\n", "line 2 has fewer than three numbers"),
            ("x,y,z\n1,2,3,4\n", "line 2 has 4 numbers, but line 1 names 3 columns"),
            (&"1 ".repeat(COLUMNS_MAX + 1), "line 1 has more than 1024 numbers"),
        ] {
            let kind = classify(text.as_bytes());
            let Some(Kind::NoPoints(why)) = &kind else { panic!("{text}: {kind:?}") };
            assert!(why.starts_with(want), "{why}");
        }
    }

    #[test]
    fn a_count_before_the_points_makes_a_pts_file() {
        for (text, want) in [
            ("2\n1 2 3\n", "x y z"),
            ("2\r\n1 2 3 -4\r\n", "x y z intensity"),
            ("2\n1 2 3 4 5 6\n", "x y z red green blue"),
            ("# made by hand\n2\n1 2 3 4 5 6 7\n", "x y z intensity red green blue"),
            ("2\n1 2 3 4 5 6 7 0 0 1\n", "x y z intensity red green blue nx ny nz"),
        ] {
            assert_eq!(columns(text).unwrap().1, names(want), "{text}");
        }
        assert_eq!(columns("2\n1 2 3 4 5\n"), Some((5, None)));
        assert_eq!(classify(b"x;y;z\n1,5;2,5;3,5\n"), Some(Kind::DecimalCommas(2)));
    }
}
