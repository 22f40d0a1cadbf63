//! Blanks test items in the code of a Rust file: what `#[cfg(test)]` stands before.

use crate::house::source::{closing, is_word};

/// Words that start an item; whatever else has the attribute is a field, an arm or a statement.
const ITEMS: [&str; 16] = [
    "mod",
    "fn",
    "use",
    "impl",
    "struct",
    "enum",
    "const",
    "static",
    "type",
    "trait",
    "extern",
    "let",
    "unsafe",
    "async",
    "macro_rules",
    "union",
];

/// Code, already without comments and strings, with its test items blank; of the same length.
pub fn without_tests(code: &str) -> String {
    let mut bytes = code.as_bytes().to_vec();
    let mut at = 0;
    while let Some(found) = code[at..].find("#[cfg(") {
        let start = at + found;
        let end = closing(code, start + 1);
        at = end;
        if requires_test(&code[start..end]) {
            at = end_of_item(code, end);
            bytes[start..at].iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Whether a `cfg` attribute holds in tests only.
fn requires_test(attribute: &str) -> bool {
    let mut words = attribute.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|word| word == "test") && !attribute.contains("not(") && !attribute.contains("any(")
}

/// Offset behind the item that starts at `from`, its other attributes included.
fn end_of_item(code: &str, from: usize) -> usize {
    let mut start = from;
    loop {
        start += code[start..].len() - code[start..].trim_start().len();
        if !code[start..].starts_with("#[") {
            break;
        }
        start = closing(code, start + 1);
    }
    let word = first_word(&code[start..]);
    let is_item = ITEMS.contains(&word);
    let mut at = start;
    while at < code.len() {
        match code.as_bytes()[at] {
            b';' => return at + 1,
            b',' if !is_item => return at + 1,
            b'}' | b')' | b']' => return at,
            b'{' if word != "use" && word != "let" => return closing(code, at),
            b'{' | b'(' | b'[' => at = closing(code, at),
            _ => at += 1,
        }
    }
    code.len()
}

/// First word behind the visibility.
fn first_word(text: &str) -> &str {
    let mut text = text;
    if let Some(rest) = text.strip_prefix("pub") {
        let rest = rest.trim_start();
        text = if rest.starts_with('(') { rest[closing(rest, 0)..].trim_start() } else { rest };
    }
    let end = text.bytes().position(|b| !is_word(b)).unwrap_or(text.len());
    &text[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(code: &str) -> String {
        let left = without_tests(code);
        assert_eq!(left.len(), code.len());
        left.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn test_items_are_blank() {
        assert_eq!(words("a();\n#[cfg(test)]\nmod tests { fn b() {} }\nc();"), "a(); c();");
        assert_eq!(
            words("#[cfg(all(test, unix))]\n#[allow(x)]\npub(crate) mod a;\nmod b;"),
            "mod b;"
        );
        assert_eq!(words("#[cfg(test)]\nuse a::{b, c};\nd"), "d");
        assert_eq!(words("#[cfg(test)]\nfn a(b: [u8; 4]) -> C { d }\ne"), "e");
        assert_eq!(words("struct A { #[cfg(test)] b: C, d: E }"), "struct A { d: E }");
    }

    #[test]
    fn other_items_stay() {
        assert_eq!(words("#[cfg(not(test))]\nmod a;"), "#[cfg(not(test))] mod a;");
        assert_eq!(words("#[cfg(unix)]\nmod a;"), "#[cfg(unix)] mod a;");
    }
}
