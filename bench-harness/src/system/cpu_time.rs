//! Processor time: what threads really ran, without what other programs took.

use std::time::Duration;

/// Processor time of all threads of this process so far; `None` if the system does not tell.
pub(crate) fn of_process() -> Option<Duration> {
    #[cfg(unix)]
    return clock(libc::CLOCK_PROCESS_CPUTIME_ID);
    #[cfg(not(unix))]
    None
}

/// Processor time of this thread so far; `None` if the system does not tell.
pub(crate) fn of_thread() -> Option<Duration> {
    #[cfg(unix)]
    return clock(libc::CLOCK_THREAD_CPUTIME_ID);
    #[cfg(not(unix))]
    None
}

#[cfg(unix)]
fn clock(clock: libc::clockid_t) -> Option<Duration> {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // The files of /proc have steps of 10 ms, half of what a frame takes, and the standard library has no such clock.
    // SAFETY: `time` is a valid timespec that lives until the call returns, and the call writes nothing else.
    let failed = unsafe { libc::clock_gettime(clock, &raw mut time) } != 0;
    (!failed).then(|| Duration::new(time.tv_sec as u64, time.tv_nsec as u32))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_takes_processor_time_and_sleep_does_not() {
        let start = of_thread().unwrap();
        while of_thread().unwrap() - start < Duration::from_millis(5) {
            std::hint::spin_loop();
        }
        assert!(of_process().unwrap() >= Duration::from_millis(5));
        let start = of_thread().unwrap();
        std::thread::sleep(Duration::from_millis(20));
        assert!(of_thread().unwrap() - start < Duration::from_millis(15));
    }
}
