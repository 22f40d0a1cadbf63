//! Reads what a Rust file names: `use` declarations, other paths, child modules, and its own items.
//! All of it works on code without comments, strings and tests.

use crate::house::source::{closing, is_word};

/// A path that a file names: its segments, where it stands, and the depth of inline modules there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    pub segments: Vec<String>,
    pub offset: usize,
    pub depth: usize,
}

/// A leaf of a `use` declaration; `name` is `*` for all items.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    pub path: Named,
    pub name: String,
    pub is_public: bool,
}

/// All `use` declarations, and the code without them.
pub fn uses(code: &str) -> (Vec<Use>, String) {
    let inline = inline_modules(code);
    let mut body = code.as_bytes().to_vec();
    let mut uses = Vec::new();
    for (start, _) in code.match_indices("use ").filter(|(at, _)| starts_word(code, *at)) {
        let end = code[start..].find(';').map_or(code.len(), |e| start + e);
        body[start..end].iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
        let before = code[..start].trim_end();
        let is_public = before.ends_with("pub") || before.ends_with(')');
        let depth = inline.iter().filter(|(from, to)| (*from..*to).contains(&start)).count();
        for (segments, name) in leaves(&[], &code[start + 4..end]) {
            let path = Named { segments, offset: start, depth };
            uses.push(Use { path, name, is_public });
        }
    }
    (uses, String::from_utf8_lossy(&body).into_owned())
}

/// Segments and names of the leaves of a `use` tree below a path.
fn leaves(above: &[String], tree: &str) -> Vec<(Vec<String>, String)> {
    let tree = tree.trim();
    let (path, group) = match tree.find('{') {
        Some(open) => (&tree[..open], Some(&tree[open + 1..closing(tree, open) - 1])),
        None => (tree, None),
    };
    let (path, alias) = path.split_once(" as ").unwrap_or((path, ""));
    let own = path.split("::").map(str::trim).filter(|s| !s.is_empty()).map(str::to_owned);
    let mut segments: Vec<String> = above.iter().cloned().chain(own).collect();
    if let Some(group) = group {
        return parts(group).into_iter().flat_map(|part| leaves(&segments, part)).collect();
    }
    if !above.is_empty() && segments.last().is_some_and(|s| s == "self") {
        segments.pop();
    }
    let last = segments.last().cloned().unwrap_or_default();
    let name = if alias.is_empty() { last.clone() } else { alias.trim().to_owned() };
    if last == "*" {
        segments.pop();
    }
    if last.is_empty() { vec![] } else { vec![(segments, name)] }
}

