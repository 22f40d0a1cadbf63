//! The text files of the working tree that git lists, and the form of a fault found in one.

use crate::shell::output;
use anyhow::{Context, Result};
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

/// Kinds of files whose text is read; files without a kind are scripts.
const TEXTS: [&str; 8] = ["rs", "wgsl", "py", "md", "toml", "sh", "yml", "yaml"];

/// A text file: its path from the root with `/`, the end of its name, its text.
pub struct File {
    pub name: String,
    pub kind: String,
    pub text: String,
}

/// All files that git has or could take up.
#[derive(Default)]
pub struct Tree {
    pub files: Vec<File>,
    /// Every file, also those that are no text, and every folder.
    paths: BTreeSet<String>,
}

impl Tree {
    /// Reads the working tree below the current folder.
    pub fn of_git() -> Result<Self> {
        let list = ["ls-files", "-z", "--cached", "--others", "--exclude-standard"];
        let names = output("git".as_ref(), &list).context("git lists the files to check")?;
        let mut tree = Self::default();
        // A file that was deleted and not yet committed is still listed.
        for name in names.split('\0').filter(|n| Path::new(n).is_file()) {
            let is_text = TEXTS.contains(&kind_of(name));
            let text = if is_text { std::fs::read_to_string(name).ok() } else { None };
            tree.add(name, text);
        }
        tree.files.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(tree)
    }

    /// Files of these kinds.
    pub fn of_kinds<'a>(&'a self, kinds: &'a [&str]) -> impl Iterator<Item = &'a File> {
        self.files.iter().filter(|file| kinds.contains(&file.kind.as_str()))
    }

    /// The text file at a path.
    pub fn file(&self, name: &str) -> Option<&File> {
        self.files.iter().find(|file| file.name == name)
    }

    /// Whether a file or a folder is at a path.
    pub fn has(&self, path: &str) -> bool {
        self.paths.contains(path)
    }

    /// Paths of all files and folders, in order.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.paths.iter().map(String::as_str)
    }

    fn add(&mut self, name: &str, text: Option<String>) {
        let mut path = name;
        while !path.is_empty() && self.paths.insert(path.to_owned()) {
            path = folder_of(path);
        }
        if let Some(text) = text {
            self.files.push(File { name: name.into(), kind: kind_of(name).into(), text });
        }
    }

    /// A tree of these files: name and text.
    #[cfg(test)]
    pub fn of(files: &[(&str, &str)]) -> Self {
        let mut tree = Self::default();
        files.iter().for_each(|(name, text)| tree.add(name, Some((*text).to_owned())));
        tree
    }
}

/// Path of the folder that holds a file or a folder; empty for the root.
pub fn folder_of(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

fn kind_of(name: &str) -> &str {
    Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or("sh")
}

/// What is wrong, where, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    pub file: String,
    /// Line from 1; 0 for the whole file.
    pub line: usize,
    pub message: String,
}

impl Fault {
    /// A fault at a line of a file.
    pub fn new(file: &str, line: usize, message: impl Into<String>) -> Self {
        Self { file: file.into(), line, message: message.into() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}: {}", self.file, self.message),
            line => write!(f, "{}:{line}: {}", self.file, self.message),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_known_and_kinds_filter() {
        let tree = Tree::of(&[("a/b/c.rs", ""), ("a/d.md", ""), (".ci/run", "")]);
        assert_eq!(
            tree.paths().collect::<Vec<_>>(),
            [".ci", ".ci/run", "a", "a/b", "a/b/c.rs", "a/d.md"]
        );
        assert_eq!(tree.of_kinds(&["md", "sh"]).count(), 2);
        assert!(tree.has("a/b") && !tree.has("b") && tree.file("a/d.md").is_some());
    }

    #[test]
    fn faults_of_whole_files_have_no_line() {
        assert_eq!(Fault::new("a.rs", 7, "wrong").to_string(), "a.rs:7: wrong");
        assert_eq!(Fault::new("a.rs", 0, "wrong").to_string(), "a.rs: wrong");
    }
}
