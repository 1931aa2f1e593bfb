//! The page is whole, its tables are those of the crates, and the server does what browsers need.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;

use esvo_core::BEAM_BLOCK;
use esvo_core::filter::{radii, samples};
use esvo_core::gpu::arithmetic::Arithmetic;
use esvo_core::gpu::kernel::{CAST_WGSL, Variant, WORKGROUP};
use esvo_core::gpu::slots::Slots;
use esvo_web::{Server, export, page};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

#[test]
fn the_page_has_every_file_of_its_folders() {
    let paths: BTreeSet<_> = page().map(|file| file.path.to_owned()).collect();
    for folder in ["viewer", "reader/src", "reader/vendor"] {
        for entry in std::fs::read_dir(Path::new(ROOT).join(folder)).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            assert!(paths.contains(&format!("{folder}/{name}")), "{folder}/{name} is not listed in src/lib.rs");
        }
    }
}

/// Every import of a module leads to a file of the page.
#[test]
fn modules_find_each_other() {
    let paths: BTreeSet<_> = page().map(|file| file.path.to_owned()).collect();
    let mut imports = 0;
    for file in page().filter(|file| file.path.ends_with(".js") && !file.path.contains("vendor")) {
        let folder = Path::new(file.path).parent().unwrap();
        let text = std::str::from_utf8(file.bytes).unwrap();
        for line in text.lines().filter(|line| line.starts_with("import ") || line.starts_with("export {")) {
            let Some((_, from)) = line.split_once(" from '") else { continue };
            let from = from.trim_end_matches("';");
            assert!(from.starts_with('.'), "{}: {from} needs a bundler", file.path);
            let mut parts: Vec<_> = folder.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
            for part in from.split('/') {
                match part {
                    "." => {}
                    ".." => drop(parts.pop()),
                    name => parts.push(name.to_owned()),
                }
            }
            assert!(paths.contains(&parts.join("/")), "{}: {from}", file.path);
            imports += 1;
        }
    }
    assert!(imports > 40, "{imports}");
}

/// The preludes of some variants, as the engines compile them. `test/unit/kernel.test.js` makes the same in JavaScript.
#[test]
fn the_kernels_preludes_are_those_of_the_engines() {
    let mut text = String::new();
    let base = Variant {
        contours: true,
        far_pointers: true,
        lod: true,
        beam: false,
        rays: false,
        instances: false,
        levels: 11,
        beam_block: BEAM_BLOCK,
        slots: Slots::ONE_BUFFER,
        workgroup: WORKGROUP,
        arithmetic: Arithmetic::EXACT,
    };
    let plain = Arithmetic { rounds_quotients: false, ..Arithmetic::EXACT };
    let variants = [
        base,
        Variant { beam: true, ..base },
        Variant { beam: true, ..base }.of_coarse_pass(),
        Variant { contours: false, lod: false, levels: 23, arithmetic: plain, ..base },
        Variant { far_pointers: false, slots: Slots::Buffers { parts: 2, part_shift: 23 }, ..base },
        Variant { slots: Slots::Buffers { parts: 5, part_shift: 24 }, ..base },
    ];
    for variant in variants {
        let source = variant.source();
        let _ =
            writeln!(text, "// variant\n{}", source.strip_suffix(CAST_WGSL).expect("the kernel comes last").trim_end());
    }
    let path = Path::new(ROOT).join("tests/preludes.wgsl");
    if std::env::var_os("ESVO_BLESS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    assert_eq!(
        std::fs::read_to_string(&path).unwrap_or_default(),
        text,
        "ESVO_BLESS=1 writes tests/preludes.wgsl anew"
    );
}

#[test]
fn the_filters_table_is_that_of_the_crate() {
    let samples: Vec<_> = samples().iter().map(|s| [s.x as f32, s.y as f32, s.distance, s.weight]).collect();
    let text = page().find(|file| file.path == "viewer/filter.json").expect("is there").bytes;
    let found: serde_json::Value = serde_json::from_slice(text).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap() as f32;
    let found_samples: Vec<_> =
        found["samples"].as_array().unwrap().iter().map(|s| std::array::from_fn(|k| number(&s[k]))).collect();
    assert_eq!(found_samples, samples);
    let found_radii: Vec<_> = found["radii"].as_array().unwrap().iter().map(number).collect();
    assert_eq!(found_radii, radii());
}

#[test]
fn the_page_is_exported_with_the_name_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let written = export(&folder.path().join("a/b"), Some("a \"b\".esvo")).unwrap();
    assert_eq!(written.len(), page().count());
    let index = std::fs::read_to_string(folder.path().join("a/b/index.html")).unwrap();
    assert!(index.contains("<html lang=\"en\" data-file=\"a &quot;b&quot;.esvo\">"), "{}", &index[..200]);
    assert_eq!(std::fs::read_to_string(folder.path().join("a/b/kernels/cast.wgsl")).unwrap(), CAST_WGSL);
    std::fs::write(folder.path().join("file"), "").unwrap();
    let error = export(&folder.path().join("file/b"), None).unwrap_err();
    assert!(error.contains("file"), "{error}");
}

