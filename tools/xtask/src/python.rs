//! Builds the Python package (`bindings/python`) into a wheel, installs it, and runs its tests, the
//! examples of its documentation and its example script. `ESKER_PYTHON_VENV` names a virtual
//! environment of Python 3.10 or newer with maturin, numpy, laspy and lazrs; `.ci/run` makes one
//! where it can. Without it the step is skipped, which it prints.

use crate::shell::{Scratch, build_esker, follow_words, output, run, run_cargo};
use crate::tally::Tally;
use anyhow::{Context, Result, ensure};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Folder of the package.
const PACKAGE: &str = "bindings/python";
/// Names the versions, or fails.
const CHECK: &str = "import sys, numpy, laspy, lazrs\n\
    assert sys.version_info >= (3, 10), 'it is older than Python 3.10'\n\
    print(sys.version.split()[0], 'numpy', numpy.__version__, 'laspy', laspy.__version__)";
/// Most bytes of a wheel.
const WHEEL_BYTES_MAX: u64 = 12_000_000;

/// Lints, builds, installs and tests the package.
pub fn check(tally: &mut Tally) -> Result<()> {
    let skip = |why: &str| {
        println!("skipped: {why}; the Python package is not tested");
        Ok(())
    };
    let Some(venv) = std::env::var_os("ESKER_PYTHON_VENV").map(PathBuf::from) else {
        return skip("ESKER_PYTHON_VENV names no virtual environment with maturin and laspy");
    };
    let programs = venv.join(if cfg!(windows) { "Scripts" } else { "bin" });
    let python = programs.join("python");
    match output(python.as_os_str(), &["-c", CHECK]) {
        Ok(versions) => print!("python {versions}"),
        Err(error) => return skip(&format!("{error:#}")),
    }
    let maturin = programs.join("maturin");
    if output(maturin.as_os_str(), &["--version"]).is_err() {
        return skip("there is no maturin beside its python");
    }
    let lints = ["--release", "--no-deps", "--", "-D", "warnings"];
    run_cargo(&[&["clippy", "-p", "esker-python"][..], &lints].concat())?;
    let scratch = Scratch::new("python")?;
    let wheel = build_wheel(&maturin, scratch.folder())?;
    let wheel = wheel.to_str().context("the name of the wheel is no Unicode")?;
    let install = ["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"];
    run("pip", python.as_os_str(), &[&install[..], &[wheel]].concat())?;
    let program = build_esker()?;
    let tests = format!("{PACKAGE}/tests/run.py");
    let words = [python.to_str().context("the environment's name is no Unicode")?, &tests];
    println!("$ {}", words.join(" "));
    let before = tally.passed;
    let environment = [("ESKER_PROGRAM", program.to_str().unwrap_or_default())];
    let (lines, ok) = follow_words(&words, &environment)?;
    lines.iter().for_each(|line| tally.read(line));
    ensure!(ok && tally.passed > before, "failed, or ran no test: {}", words.join(" "));
    let example = std::path::absolute(format!("{PACKAGE}/examples/creek.py"))?;
    let out = scratch.file("example");
    let words = [example.as_os_str(), out.as_os_str()];
    run("the example", python.as_os_str(), &words)
}

/// Builds the wheel; its path.
fn build_wheel(maturin: &Path, folder: &Path) -> Result<PathBuf> {
    let manifest = format!("{PACKAGE}/Cargo.toml");
    let mut words: Vec<&OsStr> = vec![
        "build".as_ref(),
        "--release".as_ref(),
        "--locked".as_ref(),
        "--compression-level".as_ref(),
        "9".as_ref(),
        "--manifest-path".as_ref(),
        manifest.as_ref(),
        "--out".as_ref(),
        folder.as_os_str(),
    ];
    // The linker that Rust has there by default joins functions that are equal, 5 % of a wheel.
    if cfg!(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu")) {
        words.extend(["--", "-C", "link-arg=-Wl,--icf=all"].map(OsStr::new));
    }
    run("maturin", maturin.as_os_str(), &words)?;
    let mut files = std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path()));
    let wheel = files.find(|path: &Result<PathBuf>| {
        path.as_ref().is_ok_and(|path| path.extension().is_some_and(|ending| ending == "whl"))
    });
    let wheel = wheel.context("maturin made no wheel")??;
    let bytes = wheel.metadata()?.len();
    println!("python: a wheel of {:.1} MB", bytes as f64 / 1e6);
    ensure!(bytes <= WHEEL_BYTES_MAX, "the wheel has {bytes} bytes, over {WHEEL_BYTES_MAX}");
    Ok(wheel)
}
