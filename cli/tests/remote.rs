//! Files on servers, in a program with them and in one without.

mod common;

use common::Folder;

/// What a command that fails says.
fn error_of(folder: &Folder, arguments: &[&str], expected: &str) -> String {
    folder.fails(arguments, 1, expected);
    String::from_utf8(folder.run(arguments).stderr).unwrap()
}

#[cfg(not(feature = "remote"))]
#[test]
fn a_program_without_servers_says_how_to_get_one() {
    let folder = Folder::new();
    for arguments in [
        &["info", "https://me:secret@example.org/a.esvo"][..],
        &["validate", "https://me:secret@example.org/a.esvo"],
        &["convert", "https://me:secret@example.org/a.esvo?key=secret", "-o", "b.esvo"],
        &["render", "s3://bucket/a.esvo", "-o", "b.png"],
    ] {
        let error = error_of(&folder, arguments, "cargo build --release --features remote");
        assert!(!error.contains("secret"), "{error}");
    }
    folder.fails(&["bench", "serve", "a.esvo"], 1, "cargo build --release --features remote");
    folder.fails(&["dump", "http://example.org/a.esvo"], 1, "esvo convert http://example.org/a.esvo -o FILE");
}

#[cfg(feature = "remote")]
mod with_servers {
    use std::fs::File;

    use esvo_remote::server::{Pace, Reply, Server};

    use super::{Folder, error_of};

    /// An octree with parts, one without, and a server for each.
    fn served(folder: &Folder) -> [Server; 2] {
        folder.put("ball.obj", ball());
        folder.ok(&["build", "ball.obj", "-o", "plain.esvo", "--levels", "9"]);
        folder.ok(&["convert", "plain.esvo", "-o", "parts.esvo", "--parts"]);
        ["parts.esvo", "plain.esvo"]
            .map(|name| Server::of_file(File::open(folder.path(name)).unwrap(), Pace::default()).unwrap())
    }

