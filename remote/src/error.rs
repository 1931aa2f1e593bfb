//! Why a remote file cannot be read.

/// Why a remote file cannot be read: what happened, where, and what to do. Does not name the file: callers know its address, see
/// [`shown`](crate::shown).
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RemoteError {
    /// An address that this crate cannot use.
    #[error("{0}")]
    Address(String),
    /// There is no such file, or no permission to read it.
    #[error("{0}")]
    Refused(String),
    /// The server cannot be reached, answers too slowly or with errors, after all tries.
    #[error("{what}, {tries} times; try again later, or check the address and the network")]
    Unavailable {
        /// What happened the last time.
        what: String,
        /// How often it was tried.
        tries: u32,
    },
    /// An answer that breaks the protocol or is not what was asked for.
    #[error("{0}; the server or something before it is broken: download the file in another way")]
    Answer(String),
    /// The file was replaced between two requests.
    #[error("the file was replaced on the server while it was read ({0}); run it again")]
    Replaced(String),
    /// The whole file is needed, and is above the limit.
    #[error("{0}")]
    TooLarge(String),
    /// The temporary file cannot be written.
    #[error("temporary file: {0}")]
    Temporary(String),
}

/// Why a request failed, and whether another one may succeed.
#[derive(Debug)]
pub(crate) enum Failed {
    /// Again after at least so many seconds.
    Again(String, u64),
    Never(RemoteError),
}

impl Failed {
    pub(crate) fn again(what: impl Into<String>) -> Self {
        Self::Again(what.into(), 0)
    }

    pub(crate) fn answer(what: impl Into<String>) -> Self {
        Self::Never(RemoteError::Answer(what.into()))
    }
}

impl From<RemoteError> for Failed {
    fn from(error: RemoteError) -> Self {
        Self::Never(error)
    }
}

impl From<RemoteError> for std::io::Error {
    fn from(error: RemoteError) -> Self {
        Self::other(error)
    }
}

/// An error of a library and its causes in one line. Addresses are left out: they may contain passwords.
pub(crate) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let more = cause.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        source = cause.source();
    }
    text
}
