//! Light: pictures lit by path tracing (`bauszat2011`), as users ask for them. Takes lights from
//! the command line or a document, builds the scene of a cut, and draws still pictures and the
//! frames of sessions. Without the feature `light` only the settings remain, which are refused.

pub mod document;
pub mod settings;
pub mod spec;

use anyhow::{Result, ensure};

/// Whether this program can light.
pub const IS_BUILT: bool = cfg!(feature = "light");

/// Refuses to light in a program that was built without it.
///
/// # Errors
/// If the feature `light` is off; the message has the command that builds with it.
pub fn check_built() -> Result<()> {
    ensure!(
        IS_BUILT,
        "this program was built without light, so that it has no --method lit; build it with: \
         cargo build --release -p esker -p esker-view --features light"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_refused_exactly_where_it_is_not_built() {
        let refused = check_built().map_err(|e| e.to_string());
        assert_eq!(refused.is_ok(), IS_BUILT);
        assert!(refused.err().is_none_or(|fault| fault.contains("--features light")));
    }
}
