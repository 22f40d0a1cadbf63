//! Modules of a crate by their files, and which file defines the item that a path names.

use super::imports::{self, Named, Use};
use super::non_test::without_tests;
use crate::house::source::split;
use std::collections::{BTreeMap, BTreeSet};

/// Re-exports that are followed one after the other, at most.
const FOLLOWED_MAX: usize = 8;

/// A file of a crate.
pub struct Module {
    /// Its path below the folder `src`.
    pub file: String,
    /// Path of the module from the root of the crate.
    path: Vec<String>,
    /// Code without comments, strings, tests and `use` declarations; of the length of the file.
    pub body: String,
    pub uses: Vec<Use>,
    children: Vec<String>,
    /// Paths from the root of the crate of what `use` declarations name, by the names given.
    names: BTreeMap<String, Vec<String>>,
    /// Modules of which all items are named.
    globs: Vec<Vec<String>>,
}

/// The modules of a crate that are not for tests.
pub struct Crate {
    pub modules: Vec<Module>,
}

/// The item that a path leads to: the module that defines it, and its name. No name is the module
/// itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    pub module: usize,
    pub item: Option<String>,
}

impl Crate {
    /// Reads files: paths below `src`, and texts.
    pub fn new<'a>(files: impl Iterator<Item = (&'a str, &'a str)>) -> Self {
        let modules = files.map(|(file, text)| Module::new(file, text)).collect();
        let mut all = Self { modules };
        all.drop_undeclared();
        all
    }

    /// Keeps the modules that a root declares, directly or not; others are for tests.
    fn drop_undeclared(&mut self) {
        let mut declared: BTreeSet<Vec<String>> = BTreeSet::from([vec![]]);
        loop {
            let known = self.modules.iter().filter(|m| declared.contains(&m.path));
            let children: Vec<Vec<String>> =
                known.flat_map(|m| m.children.iter().map(|c| joined(&m.path, c))).collect();
            let count = declared.len();
            declared.extend(children);
            if declared.len() == count {
                break;
            }
        }
        self.modules.retain(|m| declared.contains(&m.path));
    }

    /// What a path in a module leads to; none outside the crate, and for what a root only
    /// re-exports.
    pub fn target(&self, from: usize, named: &Named) -> Option<Target> {
        self.find(&self.modules[from].absolute(named)?, 0)
    }

    fn find(&self, path: &[String], followed: usize) -> Option<Target> {
        let (module, rest) = self.longest(path)?;
        let Some((item, rest)) = rest.split_first() else {
            return Some(Target { module, item: None });
        };
        let own = &self.modules[module];
        if let Some(named) = own.names.get(item).filter(|_| followed < FOLLOWED_MAX) {
            return self.find(&[named, rest].concat(), followed + 1);
        }
        let target = |module| Some(Target { module, item: Some(item.clone()) });
        if imports::defines(&own.body, item) {
            return target(module);
        }
        let mut globs = own.globs.iter().filter_map(|glob| self.longest(glob));
        let glob = globs.find(|(glob, rest)| {
            rest.is_empty() && imports::defines(&self.modules[*glob].body, item)
        });
        match glob {
            Some((glob, _)) => target(glob),
            None if own.is_root() => None,
            None => target(module),
        }
    }

    /// The module of the longest part of a path, and the rest of the path.
    fn longest<'a>(&self, path: &'a [String]) -> Option<(usize, &'a [String])> {
        (0..=path.len()).rev().find_map(|length| {
            let module = self.modules.iter().position(|m| m.path == path[..length])?;
            Some((module, &path[length..]))
        })
    }
}

impl Module {
    fn new(file: &str, text: &str) -> Self {
        let code = without_tests(&split(text).code);
        let (uses, body) = imports::uses(&code);
        let children = imports::child_modules(&code);
        let (names, globs) = (BTreeMap::new(), Vec::new());
        let file = file.to_owned();
        let mut module = Self { path: path_of(&file), file, body, uses, children, names, globs };
        for leaf in module.uses.iter().filter(|u| u.path.depth == 0) {
            match module.absolute(&leaf.path) {
                Some(path) if leaf.name == "*" => module.globs.push(path),
                Some(path) => drop(module.names.insert(leaf.name.clone(), path)),
                None => {}
            }
        }
        module
    }

