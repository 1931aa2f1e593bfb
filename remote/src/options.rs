//! Bounds of time and space.

use std::sync::Arc;
use std::time::Duration;

/// A function that is told the bytes that have been read so far, and the length of the file if all of it is read.
pub type OnBytes = Arc<dyn Fn(u64, Option<u64>) + Send + Sync>;

/// Bounds of a [`RemoteFile`](crate::RemoteFile).
#[derive(Clone)]
pub struct RemoteOptions {
    /// Most bytes of a temporary file, where all of a file is read.
    pub max_download: u64,
    /// How often a request is made until it succeeds, at least once.
    pub tries: u32,
    /// How long a server may be silent: to connect, to answer, between two pieces of a body.
    pub patience: Duration,
    /// Bytes in a second below which a body is too slow, after `patience`.
    pub slowest: u64,
    /// Requests at the same time.
    pub at_once: usize,
    /// Told how many bytes have been read.
    pub on_bytes: Option<OnBytes>,
}

impl Default for RemoteOptions {
    /// 4 GB of temporary file, four tries, 20 seconds of silence, 16 KiB in a second, eight requests at once.
    fn default() -> Self {
        Self {
            max_download: 4_000_000_000,
            tries: 4,
            patience: Duration::from_secs(20),
            slowest: 16 << 10,
            at_once: 8,
            on_bytes: None,
        }
    }
}

impl std::fmt::Debug for RemoteOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RemoteOptions")
            .field("max_download", &self.max_download)
            .field("tries", &self.tries)
            .field("patience", &self.patience)
            .field("slowest", &self.slowest)
            .field("at_once", &self.at_once)
            .finish_non_exhaustive()
    }
}

impl RemoteOptions {
    /// The longest that one request for so many bytes may take.
    pub(crate) fn deadline(&self, bytes: u64) -> Duration {
        self.patience.saturating_mul(2).saturating_add(Duration::from_secs(bytes / self.slowest.max(1)))
    }
}
