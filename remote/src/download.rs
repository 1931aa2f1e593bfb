//! All of a remote file, in a temporary file.

use std::io::Write;

use crate::answer::{Body, read};
use crate::error::Failed;
use crate::temporary::Temporary;
use crate::{RemoteError, RemoteFile};
use esvo_format::RangeRead;

/// Bytes of one request.
const PIECE: u64 = 4 << 20;

impl RemoteFile {
    /// Reads all of the file to a temporary file, which is removed when it is dropped. Reads at most
    /// [`at_once`](crate::RemoteOptions::at_once) pieces of 4 MiB at the same time.
    ///
    /// # Errors
    /// [`RemoteError`].
    pub fn download(mut self) -> Result<Temporary, RemoteError> {
        if let Some(whole) = self.whole.take() {
            return Ok(whole);
        }
        self.check_size(self.length, "")?;
        let file = Temporary::new()?;
        let mut offset = 0;
        while offset < self.length {
            let mut reads = Vec::new();
            while offset < self.length && reads.len() < self.options.at_once.max(1) {
                let length = PIECE.min(self.length - offset);
                reads.push((offset, vec![0; length as usize]));
                offset += length;
            }
            self.read_many(&mut reads).map_err(|(_, error)| match error.downcast::<RemoteError>() {
                Ok(error) => error,
                Err(error) => RemoteError::Answer(error.to_string()),
            })?;
            for (_, piece) in reads {
                file.file().write_all(&piece).map_err(|error| temporary(&error))?;
            }
            self.count(0, Some(self.length));
        }
        file.file().flush().map_err(|error| temporary(&error))?;
        Ok(file)
    }

    /// Reads an answer that is the whole file. Returns the file and its length.
    pub(crate) async fn take_whole(&self, length: Option<u64>, body: Body) -> Result<(Temporary, u64), Failed> {
        const WHY: &str = ", and the server sends no ranges";
        if let Some(length) = length {
            self.check_size(length, WHY)?;
        }
        let file = Temporary::new()?;
        let mut bytes = 0u64;
        read(body, &self.options, |piece| {
            bytes += piece.len() as u64;
            self.check_size(bytes, WHY)?;
            file.file().write_all(piece).map_err(|error| temporary(&error))?;
            self.count(piece.len() as u64, length);
            Ok(())
        })
        .await?;
        if let Some(length) = length.filter(|length| *length != bytes) {
            return Err(Failed::again(format!("the answer has {bytes} of {length} bytes")));
        }
        file.file().flush().map_err(|error| temporary(&error))?;
        Ok((file, bytes))
    }

    fn check_size(&self, bytes: u64, why: &str) -> Result<(), RemoteError> {
        let limit = self.options.max_download;
        if bytes <= limit {
            return Ok(());
        }
        Err(RemoteError::TooLarge(format!(
            "all of it is needed{why}: {bytes} bytes or more, above the limit of {limit} for temporary files; raise the limit, or download it in another way"
        )))
    }
}

fn temporary(error: &std::io::Error) -> RemoteError {
    RemoteError::Temporary(error.to_string())
}
