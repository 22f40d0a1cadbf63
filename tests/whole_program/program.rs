//! Runs the program: takes arguments; returns exit code, output and the last JSON object. A program
//! that hangs is killed, and the trial fails.

use serde_json::Value;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The program under test.
pub const ESKER: &str = env!("CARGO_BIN_EXE_esker");
/// Seconds after which a program counts as hanging; far above the need of any trial.
const HANGS_AFTER_S: u64 = 400;

/// Exit code and output of a program.
pub struct Outcome {
    /// Exit code; `None` if a signal ended the program.
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
    shown: String,
}

impl Outcome {
    /// Asserts success and returns the object on the last line.
    pub fn json(&self) -> Value {
        self.worked();
        let last = self.stdout.lines().last().unwrap_or_default();
        serde_json::from_str(last).unwrap_or_else(|e| panic!("{}: {e}: {last}", self.shown))
    }

    /// Asserts success.
    pub fn worked(&self) -> &Self {
        assert_eq!(self.code, Some(0), "{}: {}", self.shown, self.stderr);
        self
    }

    /// Asserts a clean failure: an exit code and one line that begins with `error:`. Returns that
    /// line.
    pub fn error(&self) -> &str {
        let shown = &self.shown;
        let code = self.code.unwrap_or_else(|| panic!("{shown}: ended by a signal"));
        assert_ne!(code, 0, "{shown}: should have failed: {}", self.stdout);
        assert!(!self.stderr.contains("panicked"), "{shown}: {}", self.stderr);
        let mut lines = self.stderr.lines().filter(|l| !l.starts_with("note: "));
        let line = lines.next().unwrap_or_else(|| panic!("{shown}: failed without a word"));
        assert!(line.starts_with("error: "), "{shown}: {line}");
        // Clap prints the usage after the error, and exits with code 2.
        assert!(code == 2 || lines.next().is_none(), "{shown}: more than a line: {}", self.stderr);
        line
    }
}

/// Runs `esker` with these arguments.
pub fn esker<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Outcome {
    let mut command = Command::new(ESKER);
    // Nothing is written to the user's cache.
    let cache = std::env::temp_dir().join("esker-tests-cache");
    command.args(arguments).env("XDG_CACHE_HOME", cache);
    run(command, HANGS_AFTER_S)
}

/// Runs `esker` under a limit of anonymous memory (`RLIMIT_DATA`), KiB.
#[cfg(unix)]
pub fn esker_within<S: AsRef<OsStr>>(
    data_kib: u64,
    hangs_after_s: u64,
    arguments: impl IntoIterator<Item = S>,
) -> Outcome {
    run(under(&format!("ulimit -d {data_kib}"), arguments), hangs_after_s)
}

/// Runs `esker` in a shell after a command that sets a limit.
#[cfg(unix)]
pub fn esker_under<S: AsRef<OsStr>>(
    limit: &str,
    arguments: impl IntoIterator<Item = S>,
) -> Outcome {
    run(under(limit, arguments), HANGS_AFTER_S)
}

#[cfg(unix)]
fn under<S: AsRef<OsStr>>(limit: &str, arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{limit} && exec \"$0\" \"$@\""), ESKER]).args(arguments);
    command
}

/// Anonymous memory of the empty program: least limit under which it builds three points, KiB.
#[cfg(unix)]
pub fn empty_kib() -> u64 {
    static KIB: std::sync::OnceLock<u64> = std::sync::OnceLock::new();
    *KIB.get_or_init(|| {
        let folder = crate::folder::Folder::new();
        let tiny = folder.write("tiny.xyz", "0 0 0\n1 2 3\n4 5 6\n");
        let words = ["build".into(), tiny, "-o".into(), folder.file("tiny.esker")];
        let (mut fails, mut works) = (0, 1 << 20);
        while works - fails > 512 {
            let middle = u64::midpoint(fails, works);
            let outcome = esker_within(middle, 60, &words);
            *(if outcome.code == Some(0) { &mut works } else { &mut fails }) = middle;
        }
        assert!(works < 128 << 10, "the empty program needs {works} KiB");
        works
    })
}

/// Builds `inputs` into `out` and returns the report.
pub fn build<P: AsRef<Path>>(inputs: &[P], out: &Path, more: &[&str]) -> Value {
    let mut arguments = vec![OsStr::new("build")];
    arguments.extend(inputs.iter().map(|i| i.as_ref().as_os_str()));
    arguments.extend([OsStr::new("-o"), out.as_os_str()]);
    arguments.extend(["--json", "--progress", "none"].map(OsStr::new));
    arguments.extend(more.iter().map(OsStr::new));
    esker(arguments).json()
}

/// Verifies `file`, against `inputs` if there are any, and returns the outcome.
pub fn verify<P: AsRef<Path>>(file: &Path, inputs: &[P]) -> Outcome {
    let mut arguments = vec![OsStr::new("verify"), file.as_os_str(), OsStr::new("--json")];
    if !inputs.is_empty() {
        arguments.push(OsStr::new("--against"));
        arguments.extend(inputs.iter().map(|i| i.as_ref().as_os_str()));
    }
    esker(arguments)
}

/// Starts a command with its output going to files, which can grow without a reader.
pub fn start(mut command: Command) -> (Child, [File; 2]) {
    let [out, err] = [(); 2].map(|()| tempfile::tempfile().unwrap());
    // Graphics drivers print an error if it is unset.
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    }
    command.stdin(Stdio::null());
    command.stdout(out.try_clone().unwrap()).stderr(err.try_clone().unwrap());
    let child = command.spawn().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    (child, [out, err])
}

/// Waits for what [`start`] started.
pub fn finish(mut child: Child, outputs: [File; 2], shown: String, hangs_after_s: u64) -> Outcome {
    let deadline = Instant::now() + Duration::from_secs(hangs_after_s);
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if Instant::now() > deadline {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("{shown}: hangs");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let [stdout, stderr] = outputs.map(|mut file| {
        let mut text = Vec::new();
        file.rewind().unwrap();
        file.read_to_end(&mut text).unwrap();
        String::from_utf8_lossy(&text).into_owned()
    });
    Outcome { code: status.code(), stdout, stderr, shown }
}

/// Runs any command to its end.
pub fn run(command: Command, hangs_after_s: u64) -> Outcome {
    let shown = format!("{command:?}").replace(ESKER, "esker");
    let (child, outputs) = start(command);
    finish(child, outputs, shown, hangs_after_s)
}

/// The scan that comes with the project.
pub fn sample() -> PathBuf {
    let folder = std::path::absolute("../../tests/sample").unwrap();
    let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let mut scans: Vec<_> = files.filter(|f| f.extension().is_some_and(|e| e != "md")).collect();
    assert_eq!(scans.len(), 1, "{} has one scan", folder.display());
    scans.remove(0)
}
