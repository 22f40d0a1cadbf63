//! Tests files at addresses (`crates/remote`), which are no part of a build without the feature
//! `remote`, and checks the programs with it.

use crate::shell::{cargo, follow_words, output, run_cargo};
use crate::tally::Tally;
use anyhow::{Result, bail, ensure};

/// Programs that may have it.
const PROGRAMS: [&str; 2] = ["esker", "esker-view"];
/// Commands of the tests: of the crate, and of the program with it.
const TESTS: [&[&str]; 2] = [
    &["cargo", "test", "--release", "-p", "esker-remote"],
    &["cargo", "test", "--release", "-p", "esker", "--features", "remote", "--test", "addresses"],
];
/// Variable that names the server of S3.
const MOTO: &str = "ESKER_MOTO";
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
    if std::env::var_os(MOTO).is_none_or(|program| program.is_empty()) {
        println!("S3 is skipped: {MOTO} names no moto_server (pip install 'moto[server]')");
    }
    for tests in TESTS {
        println!("$ {}", tests.join(" "));
        let before = tally.passed;
        let (lines, ok) = follow_words(tests, &[])?;
        lines.iter().for_each(|line| tally.read(line));
        ensure!(ok && tally.passed > before, "failed, or ran no test: {}", tests.join(" "));
    }
    Ok(())
}
