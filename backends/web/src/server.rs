//! A server on loopback: the page, and one octree with ranges.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use tiny_http::{Header, Method, Request, Response, StatusCode};

use crate::{in_path, in_query, page};

/// Requests that are answered at a time: as many as browsers make, and some for a second window.
const THREADS: usize = 8;
/// What the page may do: run its own scripts and the decoder of Zstandard, and read octrees from anywhere.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; connect-src 'self' http: https: data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Shows an octree on this machine. Only programs on it can connect.
pub struct Server {
    http: tiny_http::Server,
    port: u16,
    file: Option<PathBuf>,
    query: String,
}

impl Server {
    /// Listens on a port of loopback; 0: any that is free. `file`: an octree on this machine, or an address that the browser reads itself.
    ///
    /// # Errors
    /// The file cannot be read, or the port is in use.
    pub fn new(file: Option<&str>, port: u16) -> Result<Self, String> {
        let (file, query) = match file {
            None => (None, String::new()),
            Some(address) if address.contains("://") => (None, format!("?file={}", in_query(address))),
            Some(path) => {
                let path = PathBuf::from(path);
                let told = |error| format!("{}: {error}", path.display());
                if !File::open(&path).and_then(|file| file.metadata()).map_err(told)?.is_file() {
                    return Err(format!("{}: it is no file", path.display()));
                }
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                (Some(path), format!("?file=/file/{}", in_query(&in_path(&name))))
            }
        };
        let http = tiny_http::Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(|error| {
            format!("port {port} of this machine cannot be used: {error}; choose another with --port")
        })?;
        let port = http.server_addr().to_ip().map_or(port, |address| address.port());
        Ok(Self { http, port, file, query })
    }

    /// The address to open.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}", self.port, self.query)
    }

    /// Answers requests until the program ends, or [`stop`](Self::stop) is called as often as it has threads.
    pub fn run(self: &Arc<Self>) {
        let threads: Vec<_> = (1..THREADS)
            .filter_map(|_| {
                let own = self.clone();
                std::thread::Builder::new().name("view".into()).spawn(move || own.work()).ok()
            })
            .collect();
        self.work();
        for thread in threads {
            let _ = thread.join();
        }
    }

    /// Ends [`run`](Self::run).
    pub fn stop(&self) {
        for _ in 0..THREADS {
            self.http.unblock();
        }
    }

    fn work(&self) {
        while let Ok(request) = self.http.recv() {
            // Whoever asked has gone away: there is nobody to tell.
            let _ = self.answer(request);
        }
    }

    fn answer(&self, request: Request) -> std::io::Result<()> {
        // A page of another site can make a browser send requests here by a name of its own that leads to this machine.
        let hosts = [format!("127.0.0.1:{}", self.port), format!("localhost:{}", self.port)];
        if !value(&request, "Host").is_some_and(|host| hosts.contains(&host)) {
            return say(request, 403, "this server answers to 127.0.0.1 and localhost only");
        }
        if !matches!(request.method(), Method::Get | Method::Head) {
            return say(request, 405, "only GET and HEAD");
        }
        let path = request.url().split(['?', '#']).next().unwrap_or_default().to_owned();
        if path.starts_with("/file/") {
            return match &self.file {
                Some(file) => serve_file(request, file),
                None => say(request, 404, "no file is shown"),
            };
        }
        let wanted = if path == "/" { "index.html" } else { &path[1.min(path.len())..] };
        match page().find(|file| file.path == wanted) {
            Some(file) => {
                let response = Response::from_data(file.bytes).with_header(header("Content-Type", file.media_type));
                respond(request, response)
            }
            None => say(request, 404, "the page has no such file"),
        }
    }
}

/// What a request asks for of a file.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Wanted {
    /// All of it.
    Whole,
    /// Bytes from the first number up to the second, without it.
    Range(u64, u64),
    /// Bytes that it does not have.
    Nothing,
}

