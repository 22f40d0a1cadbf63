//! Turns panics of third-party decoders on damaged bytes into errors. Programs may silence the
//! messages of such panics.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::thread::Result;

thread_local! {
    /// Whether a panic of this thread becomes an error.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Returns the result of `f`, or the payload of its panic.
///
/// # Errors
/// If `f` panics.
pub fn catch<T>(f: impl FnOnce() -> T) -> Result<T> {
    let before = IS_CAUGHT.replace(true);
    let result = catch_unwind(AssertUnwindSafe(f));
    IS_CAUGHT.set(before);
    result
}

/// Silences, in the whole program, the messages of panics that become errors. Other panics are
/// still reported on standard error.
pub fn hide() {
    let say = take_hook();
    set_hook(Box::new(move |panic| {
        if !IS_CAUGHT.get() {
            say(panic);
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_are_caught_and_what_follows_is_not() {
        assert!(catch(|| 7).is_ok_and(|seven| seven == 7) && !IS_CAUGHT.get());
        // An inner call does not end the outer one.
        assert!(catch(|| catch(|| IS_CAUGHT.get()).is_ok() && IS_CAUGHT.get()).is_ok_and(|is| is));
        assert!(catch(|| assert!(!IS_CAUGHT.get())).is_err() && !IS_CAUGHT.get());
    }
}
