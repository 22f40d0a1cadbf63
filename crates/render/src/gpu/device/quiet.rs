//! Drivers that complain without need. On Linux without a desktop a layer of Mesa's looks for one whenever drivers are asked for, and
//! writes "error: XDG_RUNTIME_DIR is invalid or not set" where all is well.

/// Does what asks drivers what there is; where there is no desktop, without what they write to standard error meanwhile.
#[cfg(target_os = "linux")]
pub fn while_probing<T>(probe: impl FnOnce() -> T) -> T {
    use std::sync::{Mutex, PoisonError};
    /// One at a time, or one would restore what another has put there.
    static ONE: Mutex<()> = Mutex::new(());
    if std::env::var_os("XDG_RUNTIME_DIR").is_some_and(|folder| !folder.is_empty()) {
        return probe();
    }
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let _muted = Muted::new();
    probe()
}

/// The same elsewhere, where nobody complains.
#[cfg(not(target_os = "linux"))]
pub fn while_probing<T>(probe: impl FnOnce() -> T) -> T {
    probe()
}

/// Standard error leads nowhere, until this is dropped.
#[cfg(target_os = "linux")]
struct Muted(std::os::fd::OwnedFd);

#[cfg(target_os = "linux")]
impl Muted {
    /// `None` where that is not to be had.
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
        // It was open before.
        let _ = rustix::stdio::dup2_stderr(&self.0);
    }
}
