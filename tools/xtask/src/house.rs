//! House rules that no compiler checks: every source file opens with a comment that says what it is
//! for, none is longer than 800 lines, and no file names a folder of somebody's machine.

use crate::figures;
use crate::shell::output;
use anyhow::{Context, Result, bail};
use std::path::Path;

/// Lines of a source file at most.
const LINES_MAX: usize = 800;
/// Kinds of files that are sources.
const SOURCES: [&str; 3] = ["rs", "wgsl", "py"];
/// Kinds of files that are read for paths; files without a kind are scripts.
const TEXTS: [&str; 8] = ["rs", "wgsl", "py", "md", "toml", "sh", "yml", "yaml"];
/// First folders of paths that are somebody's own.
const OWN_FOLDERS: [&str; 3] = ["work", "home", "Users"];

/// Checks every file that git knows or could take up.
pub fn check() -> Result<()> {
    let list = ["ls-files", "--cached", "--others", "--exclude-standard"];
    let files = output(&"git".into(), &list).context("git lists the files to check")?;
    let mut faults = Vec::new();
    let mut checked = 0;
    for name in files.lines() {
        let path = Path::new(name);
        let kind = path.extension().and_then(|e| e.to_str()).unwrap_or("sh");
        // A file that was deleted and not yet committed is still listed.
        if !TEXTS.contains(&kind) || !path.is_file() {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(path) else {
            continue;
        };
        checked += 1;
        faults.extend(faults_of(kind, &text).into_iter().map(|fault| format!("{name}{fault}")));
    }
    if !faults.is_empty() {
        bail!("\n  {}", faults.join("\n  "));
    }
    println!("house: {checked} files keep the rules");
    figures::check()
}

fn faults_of(kind: &str, text: &str) -> Vec<String> {
    let mut faults = Vec::new();
    if SOURCES.contains(&kind) {
        let opening: &[&str] = if kind == "py" { &["#", "\"\"\""] } else { &["//"] };
        let first = text.lines().next().unwrap_or_default();
        if !opening.iter().any(|o| first.starts_with(o)) {
            faults.push(": does not open with a comment that says what it is for".into());
        }
        let lines = text.lines().count();
        if lines > LINES_MAX {
            faults.push(format!(": {lines} lines; split it before {LINES_MAX}"));
        }
    }
    for (number, line) in text.lines().enumerate() {
        if names_own_folder(line) {
            faults.push(format!(":{}: names a folder of somebody's machine", number + 1));
        }
    }
    faults
}

/// Whether a line has an absolute path below one of [`OWN_FOLDERS`]; those inside URLs and longer
/// paths are none.
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
        let path = |folder: &str| format!("/{folder}/data");
        for folder in OWN_FOLDERS {
            assert!(names_own_folder(&format!("open(\"{}\")", path(folder))));
            assert!(names_own_folder(&path(folder)));
            assert!(!names_own_folder(&format!("https://example.org{}", path(folder))));
        }
        assert!(!names_own_folder("the /workspace/ and a /homeless/ path"));
    }

    #[test]
    fn openings_and_lengths_are_checked() {
        assert!(faults_of("rs", "//! Purpose.\nfn main() {}\n").is_empty());
        assert_eq!(faults_of("rs", "fn main() {}\n").len(), 1);
        assert!(faults_of("py", "#!/usr/bin/env python3\n").is_empty());
        assert_eq!(faults_of("wgsl", &format!("// Long.\n{}", "\n".repeat(LINES_MAX))).len(), 1);
        assert!(faults_of("md", "No comment.\n").is_empty());
    }
}
