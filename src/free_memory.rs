//! How much memory this process may still take.

use std::fs::read_to_string;

/// Bytes that may still be taken: the least of what the system has free, what the process's control group
/// leaves, and what its limit on addresses leaves (`ulimit -v`). `None` where nothing is known.
pub fn bytes() -> Option<u64> {
    [of_system(), of_group(), of_addresses()].into_iter().flatten().min()
}

fn of_system() -> Option<u64> {
    kilobytes(&read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
}

/// Control groups of version 2, then of version 1, as a container sees its own. Files that the system keeps
/// at hand are given back where memory is wanted.
fn of_group() -> Option<u64> {
    let groups = [
        ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file "),
        ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "),
    ];
    groups.iter().find_map(|(folder, limit, used, kept)| {
        let read = |name: &str| read_to_string(format!("{folder}/{name}")).ok();
        let number = |name: &str| read(name)?.trim().parse::<u64>().ok();
        let kept = read("memory.stat").and_then(|text| {
            text.lines().find_map(|line| line.strip_prefix(kept)).and_then(|value| value.parse().ok())
        });
        Some(number(limit)?.saturating_sub(number(used)?.saturating_sub(kept.unwrap_or(0))))
    })
}

/// The limit of this process' address space in bytes, where it is one that drivers can feel: their compilers alone
/// take hundreds of megabytes.
pub fn tight_limit() -> Option<u64> {
    const PLENTY: u64 = 8 << 30;
    address_limit(&read_to_string("/proc/self/limits").ok()?).filter(|&bytes| bytes < PLENTY)
}

fn address_limit(limits: &str) -> Option<u64> {
    let line = limits.lines().find(|line| line.starts_with("Max address space"))?;
    line.split_whitespace().nth(3)?.parse().ok()
}

fn of_addresses() -> Option<u64> {
    let limit = address_limit(&read_to_string("/proc/self/limits").ok()?)?;
    let used = kilobytes(&read_to_string("/proc/self/status").ok()?, "VmSize:")?;
    Some(limit.saturating_sub(used))
}

/// The value of a line such as `VmSize:   1234 kB`, in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_tells_a_sensible_number() {
        assert_eq!(kilobytes("MemTotal: 8 kB\nMemAvailable:   12 kB\n", "MemAvailable:"), Some(12 << 10));
        assert_eq!(kilobytes("MemTotal: 8 kB\n", "MemAvailable:"), None);
        let bytes = bytes().unwrap();
        assert!((1 << 20..1 << 50).contains(&bytes), "{bytes}");
    }

    #[test]
    fn limits_are_read() {
        let limits = |soft: &str| {
            address_limit(&format!(
                "Limit                     Soft Limit           Hard Limit           Units\n\
                 Max cpu time              unlimited            unlimited            seconds\n\
                 Max address space         {soft}            unlimited            bytes\n"
            ))
        };
        assert_eq!(limits("614400000"), Some(614_400_000));
        assert_eq!((limits("unlimited"), address_limit("")), (None, None));
    }
}
