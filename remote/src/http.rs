//! Web servers: byte ranges over HTTP (RFC 9110, section 14).

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use futures_util::stream;
use reqwest::header::{
    ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_RANGE, ETAG, HeaderMap, HeaderName, IF_RANGE, RANGE,
    RETRY_AFTER,
};
use reqwest::redirect::Policy;
use reqwest::{Client, Response, StatusCode};
use url::Url;

use crate::answer::{Answer, Body, Piece};
use crate::error::{Failed, chain};
use crate::{RemoteError, RemoteOptions};

/// Most redirects of one request.
const REDIRECTS: usize = 5;
/// The longest that a server may tell to wait, in seconds.
const LONGEST_WAIT: u64 = 5;

pub(crate) struct Http {
    client: Client,
    address: Url,
    /// Where redirects led the last time: later requests begin there.
    place: Mutex<Url>,
}

impl Http {
    pub(crate) fn new(address: Url, options: &RemoteOptions) -> Result<Self, RemoteError> {
        // Whoever calls this library may have chosen another one.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let redirects = Policy::custom(|attempt| {
            let (previous, next) = (attempt.previous(), attempt.url());
            if previous.contains(next) {
                return attempt.error("it redirects to itself");
            }
            if previous.len() > REDIRECTS {
                return attempt.error(format!("it redirects more than {REDIRECTS} times"));
            }
            let secure = previous.last().is_some_and(|from| from.scheme() == "https");
            if secure && next.scheme() != "https" {
                return attempt.error("it redirects from https to an address that is not encrypted");
            }
            attempt.follow()
        });
        let client = Client::builder()
            .user_agent(concat!("esvo/", env!("CARGO_PKG_VERSION")))
            .redirect(redirects)
            .connect_timeout(options.patience)
            .http1_only()
            .build()
            .map_err(|error| RemoteError::Address(format!("cannot be asked for: {}", chain(&error))))?;
        Ok(Self { client, place: Mutex::new(address.clone()), address })
    }

    /// Asks for a range. With a strong entity tag, the server sends the whole file if it has another one.
    pub(crate) async fn get(
        &self,
        range: &Range<u64>,
        tag: Option<&str>,
        options: &RemoteOptions,
    ) -> Result<Answer, Failed> {
        let place = self.place.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let mut request = self.client.get(place.clone());
        request = request.header(RANGE, format!("bytes={}-{}", range.start, range.end - 1));
        // Ranges count bytes as they are stored.
        request = request.header(ACCEPT_ENCODING, "identity");
        if let Some(tag) = tag.filter(|tag| is_strong(tag)) {
            request = request.header(IF_RANGE, tag);
        }
        let sent = tokio::time::timeout(options.patience, request.send()).await;
        let response = match sent {
            Err(_) => {
                return Err(Failed::again(format!(
                    "the server did not answer for {} s",
                    options.patience.as_secs_f32()
                )));
            }
            Ok(Err(error)) if error.is_redirect() => {
                let what = chain(&error.without_url());
                return Err(RemoteError::Refused(format!("{what}; check the address")).into());
            }
            Ok(Err(error)) => return Err(Failed::again(chain(&error.without_url()))),
            Ok(Ok(response)) => response,
        };
        let moved = place != self.address;
        if moved && matches!(response.status().as_u16(), 401 | 403 | 404 | 410) {
            // Addresses that redirects lead to may be valid for minutes only.
            *self.place.lock().unwrap_or_else(PoisonError::into_inner) = self.address.clone();
            return Err(Failed::again(status_text(response.status())));
        }
        self.check(response, range)
    }

    /// Checks status and headers of an answer.
    fn check(&self, response: Response, range: &Range<u64>) -> Result<Answer, Failed> {
        let status = response.status();
        let text = status_text(status);
        match status.as_u16() {
            200 | 206 => {}
            404 | 410 => {
                return Err(RemoteError::Refused(format!("{text}: there is no such file; check the address")).into());
            }
            401 | 403 | 407 => return Err(RemoteError::Refused(format!(
                "{text}: the server wants to know who asks; give the address with user and password, or a signed one"
            ))
            .into()),
            416 if range.start == 0 => {
                return Err(RemoteError::Refused(format!("{text}: the file is empty; check the address")).into());
            }
            416 => return Err(RemoteError::Replaced(format!("it ends before byte {}", range.start)).into()),
            300..=399 => {
                let what = format!("{text}, to no address that can be followed; check the address");
                return Err(RemoteError::Refused(what).into());
            }
            408 | 425 | 429 | 500.. => {
                let seconds = header(response.headers(), RETRY_AFTER).and_then(|wait| wait.parse::<u64>().ok());
                return Err(Failed::Again(text, seconds.unwrap_or(0).min(LONGEST_WAIT)));
            }
            _ => {
                return Err(Failed::answer(format!(
                    "{text} is no answer to a request for bytes {}..{}",
                    range.start, range.end
                )));
            }
        }
        let headers = response.headers();
        if let Some(encoding) = header(headers, CONTENT_ENCODING).filter(|encoding| *encoding != "identity") {
            return Err(Failed::answer(format!("the answer is encoded ({encoding:.20}) although it must not be")));
        }
        let tag = header(headers, ETAG).filter(|tag| tag.len() <= 1024).map(str::to_owned);
        let announced = header(headers, CONTENT_LENGTH).and_then(|length| length.parse::<u64>().ok());
        let place = response.url().clone();
        if status == StatusCode::OK {
            *self.place.lock().unwrap_or_else(PoisonError::into_inner) = place;
            return Ok(Answer::Whole { length: announced, tag, body: body(response) });
        }
        let text = header(headers, CONTENT_RANGE).unwrap_or("none");
        let Some((got, length)) = parse_range(text) else {
            return Err(Failed::answer(format!(
                "the answer to a request for a range has the Content-Range {text:.60}"
            )));
        };
        let wanted = range.start..range.end.min(length);
        if got != wanted {
            return Err(Failed::answer(format!(
                "bytes {}..{} of {length} were sent, {}..{} were asked for",
                got.start, got.end, range.start, range.end
            )));
        }
        let expected = got.end - got.start;
        if let Some(announced) = announced.filter(|announced| *announced != expected) {
            return Err(Failed::answer(format!("the answer announces {announced} bytes for a range of {expected}")));
        }
        *self.place.lock().unwrap_or_else(PoisonError::into_inner) = place;
        Ok(Answer::Range { length, tag, body: body(response) })
    }
}

