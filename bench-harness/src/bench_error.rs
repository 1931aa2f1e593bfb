//! The errors of this crate.

use std::path::{Path, PathBuf};

use esvo_core::CastError;
use esvo_engines::{EngineId, OpenError};
use esvo_format::FormatError;

/// Why a benchmark failed. Each message is one line: where, what, what to do.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// An error of the operating system.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A matrix that cannot be read or has values out of range.
    #[error("{file}: {what}")]
    Matrix {
        /// The file as given.
        file: String,
        /// What is wrong with it.
        what: String,
    },
    /// A scene that does not exist or cannot be measured.
    #[error("scene {scene}: {what}")]
    Scene {
        /// Its name as given.
        scene: String,
        /// What is wrong.
        what: String,
    },
    /// An option that cannot be used as it is given.
    #[error("{option}: {what}")]
    Option {
        /// Its name, with its value where that helps.
        option: String,
        /// What is wrong.
        what: String,
    },
    /// An octree or a setting that cannot be used.
    #[error(transparent)]
    Format(FormatError),
    /// The octree in a file cannot be used.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// An engine failed while it cast.
    #[error("engine {engine}: {source}")]
    Cast {
        /// The engine.
        engine: EngineId,
        /// What it said.
        source: CastError,
    },
    /// An engine could not be opened: this program was built without it, or it found no device.
    #[error(transparent)]
    Open(OpenError),
}

impl BenchError {
    /// An [`Io`](Self::Io) error at `path`.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }

    /// A [`File`](Self::File) error at `path`; an [`Io`](Self::Io) error if `source` is one.
    pub fn file(path: &Path, source: FormatError) -> Self {
        match source {
            // The system's errors name the file themselves.
            FormatError::Io { path, source } => Self::Io { path, source },
            source => Self::File { path: path.to_owned(), source },
        }
    }

    /// An [`Option`](Self::Option) error.
    pub fn option(option: impl Into<String>, what: impl ToString) -> Self {
        Self::Option { option: option.into(), what: what.to_string() }
    }

    /// A [`Scene`](Self::Scene) error.
    pub fn scene(scene: &str, what: impl ToString) -> Self {
        Self::Scene { scene: scene.into(), what: what.to_string() }
    }
}
