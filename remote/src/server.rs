//! A small web server on the loopback device, for tests and measurements: it serves byte ranges of a file as fast as it is told
//! to, or whatever a function answers.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Result, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use esvo_format::RangeRead;

/// Bytes that are written at once.
const PIECE: usize = 16 << 10;
/// Longest request that is read, in bytes.
const LONGEST_REQUEST: u64 = 16 << 10;

/// How fast answers come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pace {
    /// Time before each answer: as if the server were so far away.
    pub delay: Duration,
    /// Bytes of bodies in a second, over all connections; 0: as fast as it goes.
    pub bytes_per_second: u64,
}

/// A request.
#[derive(Clone, Debug)]
pub struct Request {
    /// Number of the request, from 0.
    pub number: u64,
    /// The path, with what follows a `?`.
    pub path: String,
    /// Headers, their names in lower-case letters.
    pub headers: Vec<(String, String)>,
}

impl Request {
    /// The value of a header, by its name in lower-case letters.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|header| header.0 == name).map(|header| &header.1[..])
    }

    /// Start and end of the range that is asked for.
    pub fn range(&self) -> Option<(u64, u64)> {
        let (first, last) = self.header("range")?.strip_prefix("bytes=")?.split_once('-')?;
        let (first, last) = (first.parse::<u64>().ok()?, last.parse::<u64>().ok()?);
        (first <= last).then(|| (first, last.saturating_add(1)))
    }
}

/// The body of an answer.
#[derive(Clone)]
pub enum Body {
    /// These bytes.
    Bytes(Vec<u8>),
    /// Bytes of a file: offset and length.
    Part(Arc<File>, u64, u64),
    /// Zeros without end.
    Endless,
    /// Nothing comes, and the connection stays open.
    Silence,
}

/// An answer. The headers say all there is to say: nothing is added but the end of the connection where `close` is set.
#[derive(Clone)]
pub struct Reply {
    /// Status and its name: `206 Partial Content`.
    pub status: String,
    /// Headers.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Body,
    /// Whether the connection ends after the body.
    pub close: bool,
}

impl Reply {
    /// An answer with a body of known length.
    pub fn new(status: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Self {
        let mut headers: Vec<_> = headers.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect();
        headers.push(("Content-Length".into(), body.len().to_string()));
        Self { status: status.into(), headers, body: Body::Bytes(body), close: false }
    }

    /// The answer of a server that knows ranges and entity tags to a request for a file.
    pub fn of_file(request: &Request, file: &Arc<File>, length: u64, tag: &str) -> Self {
        let old = request.header("if-range").is_some_and(|wanted| wanted != tag);
        let range = request.range().filter(|_| !old);
        let (status, start, end) = match range {
            Some((start, _)) if start >= length => {
                let range = format!("bytes */{length}");
                return Self::new("416 Range Not Satisfiable", &[("Content-Range", &range)], Vec::new());
            }
            Some((start, end)) => ("206 Partial Content", start, end.min(length)),
            None => ("200 OK", 0, length),
        };
        let mut headers = vec![
            ("Content-Length".into(), (end - start).to_string()),
            ("Accept-Ranges".into(), "bytes".into()),
            ("ETag".into(), tag.into()),
        ];
        if range.is_some() {
            headers.push(("Content-Range".into(), format!("bytes {start}-{}/{length}", end - 1)));
        }
        Self { status: status.into(), headers, body: Body::Part(file.clone(), start, end - start), close: false }
    }
}

type Answer = dyn Fn(&Request) -> Reply + Send + Sync;

/// What the threads of a server share.
struct Shared {
    answer: Box<Answer>,
    pace: Pace,
    stop: AtomicBool,
    requests: AtomicU64,
    bytes: AtomicU64,
    /// When the last byte that was promised to a connection will have left.
    line: Mutex<Instant>,
}

/// A server that answers until it is dropped.
pub struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
}

impl Server {
    /// Serves a file under every path, with ranges and an entity tag.
    ///
    /// # Errors
    /// The system's.
    pub fn of_file(file: File, pace: Pace) -> Result<Self> {
        let length = file.metadata()?.len();
        let file = Arc::new(file);
        Self::start(pace, move |request| Reply::of_file(request, &file, length, "\"1\""))
    }