fn status_text(status: StatusCode) -> String {
    format!("the server answered {} {}", status.as_u16(), status.canonical_reason().unwrap_or("")).trim_end().to_owned()
}

/// Whether an entity tag changes with every byte of the file.
fn is_strong(tag: &str) -> bool {
    tag.len() >= 2 && tag.starts_with('"') && tag.ends_with('"')
}

fn header(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name)?.to_str().ok().map(str::trim)
}

/// Range and length of `bytes 0-99/1000`.
fn parse_range(text: &str) -> Option<(Range<u64>, u64)> {
    let (unit, rest) = text.split_once(' ')?;
    let (range, length) = rest.trim().split_once('/')?;
    let (first, last) = range.split_once('-')?;
    let number = |text: &str| text.bytes().all(|b| b.is_ascii_digit()).then(|| text.parse::<u64>().ok()).flatten();
    let (first, last, length) = (number(first)?, number(last)?, number(length)?);
    (unit.eq_ignore_ascii_case("bytes") && first <= last && last < length).then(|| (first..last + 1, length))
}

fn body(response: Response) -> Body {
    Box::pin(stream::unfold(Some(response), |response| async move {
        let mut response = response?;
        match response.chunk().await {
            Ok(Some(piece)) => Some((Ok(Box::new(piece) as Piece), Some(response))),
            Ok(None) => None,
            Err(error) => Some((Err(chain(&error.without_url())), None)),
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_ranges() {
        assert_eq!(parse_range("bytes 0-99/1000"), Some((0..100, 1000)));
        assert_eq!(parse_range("Bytes 999-999/1000"), Some((999..1000, 1000)));
        for bad in [
            "",
            "none",
            "bytes 0-99/*",
            "bytes */100",
            "bytes 5-4/10",
            "bytes 0-10/10",
            "items 0-1/9",
            "bytes -1-2/9",
            "bytes 0-99999999999999999999/9",
            "bytes +0-1/9",
        ] {
            assert_eq!(parse_range(bad), None, "{bad}");
        }
        assert!(is_strong("\"a\"") && !is_strong("W/\"a\"") && !is_strong("\""));
    }
}
