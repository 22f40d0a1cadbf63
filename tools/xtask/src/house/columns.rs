//! Checks that comment lines and Markdown lines have at most 100 columns. Exempt is what cannot be
//! wrapped: rows of tables, code in fences, images, and a line that starts with a URL or a link and
//! is long by the URL alone.

use super::markdown::without_fences;
use super::tree::{Fault, File, Tree};

/// Columns of a line at most, in characters.
const COLUMNS_MAX: usize = 100;

/// Faults of all sources, manifests and Markdown files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    tree.of_kinds(&["rs", "wgsl", "py", "toml", "md"]).flat_map(faults_of).collect()
}

fn faults_of(file: &File) -> Vec<Fault> {
    let (text, what, is_checked): (_, _, fn(&str) -> bool) = match file.kind.as_str() {
        "md" => (without_fences(&file.text), "line", |line| !is_unwrappable(line)),
        "py" | "toml" => (file.text.clone(), "comment", |line| is_comment(line, "#")),
        _ => (file.text.clone(), "comment", |line| is_comment(line, "//")),
    };
    let lengths = text.lines().map(|line| (line, line.trim_end().chars().count())).enumerate();
    let long = lengths.filter(|(_, (line, columns))| *columns > COLUMNS_MAX && is_checked(line));
    let message = |columns| format!("{what} of {columns} columns; wrap it at {COLUMNS_MAX}");
    long.map(|(at, (_, columns))| Fault::new(&file.name, at + 1, message(columns))).collect()
}

/// Whether a line is a comment that could be wrapped.
fn is_comment(line: &str, leader: &str) -> bool {
    line.trim().strip_prefix(leader).is_some_and(|rest| {
        let text = rest.trim_start_matches(['/', '!', '#']).trim();
        !text.starts_with('|') && !is_unwrappable(text)
    })
}

/// Whether a line of Markdown cannot be made shorter by wrapping.
fn is_unwrappable(line: &str) -> bool {
    let text = line.trim_start_matches([' ', '-', '*', '>', '+']);
    if text.starts_with('|') || text.contains("![") || text.contains("<img") {
        return true;
    }
    let first = text.split_whitespace().next().unwrap_or_default();
    if first == text.trim() && first.contains("://") {
        return true;
    }
    // A label and its URL: `[label]: https://...`
    if text.starts_with('[') && text.contains("]: ") && text.split_whitespace().count() == 2 {
        return true;
    }
    let indent = line.chars().count() - text.chars().count();
    text.starts_with('[')
        && text.matches("](").count() == 1
        && indent + without_url(text).chars().count() <= COLUMNS_MAX
}

/// The text without the URL of its link.
fn without_url(text: &str) -> String {
    let Some((before, rest)) = text.split_once("](") else {
        return text.to_owned();
    };
    let after = rest.split_once(')').map_or("", |(_, after)| after);
    format!("{before}]{after}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines_at_fault(name: &str, text: &str) -> Vec<usize> {
        check(&Tree::of(&[(name, text)])).iter().map(|f| f.line).collect()
    }

    #[test]
    fn long_comments_are_found() {
        let words = "word ".repeat(20) + "w";
        let text = format!("// {words}\nlet a = \"{words}\";\n    /// {words}\n//! | {words} |\n");
        assert_eq!(lines_at_fault("a.rs", &text), [1, 3]);
        assert_eq!(lines_at_fault("a.wgsl", &text), [1, 3]);
        assert_eq!(lines_at_fault("a.py", &format!("# {words}\n{words}\n")), [1]);
        assert_eq!(lines_at_fault("a.rs", &format!("#[doc = \"{words}\"]\n")), [0; 0]);
    }

    #[test]
    fn columns_are_characters() {
        assert_eq!(lines_at_fault("a.rs", &format!("// {}", "ä".repeat(97))), [0; 0]);
        assert_eq!(lines_at_fault("a.rs", &format!("// {}", "a".repeat(98))), [1]);
    }

    #[test]
    fn long_markdown_is_found_unless_it_cannot_be_wrapped() {
        let words = "word ".repeat(20) + "w";
        let url = format!("https://example.org/{}", "a".repeat(99));
        let good = format!(
            "| {words} |\n```\n{words}\n```\n![{words}](a.png)\n\
             - [words]({url}).\n<{url}>\n[a]: {url}\n"
        );
        assert_eq!(lines_at_fault("a.md", &good), [0; 0]);
        let bad = format!("{words}\nSome words before [a link]({url})\n[{words}]({url})\n");
        assert_eq!(lines_at_fault("a.md", &bad), [1, 2, 3]);
        assert_eq!(lines_at_fault("a.rs", &format!("/// <{url}>\n/// See <{url}>\n")), [2]);
    }
}
