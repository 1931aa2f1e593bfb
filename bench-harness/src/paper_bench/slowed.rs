//! Slowing an engine on purpose: the negative control of `esvo bench compare`.

use std::time::{Duration, Instant};

use esvo_engines::EngineId;
use serde::{Deserialize, Serialize};

use crate::calibration::with_cpu_time;
use crate::system::cpu_time;

/// An engine that is slowed on purpose, by `--slow ENGINE=PERCENT`.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Slowed {
    /// The engine.
    pub engine: EngineId,
    /// By how much its times are longer, in percent.
    pub percent: f64,
}

impl Slowed {
    /// What this engine is slowed by; 0: nothing.
    pub(crate) fn percent_of(slowed: &[Self], engine: EngineId) -> f64 {
        slowed.iter().find(|slowed| slowed.engine == engine).map_or(0.0, |slowed| slowed.percent)
    }

    /// Measures a frame, and lets every thread of `pool` work as long again as `percent` of the processor time that the frame took, as if
    /// the caster had more to do. What that really takes is part of the result: other programs disturb it, too. Where the system does
    /// not tell processor times, this thread works for `percent` of the frame's time.
    pub(crate) fn time<E>(
        percent: f64,
        pool: &rayon::ThreadPool,
        measure: impl FnOnce() -> Result<Duration, E>,
    ) -> Result<Duration, E> {
        let (taken, cpu) = with_cpu_time(measure);
        let taken = taken?;
        if percent <= 0.0 {
            return Ok(taken);
        }
        let start = Instant::now();
        match cpu {
            Some(cpu) => {
                let each = cpu * percent / 100.0 / pool.current_num_threads() as f64;
                pool.broadcast(|_| {
                    let start = cpu_time::of_thread().unwrap_or_default();
                    let worked = || cpu_time::of_thread().map_or(f64::INFINITY, |now| (now - start).as_secs_f64());
                    while worked() < each {
                        std::hint::spin_loop();
                    }
                });
            }
            None => {
                while start.elapsed().as_secs_f64() < taken.as_secs_f64() * percent / 100.0 {
                    std::hint::spin_loop();
                }
            }
        }
        Ok(taken + start.elapsed())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_named_engine_takes_longer() {
        let slowed = [Slowed { engine: EngineId::Cpu, percent: 10.0 }];
        assert_eq!(Slowed::percent_of(&slowed, EngineId::Ash), 0.0);
        let percent = Slowed::percent_of(&slowed, EngineId::Cpu);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let work = || {
            let start = cpu_time::of_thread();
            while cpu_time::of_thread().zip(start).is_some_and(|(now, start)| now - start < Duration::from_millis(20)) {
                std::hint::spin_loop();
            }
            Ok::<_, ()>(Duration::from_millis(20))
        };
        assert_eq!(Slowed::time(0.0, &pool, work), Ok(Duration::from_millis(20)));
        assert!(Slowed::time(percent, &pool, work).unwrap() >= Duration::from_millis(22));
        assert_eq!(Slowed::time(percent, &pool, || Err(1)), Err(1));
    }
}
