//! Errors of this crate.

use std::path::PathBuf;

/// Why a file could not be opened, read or written.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// An error of the operating system.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The source of a [`StreamReader`](crate::StreamReader) failed.
    #[error("cannot read at byte {offset}: {source}")]
    Source {
        /// Offset in the file in bytes.
        offset: u64,
        /// The error of the source.
        source: std::io::Error,
    },
    /// The bytes break a rule of the specification.
    #[error(transparent)]
    Broken(#[from] Broken),
    /// A file of the paper's authors (`.oct`) is damaged, or contains something that this library does not support.
    #[error(".oct file, {place}: {what}")]
    Oct {
        /// The part of the file.
        place: String,
        /// What was found there.
        what: String,
    },
    /// A value out of range, something that the format cannot express, or a limit that was exceeded.
    #[error("{0}")]
    Limit(String),
}

/// A rule of the specification that the bytes break.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{what} (byte offset {offset}, rule {rule}: {})", rule_text(rule))]
pub struct Broken {
    /// Id of the rule, as in the specification.
    pub rule: &'static str,
    /// Offset in the file in bytes. Within a compressed block: offset in the image.
    pub offset: u64,
    /// What was found.
    pub what: String,
}

fn rule_text(id: &str) -> &'static str {
    esvo_spec::rule(id).map_or("", |rule| rule.text.trim_end_matches('.'))
}

impl Broken {
    /// A finding.
    pub fn new(rule: &'static str, offset: u64, what: impl Into<String>) -> Self {
        Self { rule, offset, what: what.into() }
    }
}

impl FormatError {
    pub(crate) fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}
