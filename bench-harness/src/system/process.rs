//! Processes that do not outlive the program.

use std::io;
use std::process::{Child, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::system::clock::status_bytes;
use crate::system::scratch::remove_temporaries;

/// Those that are running.
static RUNNING: Mutex<Vec<Child>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Child>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A process that is killed when this is dropped, or by [`interrupted`].
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

    /// How it ended, if it has.
    pub(crate) fn ended(&self) -> io::Result<Option<ExitStatus>> {
        match running().iter_mut().find(|child| child.id() == self.id) {
            Some(child) => child.try_wait(),
            // The program is about to end, and this need not be told.
            None => Ok(None),
        }
    }

    /// Bytes that it holds for itself: pages of files can be had back at any time. `None` where the system does not say.
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
    // One that has ended cannot be killed, and need not be.
    let _ = child.kill();
    let _ = child.wait();
}

/// Ends the processes and removes the large files of all runs that are going on: for a program that is interrupted.
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
        assert!(short.ended().unwrap().is_some_and(|status| status.success()));
        assert_eq!(long.ended().unwrap(), None);
        assert!(cfg!(not(target_os = "linux")) || long.held_bytes().is_some());
        let id = long.id;
        drop(long);
        assert!(running().iter().all(|child| child.id() != id));
        assert_eq!(status_bytes(&id.to_string(), "VmRSS:"), None);
    }
}
