//! Checks that all Rust files are formatted by the rules of `rustfmt.toml`.

use crate::shell::run_cargo;

/// Checks the formatting; changes nothing.
pub fn check() -> anyhow::Result<()> {
    run_cargo(&["fmt", "--all", "--check"])
}
