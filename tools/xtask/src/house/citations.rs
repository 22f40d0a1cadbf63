//! Checks that every citation key in code and Markdown, such as a surname with a year, is an entry
//! of docs/references.md: a heading, or a bold or backticked key at the start of a line or row.

use super::markdown::heading;
use super::tree::{Fault, Tree};
use std::collections::BTreeSet;

const REFERENCES: &str = "docs/references.md";

/// Words that have the form of a key and are none.
const NO_KEYS: [&str; 0] = [];

/// Faults of all Rust, WGSL and Markdown files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let mut cited = Vec::new();
    for file in tree.of_kinds(&["rs", "wgsl", "md"]) {
        for (at, line) in file.text.lines().enumerate() {
            cited.extend(keys_of(line).map(|key| (file, at + 1, key)));
        }
    }
    let Some(references) = tree.file(REFERENCES) else {
        let keys: BTreeSet<&str> = cited.iter().map(|(_, _, key)| *key).collect();
        let keys: Vec<&str> = keys.into_iter().collect();
        let message = format!("does not exist; list there {}", keys.join(", "));
        return if keys.is_empty() { vec![] } else { vec![Fault::new(REFERENCES, 0, message)] };
    };
    let entries: BTreeSet<&str> = references.text.lines().filter_map(entry).collect();
    let unknown = cited.into_iter().filter(|(_, _, key)| !entries.contains(key));
    let message =
        |key| format!("`{key}` is no entry of {REFERENCES}; add the work or correct the key");
    unknown.map(|(file, line, key)| Fault::new(&file.name, line, message(key))).collect()
}

/// Key of the entry that starts in a line.
fn entry(line: &str) -> Option<&str> {
    if let Some(heading) = heading(line) {
        return keys_of(heading).next();
    }
    let text = line.trim_start_matches(['|', ' ']);
    let text = text.strip_prefix("- ").or(text.strip_prefix("* ")).unwrap_or(text);
    let key = keys_of(text).next()?;
    let before = &text[..text.find(key)?];
    let is_marked = before.contains('`') || before.contains("**");
    (is_marked && before.chars().all(|c| "`*[".contains(c))).then_some(key)
}

/// Words of a line that have the form of a key.
fn keys_of(line: &str) -> impl Iterator<Item = &str> {
    let words = line.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.filter(|word| is_key(word) && !NO_KEYS.contains(word))
}

/// Whether a word is three or more small letters, a year from 1900 to 2099, and a small letter or
/// nothing.
fn is_key(word: &str) -> bool {
    let name = word.trim_start_matches(|c: char| c.is_ascii_lowercase());
    let year = name.strip_suffix(|c: char| c.is_ascii_lowercase()).unwrap_or(name);
    let is_year = year.len() == 4 && year.bytes().all(|b| b.is_ascii_digit());
    word.len() - name.len() >= 3 && is_year && (year.starts_with("19") || year.starts_with("20"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keys in the code of this test would be cited by it.
    fn text(text: &str) -> String {
        text.replace('@', "20")
    }

    #[test]
    fn keys_have_a_surname_and_a_year() {
        let is_key = |word: &str| is_key(&text(word));
        assert!(is_key("wang@07") && is_key("wang@07b"));
        assert!(
            !is_key("li@07") && !is_key("wang@071") && !is_key("a_wang@07") && !is_key("Wang@07")
        );
        assert!(!is_key("wang@07ab") && !is_key("wang1807") && !is_key("@07"));
    }

    #[test]
    fn keys_without_an_entry_are_found() {
        let references =
            text("**`wang@07`** Work.\n| `lee@08` | Work |\n### kim@09: Work\nSee mohr@10.\n");
        let code = text("// wang@07, section 3; lee@08\n// kim@09\n// mohr@10\n");
        let tree = Tree::of(&[(REFERENCES, &references), ("a.rs", &code)]);
        let found: Vec<_> = check(&tree).into_iter().map(|f| (f.file, f.line)).collect();
        assert_eq!(found, [(REFERENCES.to_owned(), 4), ("a.rs".to_owned(), 3)]);
    }

    #[test]
    fn a_missing_list_is_one_fault() {
        let code = text("// wang@07\n// lee@08\n");
        assert_eq!(check(&Tree::of(&[("a.wgsl", &code)])).len(), 1);
        assert!(check(&Tree::of(&[("a.wgsl", "// None.\n")])).is_empty());
    }
}
