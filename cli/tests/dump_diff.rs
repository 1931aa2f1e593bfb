//! `esvo dump` and `esvo diff`.

mod common;

use common::Folder;
use serde_json::Value;

#[test]
fn dump_shows_tables_blocks_and_voxels() {
    let folder = Folder::with_octree();
    let tables = folder.ok(&["dump", "box.esvo"]);
    assert!(tables.contains("object 0: 6 levels") && tables.contains("block 0 of object 0"), "{tables}");
    let block = folder.ok(&["dump", "box.esvo", "--block", "0"]);
    assert!(block.contains("page header") && block.contains("descriptor of / (level 0)"), "{block}");
    let json: Value = serde_json::from_str(&folder.ok(&["dump", "box.esvo", "--path", "/", "--json"])).unwrap();
    let slot = json["voxels"][0]["slot"].as_u64().unwrap();
    let voxel = folder.ok(&["dump", "box.esvo", "--path", &format!("/{slot}")]);
    assert!(voxel.contains("(level 1)"), "{voxel}");
    for (arguments, expected) in [
        (&["--block", "9999"][..], "no block 9999"),
        (&["--path", "9"], "child slots from 0 to 7"),
        (&["--path", "0", "--object", "7"], "no object 7"),
    ] {
        let failed = folder.run(&[&["dump", "box.esvo"], arguments].concat());
        let error = String::from_utf8(failed.stderr).unwrap();
        assert!(!failed.status.success() && error.contains(expected), "{error}");
    }
}

#[test]
fn diff_tells_octrees_apart_by_what_they_hold() {
    let folder = Folder::with_octree();
    folder.ok(&["build", "box.obj", "-o", "again.esvo", "--levels", "6"]);
    assert_eq!(folder.ok(&["diff", "box.esvo", "again.esvo"]), "the same octree\n");
    folder.ok(&["build", "box.obj", "-o", "coarse.esvo", "--levels", "4"]);
    let failed = folder.run(&["diff", "box.esvo", "coarse.esvo", "--limit", "2"]);
    assert_eq!(failed.status.code(), Some(1));
    let (out, error) = (String::from_utf8(failed.stdout).unwrap(), String::from_utf8(failed.stderr).unwrap());
    assert!(out.starts_with("object 0, /: levels 6 in the first, 4 in the second\n"), "{out}");
    assert!(out.lines().count() == 3 && out.contains(" more"), "{out}");
    assert!(error.contains("differ in"), "{error}");
    // Other normals in the same voxels.
    folder.ok(&["build", "box.obj", "-o", "bare.esvo", "--levels", "6", "--no-normals"]);
    assert_eq!(folder.run(&["diff", "box.esvo", "bare.esvo"]).status.code(), Some(1));
    let cubes =
        |normals: &str, file: &str| folder.ok(&["build", "box.obj", "-o", file, "-l", "5", "--no-contours", normals]);
    cubes("--no-normals", "bare.esvo");
    cubes("--plain-attributes", "dressed.esvo");
    assert_eq!(folder.ok(&["diff", "bare.esvo", "dressed.esvo", "--topology"]), "the same voxels\n");
    assert_eq!(folder.run(&["diff", "bare.esvo", "dressed.esvo"]).status.code(), Some(1));
    assert_eq!(folder.run(&["diff", "bare.esvo", "coarse.esvo", "--topology"]).status.code(), Some(1));
    let json = folder.run(&["diff", "box.esvo", "coarse.esvo", "--json"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!(json["total"].as_u64().unwrap() > 2 && json["list"][0]["what"] == "levels", "{json}");
    assert_eq!(folder.run(&["diff", "box.esvo", "missing.esvo"]).status.code(), Some(1));
}