    fn is_root(&self) -> bool {
        self.path.is_empty()
    }

    /// Path from the root of the crate of a path that stands in this module; none if it starts with
    /// the name of another crate or of an item.
    fn absolute(&self, named: &Named) -> Option<Vec<String>> {
        let (first, rest) = named.segments.split_first()?;
        match first.as_str() {
            "crate" => Some(rest.to_vec()),
            "self" => Some([&self.path, rest].concat()),
            "super" => {
                let supers = named.segments.iter().take_while(|s| *s == "super").count();
                // In an inline module the first `super` is the file itself.
                let up = supers.saturating_sub(named.depth);
                let kept = self.path.len().checked_sub(up)?;
                Some([&self.path[..kept], &named.segments[supers..]].concat())
            }
            _ if self.children.contains(first) => Some([&self.path, &named.segments[..]].concat()),
            _ => self.names.get(first).map(|path| [path, rest].concat()),
        }
    }
}

/// Path of the module that a file below `src` holds; empty for `lib.rs` and `main.rs`.
fn path_of(file: &str) -> Vec<String> {
    let name = file.strip_suffix(".rs").unwrap_or(file);
    let mut path: Vec<String> = name.split('/').map(str::to_owned).collect();
    if path.last().is_some_and(|last| last == "mod") || ["lib", "main"].contains(&name) {
        path.pop();
    }
    path
}

fn joined(path: &[String], name: &str) -> Vec<String> {
    path.iter().cloned().chain([name.to_owned()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILES: [(&str, &str); 6] = [
        (
            "lib.rs",
            "mod a;\nmod b;\npub use a::child::Deep;\n#[cfg(test)]\nmod only_tests;\nfn own() {}",
        ),
        (
            "a/mod.rs",
            "pub mod child;\npub use child::Deep;\nuse other::*;\nmod other;\npub struct Own;",
        ),
        ("a/child.rs", "pub struct Deep;\nmod inline { use super::Deep; }"),
        ("a/other.rs", "pub fn helper() {}"),
        ("b.rs", "use crate::a::{self, child};\nfn f() { a::Own; child::Deep; }"),
        ("only_tests.rs", "use crate::b::f;"),
    ];

    fn target(from: &str, path: &str, depth: usize) -> Option<String> {
        let all = Crate::new(FILES.into_iter());
        let index = all.modules.iter().position(|m| m.file == from).unwrap();
        let segments = path.split("::").map(str::to_owned).collect();
        let target = all.target(index, &Named { segments, offset: 0, depth })?;
        Some(format!("{} {}", all.modules[target.module].file, target.item.unwrap_or_default()))
    }

    #[test]
    fn paths_lead_to_the_file_that_defines_the_item() {
        assert_eq!(target("b.rs", "crate::a::Own", 0).as_deref(), Some("a/mod.rs Own"));
        assert_eq!(target("b.rs", "crate::a::Deep", 0).as_deref(), Some("a/child.rs Deep"));
        assert_eq!(target("b.rs", "crate::Deep", 0).as_deref(), Some("a/child.rs Deep"));
        assert_eq!(target("b.rs", "crate::own", 0).as_deref(), Some("lib.rs own"));
        assert_eq!(target("b.rs", "child::Deep::new", 0).as_deref(), Some("a/child.rs Deep"));
        assert_eq!(target("a/child.rs", "super::helper", 0).as_deref(), Some("a/other.rs helper"));
        assert_eq!(target("a/child.rs", "super::Deep", 1).as_deref(), Some("a/child.rs Deep"));
        assert_eq!(target("b.rs", "crate::a", 0).as_deref(), Some("a/mod.rs "));
    }

    #[test]
    fn other_crates_and_what_a_root_does_not_define_lead_nowhere() {
        assert_eq!(target("b.rs", "std::fs::File", 0), None);
        assert_eq!(target("b.rs", "crate::Unknown", 0), None);
    }

    #[test]
    fn modules_for_tests_are_left_out() {
        let all = Crate::new(FILES.into_iter());
        assert!(all.modules.iter().all(|m| m.file != "only_tests.rs") && all.modules.len() == 5);
    }
}
