//! All Rust files are formatted as `rustfmt.toml` says.

use crate::shell::run_cargo;

/// Checks, changes nothing.
pub fn check() -> anyhow::Result<()> {
    run_cargo(&["fmt", "--all", "--check"])
}
