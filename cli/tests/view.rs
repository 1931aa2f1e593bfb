//! `esvo view`: the page and a file on loopback, and the page in a folder.

mod common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Stdio;

use common::Folder;

#[test]
fn page_and_file_are_served_until_the_program_ends() {
    let folder = Folder::with_octree();
    let mut command = folder.command(&["view", "box.esvo", "--no-open"]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("http://").unwrap();
    let (host, path) = address.split_once('/').unwrap();
    assert_eq!(path, "?file=/file/box.esvo");
    let ask = |path: &str, headers: &str| {
        let mut stream = TcpStream::connect(host).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n{headers}Connection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        answer
    };
    assert!(String::from_utf8_lossy(&ask("/", "")).contains("esvo viewer"));
    let answer = ask("/file/box.esvo", "Range: bytes=0-11\r\n");
    assert!(answer.starts_with(b"HTTP/1.1 206") && answer.ends_with(b"\xABESVO 1\xBB\r\n\x1A\n"));
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn the_page_is_exported_with_the_file() {
    let folder = Folder::with_octree();
    let said = folder.ok(&["view", "--export", "www", "box.esvo"]);
    assert!(said.contains("put the folder on any server"), "{said}");
    let read = |name: &str| std::fs::read(folder.path("www").join(name)).unwrap();
    assert!(String::from_utf8(read("index.html")).unwrap().contains("data-file=\"box.esvo\""));
    assert_eq!(read("box.esvo"), std::fs::read(folder.path("box.esvo")).unwrap());
    assert!(!read("kernels/cast.wgsl").is_empty() && !read("viewer/app.js").is_empty());
}

#[test]
fn what_cannot_be_shown_is_named() {
    let folder = Folder::new();
    for arguments in [&["view", "no.esvo", "--no-open"][..], &["view", "--export", "www", "no.esvo"]] {
        folder.fails(arguments, 1, "no.esvo: ");
    }
    assert!(folder.files().is_empty(), "{:?}", folder.files());
}