/// Parts of a group, cut at the commas that are in no inner group.
fn parts(group: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let (mut start, mut depth) = (0, 0);
    for (at, byte) in group.bytes().enumerate() {
        match byte {
            b'{' => depth += 1,
            b'}' => depth -= 1,
            b',' if depth == 0 => {
                parts.push(&group[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&group[start..]);
    parts.into_iter().filter(|part| !part.trim().is_empty()).collect()
}

/// Paths of two or more segments in code without `use` declarations.
pub fn paths(body: &str) -> Vec<Named> {
    let inline = inline_modules(body);
    let bytes = body.as_bytes();
    let mut paths = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        if !is_word(bytes[at]) {
            at += 1;
            continue;
        }
        let start = at;
        let mut segments = Vec::new();
        loop {
            let end = (at..bytes.len()).find(|i| !is_word(bytes[*i])).unwrap_or(bytes.len());
            segments.push(body[at..end].to_owned());
            at = end;
            if !body[at..].starts_with("::") || !bytes.get(at + 2).is_some_and(|b| is_word(*b)) {
                break;
            }
            at += 2;
        }
        if segments.len() > 1 && starts_path(body, start) {
            let depth = inline.iter().filter(|(from, to)| (*from..*to).contains(&start)).count();
            paths.push(Named { segments, offset: start, depth });
        }
    }
    paths
}

/// Whether no longer path ends here; `pub(in crate::a)` is no path that a file uses.
fn starts_path(code: &str, at: usize) -> bool {
    let before = &code[..at];
    !before.ends_with(['.', '$', '\'']) && !before.ends_with("::") && !before.ends_with("(in ")
}

/// Names of the modules that other files hold: `mod name;`.
pub fn child_modules(code: &str) -> Vec<String> {
    modules(code).filter(|(_, _, mark)| *mark == ';').map(|(name, ..)| name).collect()
}

/// Ranges of the bodies of inline modules.
fn inline_modules(code: &str) -> Vec<(usize, usize)> {
    let inline = modules(code).filter(|(_, _, mark)| *mark == '{');
    inline.map(|(_, at, _)| (at, closing(code, at))).collect()
}

/// Modules by name, offset of the mark behind the name, and that mark: `;` or `{`.
fn modules(code: &str) -> impl Iterator<Item = (String, usize, char)> {
    code.match_indices("mod ").filter(|(at, _)| starts_word(code, *at)).filter_map(|(at, _)| {
        let rest = &code[at + 4..];
        let mark = rest.find([';', '{'])?;
        let name = rest[..mark].trim();
        let is_name = !name.is_empty() && name.bytes().all(is_word);
        is_name.then(|| {
            (name.to_owned(), at + 4 + mark, if rest[mark..].starts_with(';') { ';' } else { '{' })
        })
    })
}

/// Whether code defines an item of this name.
pub fn defines(code: &str, name: &str) -> bool {
    const KINDS: [&str; 10] =
        ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "mod", "mut"];
    has_word(code, name, |before| {
        let start = before.trim_end();
        KINDS.iter().any(|kind| start.ends_with(kind)) || start.ends_with("macro_rules!")
    })
}

/// Whether code has a word anywhere.
pub fn mentions(code: &str, name: &str) -> bool {
    has_word(code, name, |_| true)
}

fn has_word(code: &str, name: &str, is_wanted: impl Fn(&str) -> bool) -> bool {
    code.match_indices(name).any(|(at, _)| {
        let ends = !code.as_bytes().get(at + name.len()).is_some_and(|b| is_word(*b));
        ends && starts_word(code, at) && is_wanted(&code[..at])
    })
}

fn starts_word(code: &str, at: usize) -> bool {
    at == 0 || !is_word(code.as_bytes()[at - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn use_trees_have_leaves() {
        let (uses, body) =
            uses("pub use crate::a::{self, b::{C, D as E}, f::*};\nuse super::G;\nh();");
        let text = |u: &Use| format!("{} {} {}", u.path.segments.join("::"), u.name, u.is_public);
        let expected = [
            "crate::a a true",
            "crate::a::b::C C true",
            "crate::a::b::D E true",
            "crate::a::f * true",
            "super::G G false",
        ];
        assert_eq!(uses.iter().map(text).collect::<Vec<_>>(), expected);
        assert_eq!(body.split_whitespace().collect::<String>(), "pub;;h();");
    }

    #[test]
    fn paths_are_read_from_their_start() {
        let code =
            "fn f(a: crate::b::C) { super::d::<E>(g.h::<I>(), $crate::j); pub(in crate::k) l }";
        let found: Vec<String> = paths(code).iter().map(|p| p.segments.join("::")).collect();
        assert_eq!(found, ["crate::b::C", "super::d"]);
    }

    #[test]
    fn inline_modules_add_depth_and_are_no_children() {
        let code = "mod a;\npub mod b { use super::C; }\nuse d::E;";
        assert_eq!(child_modules(code), ["a"]);
        assert_eq!(uses(code).0.iter().map(|u| u.path.depth).collect::<Vec<_>>(), [1, 0]);
    }

    #[test]
    fn items_are_known_by_their_kind() {
        assert!(defines("pub const fn a() {}", "a") && defines("struct B;", "B"));
        assert!(!defines("fn ab() { a() }", "a"));
        assert!(mentions("f(Bc, B)", "B") && !mentions("f(Bc)", "B"));
    }
}
