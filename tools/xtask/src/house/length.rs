//! Checks that no source file is longer than 800 lines.

use super::tree::{Fault, Tree};

/// Lines of a source file at most.
const LINES_MAX: usize = 800;

/// Faults of all source files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let lengths = tree.of_kinds(&["rs", "wgsl", "py"]).map(|f| (f, f.text.lines().count()));
    let long = lengths.filter(|(_, lines)| *lines > LINES_MAX);
    long.map(|(file, lines)| Fault::new(&file.name, 0, message(lines))).collect()
}

fn message(lines: usize) -> String {
    format!("{lines} lines; split the file into parts of at most {LINES_MAX}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_sources_are_found() {
        let long = "\n".repeat(LINES_MAX + 1);
        assert_eq!(check(&Tree::of(&[("a.rs", &long), ("b.wgsl", &long)])).len(), 2);
        assert!(check(&Tree::of(&[("a.rs", &long[1..]), ("b.md", &long)])).is_empty());
    }
}
