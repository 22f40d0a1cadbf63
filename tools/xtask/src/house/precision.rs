//! Checks the tables of docs/precision.md: each row names a test by a link to its file, which has
//! the test, and the bound as the row quotes it. So the tables cannot differ from the tests.

use super::markdown::spans;
use super::tree::{Fault, Tree};

const PRECISION: &str = "docs/precision.md";
/// Column of the code that is quoted, and that of the test.
const QUOTE: usize = 3;
const TEST: usize = 4;

/// Faults of the tables; none if there is no such file.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let Some(file) = tree.file(PRECISION) else { return Vec::new() };
    let rows = file.text.lines().enumerate().filter(|(_, line)| is_row(line));
    let fault = |(at, line)| {
        let message = fault_of(tree, line)?;
        Some(Fault::new(PRECISION, at + 1, message))
    };
    rows.filter_map(fault).collect()
}

/// Whether a line is a row of a table, and neither its head nor the line below.
fn is_row(line: &str) -> bool {
    line.starts_with("| ") && !line.starts_with("| pass |")
}

/// What is wrong with a row.
fn fault_of(tree: &Tree, line: &str) -> Option<String> {
    let cells = cells(line);
    let [quote, test] = [QUOTE, TEST].map(|column| cells.get(column).map_or("", |cell| cell));
    let Some((name, path)) = link_of(test) else {
        return Some(
            "the last cell is no link [test](../path); name the test that holds it".into(),
        );
    };
    let Some(file) = tree.file(path) else {
        return Some(format!("{path} is no file; correct the link"));
    };
    if !file.text.contains(&format!("fn {name}(")) {
        return Some(format!("{path} has no test `{name}`; name the test that holds the bound"));
    }
    let spans = spans(quote);
    let Some(span) = spans.first() else {
        return Some("no bound is quoted; quote in backticks what the test asserts".into());
    };
    let quoted = without_spaces(span.text);
    let has = without_spaces(&file.text).contains(&quoted);
    (!has).then(|| format!("{path} has no `{}`; correct the bound", span.text))
}

/// Cells of a row. A bar after a backslash is part of a cell.
fn cells(line: &str) -> Vec<String> {
    const BAR: char = '\u{1}';
    let line = line.replace("\\|", &BAR.to_string());
    let cells = line.trim_matches('|').split('|');
    cells.map(|cell| cell.trim().replace(BAR, "|")).collect()
}

/// Text and path from the root of a link such as `[test](../crates/a/tests/b.rs)`.
fn link_of(cell: &str) -> Option<(&str, &str)> {
    let (name, rest) = cell.strip_prefix('[')?.split_once("](")?;
    let path = rest.strip_suffix(')')?.strip_prefix("../")?;
    Some((name, path))
}

/// Code without spaces and line breaks, which a formatter may move.
fn without_spaces(code: &str) -> String {
    code.split_whitespace().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEST: &str = "#[test]\nfn holds() {\n    assert!(all(|&n|\n n <= 3));\n}\n";

    fn faults(row: &str) -> Vec<String> {
        let table = format!("| pass | to | at most | in | test |\n|---|---|---|---|---|\n{row}\n");
        let tree = Tree::of(&[("docs/precision.md", &table), ("crates/a/tests/b.rs", TEST)]);
        check(&tree).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_row_of_a_test_that_asserts_it_has_no_fault() {
        let row = "| p | q | 3 | `all(\\|&n\\| n <= 3)` | [holds](../crates/a/tests/b.rs) |";
        assert_eq!(faults(row), Vec::<String>::new());
    }

    #[test]
    fn rows_that_differ_from_their_tests_are_faults() {
        let rows = [
            ("| p | q | 3 | `n <= 4` | [holds](../crates/a/tests/b.rs) |", "has no `n <= 4`"),
            ("| p | q | 3 | `n <= 3` | [gone](../crates/a/tests/b.rs) |", "no test `gone`"),
            ("| p | q | 3 | `n <= 3` | [holds](../crates/a/tests/c.rs) |", "is no file"),
            ("| p | q | 3 | 3 | [holds](../crates/a/tests/b.rs) |", "no bound is quoted"),
            ("| p | q | 3 | `n <= 3` |", "is no link"),
        ];
        for (row, wanted) in rows {
            let found = faults(row);
            assert!(found.len() == 1 && found[0].contains(wanted), "{row}: {found:?}");
            assert!(found[0].starts_with("docs/precision.md:3: "), "{found:?}");
        }
    }

    #[test]
    fn without_tables_there_is_nothing_to_check() {
        assert!(check(&Tree::of(&[("README.md", "| a |")])).is_empty());
    }
}
