//! Why a command ends early, and output that survives a closed pipe.

use std::fmt::Display;
use std::io::{ErrorKind, Write};

/// Why a command ends early.
#[derive(Debug)]
pub(crate) enum Failure {
    /// An error in one line: where, what, what to do.
    Message(String),
    /// Standard output was closed.
    Pipe,
}

impl<T: Display> From<T> for Failure {
    fn from(error: T) -> Self {
        Self::Message(error.to_string())
    }
}

/// Writes to standard output.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Err(Failure::Pipe),
        Err(e) => Err(Failure::Message(format!("standard output: {e}"))),
        Ok(()) => Ok(()),
    }
}

/// Writes one line to standard error. Nothing can be done if that fails.
pub(crate) fn complain(kind: &str, message: &str) {
    // Messages of libraries may have several lines; errors of this program have one.
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = writeln!(std::io::stderr(), "{kind}: {line}");
}
