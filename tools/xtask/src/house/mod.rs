//! House rules that no compiler checks, one file a rule. `cargo xtask house` runs them all over the
//! files that git lists, prints the faults of each rule as file:line and what to do, and fails if
//! there is any.

mod circles;
mod citations;
mod code_paths;
mod columns;
mod functions;
mod length;
mod links;
mod machine_paths;
mod map_size;
mod markdown;
mod opening;
mod precision;
mod source;
mod tree;
mod wording;

use crate::{figures, report as evidence};
use anyhow::{Result, bail};
use tree::{Fault, Tree};

/// Faults of one rule that are printed at most.
const SHOWN_MAX: usize = 40;

/// A rule: the heading of its faults, and the check.
struct Rule {
    name: &'static str,
    check: fn(&Tree) -> Vec<Fault>,
}

const RULES: [Rule; 12] = [
    Rule { name: "opening comments", check: opening::check },
    Rule { name: "length of files", check: length::check },
    Rule { name: "folders of one machine", check: machine_paths::check },
    Rule { name: "columns of comments and Markdown", check: columns::check },
    Rule { name: "length of functions", check: functions::check },
    Rule { name: "import circles", check: circles::check },
    Rule { name: "links in Markdown", check: links::check },
    Rule { name: "paths in Markdown", check: code_paths::check },
    Rule { name: "citation keys", check: citations::check },
    Rule { name: "bounds of tests in docs/precision.md", check: precision::check },
    Rule { name: "size of ARCHITECTURE.md", check: map_size::check },
    Rule { name: "banned wording", check: wording::check },
];

/// Runs every rule over the files of the working tree.
pub fn check() -> Result<()> {
    let tree = Tree::of_git()?;
    let mut counts = Vec::new();
    for rule in &RULES {
        let faults = (rule.check)(&tree);
        if !faults.is_empty() {
            println!("{}", report(rule.name, &faults, SHOWN_MAX));
            counts.push(format!("{} {}", faults.len(), rule.name));
        }
    }
    if !counts.is_empty() {
        bail!("faults: {}", counts.join(", "));
    }
    println!("house: {} files keep {} rules", tree.files.len(), RULES.len());
    evidence::check()?;
    figures::check()
}

/// Lines that show the first `shown_max` faults of a rule.
fn report(name: &str, faults: &[Fault], shown_max: usize) -> String {
    let mut lines = vec![format!("{name}: {}", faults.len())];
    lines.extend(faults.iter().take(shown_max).map(|fault| format!("  {fault}")));
    if faults.len() > shown_max {
        lines.push(format!("  ... and {} more", faults.len() - shown_max));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_count_all_faults_and_show_the_first() {
        let faults: Vec<Fault> = (1..4).map(|line| Fault::new("a.md", line, "wrong")).collect();
        assert_eq!(report("rule", &faults, 3).lines().count(), 4);
        let short = report("rule", &faults, 1);
        assert_eq!(short, "rule: 3\n  a.md:1: wrong\n  ... and 2 more");
    }
}
