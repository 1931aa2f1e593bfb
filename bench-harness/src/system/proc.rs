//! What Linux's `/proc` says about processes and the machine. Elsewhere nothing is known.

use std::path::Path;

/// The value after `key` in a file of lines `key: value` or `key=value`, without quotation marks.
pub(crate) fn field(path: &str, key: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|l| l.starts_with(key))?;
    Some(line.split_once([':', '='])?.1.trim().trim_matches('"').to_string())
}

/// The first line of a file, or an empty text.
pub(crate) fn line(path: &str) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.lines().next().unwrap_or_default().trim().to_string()
}

/// A line of `/proc/<process>/status` in bytes. `process` is `self` or a process number. `None` if the system does not say.
pub(crate) fn status_bytes(process: &str, key: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    status.lines().find_map(|line| kilobytes(line.strip_prefix(key)?))
}

/// Whether this process ignores the signal of that number, 1 to 64; false if the system does not say.
pub fn ignores_signal(number: u32) -> bool {
    let mask = field("/proc/self/status", "SigIgn").and_then(|text| u64::from_str_radix(&text, 16).ok());
    mask.is_some_and(|mask| (1..=64).contains(&number) && mask >> (number - 1) & 1 == 1)
}

/// Memory that the machine can still give, in bytes; `None` if the system does not say.
pub fn available_bytes() -> Option<u64> {
    kilobytes(&field("/proc/meminfo", "MemAvailable")?)
}

/// Bytes that this process holds in memory, or 0 if the system does not say.
pub(crate) fn resident_bytes() -> u64 {
    status_bytes("self", "VmRSS:").unwrap_or(0)
}

/// Most memory that this process has held so far, in bytes, or 0 if the system does not say.
pub fn peak_bytes() -> u64 {
    status_bytes("self", "VmHWM:").unwrap_or(0)
}

/// Bytes of a file that are mapped into this process; `None` if the system does not say.
pub(crate) fn mapped_bytes(path: &Path) -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/smaps").ok()?;
    let name = path.canonicalize().ok()?;
    let mut lines = text.lines().skip_while(|line| !line.ends_with(&*name.to_string_lossy()));
    lines.find_map(|line| kilobytes(line.strip_prefix("Rss:")?))
}

/// Load of the machine over the last minute, or 0 if the system does not say.
pub(crate) fn load() -> f64 {
    line("/proc/loadavg").split_whitespace().next().and_then(|s| s.parse().ok()).unwrap_or(0.0)
}

/// `123 kB` in bytes.
fn kilobytes(text: &str) -> Option<u64> {
    text.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn this_process_holds_memory() {
        assert!(resident_bytes() > 1 << 16);
        assert!(peak_bytes() >= resident_bytes() / 2);
        assert_eq!(status_bytes("self", "Nothing:"), None);
        assert_eq!(status_bytes("0", "VmRSS:"), None);
        // Signal 13, a closed pipe, is ignored by all Rust programs; 9 cannot be ignored.
        assert!(ignores_signal(13) && !ignores_signal(9) && !ignores_signal(0));
        assert!(available_bytes().is_some_and(|bytes| bytes > 1 << 20));
        assert!(mapped_bytes(&std::env::current_exe().unwrap()).is_some_and(|bytes| bytes > 0));
    }

    #[test]
    fn fields_and_lines() {
        assert!(field("/proc/meminfo", "MemTotal").is_some_and(|value| value.ends_with("kB")));
        assert_eq!(field("/proc/absent", "x"), None);
        assert_eq!(line("/proc/absent"), "");
        assert!(load() >= 0.0);
        assert_eq!((kilobytes("  3 kB"), kilobytes("3 MB")), (Some(3072), None));
    }
}
