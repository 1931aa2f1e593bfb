//! `esvo ambient`.

mod common;

use common::Folder;

#[test]
fn ambient_occlusion_is_added_and_changes_the_picture() {
    let folder = Folder::with_octree();
    let out = folder.ok(&["ambient", "box.esvo", "-o", "ao.esvo", "--rays", "32", "--radius", "0.3"]);
    assert!(out.contains("32 rays each") && out.contains("cast by cpu"), "{out}");
    folder.ok(&["validate", "ao.esvo"]);
    // The octree is unchanged otherwise, and every engine gives the same values.
    folder.ok(&[
        "ambient",
        "box.esvo",
        "-o",
        "again.esvo",
        "--rays",
        "32",
        "--radius",
        "0.3",
        "--backend",
        "reference",
    ]);
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(bytes("ao.esvo") == bytes("again.esvo"));
    assert!(bytes("ao.esvo").len() > bytes("box.esvo").len());
    for name in ["box", "ao"] {
        folder.ok(&["render", &format!("{name}.esvo"), "-o", &format!("{name}.png"), "--size", "64x48"]);
    }
    assert!(bytes("ao.png") != bytes("box.png"));
    // Existing ambient occlusion is replaced.
    folder.ok(&["ambient", "ao.esvo", "-o", "twice.esvo", "--rays", "32", "--radius", "0.3"]);
    assert!(bytes("ao.esvo") == bytes("twice.esvo"));
}

#[test]
fn what_cannot_be_done_is_said_in_one_line() {
    let folder = Folder::with_octree();
    folder.ok(&["build", "box.obj", "-o", "plain.esvo", "--levels", "4", "--no-normals"]);
    for (arguments, expected) in [
        (&["ambient", "plain.esvo", "-o", "x.esvo"][..], "plain.esvo: the octree has no normals"),
        (
            &["ambient", "box.esvo", "-o", "x.esvo", "--radius", "0"],
            "radius is 0.0: it must be above 0 and at most 4 times the scene",
        ),
        (&["ambient", "box.esvo", "-o", "box.esvo"], "box.esvo: is the input"),
        (&["ambient", "none.esvo", "-o", "x.esvo"], "none.esvo: "),
    ] {
        let output = folder.run(arguments);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
        assert!(error.starts_with("error: ") && error.contains(expected) && error.lines().count() == 1, "{error}");
    }
    assert!(!folder.files().contains(&"x.esvo".to_string()));
}
