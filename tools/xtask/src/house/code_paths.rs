//! Checks paths of the repository that stand in backticks in Markdown, such as
//! `crates/*/src/{lib,main}.rs:12`: each alternative names a file or folder that git lists.

use super::markdown::{spans, without_fences};
use super::source::line_at;
use super::tree::{Fault, File, Tree, folder_of};

/// Folders of the root whose paths are checked.
const FOLDERS: [&str; 7] =
    ["crates/", "shaders/", "tools/", "tests/", "docs/", "bench/", "data-format/"];

/// Faults of all Markdown files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    tree.of_kinds(&["md"]).flat_map(|file| faults_of(tree, file)).collect()
}

fn faults_of(tree: &Tree, file: &File) -> Vec<Fault> {
    let prose = without_fences(&file.text);
    let mut faults = Vec::new();
    for span in spans(&prose) {
        let Some(path) = path_of(span.text) else {
            continue;
        };
        for path in alternatives(&path) {
            // A file of a crate may name the crate's own tests.
            let beside = format!("{}/{path}", folder_of(&file.name));
            if !exists(tree, &path) && !exists(tree, &beside) {
                let message = format!("`{path}` does not exist; name the file from the root");
                faults.push(Fault::new(&file.name, line_at(&prose, span.offset), message));
            }
        }
    }
    faults
}

/// The path that a code span starts with, without a line number or a closing slash. Placeholders
/// such as `bench/results/<date>` are no paths.
fn path_of(span: &str) -> Option<String> {
    if !FOLDERS.iter().any(|folder| span.starts_with(folder)) {
        return None;
    }
    let mut depth = 0;
    let mut path = String::new();
    for c in span.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            c if c.is_whitespace() && depth == 0 => break,
            c if c.is_whitespace() => continue,
            _ => {}
        }
        path.push(c);
    }
    let path = path.split(':').next().unwrap_or_default().trim_end_matches('/');
    (!path.contains(['<', '$']) && !path.contains("...")).then(|| path.to_owned())
}

/// Paths that `{a,b}` in a path stand for.
fn alternatives(path: &str) -> Vec<String> {
    let braces = path.find('{').and_then(|open| Some((open, open + path[open..].find('}')?)));
    let Some((open, close)) = braces else {
        return vec![path.to_owned()];
    };
    let (before, after) = (&path[..open], &path[close + 1..]);
    let parts = path[open + 1..close].split(',');
    parts.flat_map(|part| alternatives(&format!("{before}{part}{after}"))).collect()
}

/// Whether a path is that of a file or a folder. It may have `*` and `**`, and names in capitals
/// that stand for any name: `crates/scan/src/FORMAT/mod.rs`.
fn exists(tree: &Tree, path: &str) -> bool {
    let pattern: Vec<String> = path.split('/').map(without_capitals).collect();
    let pattern: Vec<&str> = pattern.iter().map(String::as_str).collect();
    tree.has(path) || tree.paths().any(|p| matches(&pattern, &p.split('/').collect::<Vec<_>>()))
}

/// A part of a path, of which a name in capitals is replaced by `*`.
fn without_capitals(part: &str) -> String {
    let (name, end) = part.split_at(part.find('.').unwrap_or(part.len()));
    let is_placeholder = name.len() > 1 && name.bytes().all(|b| b.is_ascii_uppercase());
    if is_placeholder { format!("*{end}") } else { part.to_owned() }
}

/// Whether parts of a path match those of a pattern; `**` stands for any number of parts.
fn matches(pattern: &[&str], parts: &[&str]) -> bool {
    match (pattern.split_first(), parts.split_first()) {
        (None, None) => true,
        (Some((&"**", rest)), _) => (0..=parts.len()).any(|skip| matches(rest, &parts[skip..])),
        (Some((first, rest)), Some((part, others))) => {
            matches_part(first, part) && matches(rest, others)
        }
        _ => false,
    }
}

/// Whether one part of a path matches a pattern with any number of `*`.
fn matches_part(pattern: &str, part: &str) -> bool {
    let Some((before, rest)) = pattern.split_once('*') else {
        return pattern == part;
    };
    part.strip_prefix(before).is_some_and(|part| {
        let ends = part.char_indices().map(|(at, _)| at).chain([part.len()]);
        ends.into_iter().any(|at| matches_part(rest, &part[at..]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> Vec<String> {
        let sources = [("crates/a/src/lib.rs", ""), ("crates/a/src/b/mod.rs", "")];
        let readme = ("crates/a/README.md", "`tests/own.rs`");
        let tree = Tree::of(&[
            ("a.md", text),
            sources[0],
            sources[1],
            readme,
            ("crates/a/tests/own.rs", ""),
        ]);
        check(&tree).into_iter().map(|f| format!("{}:{}", f.file, f.line)).collect()
    }

    #[test]
    fn paths_that_exist_are_good() {
        let text = "`crates/a/src/lib.rs:12` `crates/*/src/` `crates/a/{src/b, tests/own.rs}`\n\
                    `crates/**/mod.rs` `bench/results/<date>/` `cargo test` crates/none\n\
                    `crates/a/src/l*b.rs --flag` `crates/NAME/src/NAME.rs`\n";
        assert_eq!(faults(text), [""; 0]);
    }

    #[test]
    fn paths_that_do_not_exist_are_found() {
        let text = "`crates/none`\n`crates/a/{src,none}` and\n`tests/own.rs`\n`crates/*/none*.rs`\n\
                    `crates/NAME/none.rs`";
        assert_eq!(faults(text), ["a.md:1", "a.md:2", "a.md:3", "a.md:4", "a.md:5"]);
    }
}
