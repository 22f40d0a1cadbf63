//! Runs the `esker` binary on files at addresses: with a server on loopback, as users run it, and
//! with S3 as the package `moto` of PyPI has it, if `ESKER_MOTO` names its `moto_server`.
#![allow(clippy::unwrap_used, reason = "tests may panic")]
#![allow(
    clippy::disallowed_methods,
    reason = "files that the tests made themselves are read whole"
)]

mod commands;
mod faults;
#[path = "../whole_program/folder.rs"]
#[allow(dead_code, reason = "the other tests use all of it")]
mod folder;
mod forest;
mod jobs;
mod moto;
#[path = "../whole_program/program.rs"]
#[allow(dead_code, reason = "the other tests use all of it")]
mod program;
mod s3;
#[path = "../../crates/remote/tests/server/mod.rs"]
mod server;

use program::{ESKER, Outcome, finish, start};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A word that no output may have.
const SECRET: &str = "top-secret";

/// Runs `esker` with some variables set, and checks that no secret is printed.
fn esker_with<S: AsRef<OsStr>>(
    variables: &[(&str, &str)],
    arguments: impl IntoIterator<Item = S>,
) -> Outcome {
    let mut command = Command::new(ESKER);
    // Nothing is kept in the user's cache.
    let cache = tempfile::tempdir().unwrap();
    command.env("XDG_CACHE_HOME", cache.path()).env("HOME", cache.path());
    command.args(arguments).envs(variables.iter().copied());
    let shown = format!("{command:?}").replace(SECRET, "***");
    let (child, outputs) = start(command);
    let outcome = finish(child, outputs, shown, 200);
    for text in [&outcome.stdout, &outcome.stderr] {
        assert!(!text.contains(SECRET), "a secret is printed");
    }
    outcome
}

fn esker<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Outcome {
    esker_with(&[], arguments)
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

/// The sample scan.
fn scan() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/sample/creek.laz")
}

/// Builds the sample scan with small nodes.
fn built(folder: &folder::Folder, name: &str) -> PathBuf {
    let out = folder.file(name);
    std::fs::create_dir_all(out.parent().unwrap()).unwrap();
    program::build(&[scan()], &out, &["--node-capacity", "4096"]);
    out
}

/// Draws a small picture; its bytes.
fn drawn(file: &str, folder: &folder::Folder, variables: &[(&str, &str)]) -> Vec<u8> {
    let out = folder.file("drawn.png");
    let out = out.to_str().unwrap();
    let words = ["render", file, "-o", out, "--size", "320x200", "--backend", "cpu"];
    esker_with(variables, words).worked();
    bytes(Path::new(out))
}

/// The points of a file and their hash, as `verify` reports them.
fn verified(file: &str, variables: &[(&str, &str)]) -> [String; 2] {
    let report = esker_with(variables, ["verify", file, "--json"]).json();
    ["points", "multiset_hash"].map(|field| report[field].to_string())
}
