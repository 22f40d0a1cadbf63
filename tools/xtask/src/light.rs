//! Checks that light is optional: programs built without the feature `light` link none of its
//! crates, compile without a warning, and hold no line of its shaders.

use crate::shell::{cargo, output, run_cargo};
use anyhow::{Context, Result, bail, ensure};
use std::path::{Path, PathBuf};

/// The programs.
const PROGRAMS: [&str; 2] = ["esker", "esker-view"];
/// Crates that only light links.
const CRATES: [&str; 2] = ["esker-trace", "obvhs"];
/// Folders of `shaders/` that only light has.
const FOLDERS: [&str; 3] = ["trace", "filter", "splats"];
/// A folder of `shaders/` that every program has: its lines must be found where lines are searched.
const ALWAYS: &str = "shade";
/// Shortest line that is searched: shorter ones are in several shaders.
const LINE_MIN: usize = 24;

/// Checks trees of dependencies, the build without light, and its bytes.
#[allow(clippy::disallowed_methods, reason = "the program was built a moment ago")]
pub fn check() -> Result<()> {
    for program in PROGRAMS {
        let tree = ["tree", "-p", program, "--no-default-features", "-e", "normal,build"];
        let tree =
            output(&cargo(), &[&tree[..], &["--prefix", "none", "--target", "all"]].concat())?;
        if let Some(linked) = CRATES.into_iter().find(|name| names(&tree, name)) {
            bail!("{program} links {linked} without the feature light");
        }
    }
    let lints = ["--no-default-features", "--", "-D", "warnings"];
    for program in PROGRAMS {
        run_cargo(&[&["clippy", "--release", "-p", program][..], &lints].concat())?;
    }
    run_cargo(&["build", "--release", "-p", PROGRAMS[0], "--no-default-features"])?;
    let bytes = std::fs::read(program_path()?).context("the program without light")?;
    let always = lines(ALWAYS, "")?;
    ensure!(
        !always.is_empty() && always.iter().all(|line| contains(&bytes, line)),
        "the program has no shaders of {ALWAYS}, so that the search for others shows nothing"
    );
    let mut others = String::new();
    for folder in std::fs::read_dir("shaders")? {
        let name = folder?.file_name();
        if !FOLDERS.iter().any(|own| name == *own) {
            others += &texts(&name.to_string_lossy())?.concat();
        }
    }
    let mut searched = 0;
    for folder in FOLDERS {
        for line in lines(folder, &others)? {
            searched += 1;
            ensure!(!contains(&bytes, &line), "the program without light has `{line}`");
        }
    }
    ensure!(searched > 0, "the shaders of light hold nothing to search for");
    println!("light: {searched} lines of its shaders are not in the program without it");
    Ok(())
}

fn program_path() -> Result<PathBuf> {
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    let name = format!("{}{}", PROGRAMS[0], std::env::consts::EXE_SUFFIX);
    Path::new(&target).join("release").join(name).canonicalize().context("the program")
}

/// Whether a tree, one crate a line, names a crate.
fn names(tree: &str, name: &str) -> bool {
    tree.lines().any(|line| line.split_whitespace().next() == Some(name))
}

/// The longest line of code of each shader in a folder that `others` has not.
fn lines(folder: &str, others: &str) -> Result<Vec<String>> {
    let longest = |text: &String| {
        let code = text.lines().map(str::trim).filter(|line| !line.starts_with("//"));
        let own = code.filter(|line| line.len() >= LINE_MIN && !others.contains(line));
        own.max_by_key(|line| line.len()).map(str::to_owned)
    };
    Ok(texts(folder)?.iter().filter_map(longest).collect())
}

/// Texts of the shaders in a folder of `shaders/`; none if there is no such folder.
fn texts(folder: &str) -> Result<Vec<String>> {
    let folder = Path::new("shaders").join(folder);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let read = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry?.path();
        std::fs::read_to_string(&path).with_context(|| format!("{}", path.display()))
    };
    std::fs::read_dir(&folder)?.map(read).collect()
}

fn contains(bytes: &[u8], line: &str) -> bool {
    let line = line.as_bytes();
    let first = line[0];
    let mut at = 0;
    while let Some(next) = bytes[at..].iter().position(|&byte| byte == first) {
        at += next;
        if bytes[at..].starts_with(line) {
            return true;
        }
        at += 1;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_found_wherever_they_are() {
        for (bytes, line, is_in) in
            [("abab", "ab", true), ("aab", "ab", true), ("a", "ab", false), ("", "ab", false)]
        {
            assert_eq!(contains(bytes.as_bytes(), line), is_in, "{bytes}");
        }
    }

    #[test]
    fn crates_are_named_by_whole_words() {
        assert!(names("esker v1\nobvhs v0.4.0\n", "obvhs"));
        assert!(!names("obvhs-more v0.4.0\n", "obvhs"));
    }
}