    /// A bumpy sphere.
    fn ball() -> String {
        let mut text = String::new();
        let (rows, columns) = (40, 80);
        for row in 0..=rows {
            for column in 0..columns {
                let (a, b) = (
                    f64::from(row) / f64::from(rows) * std::f64::consts::PI,
                    f64::from(column) / f64::from(columns) * std::f64::consts::TAU,
                );
                let r = 1.0 + 0.1 * (9.0 * a).sin() * (7.0 * b).cos();
                text += &format!("v {} {} {}\n", r * a.sin() * b.cos(), r * a.cos(), r * a.sin() * b.sin());
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let at = |row: i32, column: i32| row * columns + column % columns + 1;
                let (a, b, c, d) = (at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column));
                text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
            }
        }
        text
    }

    #[test]
    fn commands_read_what_they_need_and_give_what_the_file_gives() {
        let folder = Folder::new();
        let [parts, plain] = served(&folder);
        let address = parts.address("a/octree.esvo?key=secret");
        let length = std::fs::metadata(folder.path("parts.esvo")).unwrap().len();

        let info: serde_json::Value = serde_json::from_str(&folder.ok(&["info", &address, "--json"])).unwrap();
        assert_eq!(info["read"]["requests"], 1);
        assert_eq!((info["read"]["bytes"].as_u64(), info["file_bytes"].as_u64()), (Some(32768), Some(length)));
        let local: serde_json::Value = serde_json::from_str(&folder.ok(&["info", "parts.esvo", "--json"])).unwrap();
        assert_eq!(info["objects"][0]["octree_to_mesh"], local["objects"][0]["octree_to_mesh"]);
        let text = folder.ok(&["info", &address]);
        assert!(text.contains("in 1 request") && text.contains("with an index") && !text.contains("secret"), "{text}");
        let whole = folder.ok(&["info", &address, "--verify"]);
        assert_eq!(
            whole.lines().skip(1).collect::<Vec<_>>(),
            folder.ok(&["info", "parts.esvo"]).lines().skip(1).collect::<Vec<_>>()
        );

        assert!(folder.ok(&["validate", &address]).contains("keeps every rule"));
        folder.ok(&["convert", &address, "-o", "copy.esvo", "--parts"]);
        assert!(std::fs::read(folder.path("copy.esvo")).unwrap() == std::fs::read(folder.path("parts.esvo")).unwrap());

        // Pictures are those of the file in every bit.
        let near = ["--camera=0.2,0.3,2.5,0,-0.1,-1", "--size", "160x120"];
        let views: [&[&str]; 4] = [
            &near,
            &["--size", "64x48", "--max-voxel-pixels", "4"],
            &["--size", "64x48", "--light", "sun:1,2,1"],
            &["--size", "80x60", "--beam"],
        ];
        for view in views {
            let draw = |file: &str, picture: &str| folder.ok(&[&["render", file, "-o", picture][..], view].concat());
            draw("plain.esvo", "local.png");
            for server in [&parts, &plain] {
                let before = server.bytes();
                let told = draw(&server.address("octree.esvo"), "served.png");
                let read = server.bytes() - before;
                assert!(told.contains("read ") && told.contains("request"), "{told}");
                let same = std::fs::read(folder.path("local.png")).unwrap()
                    == std::fs::read(folder.path("served.png")).unwrap();
                assert!(same, "{view:?}");
                if std::ptr::eq(server, &parts) && !view.contains(&"--light") {
                    assert!(read < length * 3 / 4, "{view:?}: {read} of {length} bytes");
                }
            }
        }
        // The negative control: another picture has other bytes.
        folder.ok(&[
            "render",
            &parts.address("a"),
            "-o",
            "other.png",
            "--size",
            "80x60",
            "--max-voxel-pixels",
            "9",
            "--beam",
        ]);
        assert!(std::fs::read(folder.path("local.png")).unwrap() != std::fs::read(folder.path("other.png")).unwrap());
    }

    #[test]
    fn errors_name_the_address_and_say_what_to_do() {
        let folder = Folder::new();
        let absent = Server::start(Pace::default(), |_| Reply::new("404 Not Found", &[], Vec::new())).unwrap();
        let address = absent.address("octree.esvo");
        for command in [
            &["info", &address][..],
            &["validate", &address],
            &["convert", &address, "-o", "b.esvo"],
            &["render", &address, "-o", "b.png"],
        ] {
            let error = error_of(&folder, command, "there is no such file; check the address");
            assert!(error.contains(&address), "{error}");
        }
        let other = Folder::new();
        other.put("junk", [7; 100_000]);
        let junk = Server::of_file(File::open(other.path("junk")).unwrap(), Pace::default()).unwrap();
        let address = junk.address("octree.esvo");
        let error =
            error_of(&folder, &["validate", &address, "--max-download", "50K"], "raise the limit by --max-download");
        assert!(error.contains("100000 bytes or more, above the limit of 50000"), "{error}");
        let error = error_of(&folder, &["validate", &address], "breaks the specification");
        assert!(error.contains(&address), "{error}");
        for command in
            [&["convert", &address, "-o", "b.esvo"][..], &["info", &address], &["info", &address, "--verify"]]
        {
            let error = error_of(&folder, command, "rule H001");
            assert!(error.contains(&address) && !error.contains(".tmp"), "{error}");
        }
        folder.fails(&["dump", &address], 1, "esvo convert");
        // A server without ranges is named, and all is read.
        let whole = Server::start(Pace::default(), |_| Reply::new("200 OK", &[], vec![7; 1000])).unwrap();
        let out = folder.run(&["validate", &whole.address("a.esvo")]);
        assert!(String::from_utf8(out.stderr).unwrap().contains("warning: http") && whole.requests() == 1);
        assert!(folder.files().is_empty());
    }

    #[test]
    fn serving_is_measured() {
        let folder = Folder::new();
        drop(served(&folder));
        let text = folder.ok(&[
            "bench",
            "serve",
            "plain.esvo",
            "parts.esvo",
            "--size",
            "64x48",
            "--pixels",
            "16,1",
            "--delay",
            "1",
            "--mbit",
            "8000",
            "--out",
            "records",
            "--machine",
            "m",
        ]);
        assert!(text.contains("parts by level") && text.contains("16 px"), "{text}");
    }
}
