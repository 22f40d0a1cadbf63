//! Clippy, with the lints of the workspace, over everything that a newcomer builds and the tools;
//! a warning is an error.

use crate::shell::run_cargo;

/// Checks the default members of the workspace, then the tools.
pub fn check() -> anyhow::Result<()> {
    run_cargo(&["clippy", "--release", "--all-targets", "--", "-D", "warnings"])?;
    run_cargo(&["clippy", "--release", "-p", "xtask", "--all-targets", "--", "-D", "warnings"])
}
