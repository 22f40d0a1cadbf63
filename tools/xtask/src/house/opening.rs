//! Checks that every source file opens with a comment that says what it is for.

use super::tree::{Fault, File, Tree};

/// Faults of all source files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let files = tree.of_kinds(&["rs", "wgsl", "py"]);
    files.filter(|file| !opens_with_comment(file)).map(fault_of).collect()
}

fn fault_of(file: &File) -> Fault {
    Fault::new(&file.name, 1, "open with a comment that says what the file is for")
}

fn opens_with_comment(file: &File) -> bool {
    let opening: &[&str] = if file.kind == "py" { &["#", "\"\"\""] } else { &["//"] };
    let first = file.text.lines().next().unwrap_or_default();
    opening.iter().any(|o| first.starts_with(o))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_without_an_opening_comment_are_found() {
        let good = [
            ("a.rs", "//! Purpose.\nfn main() {}\n"),
            ("b.py", "#!/usr/bin/env python3\n"),
            ("c.py", "\"\"\"Purpose.\"\"\"\n"),
            ("d.md", "No comment.\n"),
        ];
        assert!(check(&Tree::of(&good)).is_empty());
        let bad = [("a.rs", "fn main() {}\n"), ("b.py", "import os\n"), ("c.wgsl", "\n// Late.\n")];
        assert_eq!(check(&Tree::of(&bad)).len(), 3);
    }
}