    /// Serves what a function answers.
    ///
    /// # Errors
    /// The system's.
    pub fn start(pace: Pace, answer: impl Fn(&Request) -> Reply + Send + Sync + 'static) -> Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            answer: Box::new(answer),
            pace,
            stop: false.into(),
            requests: 0.into(),
            bytes: 0.into(),
            line: Mutex::new(Instant::now()),
        });
        let own = shared.clone();
        std::thread::Builder::new().name("web server".into()).spawn(move || {
            for stream in listener.incoming() {
                if own.stop.load(Ordering::Relaxed) {
                    return;
                }
                let Ok(stream) = stream else { continue };
                let shared = own.clone();
                // Connections that the system has no thread for are closed. One that ends early is no error of the server.
                let _ = std::thread::Builder::new().spawn(move || talk(&shared, stream));
            }
        })?;
        Ok(Self { shared, address })
    }

    /// The address of a file on the server.
    pub fn address(&self, path: &str) -> String {
        format!("http://{}/{path}", self.address)
    }

    /// Requests that were answered.
    pub fn requests(&self) -> u64 {
        self.shared.requests.load(Ordering::Relaxed)
    }

    /// Bytes of bodies that were sent.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        // Wakes the thread that waits for connections.
        let _ = TcpStream::connect(self.address);
    }
}

/// Answers the requests of a connection.
fn talk(shared: &Shared, stream: TcpStream) -> Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(Duration::from_millis(200)))?;
    let mut input = BufReader::new(stream.try_clone()?);
    let mut output = stream;
    while let Some(mut request) = hear(shared, &mut input)? {
        request.number = shared.requests.fetch_add(1, Ordering::Relaxed);
        let reply = (shared.answer)(&request);
        std::thread::sleep(shared.pace.delay);
        let mut head = format!("HTTP/1.1 {}\r\n", reply.status);
        for (name, value) in &reply.headers {
            head += &format!("{name}: {value}\r\n");
        }
        output.write_all((head + "\r\n").as_bytes())?;
        match reply.body {
            Body::Bytes(bytes) => bytes.chunks(PIECE).try_for_each(|piece| shared.send(&mut output, piece))?,
            Body::Part(file, mut offset, mut length) => {
                let mut piece = vec![0; PIECE];
                while length > 0 {
                    let piece = &mut piece[..length.min(PIECE as u64) as usize];
                    file.read_at(offset, piece)?;
                    shared.send(&mut output, piece)?;
                    (offset, length) = (offset + piece.len() as u64, length - piece.len() as u64);
                }
            }
            Body::Endless => {
                while !shared.stop.load(Ordering::Relaxed) {
                    shared.send(&mut output, &[0; PIECE])?;
                }
            }
            Body::Silence => {
                while !shared.stop.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(20));
                }
            }
        }
        if reply.close {
            break;
        }
    }
    Ok(())
}

/// The next request; `None` at the end of the connection or of the server.
fn hear(shared: &Shared, input: &mut BufReader<TcpStream>) -> Result<Option<Request>> {
    let mut text = String::new();
    while !text.ends_with("\r\n\r\n") {
        // What has been read of a line stays in `text` when the time is over.
        match input.by_ref().take(LONGEST_REQUEST).read_line(&mut text) {
            Ok(0) => return Ok(None),
            Ok(_) if text.len() as u64 > LONGEST_REQUEST => return Ok(None),
            Ok(_) => {}
            Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {
                if shared.stop.load(Ordering::Relaxed) {
                    return Ok(None);
                }
            }
            Err(error) => return Err(error),
        }
    }
    let mut lines = text.lines();
    let path = lines.next().and_then(|line| line.split(' ').nth(1)).unwrap_or("/").to_owned();
    let headers = lines.filter_map(|line| line.split_once(':'));
    let headers = headers.map(|(name, value)| (name.to_ascii_lowercase(), value.trim().to_owned())).collect();
    Ok(Some(Request { number: 0, path, headers }))
}

impl Shared {
    /// Sends bytes of a body when the line is free for them.
    fn send(&self, output: &mut TcpStream, piece: &[u8]) -> Result<()> {
        if self.pace.bytes_per_second > 0 {
            let time = Duration::from_secs_f64(piece.len() as f64 / self.pace.bytes_per_second as f64);
            let until = {
                let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
                *line = (*line).max(Instant::now()) + time;
                *line
            };
            std::thread::sleep(until.saturating_duration_since(Instant::now()));
        }
        output.write_all(piece)?;
        self.bytes.fetch_add(piece.len() as u64, Ordering::Relaxed);
        Ok(())
    }
}
