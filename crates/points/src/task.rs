//! Progress of long work: phases, how much is done, and cancellation.

use std::fmt;

/// Receives the progress of long work; implemented by whoever displays it. Calls are cheap and come
/// from any thread.
pub trait Task: Sync {
    /// Begins a phase: its name, and the amount of work if it is known.
    fn phase(&self, _name: &str, _total: Option<u64>, _unit: &'static str) {}
    /// Adds to the work done in the phase.
    fn advance(&self, _by: u64) {}
    /// Passes on a message to the user, in one line.
    fn note(&self, _line: &str) {}
    /// Whether the user wants to stop. Long work tests this at least every few hundred
    /// milliseconds.
    fn is_cancelled(&self) -> bool {
        false
    }
    /// Returns an error if the user wants to stop.
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

/// Displays nothing and never stops: for tests and short work.
pub struct Silent;
impl Task for Silent {}
