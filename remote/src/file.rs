//! A remote file as a source of byte ranges.

use std::fs::File;
use std::io::{Error, ErrorKind, Result as IoResult};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use esvo_format::RangeRead;
use futures_util::stream::{self, StreamExt};
use tokio::runtime::{Handle, Runtime};

use crate::address::{is_web, parse};
use crate::answer::{Answer, fill};
use crate::error::Failed;
use crate::http::Http;
use crate::store::Store;
use crate::temporary::Temporary;
use crate::{RemoteError, RemoteOptions};

/// Bytes of the first request: what the head of most files needs (section 4.5 of the specification).
const FRONT: u64 = 32 << 10;

/// Pause before the first repetition of a request; each later one is four times as long.
const PAUSE: Duration = Duration::from_millis(100);

/// Who is asked.
pub(crate) enum Place {
    Web(Http),
    Store(Store),
}

impl Place {
    pub(crate) async fn get(
        &self,
        range: &Range<u64>,
        tag: Option<&str>,
        options: &RemoteOptions,
    ) -> Result<Answer, Failed> {
        match self {
            Self::Web(http) => http.get(range, tag, options).await,
            Self::Store(store) => store.get(range, tag, options).await,
        }
    }
}

/// A file on a web server or in an object store, read by byte ranges. Each read is a request, but for the first 32 KiB, which come
/// when the file is opened.
pub struct RemoteFile {
    pub(crate) place: Place,
    pub(crate) options: RemoteOptions,
    pub(crate) length: u64,
    pub(crate) tag: Option<String>,
    /// The first bytes of the file.
    pub(crate) front: Vec<u8>,
    /// The whole file, if the server knows no ranges.
    pub(crate) whole: Option<Temporary>,
    pub(crate) counts: Counts,
    /// `None` while it is dropped.
    runtime: Option<Runtime>,
}

/// What has been read and asked for.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(crate) bytes: AtomicU64,
    pub(crate) requests: AtomicU64,
}

impl std::fmt::Debug for RemoteFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RemoteFile").field("length", &self.length).field("counts", &self.counts).finish_non_exhaustive()
    }
}

impl RemoteFile {
    /// Opens a file by its address: asks for its first 32 KiB, which tell its length and whether the server knows ranges.
    /// Of a server that does not, reads all.
    ///
    /// # Errors
    /// [`RemoteError`].
    pub fn open(address: &str, options: RemoteOptions) -> Result<Self, RemoteError> {
        let url = parse(address)?;
        let place = if is_web(&url) {
            Place::Web(Http::new(url, &options)?)
        } else {
            Place::Store(Store::new(&url, &options)?)
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| RemoteError::Address(format!("the system gives no sockets: {error}")))?;
        let (tag, front) = (None, Vec::new());
        let mut file = Self {
            place,
            options,
            length: 0,
            tag,
            front,
            whole: None,
            counts: Counts::default(),
            runtime: Some(runtime),
        };
        file.begin()?;
        Ok(file)
    }

    /// The first request.
    fn begin(&mut self) -> Result<(), RemoteError> {
        enum Begun {
            Front { length: u64, tag: Option<String>, front: Vec<u8> },
            Whole(Temporary, u64),
        }
        let begun = self.wait(self.again(async || {
            self.counts.requests.fetch_add(1, Ordering::Relaxed);
            match self.place.get(&(0..FRONT), None, &self.options).await? {
                Answer::Range { length, tag, body } => {
                    let mut front = vec![0; FRONT.min(length) as usize];
                    fill(body, &self.options, &mut front).await?;
                    self.count(front.len() as u64, None);
                    Ok(Begun::Front { length, tag, front })
                }
                Answer::Whole { length, body, .. } => {
                    let (file, length) = self.take_whole(length, body).await?;
                    Ok(Begun::Whole(file, length))
                }
            }
        }))??;
        match begun {
            Begun::Front { length, tag, front } => (self.length, self.tag, self.front) = (length, tag, front),
            Begun::Whole(file, length) => (self.length, self.whole) = (length, Some(file)),
        }
        Ok(())
    }

    /// Length of the file in bytes.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether the file has no bytes.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Bytes of answers that have been read so far, without headers and failed requests.
    pub fn bytes(&self) -> u64 {
        self.counts.bytes.load(Ordering::Relaxed)
    }

    /// Requests that have been made so far, repeated ones included; redirects are not counted.
    pub fn requests(&self) -> u64 {
        self.counts.requests.load(Ordering::Relaxed)
    }

    /// Whether all of it was read when it was opened, as the server knows no ranges.
    pub fn is_whole(&self) -> bool {
        self.whole.is_some()
    }

