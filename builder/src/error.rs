//! Errors of a build.

use std::path::{Path, PathBuf};

/// Why a build failed.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A setting is out of its range.
    #[error("{name} is {value}: it must be {range}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: String,
        /// The range it must be in.
        range: &'static str,
    },
    /// The mesh has no surface, numbers that are not finite, or indices out of range.
    #[error("mesh: {0}")]
    Mesh(String),
    /// A list of cells is empty, not in order, out of range, or does not fit its attributes.
    #[error("cells: {0}")]
    Cells(String),
    /// The format cannot hold the result, or the file cannot be written.
    #[error(transparent)]
    Format(#[from] esvo_format::FormatError),
    /// A file or folder of the build cannot be read or written.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// Another process is building the same file.
    #[error("{}: another build uses this folder; wait until it ends or choose another output", .0.display())]
    Busy(PathBuf),
    /// What an earlier build left for `resume` is damaged.
    #[error("{}: {source}; remove this folder and start the build anew", folder.display())]
    Part {
        /// The folder of the parts.
        folder: PathBuf,
        /// The damage.
        source: esvo_format::FormatError,
    },
    /// The folder of a build that is to be continued holds the parts of another one.
    #[error(
        "{}: holds the finished parts of another build (another mesh, other settings or another version of esvo); continue that \
         build, choose another output, or remove this folder",
        .0.display()
    )]
    OtherWork(PathBuf),
    /// A file is no part of a build, or not one that fits the others.
    #[error("{}: {what}", path.display())]
    PartFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// Parts of a build are missing.
    #[error("{0}")]
    PartsMissing(String),
    /// The memory limit is too small for a build on one thread.
    #[error("a memory limit of {} MB is too small for this mesh: it needs at least {} MB", limit / 1_000_000, least.div_ceil(1_000_000))]
    Memory {
        /// The limit in bytes.
        limit: u64,
        /// What is needed, in bytes.
        least: u64,
    },
    /// The threads of the build cannot be started.
    #[error("cannot start the threads of the build: {0}")]
    Threads(String),
}

impl BuildError {
    pub(crate) fn io(path: &Path, error: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), error }
    }
}
