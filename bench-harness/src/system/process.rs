//! Child processes that end with this program at the latest.

use std::io;
use std::process::{Child, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::system::cpu_time::of_ended_children;
use crate::system::proc::status_bytes;
use crate::system::scratch::remove_temporaries;

/// The child processes that are running.
static RUNNING: Mutex<Vec<Child>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Child>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How a process ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Exit {
    pub(crate) status: ExitStatus,
    /// Processor time of the process, user and system; `None` if the system does not tell, or if this was asked before.
    pub(crate) cpu: Option<Duration>,
}

/// A child process. It is killed when this is dropped, or by [`interrupted`].
pub(crate) struct Process {
    id: u32,
}

impl Process {
    pub(crate) fn start(command: &mut Command) -> io::Result<Self> {
        let child = command.spawn()?;
        let id = child.id();
        running().push(child);
        Ok(Self { id })
    }

    /// How the process ended; `None` while it runs.
    pub(crate) fn ended(&self) -> io::Result<Option<Exit>> {
        // No other of these processes is waited for while this is locked, so that the difference is what this one took.
        let mut running = running();
        // `interrupted` may have removed it: this program is about to end.
        let Some(child) = running.iter_mut().find(|child| child.id() == self.id) else { return Ok(None) };
        let before = of_ended_children();
        let Some(status) = child.try_wait()? else { return Ok(None) };
        let cpu = of_ended_children().zip(before).map(|(after, before)| after.saturating_sub(before));
        Ok(Some(Exit { status, cpu: cpu.filter(|cpu| !cpu.is_zero()) }))
    }

    /// Bytes of anonymous memory that the process holds; mapped pages of files are not counted, as the system can drop them at
    /// any time. `None` if the system does not say.
    pub(crate) fn held_bytes(&self) -> Option<u64> {
        let id = self.id.to_string();
        status_bytes(&id, "RssAnon:").or_else(|| status_bytes(&id, "VmRSS:"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let mut running = running();
        if let Some(place) = running.iter().position(|child| child.id() == self.id) {
            end(running.swap_remove(place));
        }
    }
}

fn end(mut child: Child) {
    // `kill` fails if the process has ended already, which is fine.
    let _ = child.kill();
    let _ = child.wait();
}

/// Kills all child processes and removes the temporary folders of all runs. Call this when the program is interrupted.
pub fn interrupted() {
    running().drain(..).for_each(end);
    remove_temporaries();
}

#[cfg(all(test, unix))]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn a_process_is_watched_and_ends_with_its_owner() {
        let start = |seconds: &str| Process::start(Command::new("sleep").arg(seconds)).unwrap();
        let (short, long) = (start("0.01"), start("600"));
        let began = Instant::now();
        while short.ended().unwrap().is_none() && began.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(short.ended().unwrap().is_some_and(|exit| exit.status.success()));
        assert_eq!(long.ended().unwrap(), None);
        assert!(cfg!(not(target_os = "linux")) || long.held_bytes().is_some());
        let id = long.id;
        drop(long);
        // Asked again, it has no time of its own any more, nor that of the process that was killed meanwhile.
        assert_eq!(short.ended().unwrap().unwrap().cpu, None);
        assert!(running().iter().all(|child| child.id() != id));
        assert_eq!(status_bytes(&id.to_string(), "VmRSS:"), None);
    }

    #[test]
    fn the_processor_time_of_a_process_is_its_own() {
        let run = |program: &str, argument: &str| {
            let process = Process::start(Command::new(program).args(["-c", argument])).unwrap();
            loop {
                if let Some(exit) = process.ended().unwrap() {
                    break exit.cpu.unwrap_or_default();
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        let busy = run("sh", "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done");
        let idle = run("sh", "sleep 0.3");
        assert!(busy > Duration::from_millis(20) && idle < busy, "{busy:?} {idle:?}");
    }
}
