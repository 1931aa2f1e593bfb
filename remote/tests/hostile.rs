//! Web servers that are broken or mean harm: each gives an error that says so, soon, and little is read.

mod common;

use std::fs::File;
use std::sync::Arc;
use std::time::{Duration, Instant};

use common::{bytes, octree, options, stored};
use esvo_format::{FormatError, IndexReader, Region};
use esvo_remote::server::{Body, Pace, Reply, Request, Server};
use esvo_remote::{RemoteFile, RemoteOptions};

/// Opens a file and reads all of it as an octree.
fn read(server: &Server, options: RemoteOptions) -> Result<(), FormatError> {
    let file = RemoteFile::open(&server.address("a.esvo"), options);
    let file = file.map_err(|error| FormatError::Source { offset: 0, source: error.into() })?;
    IndexReader::open(&file)?.octree(0, &Region::ALL, 23).map(drop)
}

/// How a server answers a request, beside the right answer.
type Change = fn(&Request, Reply) -> Reply;

fn set(mut reply: Reply, name: &str, value: &str) -> Reply {
    reply.headers.retain(|header| !header.0.eq_ignore_ascii_case(name));
    if !value.is_empty() {
        reply.headers.push((name.into(), value.into()));
    }
    reply
}

fn redirect(place: &str) -> Reply {
    Reply::new("302 Found", &[("Location", place)], Vec::new())
}

/// What is wrong, what the error says, and how the server answers.
const CASES: [(&str, &str, Change); 24] = [
    ("less than announced", "of the range|broke off|2 times", |_, reply| Reply {
        body: Body::Bytes(vec![0; 100]),
        close: true,
        ..reply
    }),
    ("less without a length", "has 100 of 32768 bytes, 2 times", |_, reply| Reply {
        body: Body::Bytes(vec![0; 100]),
        close: true,
        ..set(reply, "Content-Length", "")
    }),
    ("another length announced", "announces 5 bytes for a range of", |_, reply| set(reply, "Content-Length", "5")),
    ("more than the range", "more than the 32768 bytes", |_, reply| Reply {
        body: Body::Bytes(vec![0; 40_000]),
        close: true,
        ..set(reply, "Content-Length", "")
    }),
    ("a body without end", "more than the 32768 bytes", |_, reply| Reply {
        body: Body::Endless,
        ..set(reply, "Content-Length", "")
    }),
    ("silence after the headers", "no byte of the answer came for 0.4 s, 2 times", |_, reply| Reply {
        body: Body::Silence,
        ..reply
    }),
    ("another range", "bytes 8..32776 of", |_, reply| set(reply, "Content-Range", "bytes 8-32775/99999")),
    ("a shorter range", "were asked for", |_, reply| set(reply, "Content-Range", "bytes 0-99/99999")),
    ("no Content-Range", "has the Content-Range none", |_, reply| set(reply, "Content-Range", "")),
    ("no length of the file", "has the Content-Range bytes 0-32767/*", |_, reply| {
        set(reply, "Content-Range", "bytes 0-32767/*")
    }),
    ("an encoded answer", "encoded (gzip)", |_, reply| set(reply, "Content-Encoding", "gzip")),
    ("a redirect to itself", "redirects to itself", |request, _| redirect(&request.path)),
    ("redirects without end", "redirects more than 5 times", |request, _| redirect(&format!("/{}", request.number))),
    ("a redirect to a file", "to no address that can be followed", |_, _| redirect("file:///etc/hostname")),
    ("no such file", "404 Not Found: there is no such file", |_, _| Reply::new("404 Not Found", &[], Vec::new())),
    ("no permission", "403 Forbidden: the server wants to know who asks", |_, _| {
        Reply::new("403 Forbidden", &[], Vec::new())
    }),
    ("an empty file", "the file is empty", |_, _| {
        Reply::new("416 Range Not Satisfiable", &[("Content-Range", "bytes */0")], Vec::new())
    }),
    ("errors without end", "500 Internal Server Error, 2 times", |_, _| {
        Reply::new("500 Internal Server Error", &[], Vec::new())
    }),
    ("nonsense", "2 times", |_, reply| Reply { status: "nonsense".into(), ..reply }),
    ("another status", "204 No Content is no answer", |_, _| Reply::new("204 No Content", &[], Vec::new())),
    ("replaced, with If-Range", "was replaced on the server", |request, reply| match request.number {
        0 => reply,
        // The tag that the client has is that of the first answer.
        _ if request.header("if-range") == Some("\"1\"") => {
            Reply::new("200 OK", &[("ETag", "\"2\"")], vec![0; 200_000])
        }
        _ => reply,
    }),
    ("replaced, another tag", "its entity tag has changed", |request, reply| match request.number {
        0 => reply,
        _ => set(reply, "ETag", "\"2\""),
    }),
    ("replaced, another length", "was replaced on the server while it was read (it had", |request, reply| {
        match (request.number, request.range()) {
            (0, _) | (_, None) => reply,
            (_, Some((start, end))) => set(reply, "Content-Range", &format!("bytes {start}-{}/99999999", end - 1)),
        }
    }),
    ("ranges at first, then none", "sends ranges at first and the whole file later", |request, reply| {
        match request.number {
            0 => reply,
            _ => Reply::new("200 OK", &[("ETag", "\"1\"")], vec![0; 200_000]),
        }
    }),
];

