//! `esvo bench sweep` and `esvo advise`.

mod common;

use common::Folder;

/// A sweep of the stand-in of a scene, wherever this runs. Returns the path of its record.
fn sweep(folder: &Folder) -> String {
    let command = "bench sweep --scenes fairy --levels 3,4 --engines cpu --size 40x30 --views 1 --rounds 1 --cache kept --out made \
                   --machine Test";
    let text = folder.ok(&command.split_whitespace().collect::<Vec<_>>());
    for part in ["How many levels do contours save", "Where do triangles win?", "Settings on a Pareto front: FAIRY"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let (_, written) = text.trim_end().rsplit_once("Written to ").unwrap();
    assert!(folder.path(written).join("fairy.svg").exists());
    format!("{written}/report.json")
}

#[test]
fn settings_are_advised_from_a_record() {
    let folder = Folder::new();
    let record = sweep(&folder);
    let advise = ["advise", "fairy", "--sweep", &record];
    let text = folder.ok(&[&advise[..], &["--max-error", "1000px"]].concat());
    assert!(
        text.contains("\nUse: ") && text.contains("settings keep the wish") && text.contains("esvo build"),
        "{text}"
    );
    let json = folder.ok(&[&advise[..], &["--max-error", "1", "--measure", "flip", "--json"]].concat());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json["reached"] == true && json["wish"]["measure"] == "flip", "{json}");

    // What cannot be reached: the nearest on standard output, one line of error, exit code 1.
    let wish = [&advise[..], &["--max-error", "0.0001px", "--max-ms", "0.001", "--max-bytes", "1K"]].concat();
    let out = folder.run(&wish);
    let (text, error) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert_eq!((out.status.code(), &*error), (Some(1), "error: FAIRY: no setting keeps the limits\n"));
    assert!(text.contains("\nNearest: ") && text.contains("by the smallest factor"), "{text}");
    folder.fails(
        &["advise", "sibenik", "--sweep", &record, "--max-error", "1"],
        1,
        "has no scene sibenik; it has fairy",
    );
    folder.fails(&[&advise[..], &["--max-error", "1", "--engine", "reference"]].concat(), 1, "no setting of reference");

    // A file of the record is known by its content, and another is not.
    folder.ok(&["build", "--scene", "fairy", "-o", "fairy.esvo", "-l", "4"]);
    let text = folder.ok(&["advise", "fairy.esvo", "--sweep", &record, "--max-error", "1000"]);
    assert!(text.contains("Use: 4 levels with contours") && !text.contains("esvo build"), "{text}");
    folder.ok(&["build", "--scene", "fairy", "-o", "other.esvo", "-l", "2"]);
    let other = ["advise", "other.esvo", "--sweep", &record, "--max-error", "1"];
    folder.fails(&other, 1, "has no octree of the content of other.esvo; leave out --sweep");
}

#[test]
fn settings_are_advised_from_a_sweep_of_its_own() {
    let folder = Folder::with_octree();
    let small = ["--size", "40x30", "--max-error", "1000", "--no-cache"];
    let text = folder.ok(&[&["advise", "box.esvo"], &small[..]].concat());
    assert!(text.contains("own leaves") && text.contains("esvo render"), "{text}");
    let text = folder.ok(&[&["advise", "fairy", "--levels", "3,4", "--views", "1"], &small[..]].concat());
    assert!(text.starts_with("FAIRY on cpu, 40x30: "), "{text}");
    folder.fails(&[&["advise", "box.esvo", "--scene", "fairy"], &small[..]].concat(), 1, "of another mesh");
    folder.ok(&["build", "--scene", "fairy", "-o", "fairy.esvo", "-l", "4"]);
    let text = folder.ok(&[&["advise", "fairy.esvo", "--scene", "fairy"], &small[..]].concat());
    assert!(text.contains("The triangles themselves") && !text.contains("own leaves"), "{text}");
}

#[test]
fn what_cannot_be_advised_is_an_error() {
    let folder = Folder::with_octree();
    let fails = |arguments: &[&str], code, what| folder.fails(&[&["advise"], arguments].concat(), code, what);
    fails(&["box.esvo"], 2, "--max-error");
    for (option, bad) in [("--max-error", "0"), ("--max-error", "px"), ("--max-ms", "-1"), ("--max-bytes", "5X")] {
        fails(&["box.esvo", "--max-error", "1", &format!("{option}={bad}")], 2, "");
    }
    fails(&["absent.esvo", "--max-error", "1"], 1, "absent.esvo");
    fails(&["teapot", "--max-error", "1"], 1, "the scenes are");
    fails(&["fairy", "--max-error", "1", "--sweep", "box.obj"], 1, "is no record of esvo bench sweep");
    fails(&["fairy", "--max-error", "1", "--scene", "fairy"], 1, "is for octree files");
    fails(&["box.esvo", "--max-error", "1", "--levels", "3"], 1, "--levels");
    fails(&["fairy", "--max-error", "1", "--scenes-dir", "absent"], 1, "is not a folder");
    let fails = |arguments: &[&str], code, what| folder.fails(&[&["bench", "sweep"], arguments].concat(), code, what);
    fails(&["--scenes", "teapot"], 1, "the scenes are");
    fails(&["--terminations", "nan"], 1, "terminations");
    fails(&["--rounds", "0"], 1, "at least 1");
    fails(&["--cache", "a", "--no-cache"], 2, "--no-cache");
    fails(
        &["--scenes", "fairy", "--levels", "2", "--rounds", "1", "--size", "8x8", "--cache", "box.obj"],
        1,
        "box.obj",
    );
}