/// Reads the header `Range` (RFC 9110, section 14) for a file of this length. Several ranges are answered with the whole, as the text allows.
fn wanted(range: Option<&str>, length: u64) -> Wanted {
    let Some((first, last)) =
        range.and_then(|range| range.trim().strip_prefix("bytes=")).and_then(|spec| spec.split_once('-'))
    else {
        return Wanted::Whole;
    };
    match (first.trim().parse::<u64>(), last.trim().parse::<u64>()) {
        (Ok(first), Ok(last)) if first <= last && first < length => {
            Wanted::Range(first, last.saturating_add(1).min(length))
        }
        (Ok(first), Err(_)) if last.trim().is_empty() && first < length => Wanted::Range(first, length),
        (Err(_), Ok(last)) if first.trim().is_empty() && last > 0 && length > 0 => {
            Wanted::Range(length.saturating_sub(last), length)
        }
        (Ok(first), Ok(last)) if first > last => Wanted::Whole,
        (Ok(_), Ok(_)) => Wanted::Nothing,
        (Ok(_), Err(_)) if last.trim().is_empty() => Wanted::Nothing,
        (Err(_), Ok(_)) if first.trim().is_empty() => Wanted::Nothing,
        _ => Wanted::Whole,
    }
}

/// Answers with a file, opened anew for each request.
fn serve_file(request: Request, path: &Path) -> std::io::Result<()> {
    let opened = File::open(path).and_then(|file| Ok((file.metadata()?, file)));
    let Ok((metadata, mut file)) = opened else {
        return say(request, 404, "the file is no longer there");
    };
    let length = metadata.len();
    let changed = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let tag = format!("\"{length:x}-{:x}\"", changed.unwrap_or_default().as_nanos());
    let is_same = value(&request, "If-Range").is_none_or(|wanted| wanted == tag);
    let range = if is_same { wanted(value(&request, "Range").as_deref(), length) } else { Wanted::Whole };
    let (first, end, status) = match range {
        Wanted::Whole => (0, length, 200),
        Wanted::Range(first, end) => (first, end, 206),
        Wanted::Nothing => {
            let response = Response::from_string("the file does not have these bytes").with_status_code(416);
            return respond(request, response.with_header(header("Content-Range", &format!("bytes */{length}"))));
        }
    };
    file.seek(SeekFrom::Start(first))?;
    let mut headers = vec![
        header("Content-Type", "application/octet-stream"),
        header("Accept-Ranges", "bytes"),
        header("ETag", &tag),
        header("Cache-Control", "no-store"),
    ];
    if status == 206 {
        headers.push(header("Content-Range", &format!("bytes {first}-{}/{length}", end - 1)));
    }
    let body = file.take(end - first);
    let size = usize::try_from(end - first).ok();
    let response = Response::new(StatusCode(status), headers, body, size, None).with_chunked_threshold(usize::MAX);
    respond(request, response)
}

/// The value of a header of a request.
fn value(request: &Request, name: &'static str) -> Option<String> {
    request.headers().iter().find(|header| header.field.equiv(name)).map(|header| header.value.as_str().to_owned())
}

fn header(name: &str, value: &str) -> Header {
    // Names and values are ASCII without line ends: constants of this file, numbers, and tags that it makes.
    Header::from_bytes(name, value).unwrap_or_else(|()| unreachable!("{name}: {value} is a header"))
}

fn say(request: Request, status: u16, text: &str) -> std::io::Result<()> {
    respond(request, Response::from_string(text).with_status_code(status))
}

fn respond<R: Read>(request: Request, response: Response<R>) -> std::io::Result<()> {
    let response = response
        .with_header(header("Content-Security-Policy", POLICY))
        .with_header(header("X-Content-Type-Options", "nosniff"))
        .with_header(header("Cross-Origin-Resource-Policy", "same-origin"))
        .with_header(header("Referrer-Policy", "no-referrer"));
    request.respond(response)
}

#[cfg(test)]
mod tests {
    use super::Wanted::{Nothing, Range, Whole};
    use super::*;

    #[test]
    fn ranges_are_read_as_the_protocol_says() {
        for (text, expected) in [
            ("bytes=0-99", Range(0, 100)),
            ("bytes=90-", Range(90, 1000)),
            ("bytes=-10", Range(990, 1000)),
            ("bytes=-5000", Range(0, 1000)),
            ("bytes=900-5000", Range(900, 1000)),
            ("bytes=0-18446744073709551615", Range(0, 1000)),
            ("bytes=999-999", Range(999, 1000)),
            ("bytes=1000-1001", Nothing),
            ("bytes=1000-", Nothing),
            ("bytes=-0", Nothing),
            ("bytes=5-4", Whole),
            ("bytes=0-1,5-6", Whole),
            ("bytes=a-b", Whole),
            ("lines=0-1", Whole),
            ("", Whole),
        ] {
            assert_eq!(wanted(Some(text), 1000), expected, "{text}");
        }
        assert_eq!((wanted(None, 5), wanted(Some("bytes=0-0"), 0)), (Whole, Nothing));
    }
}
