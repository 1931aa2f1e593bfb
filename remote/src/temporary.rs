//! Temporary files, which a program that is interrupted can remove.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use crate::RemoteError;

/// Those that exist.
static FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// A temporary file, removed when this is dropped or by [`remove_temporaries`].
#[derive(Debug)]
pub struct Temporary(NamedTempFile);

impl Temporary {
    pub(crate) fn new() -> Result<Self, RemoteError> {
        let file = tempfile::Builder::new().prefix("esvo-").tempfile();
        let file = file.map_err(|error| RemoteError::Temporary(error.to_string()))?;
        FILES.lock().unwrap_or_else(PoisonError::into_inner).push(file.path().to_owned());
        Ok(Self(file))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// The file, opened for reading and writing.
    pub fn file(&self) -> &File {
        self.0.as_file()
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        FILES.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| path != self.0.path());
    }
}

/// Removes all temporary files of this crate: for a program that was asked to stop and will exit.
pub fn remove_temporaries() {
    for path in FILES.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // The program is about to end: an error cannot be reported any more.
        let _ = std::fs::remove_file(path);
    }
}
