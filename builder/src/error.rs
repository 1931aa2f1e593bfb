//! What can go wrong in a build.

use std::path::{Path, PathBuf};

/// Why no octree was built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A setting out of its range.
    #[error("{name} is {value}: it must be {range}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// What it was.
        value: String,
        /// What it may be.
        range: &'static str,
    },
    /// The mesh has nothing to build from, or numbers that are not finite, or indices that lead nowhere.
    #[error("mesh: {0}")]
    Mesh(String),
    /// The format cannot hold the result.
    #[error(transparent)]
    Format(#[from] esvo_format::FormatError),
    /// A file or folder of the build.
    #[error("{}: {error}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// Another process is building the same file.
    #[error("{}: another process is building there; wait for it or choose another output", .0.display())]
    Busy(PathBuf),
    /// One thread alone would need more memory than it may have.
    #[error("a memory limit of {} MB is too small for this mesh: it needs at least {} MB", limit / 1_000_000, least.div_ceil(1_000_000))]
    Memory {
        /// The limit in bytes.
        limit: u64,
        /// What is needed, in bytes.
        least: u64,
    },
    /// No threads to build with.
    #[error("no threads: {0}")]
    Threads(String),
}

impl BuildError {
    pub(crate) fn io(path: &Path, error: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), error }
    }
}
