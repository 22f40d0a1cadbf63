//! Splits Rust or WGSL text into code and comments, so that a rule reads one without the other.

/// Two texts of the length and lines of the source. What belongs to neither is blank in both.
pub struct Split {
    /// Code without comments and without the contents of strings and characters.
    pub code: String,
    /// Comments, with their slashes.
    pub comments: String,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Code,
    Comment,
    Literal,
}

/// Splits the text of a Rust or WGSL file.
pub fn split(text: &str) -> Split {
    let bytes = text.as_bytes();
    let mut parts = vec![Part::Code; bytes.len()];
    let mut at = 0;
    while at < bytes.len() {
        let (part, length) = next(&bytes[at..], at.checked_sub(1).map(|i| bytes[i]));
        let end = (at + length).min(bytes.len());
        parts[at..end].fill(part);
        at = end;
    }
    let keep = |part: Part| {
        let kept = bytes
            .iter()
            .zip(&parts)
            .map(|(byte, p)| if *p == part || *byte == b'\n' { *byte } else { b' ' });
        String::from_utf8_lossy(&kept.collect::<Vec<u8>>()).into_owned()
    };
    Split { code: keep(Part::Code), comments: keep(Part::Comment) }
}

/// The part that starts here, and its length in bytes.
fn next(rest: &[u8], before: Option<u8>) -> (Part, usize) {
    if rest.starts_with(b"//") {
        return (Part::Comment, rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len()));
    }
    if rest.starts_with(b"/*") {
        return (Part::Comment, block_comment(rest));
    }
    let starts_word = !before.is_some_and(is_word);
    match rest[0] {
        b'"' => (Part::Literal, quoted(rest, b'"')),
        b'\'' => character(rest).map_or((Part::Code, 1), |length| (Part::Literal, length)),
        b'r' | b'b' | b'c' if starts_word => {
            raw_string(rest).map_or((Part::Code, 1), |length| (Part::Literal, length))
        }
        _ => (Part::Code, 1),
    }
}

/// Length of a block comment, which may hold others.
fn block_comment(rest: &[u8]) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at + 1 < rest.len() {
        match &rest[at..at + 2] {
            b"/*" => depth += 1,
            b"*/" => depth -= 1,
            _ => {
                at += 1;
                continue;
            }
        }
        at += 2;
        if depth == 0 {
            return at;
        }
    }
    rest.len()
}

/// Length of a literal between two `quote`s, with escapes.
fn quoted(rest: &[u8], quote: u8) -> usize {
    let mut at = 1;
    while at < rest.len() {
        match rest[at] {
            b'\\' => at += 2,
            b if b == quote => return at + 1,
            _ => at += 1,
        }
    }
    rest.len()
}

/// Length of a character literal; none for a lifetime.
fn character(rest: &[u8]) -> Option<usize> {
    if rest.get(1) == Some(&b'\\') {
        return Some(quoted(rest, b'\''));
    }
    // A character has one to four bytes.
    let end = rest.iter().skip(2).take(4).position(|b| *b == b'\'')? + 2;
    let inner = std::str::from_utf8(&rest[1..end]).ok()?;
    (inner.chars().count() == 1).then_some(end + 1)
}

/// Length of a raw string, `r#"..."#` with any number of `#`, also with `b` or `c` before.
fn raw_string(rest: &[u8]) -> Option<usize> {
    let prefix = if rest[0] == b'r' { 1 } else { 2 };
    if prefix == 2 && rest.get(1) != Some(&b'r') {
        return None;
    }
    let hashes = rest[prefix..].iter().take_while(|b| **b == b'#').count();
    let open = prefix + hashes;
    if rest.get(open) != Some(&b'"') {
        return None;
    }
    let close: Vec<u8> = std::iter::once(b'"').chain(std::iter::repeat_n(b'#', hashes)).collect();
    let length = rest[open + 1..].windows(close.len()).position(|w| w == close);
    Some(length.map_or(rest.len(), |l| open + 1 + l + close.len()))
}

/// Whether a byte can stand in a word of code.
pub fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Number of the line, from 1, that holds a byte offset.
pub fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes()[..offset].iter().filter(|b| **b == b'\n').count() + 1
}

/// Offset behind the bracket that closes the one at `open`; the end of the text if none does.
pub fn closing(code: &str, open: usize) -> usize {
    let mut depth = 0;
    for (at, byte) in code.bytes().enumerate().skip(open) {
        match byte {
            b'{' | b'(' | b'[' => depth += 1,
            b'}' | b')' | b']' => depth -= 1,
            _ => continue,
        }
        if depth == 0 {
            return at + 1;
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_literals_are_no_code() {
        let text =
            "let a = \"// b\"; // c 'd\nlet e = r#\"\"f\"#; /* g /* h */ i */ j('k', '\\'');";
        let Split { code, comments } = split(text);
        assert_eq!((code.len(), comments.len()), (text.len(), text.len()));
        assert_eq!(comments.split_whitespace().collect::<String>(), "//c'd/*g/*h*/i*/");
        assert_eq!(code.split_whitespace().collect::<String>(), "leta=;lete=;j(,);");
    }

    #[test]
    fn lifetimes_are_code() {
        let text = "fn f<'a>(r: &'a str, b: u8) -> &'a str { r }";
        assert_eq!(split(text).code, text);
        assert_eq!(
            split("match c { 'ä' => '\"', _ => 'b' }").code,
            "match c {      => ".to_owned() + "   , _ =>     }"
        );
    }

    #[test]
    fn brackets_close() {
        assert_eq!(closing("f(a, [b], {c}) {}", 1), 14);
        assert_eq!(line_at("a\nb\nc", 2), 2);
    }
}
