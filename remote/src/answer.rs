//! What a server answered, before its body is read: the same for web servers and object stores.

use std::pin::Pin;
use std::time::Instant;

use futures_util::stream::{Stream, StreamExt};

use crate::RemoteOptions;
use crate::error::Failed;

/// Pieces of a body. An error of the connection: another request may succeed.
pub(crate) type Body = Pin<Box<dyn Stream<Item = Result<Piece, String>> + Send>>;

/// A piece of a body.
pub(crate) type Piece = Box<dyn AsRef<[u8]> + Send>;

/// An answer.
pub(crate) enum Answer {
    /// The range that was asked for, or its front where the file ends, of a file of `length` bytes.
    Range { length: u64, tag: Option<String>, body: Body },
    /// The whole file, from a server that knows no ranges or sees that the file was replaced.
    Whole { length: Option<u64>, tag: Option<String>, body: Body },
}

/// Reads a body piece by piece, within the time of the options. `take` is told each piece and may refuse it.
pub(crate) async fn read(
    mut body: Body,
    options: &RemoteOptions,
    mut take: impl FnMut(&[u8]) -> Result<(), Failed>,
) -> Result<(), Failed> {
    let start = Instant::now();
    let mut bytes = 0u64;
    loop {
        let piece = match tokio::time::timeout(options.patience, body.next()).await {
            Err(_) => {
                return Err(Failed::again(format!(
                    "no byte of the answer came for {} s",
                    options.patience.as_secs_f32()
                )));
            }
            Ok(None) => return Ok(()),
            Ok(Some(Err(what))) => return Err(Failed::again(format!("the answer broke off: {what}"))),
            Ok(Some(Ok(piece))) => piece,
        };
        let piece = (*piece).as_ref();
        bytes += piece.len() as u64;
        take(piece)?;
        if start.elapsed() > options.deadline(bytes) {
            return Err(Failed::again(format!("the answer is slower than {} bytes/s", options.slowest)));
        }
    }
}

/// Reads the body of a range of exactly `buf`.
pub(crate) async fn fill(body: Body, options: &RemoteOptions, buf: &mut [u8]) -> Result<(), Failed> {
    let mut filled = 0;
    let wanted = buf.len();
    read(body, options, |piece| {
        let Some(place) = buf.get_mut(filled..filled + piece.len()) else {
            return Err(Failed::answer(format!("the answer has more than the {wanted} bytes that were asked for")));
        };
        place.copy_from_slice(piece);
        filled += piece.len();
        Ok(())
    })
    .await?;
    if filled < wanted {
        return Err(Failed::again(format!("the answer has {filled} of {wanted} bytes")));
    }
    Ok(())
}
