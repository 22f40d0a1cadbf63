//! What the machine grants and what the process uses: the one place with a branch for each system.

/// Bytes a build may use where the user says nothing: half of what the machine, or its control group, grants.
pub fn default_bytes() -> u64 {
    granted_bytes().unwrap_or(4 << 30) / 2
}

/// Anonymous and resident memory of this process, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Anonymous memory now.
    pub anon_bytes: u64,
    /// Greatest resident set so far.
    pub rss_peak_bytes: u64,
}

#[cfg(target_os = "linux")]
fn granted_bytes() -> Option<u64> {
    let total = kib_field(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")?;
    let group = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let group = group.and_then(|g| g.trim().parse::<u64>().ok()).unwrap_or(u64::MAX);
    Some(total.min(group))
}

/// Memory in use; zeros where the system does not tell.
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

/// Memory in use; zeros where the system does not tell.
#[cfg(not(target_os = "linux"))]
pub fn usage() -> Usage {
    Usage::default()
}

/// Remembers the greatest anonymous memory seen.
#[derive(Debug, Default)]
pub struct Peak(std::sync::atomic::AtomicU64);

impl Peak {
    /// Looks now.
    pub fn sample(&self) {
        self.0.fetch_max(usage().anon_bytes, std::sync::atomic::Ordering::Relaxed);
    }

    /// The greatest seen, in bytes.
    pub fn bytes(&self) -> u64 {
        self.0.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn anonymous_memory_is_counted() {
        let before = usage().anon_bytes;
        let block = vec![1u8; 64 << 20];
        let after = usage().anon_bytes;
        assert!(block.iter().all(|&b| b == 1));
        assert!(after > before + (60 << 20), "{before} {after}");
        assert!(default_bytes() > 0);
    }
}
