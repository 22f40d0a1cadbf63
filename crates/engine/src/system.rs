//! What differs between systems: dropping a file from the system's cache, and how often a thread gave up
//! the processor.

use std::fs::File;
use std::io;

/// Whether [`forget`] does anything here.
pub const CAN_FORGET: bool = cfg!(target_os = "linux");

/// Drops a file's pages from the system's cache, so that the next reads are from cold. Written pages
/// stay until they are on the disk, so the file is synced first.
///
/// # Errors
/// Where the system refuses.
#[cfg(target_os = "linux")]
pub fn forget(file: &File) -> io::Result<()> {
    file.sync_all()?;
    rustix::fs::fadvise(file, 0, None, rustix::fs::Advice::DontNeed)?;
    Ok(())
}

/// Does nothing: this system has no such call.
#[cfg(not(target_os = "linux"))]
pub fn forget(_file: &File) -> io::Result<()> {
    Ok(())
}

/// How often this thread has waited of its own accord (for a lock, a channel, the disk); `None` where
/// the system does not tell.
#[cfg(target_os = "linux")]
pub fn waits_of_this_thread() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/thread-self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("voluntary_ctxt_switches:"))?;
    line.trim().parse().ok()
}

/// `None`: this system does not tell.
#[cfg(not(target_os = "linux"))]
pub fn waits_of_this_thread() -> Option<u64> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn sleeping_is_waiting_and_computing_is_not() {
        let before = waits_of_this_thread().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(2));
        assert!(waits_of_this_thread().unwrap() > before);
    }
}
