//! Calibration casts: how fast the machine is at the moments when something is timed.
//!
//! A frozen kernel (`kernel.rs`) casts a picture of a generated octree between the casts that are timed, on as many threads and in tasks
//! as a caster's. What else runs on the machine takes time from both alike, so that [`compare`](crate::compare) compares times divided by
//! those of the kernel. Processor times are kept beside both.

mod kernel;

use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::system::cpu_time;
pub use kernel::VERSION;
use kernel::{CHECKSUM, Kernel, RAYS, TASKS};

/// What the calibration casts of a record were.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct CalibrationRecord {
    /// [`VERSION`] of the kernel.
    pub version: u32,
    /// Threads that cast, as many as the CPU casters have.
    pub threads: usize,
    /// Rays of a cast.
    pub rays: u64,
    /// Checksum of the answers, 16 hexadecimal digits: that of the version, unless the kernel was changed.
    pub checksum: String,
}

/// What stands beside the times of a cell, round by round, so that it can be compared with another run's.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct GuardSamples {
    /// Processor time of all threads of this program during each frame, in seconds: `cpu_seconds[round][frame]`. Empty where the system
    /// does not tell. Unlike a frame's time, it does not count what other programs take, and it includes what the caster does before and
    /// after the part that is timed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cpu_seconds: Vec<Vec<f64>>,
    /// Calibration casts in seconds: in every round one before the first frame and one or more between and after frames.
    pub calibration_seconds: Vec<Vec<f64>>,
    /// Processor time of all threads during those casts, in seconds. Empty where the system does not tell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration_cpu_seconds: Vec<Vec<f64>>,
}

impl GuardSamples {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.calibration_seconds.is_empty()
    }

    /// Adds a round.
    pub(crate) fn push(&mut self, round: GuardRound) {
        self.calibration_seconds.push(round.calibration);
        if round.cpu.iter().chain(&round.calibration_cpu).all(Option::is_some) {
            self.cpu_seconds.push(round.cpu.into_iter().flatten().collect());
            self.calibration_cpu_seconds.push(round.calibration_cpu.into_iter().flatten().collect());
        }
    }
}

/// A round of [`GuardSamples`].
#[derive(Default)]
pub(crate) struct GuardRound {
    cpu: Vec<Option<f64>>,
    calibration: Vec<f64>,
    calibration_cpu: Vec<Option<f64>>,
}

impl GuardRound {
    /// Begins with a calibration cast.
    pub(crate) fn start(calibrator: &Calibrator) -> Self {
        let mut round = Self::default();
        round.calibrate(calibrator);
        round
    }

    /// Makes a calibration cast.
    pub(crate) fn calibrate(&mut self, calibrator: &Calibrator) {
        let (seconds, cpu) = with_cpu_time(|| calibrator.sample());
        self.calibration.push(seconds);
        self.calibration_cpu.push(cpu);
    }

    /// Does the work of a frame.
    pub(crate) fn frame<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let (done, cpu) = with_cpu_time(work);
        self.cpu.push(cpu);
        done
    }
}

/// Does some work, and measures the processor time of this program meanwhile.
pub(crate) fn with_cpu_time<T>(work: impl FnOnce() -> T) -> (T, Option<f64>) {
    let start = cpu_time::of_process();
    let done = work();
    let cpu = start.zip(cpu_time::of_process()).map(|(start, end)| end.saturating_sub(start).as_secs_f64());
    (done, cpu)
}

/// Takes calibration samples.
pub(crate) struct Calibrator {
    kernel: Kernel,
    pool: rayon::ThreadPool,
    checksum: u64,
}

impl Calibrator {
    /// Makes the octree and starts the threads; `None`: one per core, as the CPU caster does.
    ///
    /// # Errors
    /// The system starts no threads.
    pub(crate) fn new(threads: Option<usize>) -> Result<Self, BenchError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
        let pool = pool.map_err(|e| BenchError::scene("calibration", e))?;
        let mut calibrator = Self { kernel: Kernel::new(), pool, checksum: 0 };
        calibrator.checksum = calibrator.cast();
        debug_assert_eq!(calibrator.checksum, CHECKSUM);
        Ok(calibrator)
    }

    /// What is cast.
    pub(crate) fn record(&self) -> CalibrationRecord {
        CalibrationRecord {
            version: VERSION,
            threads: self.pool.current_num_threads(),
            rays: RAYS,
            checksum: format!("{:016x}", self.checksum),
        }
    }

    /// The threads that cast.
    pub(crate) fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// Casts once and returns the seconds that took.
    pub(crate) fn sample(&self) -> f64 {
        let start = Instant::now();
        std::hint::black_box(self.cast());
        start.elapsed().as_secs_f64()
    }

    fn cast(&self) -> u64 {
        let sums: Vec<u64> = self
            .pool
            .install(|| (0..TASKS).into_par_iter().with_max_len(1).map(|task| self.kernel.cast_task(task)).collect());
        sums.into_iter().fold(0, Kernel::fold)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_do_not_change_the_answers() {
        for threads in [1, 3] {
            let calibrator = Calibrator::new(Some(threads)).unwrap();
            assert_eq!(calibrator.record().threads, threads);
            assert_eq!(calibrator.checksum, CHECKSUM);
            let mut samples = GuardSamples::default();
            for _ in 0..2 {
                let mut round = GuardRound::start(&calibrator);
                assert_eq!(round.frame(|| 7), 7);
                round.calibrate(&calibrator);
                samples.push(round);
            }
            assert!(samples.calibration_seconds.iter().all(|round| round.len() == 2 && round.iter().all(|s| *s > 0.0)));
            if cfg!(unix) {
                assert!(samples.cpu_seconds.iter().all(|round| round.len() == 1));
                assert!(samples.calibration_cpu_seconds.iter().all(|round| round.len() == 2 && round[0] > 0.0));
            }
        }
    }
}
