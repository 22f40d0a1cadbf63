//! Checks relative links and images in Markdown: the target is a file or folder that git lists, and
//! an anchor is that of a heading of the target.

use super::markdown::{anchors, without_fences, without_spans};
use super::source::line_at;
use super::tree::{Fault, File, Tree, folder_of};

/// Starts of targets outside the tree.
const OUTSIDE: [&str; 3] = ["mailto:", "tel:", "data:"];

/// Faults of all Markdown files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    tree.of_kinds(&["md"]).flat_map(|file| faults_of(tree, file)).collect()
}

fn faults_of(tree: &Tree, file: &File) -> Vec<Fault> {
    let prose = without_spans(&without_fences(&file.text));
    let mut faults = Vec::new();
    for (offset, target) in targets(&prose) {
        if let Some(message) = fault_of(tree, file, target) {
            faults.push(Fault::new(&file.name, line_at(&prose, offset), message));
        }
    }
    faults.sort_by_key(|fault| fault.line);
    faults
}

/// Targets of links and images, with their offsets: `[a](b)`, `[a]: b`, `src="b"` and `href="b"`.
fn targets(prose: &str) -> Vec<(usize, &str)> {
    let mut targets = Vec::new();
    for (open, close) in [("](", ')'), ("src=\"", '"'), ("href=\"", '"')] {
        for (at, _) in prose.match_indices(open) {
            let rest = &prose[at + open.len()..];
            let target = rest.split(close).next().unwrap_or_default();
            // A target may have a title behind it, and is one word.
            targets.extend(target.split_whitespace().next().map(|t| (at, t)));
        }
    }
    let mut offset = 0;
    for line in prose.split_inclusive('\n') {
        let label =
            line.split_once("]: ").filter(|(l, _)| l.starts_with('[') && !l.starts_with("[^"));
        let target = label.and_then(|(_, target)| target.split_whitespace().next());
        targets.extend(target.map(|t| (offset, t)));
        offset += line.len();
    }
    targets
}

fn fault_of(tree: &Tree, file: &File, target: &str) -> Option<String> {
    let target = target.trim_start_matches('<').trim_end_matches('>');
    if target.contains("://") || OUTSIDE.iter().any(|o| target.starts_with(o)) {
        return None;
    }
    let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
    let path = match path {
        "" => file.name.clone(),
        _ => resolve(folder_of(&file.name), &path.replace("%20", " ")),
    };
    if !path.is_empty() && !tree.has(&path) {
        return Some(format!("the link {target} leads to no file; {path} does not exist"));
    }
    let linked = tree.file(&path).filter(|f| f.kind == "md" && !anchor.is_empty())?;
    let is_heading = anchors(&linked.text).contains(anchor);
    (!is_heading).then(|| format!("the link {target} leads to no heading of {path}"))
}

/// Path from the root of a path from a folder; `..` above the root stays and exists nowhere.
fn resolve(folder: &str, path: &str) -> String {
    let base = if path.starts_with('/') { "" } else { folder };
    let mut parts: Vec<&str> = Vec::new();
    for part in base.split('/').chain(path.split('/')).filter(|p| !p.is_empty() && *p != ".") {
        if part == ".." && parts.last().is_some_and(|last| *last != "..") {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> Vec<Fault> {
        let other = ("docs/other.md", "# One heading\n");
        check(&Tree::of(&[("docs/a.md", text), other, ("README.md", ""), ("docs/b.png", "")]))
    }

    #[test]
    fn links_that_lead_somewhere_are_good() {
        let text = "# Own\n[a](other.md#one-heading) ![b](b.png \"title\") [c](../README.md)\n\
                    [d](#own) [e](https://example.org/x.md#y) [f](..) \
                    `[g](none.md)` <img src=\"b.png\">\n\
                    ```\n[h](none.md)\n```\n[i]: other.md\n";
        assert_eq!(faults(text), []);
    }

    #[test]
    fn links_that_lead_nowhere_are_found() {
        let text = "[a](none.md)\n![b](../b.png)\n[c](other.md#none) [d](#none)\n\
                    [e](../../up.md)\n[f]: g.md\n";
        assert_eq!(faults(text).iter().map(|f| f.line).collect::<Vec<_>>(), [1, 2, 3, 3, 4, 5]);
    }
}
