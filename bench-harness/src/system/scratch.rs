//! Temporary folders for large files.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::TempDir;

use crate::BenchError;

/// The folders that exist.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn folders() -> MutexGuard<'static, Vec<PathBuf>> {
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A folder in the system's temporary folder. It is removed when this is dropped, or by [`remove_temporaries`].
pub(crate) struct Scratch(TempDir);

impl Scratch {
    pub(crate) fn new() -> Result<Self, BenchError> {
        let folder = tempfile::Builder::new().prefix("esvo-bench-").tempdir();
        let folder = folder.map_err(|e| BenchError::io(&std::env::temp_dir(), e))?;
        folders().push(folder.path().into());
        Ok(Self(folder))
    }

    /// The path of a file in the folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        folders().retain(|path| path != self.0.path());
    }
}

/// Removes the folders of all runs.
pub(crate) fn remove_temporaries() {
    for folder in folders().drain(..) {
        // The program is about to end: an error cannot be reported any more.
        let _ = std::fs::remove_dir_all(folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_go_with_their_run_and_no_other() {
        let (first, second) = (Scratch::new().unwrap(), Scratch::new().unwrap());
        let files = [first.file("a"), second.file("a")];
        files.iter().for_each(|f| std::fs::write(f, "large").unwrap());
        drop(first);
        assert_eq!(files.each_ref().map(|f| f.exists()), [false, true]);
        drop(second);
        assert!(files.iter().all(|f| !f.parent().unwrap().exists()));
    }
}
