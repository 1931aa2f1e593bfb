//! Child processes that end with this program at the latest.

use std::io;
use std::process::{Child, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::system::proc::status_bytes;
use crate::system::scratch::remove_temporaries;

/// The child processes that are running.
static RUNNING: Mutex<Vec<Child>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Child>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
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

    /// The exit status; `None` while the process runs.
    pub(crate) fn ended(&self) -> io::Result<Option<ExitStatus>> {
        match running().iter_mut().find(|child| child.id() == self.id) {
            Some(child) => child.try_wait(),
            // `interrupted` has removed it: this program is about to end.
            None => Ok(None),
        }
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
        assert!(short.ended().unwrap().is_some_and(|status| status.success()));
        assert_eq!(long.ended().unwrap(), None);
        assert!(cfg!(not(target_os = "linux")) || long.held_bytes().is_some());
        let id = long.id;
        drop(long);
        assert!(running().iter().all(|child| child.id() != id));
        assert_eq!(status_bytes(&id.to_string(), "VmRSS:"), None);
    }
}