/// Sends a request; the answer's head and body.
fn ask(server: &Server, method: &str, path: &str, headers: &str) -> (String, Vec<u8>) {
    let address = server.address();
    let host = address.strip_prefix("http://").and_then(|rest| rest.split('/').next()).unwrap().to_owned();
    let host_header = if headers.contains("Host:") { String::new() } else { format!("Host: {host}\r\n") };
    let mut stream = TcpStream::connect(&host).unwrap();
    write!(stream, "{method} {path} HTTP/1.1\r\n{host_header}{headers}Connection: close\r\n\r\n").unwrap();
    let mut all = Vec::new();
    stream.read_to_end(&mut all).unwrap();
    let end = all.windows(4).position(|window| window == b"\r\n\r\n").unwrap();
    (String::from_utf8(all[..end].to_vec()).unwrap(), all[end + 4..].to_vec())
}

#[test]
fn the_server_shows_the_page_and_one_file_by_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a b&c#?.esvo");
    let bytes: Vec<u8> = (0..100_000u32).map(|k| (k % 251) as u8).collect();
    std::fs::write(&path, &bytes).unwrap();
    let server = Arc::new(Server::new(Some(path.to_str().unwrap()), 0).unwrap());
    assert!(server.address().ends_with("/?file=/file/a%2520b%2526c%2523%253F.esvo"), "{}", server.address());
    let running = std::thread::spawn({
        let server = server.clone();
        move || server.run()
    });

    let (head, body) = ask(&server, "GET", "/?file=/file/x", "");
    assert!(
        head.starts_with("HTTP/1.1 200") && head.contains("text/html") && head.contains("Content-Security-Policy"),
        "{head}"
    );
    assert!(body.starts_with(b"<!doctype html>"));
    let (head, body) = ask(&server, "GET", "/kernels/cast.wgsl", "");
    assert!(head.starts_with("HTTP/1.1 200") && body == CAST_WGSL.as_bytes(), "{head}");
    let (head, body) = ask(&server, "GET", "/file/anything", "Range: bytes=1000-1999\r\n");
    assert!(head.starts_with("HTTP/1.1 206") && head.contains("Content-Range: bytes 1000-1999/100000"), "{head}");
    assert!(head.contains("Content-Length: 1000") && body == bytes[1000..2000], "{head}");
    let tag = head.lines().find_map(|line| line.strip_prefix("ETag: ")).unwrap().to_owned();
    let (head, _) = ask(&server, "GET", "/file/a", &format!("Range: bytes=0-9\r\nIf-Range: {tag}\r\n"));
    assert!(head.starts_with("HTTP/1.1 206"), "{head}");
    // Another file has taken its place.
    let (head, body) = ask(&server, "GET", "/file/a", "Range: bytes=0-9\r\nIf-Range: \"other\"\r\n");
    assert!(head.starts_with("HTTP/1.1 200") && body == bytes, "{head}");
    let (head, _) = ask(&server, "GET", "/file/a", "Range: bytes=100000-\r\n");
    assert!(head.starts_with("HTTP/1.1 416") && head.contains("Content-Range: bytes */100000"), "{head}");
    let (head, body) = ask(&server, "HEAD", "/file/a", "");
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("Content-Length: 100000") && body.is_empty(), "{head}");

    for (method, path, headers, status) in [
        ("GET", "/../Cargo.toml", "", 404),
        ("GET", "/viewer/../../Cargo.toml", "", 404),
        ("GET", "//etc/passwd", "", 404),
        ("GET", "/nothing", "", 404),
        ("POST", "/", "Content-Length: 0\r\n", 405),
        ("GET", "/", "Host: example.org\r\n", 403),
    ] {
        let (head, _) = ask(&server, method, path, headers);
        assert!(head.starts_with(&format!("HTTP/1.1 {status}")), "{method} {path}: {head}");
    }
    std::fs::remove_file(&path).unwrap();
    assert!(ask(&server, "GET", "/file/a", "").0.starts_with("HTTP/1.1 404"));
    server.stop();
    running.join().unwrap();
}

#[test]
fn addresses_are_left_to_the_browser_and_missing_files_are_named() {
    let server = Server::new(Some("https://example.org/a b.esvo?x=1&y=2"), 0).unwrap();
    assert!(server.address().ends_with("/?file=https://example.org/a%20b.esvo?x=1%26y=2"), "{}", server.address());
    assert!(Server::new(None, 0).unwrap().address().ends_with('/'));
    let error = |file: &str| Server::new(Some(file), 0).err().expect("is refused");
    assert!(error("no/such.esvo").starts_with("no/such.esvo: "));
    assert!(error(ROOT).contains("it is no file"));
}
