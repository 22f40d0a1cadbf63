//! Runs other programs from the root of the workspace, without a standard input, so that nothing
//! waits for a person. Output that is read is also passed on, line by line.

use anyhow::{Context, Result, bail, ensure};
use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Makes the root of the workspace the current folder.
pub fn enter_root() -> Result<()> {
    let manifest =
        output(&cargo(), &["locate-project", "--workspace", "--message-format", "plain"])?;
    let root = Path::new(manifest.trim()).parent().context("the manifest is nowhere")?;
    std::env::set_current_dir(root).with_context(|| format!("{}", root.display()))
}

/// The cargo that runs this program.
pub fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// Runs cargo and passes its output on; fails if it fails.
pub fn run_cargo(args: &[&str]) -> Result<()> {
    run("cargo", &cargo(), args)
}

/// Runs a program and passes its output on; fails if it fails. Errors call it `name`.
pub fn run<S: AsRef<OsStr>>(name: &str, program: &OsStr, args: &[S]) -> Result<()> {
    let status = Command::new(program).args(args).stdin(Stdio::null()).status()?;
    let words: Vec<_> = args.iter().map(|word| word.as_ref().to_string_lossy()).collect();
    ensure!(status.success(), "{name} {} failed ({status})", words.join(" "));
    Ok(())
}

/// Builds the `esker` program in release mode; its path.
pub fn build_esker() -> Result<PathBuf> {
    run_cargo(&["build", "--release", "--bin", "esker"])?;
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    let program = Path::new(&target).join("release/esker").canonicalize();
    program.context("the program that was built")
}

/// A folder in the system's temporary folder; deleted when dropped.
pub struct Scratch(PathBuf);

impl Scratch {
    /// Makes an empty folder for a task.
    pub fn new(task: &str) -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("esker-{task}-{}", std::process::id()));
        std::fs::create_dir(&folder).with_context(|| format!("{}", folder.display()))?;
        Ok(Self(folder))
    }

    /// Path of the folder.
    pub fn folder(&self) -> &Path {
        &self.0
    }

    /// Path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Standard output of a program; fails if the program fails.
pub fn output<S: AsRef<OsStr>>(program: &OsStr, args: &[S]) -> Result<String> {
    let name = program.to_string_lossy();
    let out = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("{name} cannot be run"))?;
    if !out.status.success() {
        let words: Vec<_> = args.iter().map(|word| word.as_ref().to_string_lossy()).collect();
        bail!("{name} {} failed: {}", words.join(" "), String::from_utf8_lossy(&out.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&out.stdout).into_owned())
}

/// Runs a command line of words without spaces; passes its output on and collects it. Returns the
/// lines, and whether the program succeeded.
pub fn follow(line: &str, environment: &[(&str, &str)]) -> Result<(Vec<String>, bool)> {
    follow_words(&line.split_whitespace().collect::<Vec<_>>(), environment)
}

/// [`follow`] for words that may contain spaces.
pub fn follow_words(words: &[&str], environment: &[(&str, &str)]) -> Result<(Vec<String>, bool)> {
    let (program, arguments) = words.split_first().context("an empty command")?;
    let mut child = Command::new(program)
        .args(arguments)
        .envs(environment.iter().copied())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("`{}` cannot be run", words.join(" ")))?;
    let stdout = child.stdout.take().context("no standard output")?;
    let stderr = child.stderr.take().context("no standard error")?;
    // Both pipes are read at the same time: a full pipe would stop the child.
    let aside = std::thread::Builder::new()
        .name("stderr".into())
        .spawn(move || pass_on(stderr, |l| eprintln!("{l}")))?;
    let mut lines = pass_on(stdout, |l| println!("{l}"));
    lines.extend(aside.join().unwrap_or_default());
    Ok((lines, child.wait()?.success()))
}

fn pass_on(from: impl Read, print: fn(&str)) -> Vec<String> {
    let mut lines = Vec::new();
    for line in BufReader::new(from).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line).trim_end().to_owned();
        print(&line);
        lines.push(line);
    }
    lines
}
