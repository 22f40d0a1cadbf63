//! Memory that the machine grants and that the process uses. The code that differs between
//! operating systems is here.

/// Least memory that a build works with, in bytes.
pub const MEMORY_BYTES_MIN: u64 = 256 << 20;

/// Default memory of a build, in bytes: half of what the machine, or its control group, grants, and
/// at least [`MEMORY_BYTES_MIN`].
pub fn default_bytes() -> u64 {
    half_of(granted_bytes().unwrap_or(4 << 30))
}

/// Bytes that the machine, or its control group, grants; `None` if that is not known.
pub fn granted() -> Option<u64> {
    granted_bytes()
}

fn half_of(granted_bytes: u64) -> u64 {
    (granted_bytes / 2).max(MEMORY_BYTES_MIN)
}

/// Anonymous and resident memory of this process, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Anonymous memory now.
    pub anon_bytes: u64,
    /// Largest resident set so far.
    pub rss_peak_bytes: u64,
}

#[cfg(target_os = "linux")]
fn granted_bytes() -> Option<u64> {
    let total = kib_field(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")?;
    let total = total.min(left_of_limits(
        &std::fs::read_to_string("/proc/self/limits").unwrap_or_default(),
        &std::fs::read_to_string("/proc/self/status").unwrap_or_default(),
    ));
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let limit = |path: &std::path::PathBuf| {
        // "max" means no limit.
        std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok()
    };
    let limits = limit_files(&groups);
    Some(limits.iter().filter_map(limit).fold(total, u64::min))
}

/// What the limits of this process (`ulimit -v`, `ulimit -d`) leave, from the texts of
/// `/proc/self/limits` and `/proc/self/status`.
#[cfg(target_os = "linux")]
fn left_of_limits(limits: &str, status: &str) -> u64 {
    let left = |limit: &str, used: &str| {
        let line = limits.lines().find_map(|line| line.strip_prefix(limit))?;
        // "unlimited" is no number.
        let bytes = line.split_whitespace().next()?.parse::<u64>().ok()?;
        Some(bytes.saturating_sub(kib_field(status, used).unwrap_or(0)))
    };
    let address_space = left("Max address space", "VmSize:");
    let data = left("Max data size", "VmData:");
    address_space.into_iter().chain(data).fold(u64::MAX, u64::min)
}

/// Paths of the files that may hold a limit for the control groups that `/proc/self/cgroup` names:
/// the group's own and those above it, of version 2 (`0::/path`) and version 1 (`4:memory:/path`).
/// In a container the path may be that of the host and lead nowhere; the visible root is then the
/// container's group.
#[cfg(target_os = "linux")]
fn limit_files(groups: &str) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { continue };
        let (root, name) = if controllers.is_empty() {
            ("/sys/fs/cgroup", "memory.max")
        } else if controllers.split(',').any(|c| c == "memory") {
            ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
        } else {
            continue;
        };
        let above = std::path::Path::new(path.trim_start_matches('/')).ancestors();
        files.extend(above.map(|group| std::path::Path::new(root).join(group).join(name)));
    }
    files
}

/// Memory in use; zeros if that is not known.
#[cfg(target_os = "linux")]
pub fn usage() -> Usage {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    Usage {
        anon_bytes: kib_field(&status, "RssAnon:").unwrap_or(0),
        rss_peak_bytes: kib_field(&status, "VmHWM:").unwrap_or(0),
    }
}

#[cfg(target_os = "linux")]
fn kib_field(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find(|l| l.starts_with(name))?;
    line[name.len()..].trim().trim_end_matches(" kB").trim().parse::<u64>().ok().map(|k| k * 1024)
}

#[cfg(not(target_os = "linux"))]
fn granted_bytes() -> Option<u64> {
    None
}

/// Memory in use; zeros if that is not known.
#[cfg(not(target_os = "linux"))]
pub fn usage() -> Usage {
    Usage::default()
}

/// Largest sample of the anonymous memory.
#[derive(Debug, Default)]
pub struct Peak(std::sync::atomic::AtomicU64);

impl Peak {
    /// Takes a sample.
    pub fn sample(&self) {
        self.0.fetch_max(usage().anon_bytes, std::sync::atomic::Ordering::Relaxed);
    }

    /// Largest sample so far, in bytes.
    pub fn bytes(&self) -> u64 {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_small_machine_builds_with_the_least_memory() {
        assert_eq!(half_of(64 << 20), MEMORY_BYTES_MIN);
        assert_eq!(half_of(8 << 30), 4 << 30);
        assert!(default_bytes() >= MEMORY_BYTES_MIN);
    }

    #[test]
    fn limits_of_the_process_count_less_what_it_uses() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units\n\
            Max data size             unlimited            unlimited            bytes\n\
            Max address space         4096000              unlimited            bytes\n";
        assert_eq!(left_of_limits(limits, "VmSize:\t    1000 kB\n"), 4_096_000 - 1_024_000);
        assert_eq!(left_of_limits(limits, "VmSize:\t    9000 kB\n"), 0);
        assert_eq!(left_of_limits("", ""), u64::MAX);
    }

    #[test]
    fn limits_are_read_for_groups_of_both_versions_and_their_parents() {
        let files = |groups| {
            let text = |p: &std::path::PathBuf| p.display().to_string();
            limit_files(groups).iter().map(text).collect::<Vec<_>>()
        };
        assert_eq!(
            files("0::/user.slice/a\n"),
            [
                "/sys/fs/cgroup/user.slice/a/memory.max",
                "/sys/fs/cgroup/user.slice/memory.max",
                "/sys/fs/cgroup/memory.max"
            ]
        );
        assert_eq!(
            files("8:pids:/\n4:cpu,memory:/box\n0::/\n"),
            [
                "/sys/fs/cgroup/memory/box/memory.limit_in_bytes",
                "/sys/fs/cgroup/memory/memory.limit_in_bytes",
                "/sys/fs/cgroup/memory.max"
            ]
        );
        assert!(files("").is_empty() && files("nonsense\n").is_empty());
    }

    #[test]
    fn anonymous_memory_is_counted() {
        let before = usage().anon_bytes;
        // Other tests of the process take and free memory meanwhile.
        let block = vec![1u8; 256 << 20];
        let after = usage().anon_bytes;
        assert!(block.iter().all(|&b| b == 1));
        assert!(after > before + (200 << 20), "{before} {after}");
        assert!(default_bytes() > 0);
    }
}
