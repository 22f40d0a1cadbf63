//! Text that is safe to print: names of files, attributes and sources come from anywhere, and must
//! not control the terminal, nor look like other names.

/// Escapes control characters, those that reorder text (such as the right-to-left override) and
/// those that show nothing.
pub fn visible(text: &str) -> String {
    let escape = |c: char| {
        if is_safe(c) || c == '\n' || c == '\t' {
            c.to_string()
        } else {
            c.escape_default().to_string()
        }
    };
    text.chars().map(escape).collect()
}

/// Escapes the same characters in a JSON document, whose value stays the same.
pub fn visible_json(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for c in json.chars() {
        if is_safe(c) || c == '\n' || c == '\t' {
            out.push(c);
        } else {
            c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| out += &format!("\\u{unit:04x}"));
        }
    }
    out
}

fn is_safe(c: char) -> bool {
    match c {
        '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' => false,
        '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{e0000}'..='\u{e007f}' => false,
        c => !c.is_control(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_hide_or_reorder_text_are_escaped() {
        assert_eq!(visible("a\u{202e}sal.\u{2066}\u{200b}"), "a\\u{202e}sal.\\u{2066}\\u{200b}");
        assert_eq!(visible("\u{1b}[31m\r"), "\\u{1b}[31m\\r");
        assert_eq!(visible("Grüße, 雪\n\tשלום"), "Grüße, 雪\n\tשלום");
    }

    #[test]
    fn escaped_json_has_the_same_value() {
        let value = serde_json::json!({ "name": "a\u{202e}\u{7f}\u{9b}31m\u{e0001}\n雪" });
        let escaped = visible_json(&value.to_string());
        assert!(escaped.contains("a\\u202e\\u007f\\u009b31m\\udb40\\udc01\\n雪"), "{escaped}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&escaped).unwrap(), value);
    }
}
