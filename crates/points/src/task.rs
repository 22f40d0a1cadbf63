//! What long work tells and asks while it runs: phases, how far it is, and whether to stop.

use std::fmt;

/// Told by long work, implemented by whoever shows progress. Calls are cheap and come from any
/// thread.
pub trait Task: Sync {
    /// A new phase begins: its name, and how much there is to do, where known.
    fn phase(&self, _name: &str, _total: Option<u64>, _unit: &'static str) {}
    /// So much more of the phase is done.
    fn advance(&self, _by: u64) {}
    /// Something the user should know, in one line.
    fn note(&self, _line: &str) {}
    /// Whether the user wants to stop. Long work asks at least every few hundred milliseconds.
    fn is_cancelled(&self) -> bool {
        false
    }
    /// `Err` where the user wants to stop.
    ///
    /// # Errors
    /// [`Cancelled`].
    fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

/// The user asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

impl fmt::Display for Cancelled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("stopped on request; nothing was left under the final name")
    }
}

impl std::error::Error for Cancelled {}

/// Shows nothing and never stops: for tests and short work.
pub struct Silent;
impl Task for Silent {}
