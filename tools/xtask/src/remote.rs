//! Tests files at addresses (`crates/remote`), which are no part of a build without the feature
//! `remote`, and checks the programs with it.

use crate::shell::{cargo, follow_words, output, run_cargo};
use crate::tally::Tally;
use anyhow::{Result, bail, ensure};

/// Programs that may have it.
const PROGRAMS: [&str; 2] = ["esker", "esker-view"];
/// Command of the tests.
const TESTS: [&str; 5] = ["cargo", "test", "--release", "-p", "esker-remote"];
/// Crates that programs without it do not link.
const CRATES: [&str; 3] = ["esker-remote", "object_store", "tokio"];

/// Checks trees of dependencies, lints the programs with the feature, and runs the tests.
pub fn check(tally: &mut Tally) -> Result<()> {
    for program in PROGRAMS {
        let tree = ["tree", "-p", program, "-e", "normal", "--prefix", "none"];
        let tree = output(&cargo(), &tree)?;
        let names = |name: &str| tree.lines().any(|l| l.split(' ').next() == Some(name));
        if let Some(linked) = CRATES.into_iter().find(|name| names(name)) {
            bail!("{program} links {linked} without the feature remote");
        }
    }
    let lints = ["--release", "--features", "remote", "--", "-D", "warnings"];
    for program in PROGRAMS {
        run_cargo(&[&["clippy", "-p", program][..], &lints].concat())?;
    }
    let lints = ["--release", "--all-targets", "--", "-D", "warnings"];
    run_cargo(&[&["clippy", "-p", "esker-remote"][..], &lints].concat())?;
    println!("$ {}", TESTS.join(" "));
    let before = tally.passed;
    let (lines, ok) = follow_words(&TESTS, &[])?;
    lines.iter().for_each(|line| tally.read(line));
    ensure!(ok && tally.passed > before, "failed, or ran no test: {}", TESTS.join(" "));
    Ok(())
}
