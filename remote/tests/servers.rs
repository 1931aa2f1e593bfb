//! Web servers that do what they should.

mod common;

use std::sync::Arc;
use std::time::Duration;

use common::{bytes, octree, options, stored};
use esvo_format::{FormatError, IndexReader, RangeRead, Region, StreamReader};
use esvo_remote::server::{Pace, Reply, Server};
use esvo_remote::{RemoteError, RemoteFile, RemoteOptions};

#[test]
fn what_is_needed_is_read_and_is_that_of_the_file() {
    let octree = octree();
    let bytes = bytes(&octree, true);
    let server = Server::of_file(stored(&bytes), Pace::default()).unwrap();
    let file = RemoteFile::open(&server.address("a.esvo"), options()).unwrap();
    assert_eq!((file.len(), file.requests(), file.bytes()), (bytes.len() as u64, 1, 32 << 10));
    let mut reader = IndexReader::open(&file).unwrap();
    let local = IndexReader::open(&bytes).and_then(|mut reader| reader.octree(0, &Region::ALL, 4)).unwrap();
    assert!(reader.octree(0, &Region::ALL, 4).unwrap().slots() == local.slots());
    assert!(file.bytes() < bytes.len() as u64 / 2, "{} of {} bytes", file.bytes(), bytes.len());
    assert!(reader.octree(0, &Region::ALL, 23).unwrap().slots() == octree.slots());
    assert_eq!((file.requests(), file.bytes()), (server.requests(), server.bytes()));
    assert!(file.requests() < 12, "{} requests", file.requests());
}

#[test]
fn files_without_parts_are_read_in_runs() {
    let octree = octree();
    let bytes = bytes(&octree, false);
    let server = Server::of_file(stored(&bytes), Pace::default()).unwrap();
    let file = RemoteFile::open(&server.address("a.esvo"), options()).unwrap();
    let reader = StreamReader::open(&file).unwrap();
    let before = file.requests();
    assert!(reader.partial(&reader.blocks_for(0, &Region::ALL, 23)).unwrap().slots() == octree.slots());
    assert!(octree.blocks().len() > 20);
    assert_eq!(file.requests() - before, 1, "all blocks are one run");
}

#[test]
fn all_of_a_file_comes_in_pieces() {
    let bytes: Vec<u8> = (0..9_000_000u32).map(|at| (at >> 3) as u8).collect();
    let server = Server::of_file(stored(&bytes), Pace::default()).unwrap();
    let seen = Arc::new(std::sync::Mutex::new(Vec::new()));
    let told = seen.clone();
    let on_bytes = move |bytes: u64, of: Option<u64>| told.lock().unwrap().push((bytes, of));
    let with = RemoteOptions { on_bytes: Some(Arc::new(on_bytes)), at_once: 2, ..options() };
    let file = RemoteFile::open(&server.address("a"), with).unwrap();
    let copy = file.download().unwrap();
    assert!(std::fs::read(copy.path()).unwrap() == bytes);
    assert_eq!(server.requests(), 1 + 3);
    assert_eq!(seen.lock().unwrap().last(), Some(&(9_000_000, Some(9_000_000))));
    let path = copy.path().to_owned();
    drop(copy);
    assert!(!path.exists());
    let small = RemoteOptions { max_download: 8_999_999, ..options() };
    let file = RemoteFile::open(&server.address("a"), small).unwrap();
    let error = file.download().unwrap_err();
    assert!(
        matches!(&error, RemoteError::TooLarge(what) if what.contains("9000000") && what.contains("8999999")),
        "{error}"
    );
    assert_eq!(server.requests(), 1 + 3 + 1);
}

