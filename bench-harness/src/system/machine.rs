//! The machine and the software that a run used.

use std::path::Path;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::system::proc;

/// The machine and the software of a run. Unknown values are `unknown` or 0.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Machine {
    /// Processor model.
    pub cpu: String,
    /// Hardware threads that this process may use.
    pub threads: usize,
    /// Memory in MiB.
    pub memory_mb: u64,
    /// Operating system and kernel.
    pub os: String,
    /// Version of the compiler that built this program.
    pub rustc: String,
    /// `debug` or `release`.
    pub profile: String,
    /// Git commit of the source, `-dirty` appended if there were changes.
    pub commit: String,
    /// Start of the run, UTC, `YYYY-MM-DDThh:mm:ssZ`.
    pub date: String,
}

impl Machine {
    /// Detects the machine and the software.
    pub fn detect() -> Self {
        let unknown = || "unknown".to_string();
        let memory = proc::field("/proc/meminfo", "MemTotal").and_then(|s| s.split(' ').next()?.parse::<u64>().ok());
        let os = proc::field("/etc/os-release", "PRETTY_NAME").unwrap_or_else(|| std::env::consts::OS.into());
        let kernel = proc::line("/proc/sys/kernel/osrelease");
        Self {
            cpu: esvo_cpu::cpu_name(),
            threads: std::thread::available_parallelism().map_or(1, Into::into),
            memory_mb: memory.unwrap_or(0) / 1024,
            os: format!("{os} {}", kernel).trim().to_string(),
            rustc: option_env!("ESVO_RUSTC_VERSION").unwrap_or("unknown").into(),
            profile: if cfg!(debug_assertions) { "debug" } else { "release" }.into(),
            commit: commit().unwrap_or_else(unknown),
            date: utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
        }
    }

    /// Name of the machine's folder: the processor and its threads in lower-case letters, digits and hyphens.
    pub fn slug(&self) -> String {
        slug(&format!("{} {} threads", self.cpu, self.threads))
    }

    /// `YYYY-MM-DD` of the run.
    pub fn day(&self) -> &str {
        self.date.split('T').next().unwrap_or(&self.date)
    }
}

/// The text in lower-case letters and digits; every run of other characters becomes one hyphen. Safe as a folder name.
pub fn slug(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.is_empty() && !out.ends_with('-') {
            out.push('-');
        }
    }
    match out.trim_end_matches('-') {
        "" => "unknown".into(),
        name => name.into(),
    }
}

/// Commit of the checkout that this crate was built from; `None` if that folder is no git checkout any more.
fn commit() -> Option<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let git = |arguments: &[&str]| {
        let out = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok()?;
        out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_string())
    };
    let hash = git(&["rev-parse", "--short=12", "HEAD"])?;
    let dirty = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|s| !s.is_empty());
    Some(if dirty { hash + "-dirty" } else { hash })
}

/// Seconds since 1970 as `YYYY-MM-DDThh:mm:ssZ`.
fn utc(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Count years from March, so that the leap day is the last of its year and months have a simple length pattern.
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_795_391_999), "2026-11-22T23:59:59Z");
        assert_eq!(utc(4_107_542_400), "2100-03-01T00:00:00Z");
    }

    #[test]
    fn slugs_are_safe_folder_names() {
        assert_eq!(slug("AMD EPYC 9B45 (2) / x"), "amd-epyc-9b45-2-x");
        assert_eq!(slug("../.."), "unknown");
        assert_eq!(Machine::detect().day().len(), 10);
    }
}
