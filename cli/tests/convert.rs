//! `esvo convert`.

mod common;

use common::Folder;

fn counts(folder: &Folder, file: &str) -> serde_json::Value {
    let json = folder.ok(&["info", file, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let stats = &json["stats"];
    serde_json::json!([stats["levels"], stats["descriptors"], stats["leaf_voxels"], stats["contours"]])
}

#[test]
fn there_and_back() {
    let folder = Folder::with_octree();
    let out = folder.ok(&["convert", "box.esvo", "-o", "box.oct"]);
    assert!(out.contains("the metadata"), "{out}");
    assert!(std::fs::read(folder.path("box.oct")).unwrap().starts_with(b"Clusters"));
    let back = folder.ok(&["convert", "box.oct", "-o", "back.esvo"]);
    assert!(back.contains("nothing lost"), "{back}");
    assert_eq!(counts(&folder, "back.esvo"), counts(&folder, "box.esvo"));
    folder.ok(&["validate", "back.esvo"]);
    // The second conversion loses nothing.
    let again = folder.ok(&["convert", "back.esvo", "-o", "again.OCT"]);
    assert!(again.contains("nothing lost"), "{again}");
}

#[test]
fn rewriting_keeps_everything() {
    let folder = Folder::with_octree();
    let out = folder.ok(&["convert", "box.esvo", "-o", "same.esvo"]);
    assert!(out.contains("nothing lost"), "{out}");
    assert!(std::fs::read(folder.path("same.esvo")).unwrap() == std::fs::read(folder.path("box.esvo")).unwrap());
    // A file can be rewritten in place, with and without compression.
    folder.ok(&["convert", "same.esvo", "-o", "same.esvo", "--compress"]);
    let size = |name: &str| std::fs::metadata(folder.path(name)).unwrap().len();
    assert!(size("same.esvo") < size("box.esvo"));
    folder.ok(&["validate", "same.esvo"]);
    folder.ok(&["convert", "same.esvo", "-o", "same.esvo"]);
    assert!(std::fs::read(folder.path("same.esvo")).unwrap() == std::fs::read(folder.path("box.esvo")).unwrap());
}

#[test]
fn what_cannot_be_converted_is_said_in_one_line() {
    let folder = Folder::with_octree();
    folder.put("broken.oct", "Clusters");
    for (arguments, expected) in [
        (&["convert", "box.obj", "-o", "x.oct"][..], "box.obj: is a mesh"),
        (&["convert", "box.esvo", "-o", "x"], ".esvo or .oct"),
        (&["convert", "broken.oct", "-o", "x.esvo"], "broken.oct: .oct file, start: the file has 8 bytes"),
        (&["convert", "none.oct", "-o", "x.esvo"], "none.oct"),
        (&["convert", "box.esvo", "-o", "x.oct", "--compress"], "leave out --compress"),
    ] {
        let output = folder.run(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.contains(expected) && error.lines().count() == 1, "{error}");
    }
    assert_eq!(folder.files(), ["box.esvo", "box.obj", "broken.oct"]);
}
