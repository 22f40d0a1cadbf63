//! Checks that Rust functions have at most 100 lines, from the `fn` to the closing brace. Longer
//! ones stand in a list with the reason; an entry that is no longer needed is a fault.

use super::source::{closing, line_at, split};
use super::tree::{Fault, Tree};

/// Lines of a function at most.
const LINES_MAX: usize = 100;

/// A function that may be longer.
struct Exception {
    file: &'static str,
    function: &'static str,
    reason: &'static str,
}

const EXCEPTIONS: [Exception; 1] = [Exception {
    file: "crates/render/examples/bench_quads.rs",
    function: "quads",
    reason: "sets up a pipeline that nothing else uses",
}];

/// Words that stand before `fn` in a declaration; strings are blank, so `extern "C"` is `extern`.
const QUALIFIERS: [&str; 6] = ["pub", "const", "async", "unsafe", "extern", "default"];

/// Faults of all Rust files.
pub fn check(tree: &Tree) -> Vec<Fault> {
    check_with(tree, &EXCEPTIONS)
}

fn check_with(tree: &Tree, exceptions: &[Exception]) -> Vec<Fault> {
    let mut faults = Vec::new();
    let mut used = vec![false; exceptions.len()];
    for file in tree.of_kinds(&["rs"]) {
        for long in functions_of(&file.text).into_iter().filter(|f| f.lines > LINES_MAX) {
            let excepted =
                exceptions.iter().position(|e| e.file == file.name && e.function == long.name);
            if let Some(index) = excepted {
                used[index] = true;
                continue;
            }
            let Function { name, line, lines } = long;
            let message = format!("`{name}` has {lines} lines; split it, {LINES_MAX} are allowed");
            faults.push(Fault::new(&file.name, line, message));
        }
    }
    let unused = exceptions.iter().zip(used).filter(|(_, used)| !used);
    faults.extend(unused.map(|(exception, _)| stale(exception)));
    faults
}

fn stale(exception: &Exception) -> Fault {
    let Exception { file, function, reason } = exception;
    let message = format!(
        "`{function}` is not longer than {LINES_MAX} lines; remove it from EXCEPTIONS in \
         tools/xtask/src/house/functions.rs ({reason})"
    );
    Fault::new(file, 0, message)
}

struct Function {
    name: String,
    line: usize,
    lines: usize,
}

/// All functions that have a body.
fn functions_of(text: &str) -> Vec<Function> {
    let code = split(text).code;
    let mut functions = Vec::new();
    let mut offset = 0;
    for line in code.split_inclusive('\n') {
        if let Some(name) = declared(line)
            && let Some(open) = body_of(&code, offset)
        {
            let first = line_at(&code, offset);
            let lines = line_at(&code, closing(&code, open)) - first + 1;
            functions.push(Function { name, line: first, lines });
        }
        offset += line.len();
    }
    functions
}

/// Name of the function whose declaration starts in a line.
fn declared(line: &str) -> Option<String> {
    let mut words = line.split_whitespace();
    let word = words.find(|w| !QUALIFIERS.contains(w) && !w.starts_with("pub("))?;
    let name = words.next().filter(|_| word == "fn")?;
    let end = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
    Some(name[..end].to_owned())
}

/// Offset of the brace that opens the body of the function declared from `start` on; none for a
/// declaration without a body.
fn body_of(code: &str, start: usize) -> Option<usize> {
    let mut depth = 0;
    for (at, byte) in code.bytes().enumerate().skip(start) {
        match byte {
            b'(' | b'[' => depth += 1,
            b')' | b']' => depth -= 1,
            b'{' if depth == 0 => return Some(at),
            b';' if depth == 0 => return None,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn function(lines: usize) -> String {
        format!(
            "impl A {{\n    pub(crate) const fn long(\n        \
             a: [u8; 4],\n    ) -> B {{\n{}    }}\n}}\n",
            "        // }\n".repeat(lines - 4)
        )
    }

    #[test]
    fn long_functions_are_found_at_their_line() {
        let text = function(LINES_MAX + 1);
        let faults = check_with(&Tree::of(&[("a.rs", &text)]), &[]);
        assert_eq!(
            faults,
            [Fault::new("a.rs", 2, "`long` has 101 lines; split it, 100 are allowed")]
        );
        assert!(check_with(&Tree::of(&[("a.rs", &function(LINES_MAX))]), &[]).is_empty());
    }

    #[test]
    fn exceptions_hold_until_they_are_not_needed() {
        let exceptions = [Exception { file: "a.rs", function: "long", reason: "a table" }];
        let text = function(LINES_MAX + 1);
        assert!(check_with(&Tree::of(&[("a.rs", &text)]), &exceptions).is_empty());
        let text = function(LINES_MAX);
        assert_eq!(check_with(&Tree::of(&[("a.rs", &text)]), &exceptions).len(), 1);
    }

    #[test]
    fn declarations_without_a_body_have_no_length() {
        assert!(functions_of("trait A {\n    fn a(&self);\n}\n").is_empty());
        assert_eq!(functions_of("fn a() {}\n").len(), 1);
        assert!(declared("let f: fn(u8) = g;").is_none());
    }
}
