//! Checks that ARCHITECTURE.md stays a map: at most 250 lines and 2,500 words. Reasons belong into
//! the chapters of docs/design.

use super::tree::{Fault, Tree};

const MAP: &str = "ARCHITECTURE.md";
const LINES_MAX: usize = 250;
/// As `wc -w` counts them.
const WORDS_MAX: usize = 2500;

/// Faults of the map.
pub fn check(tree: &Tree) -> Vec<Fault> {
    let Some(map) = tree.file(MAP) else {
        return vec![Fault::new(MAP, 0, "does not exist; write the map of the code")];
    };
    let counts = [
        ("lines", map.text.lines().count(), LINES_MAX),
        ("words", map.text.split_whitespace().count(), WORDS_MAX),
    ];
    let over = counts.iter().filter(|(_, count, max)| count > max);
    let message = |(unit, count, max): &(&str, usize, usize)| {
        format!("{count} {unit}; move reasons to docs/design until {max} are left")
    };
    over.map(|count| Fault::new(MAP, 0, message(count))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_words_have_limits() {
        let of = |text: &str| check(&Tree::of(&[(MAP, text)])).len();
        assert_eq!(of(&"word word\n".repeat(LINES_MAX)), 0);
        assert_eq!(of(&"word\n".repeat(LINES_MAX + 1)), 1);
        assert_eq!(of(&"word ".repeat(WORDS_MAX + 1)), 1);
        assert_eq!(check(&Tree::default()).len(), 1);
    }
}