    /// Runs requests on this thread.
    pub(crate) fn wait<T>(&self, work: impl Future<Output = T>) -> Result<T, RemoteError> {
        if Handle::try_current().is_ok() {
            let what = "it was read on a thread of an asynchronous program; read it where blocking is allowed";
            return Err(RemoteError::Address(what.into()));
        }
        let runtime = self.runtime.as_ref().ok_or_else(|| RemoteError::Address("it is closed".into()))?;
        Ok(runtime.block_on(work))
    }

    /// Repeats a request until it succeeds, or fails for good.
    pub(crate) async fn again<T>(&self, request: impl AsyncFn() -> Result<T, Failed>) -> Result<T, RemoteError> {
        let tries = self.options.tries.max(1);
        let mut pause = PAUSE;
        for tried in 1.. {
            match request().await {
                Ok(found) => return Ok(found),
                Err(Failed::Never(error)) => return Err(error),
                Err(Failed::Again(what, _)) if tried >= tries => return Err(RemoteError::Unavailable { what, tries }),
                Err(Failed::Again(_, seconds)) => {
                    tokio::time::sleep(pause.max(Duration::from_secs(seconds))).await;
                    pause *= 4;
                }
            }
        }
        unreachable!("the last try returns")
    }

    /// Fills a buffer from an offset on, by one request or by several that fail before one succeeds.
    pub(crate) async fn range(&self, offset: u64, buf: &mut [u8]) -> Result<(), RemoteError> {
        let range = offset..offset + buf.len() as u64;
        let buf = tokio::sync::Mutex::new(buf);
        self.again(async || {
            self.counts.requests.fetch_add(1, Ordering::Relaxed);
            let replaced = |what: String| Failed::Never(RemoteError::Replaced(what));
            match self.place.get(&range, self.tag.as_deref(), &self.options).await? {
                Answer::Whole { tag, .. } if tag.is_some() && tag == self.tag => {
                    Err(Failed::answer("the server sends ranges at first and the whole file later"))
                }
                Answer::Whole { .. } => Err(replaced("it answers with a whole file".into())),
                Answer::Range { length, .. } if length != self.length => {
                    Err(replaced(format!("it had {} bytes, now {length}", self.length)))
                }
                Answer::Range { tag, .. } if tag.is_some() && self.tag.is_some() && tag != self.tag => {
                    Err(replaced("its entity tag has changed".into()))
                }
                Answer::Range { body, .. } => {
                    let mut buf = buf.lock().await;
                    fill(body, &self.options, &mut buf).await?;
                    self.count(buf.len() as u64, None);
                    Ok(())
                }
            }
        })
        .await
    }

    pub(crate) fn count(&self, bytes: u64, of: Option<u64>) {
        let all = self.counts.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if let Some(on_bytes) = &self.options.on_bytes {
            on_bytes(all, of);
        }
    }

    /// Copies what is there already: the front, or all of it. Returns how much was.
    fn copy(&self, offset: u64, buf: &mut [u8]) -> IoResult<usize> {
        if offset.checked_add(buf.len() as u64).is_none_or(|end| end > self.length) {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        if let Some(whole) = &self.whole {
            let file: &File = whole.file();
            return file.read_at(offset, buf).map(|()| buf.len());
        }
        let have = usize::try_from(offset).ok().and_then(|at| self.front.get(at..)).unwrap_or_default();
        let length = have.len().min(buf.len());
        buf[..length].copy_from_slice(&have[..length]);
        Ok(length)
    }
}

impl RangeRead for RemoteFile {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> IoResult<()> {
        let have = self.copy(offset, buf)?;
        if have < buf.len() {
            self.wait(self.range(offset + have as u64, &mut buf[have..]))??;
        }
        Ok(())
    }

    fn read_many(&self, reads: &mut [(u64, Vec<u8>)]) -> Result<(), (u64, Error)> {
        let mut missing = Vec::new();
        for (offset, buf) in reads {
            let have = self.copy(*offset, buf).map_err(|error| (*offset, error))?;
            if have < buf.len() {
                missing.push((*offset + have as u64, &mut buf[have..]));
            }
        }
        let first = missing.first().map_or(0, |read| read.0);
        let work = async {
            let requests = missing.into_iter().map(|(offset, buf)| async move {
                self.range(offset, buf).await.map_err(|error| (offset, Error::from(error)))
            });
            let mut answers = stream::iter(requests).buffer_unordered(self.options.at_once.max(1));
            while let Some(answer) = answers.next().await {
                answer?;
            }
            Ok(())
        };
        self.wait(work).map_err(|error| (first, error.into()))?
    }

    fn length(&self) -> IoResult<Option<u64>> {
        Ok(Some(self.length))
    }
}

impl Drop for RemoteFile {
    fn drop(&mut self) {
        // Waits for nothing, so that it may be dropped anywhere.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
