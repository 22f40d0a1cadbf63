//! Checks that the files of a crate do not import each other in circles. A path leads to the file
//! that defines the item; `mod` declarations and re-exports that a file does not use itself are no
//! imports. Circles that are allowed stand in a list; an entry that is no circle is a fault.

mod exceptions;
mod graph;
mod imports;
mod modules;
mod non_test;

use super::source::line_at;
use super::tree::{Fault, Tree, folder_of};
use exceptions::{EXCEPTIONS, Exception};
use graph::Edges;
use modules::Crate;
use std::collections::{BTreeMap, BTreeSet};

/// Faults of all crates.
pub fn check(tree: &Tree) -> Vec<Fault> {
    check_with(tree, &EXCEPTIONS)
}

fn check_with(tree: &Tree, exceptions: &[Exception]) -> Vec<Fault> {
    let mut faults = Vec::new();
    let mut used = vec![false; exceptions.len()];
    for folder in crates(tree) {
        let src = format!("{folder}/src/");
        let files = tree.of_kinds(&["rs"]);
        let files = files.filter_map(|f| Some((f.name.strip_prefix(&src)?, f.text.as_str())));
        let all = Crate::new(files);
        let imports = imports_of(&all);
        for circle in graph::circles(&edges_of(&imports)) {
            let files: Vec<&str> = circle.iter().map(|m| all.modules[*m].file.as_str()).collect();
            let mut is_excepted = false;
            for (exception, used) in exceptions.iter().zip(&mut used) {
                let is_here = exception.folder == folder;
                is_excepted |= is_here && files.iter().all(|f| exception.files.contains(f));
                *used |= is_here && exception.files.iter().all(|f| files.contains(f));
            }
            if !is_excepted {
                faults.extend(faults_of(&src, &all, &imports, &circle));
            }
        }
    }
    let unused = exceptions.iter().zip(used).filter(|(_, used)| !used);
    faults.extend(unused.map(|(exception, _)| stale(exception)));
    faults
}

fn stale(exception: &Exception) -> Fault {
    let message = format!(
        "{} are no longer one circle; correct the entry in EXCEPTIONS in \
         tools/xtask/src/house/circles/exceptions.rs",
        exception.files.join(", ")
    );
    Fault::new(exception.folder, 0, message)
}

/// Folders of the crates in `crates` and `tools`.
fn crates(tree: &Tree) -> Vec<&str> {
    let manifests = tree.of_kinds(&["toml"]).filter_map(|f| f.name.strip_suffix("/Cargo.toml"));
    manifests.filter(|folder| ["crates", "tools"].contains(&folder_of(folder))).collect()
}

/// What a file imports of another: where it first names it, and the names of the items.
struct Import {
    offset: usize,
    items: BTreeSet<String>,
}

/// Imports by the module that has them and the module that defines the items.
type Imports = BTreeMap<(usize, usize), Import>;

fn imports_of(all: &Crate) -> Imports {
    let mut imports = Imports::new();
    let mut add = |from: usize, to: usize, offset: usize, item: String| {
        if from != to {
            let items = BTreeSet::new();
            let import = imports.entry((from, to)).or_insert(Import { offset, items });
            import.offset = import.offset.min(offset);
            import.items.insert(item);
        }
    };
    for (from, module) in all.modules.iter().enumerate() {
        for leaf in &module.uses {
            let is_used = !leaf.is_public || imports::mentions(&module.body, &leaf.name);
            let Some(target) = all.target(from, &leaf.path).filter(|_| is_used) else {
                continue;
            };
            // An imported module counts where one of its items is named.
            let all_items = (leaf.name == "*" && !leaf.is_public).then(|| "*".to_owned());
            if let Some(item) = target.item.or(all_items) {
                add(from, target.module, leaf.path.offset, item);
            }
        }
        for path in imports::paths(&module.body) {
            if let Some(target) = all.target(from, &path) {
                let item = target.item.unwrap_or_else(|| "self".to_owned());
                add(from, target.module, path.offset, item);
            }
        }
    }
    imports
}

