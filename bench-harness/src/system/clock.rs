//! The time limit of a run.

use std::time::{Duration, Instant};

/// The time that a run may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    start: Instant,
    limit: Option<Duration>,
}

impl Clock {
    /// Starts a clock now. `limit` is in seconds.
    pub(crate) fn start(limit: Option<f64>) -> Self {
        Self { start: Instant::now(), limit: limit.map(Duration::from_secs_f64) }
    }

    /// Seconds since the start.
    pub(crate) fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// Seconds until the limit: infinite without a limit, negative when it has passed.
    pub(crate) fn left(&self) -> f64 {
        self.limit.map_or(f64::INFINITY, |limit| limit.as_secs_f64() - self.elapsed())
    }

    /// A clock for one of `parts` parts that share the remaining time equally.
    pub(crate) fn share(&self, parts: usize) -> Self {
        let left = self.left().max(0.0) / parts.max(1) as f64;
        Self::start(left.is_finite().then_some(left))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_nothing_are_nothing() {
        assert!(Clock::start(None).share(3).left().is_infinite());
        assert!(Clock::start(Some(0.0)).share(3).left() <= 0.0);
    }
}
