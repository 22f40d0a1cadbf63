//! What differs between systems: dropping a file from the system's cache, giving memory back, how
//! often a thread gave up the processor, and what a process used.

use std::fs::File;
use std::io;
use std::process::{Child, ExitStatus};

/// Whether [`forget`] does anything here.
pub const CAN_FORGET: bool = cfg!(target_os = "linux");

/// Drops a file's pages from the system's cache, so that the next reads are from cold. Written
/// pages stay until they are on the disk, so the file is synced first.
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

/// Has this process give back from now on, as it is freed, what is allocated in runs of 4 MiB and
/// more, and what is free at a heap's end beyond 8 MiB. Left to itself the allocator raises both
/// marks with what is freed, to 32 and 64 MiB a heap, and what a process holds depends on how its
/// threads took turns.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn give_back_freed_memory() {
    for (mark, bytes) in [(libc::M_MMAP_THRESHOLD, 4 << 20), (libc::M_TRIM_THRESHOLD, 8 << 20)] {
        // SAFETY: takes numbers only, and glibc's own lock around what it changes. Where it refuses
        // all is as it was.
        unsafe { libc::mallopt(mark, bytes) };
    }
}

/// Does nothing: other systems' allocators have no such marks.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back_freed_memory() {}

/// How often this thread has waited of its own accord (for a lock, a channel, the disk); `None`
/// where the system does not tell.
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

/// What a process used in all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Used {
    /// Of all its threads, user and system, seconds.
    pub cpu_seconds: f64,
    /// Greatest resident set, in bytes: that of this process when it started the other one, at
    /// least.
    pub peak_rss_bytes: u64,
}

/// How a process ended and what it used, with what its own processes used; nothing while it runs.
/// Once it has ended the child must not be waited for again.
///
/// # Errors
/// Where the system refuses.
#[cfg(unix)]
pub fn try_wait(child: &mut Child) -> io::Result<Option<(ExitStatus, Option<Used>)>> {
    use std::os::unix::process::ExitStatusExt;
    let id = libc::pid_t::try_from(child.id()).map_err(io::Error::other)?;
    let mut status = 0;
    // SAFETY: all zeros is a value of `rusage`, which has integers only.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: both pointers are to values of the right type that live through the call; the child
    // is ours and was not waited for, so the id is no other process's.
    match unsafe { libc::wait4(id, &mut status, libc::WNOHANG, &mut usage) } {
        0 => Ok(None),
        -1 => Err(io::Error::last_os_error()),
        _ => {
            let seconds = |t: libc::timeval| t.tv_sec as f64 + t.tv_usec as f64 * 1e-6;
            // Linux counts kibibytes, macOS bytes.
            let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
            let used = Used {
                cpu_seconds: seconds(usage.ru_utime) + seconds(usage.ru_stime),
                peak_rss_bytes: usage.ru_maxrss.unsigned_abs() as u64 * unit,
            };
            Ok(Some((ExitStatus::from_raw(status), Some(used))))
        }
    }
}

/// How a process ended; nothing while it runs. What it used, this system does not tell.
///
/// # Errors
/// Where the system refuses.
#[cfg(not(unix))]
pub fn try_wait(child: &mut Child) -> io::Result<Option<(ExitStatus, Option<Used>)>> {
    Ok(child.try_wait()?.map(|status| (status, None)))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_tells_how_it_ended_and_what_it_used() {
        let count = "i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done; exit 3";
        let mut child = std::process::Command::new("sh").args(["-c", count]).spawn().unwrap();
        let (status, used) = loop {
            if let Some(ended) = try_wait(&mut child).unwrap() {
                break ended;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        };
        let used = used.unwrap();
        assert_eq!(status.code(), Some(3));
        assert!(used.cpu_seconds > 0.001 && used.cpu_seconds < 60.0, "{used:?}");
        assert!((1 << 19..1 << 33).contains(&used.peak_rss_bytes), "{used:?}");
    }

    #[test]
    fn sleeping_is_waiting_and_computing_is_not() {
        let before = waits_of_this_thread().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(2));
        assert!(waits_of_this_thread().unwrap() > before);
    }
}
