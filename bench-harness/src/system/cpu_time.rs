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

/// Processor time of all processes that this one started, that have ended and that were waited for: user and system, theirs and that of
/// their own children. `None` if the system does not tell.
pub(crate) fn of_ended_children() -> Option<Duration> {
    #[cfg(unix)]
    return usage_of_children();
    #[cfg(not(unix))]
    None
}

#[cfg(unix)]
fn usage_of_children() -> Option<Duration> {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::uninit();
    // The standard library waits for children without asking what they took.
    // SAFETY: `usage` is large enough for an rusage and lives until the call returns, and the call writes nothing else.
    let failed = unsafe { libc::getrusage(libc::RUSAGE_CHILDREN, usage.as_mut_ptr()) } != 0;
    if failed {
        return None;
    }
    // SAFETY: a call that does not fail fills in all of it, and all bits are valid in an rusage of integers.
    let usage = unsafe { usage.assume_init() };
    let of = |time: libc::timeval| Duration::new(time.tv_sec as u64, time.tv_usec as u32 * 1000);
    Some(of(usage.ru_utime) + of(usage.ru_stime))
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
