//! Checks that comments and Markdown have none of a short list of phrases: they refer to text that
//! the reader does not have, or say in words of this project what has a standard term.

use super::markdown::without_fences;
use super::source::{is_word, split};
use super::tree::{Fault, File, Tree};

/// A phrase, and what is wrong with it.
struct Banned {
    phrase: &'static str,
    remedy: &'static str,
}

const UNSEEN: &str = "the reader cannot see such instructions; write the fact itself";
const UNCLEAR: &str = "write a sentence with a subject, a verb and the standard term";

const BANNED: [Banned; 8] = [
    Banned { phrase: "As said", remedy: "name the item or the section" },
    Banned { phrase: "The same of", remedy: UNCLEAR },
    Banned { phrase: "what is told", remedy: UNCLEAR },
    Banned { phrase: "Where it is none", remedy: UNCLEAR },
    Banned { phrase: "(asked", remedy: UNSEEN },
    Banned { phrase: "DESIGN, section", remedy: UNSEEN },
    Banned { phrase: "DESIGN section", remedy: UNSEEN },
    Banned { phrase: "DESIGN (section", remedy: UNSEEN },
];

/// Faults of all sources, manifests and Markdown files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    tree.of_kinds(&["rs", "wgsl", "py", "toml", "md"]).flat_map(faults_of).collect()
}

fn faults_of(file: &File) -> Vec<Fault> {
    let (text, starts) = joined(&file.kind, &file.text);
    let mut faults = Vec::new();
    for Banned { phrase, remedy } in &BANNED {
        for (at, _) in text.match_indices(phrase).filter(|(at, _)| is_whole(&text, *at, phrase)) {
            let line = starts.partition_point(|start| *start <= at);
            faults.push(Fault::new(&file.name, line, format!("\"{phrase}\": {remedy}")));
        }
    }
    faults.sort_by_key(|fault| fault.line);
    faults
}

/// The comments or the prose of a file as one line, so that a phrase may be wrapped; and the offset
/// in it of each line of the file.
fn joined(kind: &str, text: &str) -> (String, Vec<usize>) {
    let prose = match kind {
        "md" => without_fences(text),
        "py" | "toml" => text.lines().map(|line| hash_comment(line).to_owned() + "\n").collect(),
        _ => split(text).comments,
    };
    let mut joined = String::new();
    let mut starts = Vec::new();
    for line in prose.lines() {
        starts.push(joined.len());
        let words = line.trim().trim_start_matches(['/', '!', '#']).trim();
        joined.push_str(if words.is_empty() { "\n" } else { words });
        joined.push(' ');
    }
    (joined, starts)
}

/// The comment of a line of Python or TOML: a `#` at its start or behind a space.
fn hash_comment(line: &str) -> &str {
    if line.trim_start().starts_with('#') {
        return line;
    }
    line.find(" # ").map_or("", |at| &line[at + 1..])
}

/// Whether a phrase at an offset is no part of longer words.
fn is_whole(text: &str, at: usize, phrase: &str) -> bool {
    let word = |byte: Option<&u8>| byte.is_some_and(|b| is_word(*b));
    let bytes = text.as_bytes();
    let end = at + phrase.len();
    let joins_before = at > 0 && word(bytes.get(at - 1)) && word(bytes.get(at));
    let joins_after = word(bytes.get(end - 1)) && word(bytes.get(end));
    !joins_before && !joins_after
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines_at_fault(name: &str, text: &str) -> Vec<usize> {
        check(&Tree::of(&[(name, text)])).iter().map(|f| f.line).collect()
    }

    #[test]
    fn phrases_are_found_in_comments_also_over_lines() {
        let text = "// As said above.\nlet a = \"As said\"; // (asked 2)\n\
                    /// The file is in DESIGN,\n/// section 7.\n";
        assert_eq!(lines_at_fault("a.rs", text), [1, 2, 3]);
        assert_eq!(
            lines_at_fault("a.py", "a = 'As said'\n# As said.\nb = 1  # As said.\n"),
            [2, 3]
        );
        assert_eq!(lines_at_fault("a.md", "Good.\n\nThe same of\ntwo.\n```\nAs said\n```\n"), [3]);
    }

    #[test]
    fn longer_words_and_other_paragraphs_are_no_phrases() {
        assert_eq!(
            lines_at_fault("a.rs", "// The same offset. (asked_for)\n// DESIGN\n\n// section\n"),
            [0; 0]
        );
    }
}
