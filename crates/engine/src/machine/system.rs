//! Calls that differ between systems: dropping a file from the page cache, returning freed memory,
//! counting the waits of a thread, and measuring a process.

use std::fs::File;
use std::io;
use std::process::{Child, ExitStatus};

/// Whether [`forget`] has an effect on this system.
pub const CAN_FORGET: bool = cfg!(target_os = "linux");

/// Drops the pages of a file from the page cache, so that the next reads come from the disk. The
/// file is synced first: pages that are not on the disk yet stay in the cache.
///
/// # Errors
/// If the system refuses.
#[cfg(target_os = "linux")]
pub fn forget(file: &File) -> io::Result<()> {
    file.sync_all()?;
    rustix::fs::fadvise(file, 0, None, rustix::fs::Advice::DontNeed)?;
    Ok(())
}

/// Does nothing: this system has no such call.
///
/// # Errors
/// Never.
#[cfg(not(target_os = "linux"))]
pub fn forget(_file: &File) -> io::Result<()> {
    Ok(())
}

/// Makes the allocator return freed allocations of 1 MiB and more, and free memory at the end of a
/// heap beyond 2 MiB, from now on. By default glibc raises both thresholds to 32 and 64 MiB a heap
/// as memory is freed, and what a process holds depends on how its threads were scheduled.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn give_back_freed_memory() {
    for (mark, bytes) in [(libc::M_MMAP_THRESHOLD, 1 << 20), (libc::M_TRIM_THRESHOLD, 2 << 20)] {
        // SAFETY: takes numbers only, and locks what it changes. If it refuses, nothing changes.
        unsafe { libc::mallopt(mark, bytes) };
    }
}

/// Does nothing: other allocators have no such thresholds.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back_freed_memory() {}

/// Number of voluntary waits of this thread, for a lock, a channel or the disk; `None` if the
/// system does not count them.
#[cfg(target_os = "linux")]
pub fn waits_of_this_thread() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/thread-self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("voluntary_ctxt_switches:"))?;
    line.trim().parse().ok()
}

/// `None`: this system does not count them.
#[cfg(not(target_os = "linux"))]
pub fn waits_of_this_thread() -> Option<u64> {
    None
}

/// Name of the processor; that of the architecture if the system does not tell.
pub fn processor() -> String {
    let information = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = information.lines().find_map(|line| line.strip_prefix("model name"));
    let name = name.and_then(|rest| rest.split_once(':')).map(|(_, name)| name.trim().to_owned());
    name.unwrap_or_else(|| std::env::consts::ARCH.into())
}

/// CPU time that all threads of this process have taken, milliseconds; `None` if the system does
/// not tell.
#[cfg(unix)]
pub fn cpu_ms() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6)
}

/// `None`: this system does not tell.
#[cfg(not(unix))]
pub fn cpu_ms() -> Option<f64> {
    None
}

/// Time that the threads of this process have waited for a core that another one held,
/// milliseconds; `None` if the system does not tell.
pub fn waited_for_cores_ms() -> Option<f64> {
    let threads = std::fs::read_dir("/proc/self/task").ok()?;
    let waited_ns = |thread: &std::path::Path| -> Option<f64> {
        let times = std::fs::read_to_string(thread.join("schedstat")).ok()?;
        times.split_whitespace().nth(1)?.parse().ok()
    };
    let all: Vec<f64> = threads.flatten().filter_map(|entry| waited_ns(&entry.path())).collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() * 1e-6)
}

/// Resources that a process used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessUsage {
    /// User and system time of all threads, seconds.
    pub cpu_seconds: f64,
    /// Greatest resident set, bytes; at least that of this process when it started the other one.
    pub peak_rss_bytes: u64,
}

/// How a child ended, and what it used with its own children; `None` while it runs. A child that
/// has ended must not be waited for again.
///
/// # Errors
/// If the system refuses.
#[cfg(unix)]
pub fn try_wait(child: &mut Child) -> io::Result<Option<(ExitStatus, Option<ProcessUsage>)>> {
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
            let used = ProcessUsage {
                cpu_seconds: seconds(usage.ru_utime) + seconds(usage.ru_stime),
                peak_rss_bytes: usage.ru_maxrss.unsigned_abs() as u64 * unit,
            };
            Ok(Some((ExitStatus::from_raw(status), Some(used))))
        }
    }
}

/// How a child ended; `None` while it runs. This system does not report what it used.
///
/// # Errors
/// If the system refuses.
#[cfg(not(unix))]
pub fn try_wait(child: &mut Child) -> io::Result<Option<(ExitStatus, Option<ProcessUsage>)>> {
    Ok(child.try_wait()?.map(|status| (status, None)))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_end_and_the_usage_of_a_process_are_reported() {
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
