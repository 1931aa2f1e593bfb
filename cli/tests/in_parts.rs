//! `esvo build --part`, `esvo plan` and `esvo join` of parts.

mod common;

use common::{BOX, Folder};

/// Builds the box whole and in three parts.
fn built() -> Folder {
    let folder = Folder::new();
    folder.put("box.obj", BOX);
    folder.ok(&["build", "box.obj", "-o", "whole.esvo", "-l", "8", "--parts"]);
    for k in 1..=3 {
        let part = format!("{k}/3");
        let line = folder.ok(&["build", "box.obj", "-o", &format!("{k}.esvopart"), "-l", "8", "--part", &part]);
        assert!(line.contains(&format!("part {k} of 3")), "{line}");
    }
    folder
}

#[test]
fn parts_join_to_the_file_of_a_whole_build() {
    let folder = built();
    let line = folder.ok(&["join", "3.esvopart", "1.esvopart", "2.esvopart", "-o", "joined.esvo", "--parts"]);
    assert!(line.contains("of 3 parts"), "{line}");
    let read = |name| std::fs::read(folder.path(name)).unwrap();
    assert!(read("joined.esvo") == read("whole.esvo"));
    folder.ok(&["validate", "joined.esvo"]);
    let json = folder.ok(&["build", "box.obj", "-o", "1.esvopart", "-l", "8", "--part", "1/3", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&json["part"], &json["parts"], &json["file"]), (&1.into(), &3.into(), &"1.esvopart".into()));
    assert!(json["voxels"].as_u64() > Some(0) && json["bytes"].as_u64() > Some(0));
}

#[test]
fn what_does_not_fit_together_is_named() {
    let folder = built();
    let missing = "parts 2/3 are missing: build them with --part";
    folder.fails(&["join", "1.esvopart", "3.esvopart", "-o", "a.esvo"], 1, missing);
    folder.fails(&["join", "1.esvopart", "whole.esvo", "-o", "a.esvo"], 1, "1.esvopart: is a part of a build");
    folder.fails(&["join", "whole.esvo", "-o", "a.esvo"], 1, "one octree is nothing to join");
    folder.fails(&["join", "1.esvopart", "absent.esvopart", "-o", "a.esvo"], 1, "absent.esvopart");
    folder.fails(&["build", "box.obj", "-o", "a.esvo", "--part", "1/3"], 1, "parts of builds are written as .esvopart");
    folder.fails(&["build", "box.obj", "-o", "a.esvopart", "--part", "4/3"], 2, "expected K/N");
    folder.fails(&["build", "box.obj", "-o", "a.esvopart", "--part", "1/3", "--parts"], 2, "cannot be used with");
    folder.fails(&["info", "1.esvopart"], 1, "1.esvopart");
}

#[test]
fn a_plan_says_what_each_part_has() {
    let folder = built();
    let text = folder.ok(&["plan", "box.obj", "-l", "8", "--parts", "3"]);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("box.obj: 8 levels, ") && lines[0].contains("with surface"), "{text}");
    assert_eq!(lines[1].split_whitespace().collect::<Vec<_>>(), ["part", "cubes", "pieces", "voxels", "share"]);
    assert_eq!(lines.len(), 5, "{text}");
    let json = folder.ok(&["plan", "box.obj", "-l", "8", "--parts", "3", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["levels"], 8);
    assert_eq!(json["parts"].as_array().unwrap().len(), 3);
    folder.fails(&["plan", "absent.obj", "--parts", "3"], 1, "absent.obj");
    folder.fails(&["plan", "box.obj", "--parts", "0"], 2, "0");
}

/// A worker that is killed in the middle goes on from what it had finished, and the join has the same bytes.
#[cfg(target_os = "linux")]
#[test]
fn a_part_whose_builder_was_killed_goes_on() {
    use std::time::{Duration, Instant};

    let folder = Folder::new();
    let build = |output: &'static str, more: &[&'static str]| {
        let common = ["build", "--scene", "conference", "--stand-in", "-l", "9", "--no-contours", "-o", output];
        [&common[..], more].concat()
    };
    folder.ok(&build("whole.esvo", &[]));
    folder.ok(&build("2.esvopart", &["--part", "2/2"]));
    let first = build("1.esvopart", &["--part", "1/2", "--resume"]);
    let mut child = folder.command(&first).stderr(std::process::Stdio::null()).spawn().unwrap();
    let journal = folder.path("1.esvopart.part/journal");
    let start = Instant::now();
    // Until some cubes are finished.
    while std::fs::metadata(&journal).map_or(0, |file| file.len()) < 10_000 && !folder.path("1.esvopart").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no cube was finished in two minutes");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    folder.ok(&first);
    folder.ok(&["join", "1.esvopart", "2.esvopart", "-o", "joined.esvo"]);
    let read = |name| std::fs::read(folder.path(name)).unwrap();
    assert!(read("joined.esvo") == read("whole.esvo"));
}
