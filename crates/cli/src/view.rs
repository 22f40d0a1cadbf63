//! `esker view`: starts the window, `esker-view`, with the arguments as they are, and returns its
//! exit code. The window is a program of its own, in the same folder, so that `esker` links no
//! window library.

use anyhow::{Context, Result, anyhow};
use esker_engine::io::address::whole;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Name of the window's program.
const PROGRAM: &str = "esker-view";

/// Arguments that are passed on.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub struct View {
    /// A file or scans, and options of `esker-view`; `esker view --help` lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "FILE AND OPTIONS")]
    arguments: Vec<OsString>,
}

/// Shows the window until it is closed, and returns its exit code.
///
/// # Errors
/// If the program is missing, which names the command that builds it, or cannot be started.
pub fn run(view: &View) -> Result<ExitCode> {
    let own = std::env::current_exe().context("cannot find the program itself")?;
    let program = own.with_file_name(format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX));
    if !program.is_file() {
        let command = build_command(&own, &project());
        return Err(anyhow!(
            "{}: the window is not built; build it with: {command}",
            program.display()
        ));
    }
    // The window hides secrets of addresses itself.
    let arguments = view.arguments.iter().map(|argument| whole(Path::new(argument)));
    let status = Command::new(&program).args(arguments).status();
    let status = status.with_context(|| format!("{}: cannot be started", program.display()))?;
    // A process that was ended by a signal has no code.
    Ok(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1).into())
}

/// Folder of the project that the program was built from.
fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).to_owned()
}

/// The command that builds the window's program into the folder of `own`.
fn build_command(own: &Path, project: &Path) -> String {
    let folder = own.parent().unwrap_or(Path::new("."));
    let is_built = folder.file_name().is_some_and(|name| name == "release" || name == "debug");
    if !is_built {
        return format!("cargo install --path {}", project.join("crates/view").display());
    }
    let release = if folder.ends_with("release") { " --release" } else { "" };
    let manifest = project.join("Cargo.toml");
    let target = folder.parent().unwrap_or(folder);
    let mut command =
        format!("cargo build{release} -p {PROGRAM} --manifest-path {}", manifest.display());
    if target != project.join("target") {
        command += &format!(" --target-dir {}", target.display());
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_builds_the_window_beside_the_program_that_was_started() {
        let command = |own: &str| build_command(Path::new(own), Path::new("/src/esker"));
        let build = "cargo build --release -p esker-view --manifest-path /src/esker/Cargo.toml";
        assert_eq!(command("/src/esker/target/release/esker"), build);
        assert_eq!(command("/cache/release/esker"), format!("{build} --target-dir /cache"));
        assert_eq!(command("/usr/bin/esker"), "cargo install --path /src/esker/crates/view");
    }
}
