//! Runs clippy with the lints of the workspace over all crates, the window and the tools included,
//! and checks the links in the documentation. A warning is an error.

use crate::shell::run_cargo;

/// Packages that are not default members of the workspace.
const OTHERS: [&str; 2] = ["esker-view", "xtask"];

/// Builds the documentation; a broken link is an error.
const DOC: [&str; 5] =
    ["doc", "--release", "--no-deps", "--config", "build.rustdocflags=['-Dwarnings']"];

/// Checks the default members of the workspace, then the others.
pub fn check() -> anyhow::Result<()> {
    run_cargo(&["clippy", "--release", "--all-targets", "--", "-D", "warnings"])?;
    OTHERS.iter().try_for_each(|package| {
        run_cargo(&["clippy", "--release", "-p", package, "--all-targets", "--", "-D", "warnings"])
    })?;
    run_cargo(&DOC)
}