fn serve(file: &Arc<File>, length: u64, change: Change) -> Server {
    let file = file.clone();
    let answer = move |request: &Request| change(request, Reply::of_file(request, &file, length, "\"1\""));
    Server::start(Pace::default(), answer).unwrap()
}

#[test]
fn each_gives_an_error_that_says_what_is_wrong() {
    let bytes = bytes(&octree(), true);
    let (file, length) = (Arc::new(stored(&bytes)), bytes.len() as u64);
    // The negative control: without a change, all is well.
    read(&serve(&file, length, |_, reply| reply), options()).unwrap();
    let started = Instant::now();
    std::thread::scope(|scope| {
        for (name, words, change) in CASES {
            let file = &file;
            scope.spawn(move || {
                let server = serve(file, length, change);
                let error = read(&server, options()).expect_err(name).to_string();
                assert!(words.split('|').any(|words| error.contains(words)), "{name}: {error}");
                assert!(server.requests() <= 16, "{name}: {} requests", server.requests());
                assert!(server.bytes() < 8_000_000, "{name}: {} bytes", server.bytes());
            });
        }
    });
    assert!(started.elapsed() < Duration::from_secs(60), "they are given up");
}

#[test]
fn wrong_bytes_break_a_rule() {
    let bytes = bytes(&octree(), true);
    for at in [20usize, 300, 40_000, bytes.len() / 2] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 4;
        let server = Server::of_file(stored(&damaged), Pace::default()).unwrap();
        let error = read(&server, options()).unwrap_err();
        assert!(matches!(error, FormatError::Broken(_)), "byte {at}: {error}");
    }
}

#[test]
fn a_file_without_ranges_and_without_end_is_given_up_at_the_limit() {
    let endless = Reply { status: "200 OK".into(), headers: Vec::new(), body: Body::Endless, close: true };
    let server = Server::start(Pace::default(), move |_| endless.clone()).unwrap();
    let with = RemoteOptions { max_download: 3_000_000, ..options() };
    let error = read(&server, with).unwrap_err().to_string();
    assert!(error.contains("above the limit of 3000000"), "{error}");
    assert_eq!(server.requests(), 1, "it is not asked again");
}

#[test]
fn slow_answers_and_closed_doors_are_given_up() {
    let server = Server::of_file(stored(&[0; 300_000]), Pace { bytes_per_second: 60_000, ..Pace::default() }).unwrap();
    let with = RemoteOptions { slowest: 1 << 20, patience: Duration::from_millis(800), tries: 1, ..options() };
    let file = RemoteFile::open(&server.address("a"), with).unwrap();
    let error = esvo_format::RangeRead::read_at(&file, 40_000, &mut vec![0; 260_000]).unwrap_err().to_string();
    assert!(error.contains("slower than 1048576 bytes/s"), "{error}");

    let address = server.address("a");
    drop(server);
    std::thread::sleep(Duration::from_millis(50));
    let error = RemoteFile::open(&address, options()).unwrap_err().to_string();
    assert!(error.contains("2 times; try again later"), "{error}");
}