fn edges_of(imports: &Imports) -> Edges {
    let mut edges = Edges::new();
    for (from, to) in imports.keys() {
        edges.entry(*from).or_default().insert(*to);
    }
    edges
}

/// One fault for each import that ties a circle.
fn faults_of(src: &str, all: &Crate, imports: &Imports, circle: &BTreeSet<usize>) -> Vec<Fault> {
    let file = |module: &usize| all.modules[*module].file.as_str();
    let first = circle.first().map_or("", file);
    let ties = imports.iter().filter(|((a, b), _)| circle.contains(a) && circle.contains(b));
    let fault = |((from, to), import): (&(usize, usize), &Import)| {
        let items: Vec<&str> = import.items.iter().map(String::as_str).collect();
        let message = format!(
            "imports {} of {}, which leads back here (circle of {} files from {first} on); move \
             what both need into a third file",
            items.join(", "),
            file(to),
            circle.len()
        );
        let line = line_at(&all.modules[*from].body, import.offset);
        Fault::new(&format!("{src}{}", file(from)), line, message)
    };
    ties.map(fault).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANIFEST: (&str, &str) = ("crates/x/Cargo.toml", "");

    fn tree(a: &str, parent: &str) -> Tree {
        Tree::of(&[
            MANIFEST,
            ("crates/x/src/lib.rs", "mod a;\nmod b;"),
            ("crates/x/src/a.rs", a),
            ("crates/x/src/b/mod.rs", parent),
            ("crates/x/src/b/child.rs", "use super::Shared;\npub struct Child;"),
        ])
    }

    fn found(tree: &Tree, exceptions: &[Exception]) -> Vec<String> {
        let faults = check_with(tree, exceptions);
        faults.iter().map(|f| format!("{}:{}", f.file, f.line)).collect()
    }

    #[test]
    fn files_that_import_each_other_are_found_with_what_ties_them() {
        let tree =
            tree("//! A.\nuse crate::b::Shared;", "pub struct Shared;\nfn f() { crate::a::g() }");
        assert_eq!(found(&tree, &[]), ["crates/x/src/a.rs:2", "crates/x/src/b/mod.rs:2"]);
        assert!(check_with(&tree, &[])[0].message.starts_with("imports Shared of b/mod.rs"));
    }

    #[test]
    fn a_parent_is_in_a_circle_with_a_child_only_if_it_uses_its_items() {
        let declares = "mod child;\npub use child::Child;\npub struct Shared;";
        assert_eq!(found(&tree("", declares), &[]), [""; 0]);
        let uses = format!("{declares}\nfn f(child: Child) {{}}");
        assert_eq!(found(&tree("", &uses), &[]).len(), 2);
        let names = format!("{declares}\nfn f() {{ child::Child; }}");
        assert_eq!(found(&tree("", &names), &[]).len(), 2);
    }

    #[test]
    fn tests_and_comments_import_nothing() {
        let a = "// crate::b::Shared\n#[cfg(test)]\nmod tests { use crate::b::Shared; }";
        assert_eq!(found(&tree(a, "use crate::a::g;\npub struct Shared;"), &[]), [""; 0]);
    }

    #[test]
    fn exceptions_hold_for_their_files_and_must_be_needed() {
        let circle = tree("use crate::b::Shared;", "pub struct Shared;\nuse crate::a::g;");
        let exception = |files| [Exception { folder: "crates/x", files }];
        assert_eq!(found(&circle, &exception(&["a.rs", "b/mod.rs"])), [""; 0]);
        assert_eq!(found(&circle, &exception(&["a.rs", "b/mod.rs", "c.rs"])), ["crates/x:0"]);
        assert_eq!(
            found(&tree("", "pub struct Shared;"), &exception(&["a.rs", "b/mod.rs"])).len(),
            1
        );
    }
}
