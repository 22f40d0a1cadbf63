//! Clippy, with the lints of the workspace, over everything that a newcomer builds, the window and the tools; and the
//! links in the documentation. A warning is an error.

use crate::shell::run_cargo;

/// What is no default member of the workspace.
const OTHERS: [&str; 2] = ["esker-view", "xtask"];

/// Makes documentation of which a link that leads nowhere is an error.
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
