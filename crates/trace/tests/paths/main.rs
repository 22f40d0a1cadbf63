//! Claims about the path tracer: it converges to the right light, it is the same for any number of
//! threads, it goes on where it stopped, and no scene makes it fail.

#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod converge;
mod counters;
mod hostile;
mod progress;
mod right;
mod scenes;
