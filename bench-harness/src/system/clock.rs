//! How much time and memory is left.

use std::time::{Duration, Instant};

/// The time that a run may take.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
    limit: Option<Duration>,
}

impl Clock {
    /// Starts now; `limit` in seconds.
    pub fn start(limit: Option<f64>) -> Self {
        Self { start: Instant::now(), limit: limit.map(Duration::from_secs_f64) }
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Seconds until the limit; infinite without one, negative beyond it.
    pub fn left(&self) -> f64 {
        self.limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64() - self.elapsed())
    }

    /// The clock of one of `parts` parts that share what is left evenly.
    pub fn share(&self, parts: usize) -> Self {
        let left = self.left().max(0.0) / parts.max(1) as f64;
        Self::start(left.is_finite().then_some(left))
    }
}

/// Bytes that this process holds in memory, or 0 where the system does not say.
pub fn resident_bytes() -> u64 {
    status_bytes("self", "VmRSS:").unwrap_or(0)
}

/// A line of the system's account of a process (`self` or a number), in bytes; `None` where there is none.
pub fn status_bytes(process: &str, line: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let kilobytes: u64 =
        status.lines().find_map(|l| l.strip_prefix(line)?.trim().strip_suffix("kB")?.trim().parse().ok())?;
    Some(kilobytes * 1024)
}

/// What the next level is expected to take, from what the levels before it took: the last one times its growth over the
/// one before, or times `first_guess`. Growth is kept between 1.5 and 5: surfaces quadruple.
pub fn predict(before: &[f64], first_guess: f64) -> Option<f64> {
    let last = *before.last()?;
    let growth = match before {
        [.., a, b] if *a > 0.0 => (b / a).clamp(1.5, 5.0),
        _ => first_guess,
    };
    Some(last * growth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prediction() {
        assert_eq!(predict(&[], 4.0), None);
        assert_eq!(predict(&[2.0], 4.0), Some(8.0));
        assert_eq!(predict(&[1.0, 2.0, 6.0], 4.0), Some(18.0));
        assert_eq!(predict(&[1.0, 100.0], 4.0), Some(500.0));
    }

    #[test]
    fn shares_of_nothing_are_nothing() {
        assert!(Clock::start(None).share(3).left().is_infinite());
        assert!(Clock::start(Some(0.0)).share(3).left() <= 0.0);
        assert!(cfg!(not(target_os = "linux")) || resident_bytes() > 1 << 16);
    }
}