#[test]
fn a_server_without_ranges_sends_all_once() {
    let octree = octree();
    let bytes = bytes(&octree, true);
    let whole = bytes.clone();
    let server = Server::start(Pace::default(), move |_| Reply::new("200 OK", &[], whole.clone())).unwrap();
    let file = RemoteFile::open(&server.address("a"), options()).unwrap();
    assert!(file.is_whole());
    let part = IndexReader::open(&file).and_then(|mut reader| reader.octree(0, &Region::ALL, 23)).unwrap();
    assert!(part.slots() == octree.slots());
    assert_eq!((server.requests(), file.bytes()), (1, bytes.len() as u64));
    assert_eq!(std::fs::read(file.download().unwrap().path()).unwrap(), bytes);

    let small = RemoteOptions { max_download: 1000, ..options() };
    let error = RemoteFile::open(&server.address("a"), small).unwrap_err().to_string();
    assert!(error.contains("sends no ranges") && error.contains("above the limit of 1000"), "{error}");
}

#[test]
fn a_server_that_stumbles_is_asked_again() {
    let bytes = bytes(&octree(), true);
    let (file, length) = (Arc::new(stored(&bytes)), bytes.len() as u64);
    let server = Server::start(Pace::default(), move |request| match request.number {
        0 => Reply::new("503 Service Unavailable", &[("Retry-After", "0")], Vec::new()),
        1 => Reply {
            close: true,
            ..Reply::new("206 Partial Content", &[("Content-Range", "bytes 0-32767/99999")], vec![0; 7])
        },
        2 => Reply::new("302 Found", &[("Location", "/b")], Vec::new()),
        _ => Reply::of_file(request, &file, length, "\"1\""),
    });
    let server = server.unwrap();
    let with = RemoteOptions { tries: 3, ..options() };
    let file = RemoteFile::open(&server.address("a"), with).unwrap_err();
    // The second answer announces 7 bytes for a range of 32768, which is no accident.
    assert!(matches!(file, RemoteError::Answer(_)), "{file}");
    let file = RemoteFile::open(&server.address("a"), options()).unwrap();
    let mut end = [0; 100];
    file.read_at(file.len() - 100, &mut end).unwrap();
    assert_eq!(end, bytes[bytes.len() - 100..]);
    // Redirected once: later requests go there.
    assert_eq!((file.requests(), server.requests()), (2, 5));
}

#[test]
fn reads_beyond_the_end_and_within_asynchronous_code_are_errors() {
    let server = Server::of_file(stored(&[5; 100_000]), Pace::default()).unwrap();
    let file = RemoteFile::open(&server.address("a"), options()).unwrap();
    let mut buf = [0; 10];
    assert_eq!(file.read_at(99_991, &mut buf).unwrap_err().kind(), std::io::ErrorKind::UnexpectedEof);
    assert!(file.read_at(u64::MAX, &mut buf).is_err());
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    let error = runtime.block_on(async { file.read_at(90_000, &mut buf) }).unwrap_err().to_string();
    assert!(error.contains("asynchronous"), "{error}");
    file.read_at(90_000, &mut buf).unwrap();
    assert_eq!(buf, [5; 10]);
    runtime.block_on(async { drop(file) });
}

#[test]
fn answers_come_at_the_pace_and_together() {
    let server = Server::of_file(stored(&[1; 400_000]), Pace { delay: Duration::from_millis(60), bytes_per_second: 0 });
    let server = server.unwrap();
    let file = RemoteFile::open(&server.address("a"), options()).unwrap();
    let mut reads: Vec<(u64, Vec<u8>)> = (0..8).map(|index| (40_000 + index * 40_000, vec![0; 1000])).collect();
    file.read_many(&mut reads).unwrap();
    assert!(reads.iter().all(|(_, buf)| buf.iter().all(|byte| *byte == 1)));
    assert_eq!(server.requests(), 9);
}

#[test]
fn what_is_no_octree_is_an_error_of_the_format() {
    let server = Server::of_file(stored(&[5; 100_000]), Pace::default()).unwrap();
    let file = RemoteFile::open(&server.address("a"), options()).unwrap();
    assert!(matches!(IndexReader::open(&file), Err(FormatError::Broken(_))));
}
