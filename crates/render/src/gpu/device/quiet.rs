//! Silences drivers while adapters are enumerated. On Linux without a desktop a layer of Mesa
//! writes "error: XDG_RUNTIME_DIR is invalid or not set" to standard error although nothing is
//! wrong.

/// Calls `probe`, which enumerates adapters; without a desktop, standard error is discarded
/// meanwhile.
#[cfg(target_os = "linux")]
pub fn while_probing<T>(probe: impl FnOnce() -> T) -> T {
    use std::sync::{Mutex, PoisonError};
    /// One caller at a time, or one would restore the standard error that another has replaced.
    static ONE: Mutex<()> = Mutex::new(());
    if std::env::var_os("XDG_RUNTIME_DIR").is_some_and(|folder| !folder.is_empty()) {
        return probe();
    }
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let _muted = Muted::new();
    probe()
}

/// Calls `probe`; only drivers on Linux need silencing.
#[cfg(not(target_os = "linux"))]
pub fn while_probing<T>(probe: impl FnOnce() -> T) -> T {
    probe()
}

/// Discards standard error until it is dropped, and keeps the original.
#[cfg(target_os = "linux")]
struct Muted(std::os::fd::OwnedFd);

#[cfg(target_os = "linux")]
impl Muted {
    /// Redirects standard error to `/dev/null`; `None` if the system refuses.
    fn new() -> Option<Self> {
        let nowhere = std::fs::File::options().write(true).open("/dev/null").ok()?;
        let muted = Self(rustix::io::dup(rustix::stdio::stderr()).ok()?);
        rustix::stdio::dup2_stderr(nowhere).ok()?;
        Some(muted)
    }
}

#[cfg(target_os = "linux")]
impl Drop for Muted {
    fn drop(&mut self) {
        // The descriptor was open before, so this cannot fail.
        let _ = rustix::stdio::dup2_stderr(&self.0);
    }
}
