//! Comments of a PLY header that other programs read: ASCII lines of less than 256 bytes (some hold
//! a line in 1,024 bytes, or decode it as ASCII). Characters that do not fit are escaped, long text
//! goes on in further lines. A coordinate reference system stands in lines `comment crs TEXT`,
//! which go on as `comment crs+ TEXT`, and is read back from them.

use crate::las::GpsTimes;
use std::fmt::Write;

/// Greatest length of a line, without its end.
const LINE_BYTES_MAX: usize = 240;
/// Beginning of the first line of a coordinate reference system, and of those that follow.
const CRS: [&str; 2] = ["comment crs ", "comment crs+ "];

/// Beginning of the line with the epoch of GPS times.
const TIMES: &str = "comment gps_time ";
/// Beginning of the line that names Esker as the writer.
pub(crate) const WRITTEN_BY: &str = "comment written by Esker";

/// The line of the epoch of GPS times.
pub(crate) fn times_line(times: GpsTimes) -> String {
    format!("{TIMES}{}\n", times.name())
}

/// The epoch of GPS times that a header states.
pub(crate) fn times_of(header: &[u8]) -> Option<GpsTimes> {
    let mut lines = header.split(|&b| b == b'\n');
    lines.find_map(|line| GpsTimes::of_name(line.trim_ascii_end().strip_prefix(TIMES.as_bytes())?))
}

/// Whether a header names Esker as the writer.
pub(crate) fn is_by_esker(header: &[u8]) -> bool {
    header.split(|&b| b == b'\n').any(|line| line.starts_with(WRITTEN_BY.as_bytes()))
}

/// Whether a line of a header states what Esker writes anew.
pub(crate) fn is_own(line: &str) -> bool {
    is_crs(line) || line.starts_with(TIMES) || line.starts_with(WRITTEN_BY)
}

/// Escapes characters that are no printable ASCII as `\u{..}`.
pub(crate) fn ascii(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_ascii_graphic() || c == ' ' {
            out.push(c);
        } else {
            out.extend(c.escape_unicode());
        }
    }
    out
}

/// Reverses [`ascii`].
pub(crate) fn unescaped(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(at) = rest.find("\\u{") {
        let (before, escape) = rest.split_at(at);
        out.push_str(before);
        let end = escape.find('}');
        let c = end.and_then(|end| u32::from_str_radix(&escape[3..end], 16).ok());
        match (c.and_then(char::from_u32), end) {
            (Some(c), Some(end)) => {
                out.push(c);
                rest = &escape[end + 1..];
            }
            _ => {
                out.push_str("\\u{");
                rest = &escape[3..];
            }
        }
    }
    out + rest
}

/// Lines of a comment; `line` begins with its keyword.
pub(crate) fn lines_of(line: &str) -> String {
    let line = ascii(line.trim_end());
    let (word, text) = line.split_once(' ').unwrap_or((&line, ""));
    let word = format!("{word} ");
    wrapped([&word, &word], text)
}

/// Lines of a coordinate reference system. Its blanks and line ends become single blanks.
pub(crate) fn crs_lines(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    wrapped(CRS, &ascii(&words.join(" ")))
}

/// Whether a line of a header is of a coordinate reference system.
fn is_crs(line: &str) -> bool {
    CRS.iter().any(|begin| line.starts_with(begin))
}

/// The coordinate reference system in a header, if it has one.
pub(crate) fn crs_of(header: &[u8]) -> Option<String> {
    let header = String::from_utf8_lossy(header);
    let mut lines = header.lines().skip_while(|line| !line.starts_with(CRS[0]));
    let mut text = lines.next()?[CRS[0].len()..].trim_end().to_owned();
    for more in lines.map_while(|line| line.strip_prefix(CRS[1])) {
        text.push_str(more.trim_end());
    }
    let text = unescaped(&text);
    (!text.is_empty()).then_some(text)
}

/// Splits ASCII text into lines that begin with `begin[0]`, then `begin[1]`. Lines neither begin
/// nor end with a blank of the text, which readers would drop, if it has no two in a row.
fn wrapped(begin: [&str; 2], text: &str) -> String {
    let (mut out, mut rest, mut begin_at) = (String::new(), text, 0);
    loop {
        let room = LINE_BYTES_MAX - begin[begin_at].len();
        let mut end = room.min(rest.len());
        let is_blank = |at: usize| rest.as_bytes().get(at) == Some(&b' ');
        while end < rest.len() && end > 1 && (is_blank(end) || is_blank(end - 1)) {
            end -= 1;
        }
        let _ = writeln!(out, "{}{}", begin[begin_at], &rest[..end]);
        rest = &rest[end..];
        begin_at = 1;
        if rest.is_empty() {
            return out;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn short_comments_stay_as_they_are() {
        assert_eq!(lines_of("comment made by hand \t"), "comment made by hand\n");
        assert_eq!(lines_of("obj_info"), "obj_info \n");
        assert_eq!(crs_lines("EPSG:2154"), "comment crs EPSG:2154\n");
        assert_eq!(lines_of("comment 5°\u{1b}"), "comment 5\\u{b0}\\u{1b}\n");
        assert_eq!(crs_of(b"ply\ncomment crs+ A\ncomment other\n"), None);
        assert_eq!(unescaped("\\u{b0}\\u{zz}\\u{"), "°\\u{zz}\\u{");
    }

    proptest! {
        #[test]
        fn a_reference_system_comes_back_from_lines_that_every_program_reads(
            words in prop::collection::vec("[ -~°é\u{202e}]{0,40}", 0..80),
        ) {
            let text = words.join(" ").split_whitespace().collect::<Vec<_>>().join(" ");
            // Text that looks like an escape sequence would be decoded as one.
            prop_assume!(!text.contains("\\u{"));
            let lines = format!("ply\ncomment a\n{}comment b\n", crs_lines(&text));
            prop_assert!(lines.lines().all(|line| line.len() < 256 && line.is_ascii()));
            prop_assert_eq!(crs_of(lines.as_bytes()).unwrap_or_default(), text);
        }
    }
}
