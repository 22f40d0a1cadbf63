//! Checks that no text names a folder of one machine or person.

use super::tree::{Fault, Tree};

/// First folders of paths that exist on one machine only.
const OWN_FOLDERS: [&str; 3] = ["work", "home", "Users"];

/// Faults of all text files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let mut faults = Vec::new();
    for file in &tree.files {
        for (number, line) in file.text.lines().enumerate() {
            if names_own_folder(line) {
                let message =
                    "names a folder of one machine; use a path from the root or a variable";
                faults.push(Fault::new(&file.name, number + 1, message));
            }
        }
    }
    faults
}

/// Whether a line has an absolute path below one of [`OWN_FOLDERS`]. Parts of URLs and of longer
/// paths do not count.
fn names_own_folder(line: &str) -> bool {
    OWN_FOLDERS.iter().any(|folder| {
        let path = format!("/{folder}");
        line.match_indices(&path).any(|(at, _)| {
            let before = line[..at].chars().next_back();
            let after = line[at + path.len()..].chars().next();
            let starts = !before.is_some_and(|c| c.is_alphanumeric() || "./_-})>".contains(c));
            starts && after == Some('/')
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_folders_are_found_and_urls_are_not() {
        for folder in OWN_FOLDERS {
            let path = format!("/{folder}/data");
            let bad = format!("First.\nopen(\"{path}\")\n{path}");
            let lines: Vec<usize> =
                check(&Tree::of(&[("a.md", &bad)])).iter().map(|f| f.line).collect();
            assert_eq!(lines, [2, 3]);
            assert!(!names_own_folder(&format!("https://example.org{path}")));
        }
        assert!(!names_own_folder("the /workspace/ and a /homeless/ path"));
    }
}
