//! A mesh that is not the listed one is never called by the listed one's name alone.

mod common;

use common::{BOX, Folder};

#[test]
fn a_box_at_the_place_of_sibenik_is_another_mesh() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sibenik")).unwrap();
    folder.put("sibenik/sibenik.obj", BOX);
    let out = folder.run(&["build", "--scene", "sibenik", "--scenes-dir", ".", "-o", "box.esvo", "-l", "5"]);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{error}");
    let name = "another mesh, sibenik.obj, sha256 ";
    assert!(error.contains(name), "{error}");
    let info = folder.ok(&["info", "box.esvo", "--json"]);
    assert!(info.contains(name), "{info}");
    let out =
        folder.run(&["render", "box.esvo", "-o", "a.png", "--scene", "sibenik", "--scenes-dir", ".", "--size", "9x9"]);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success() && error.contains(name), "{error}");
}

#[test]
fn tables_and_records_name_another_mesh() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sibenik")).unwrap();
    folder.put("sibenik/sibenik.obj", BOX);
    let small = "--scenes sibenik --levels 3 --scenes-dir . --machine m";
    let tables = format!("bench {small} --backends cpu --resolutions 16x16 --views 1 --rounds 1");
    let text = folder.ok(&tables.split(' ').collect::<Vec<_>>());
    let builds = "bench build --scenes sibenik --levels 3 --scenes-dir . --contours on --repeats 1 --out builds";
    let builds = folder.ok(&builds.split(' ').collect::<Vec<_>>());
    for text in [text, builds] {
        assert!(text.contains("SIBENIK: another mesh, sibenik.obj, sha256 "), "{text}");
        for wrong in ["real mesh", "contours, paper", "contours, authors", "stand-in", "Marko Dabrovic"] {
            assert!(!text.contains(wrong), "{wrong}: {text}");
        }
    }
    for record in ["results/m", "builds"] {
        let json = find_json(&folder.path(record));
        assert!(json.contains("\"mesh\": \"other\"") && json.contains("another mesh"), "{json}");
    }
    let json = find_json(&folder.path("results/m"));
    let why = "the mesh is not the listed one, and its terms are not known";
    assert!(json.contains("\"publish\": false") && json.contains(why), "{json}");
}

/// The first record in a folder or the folders in it.
fn find_json(folder: &std::path::Path) -> String {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            return find_json(&path);
        }
        if path.extension().is_some_and(|e| e == "json") {
            return std::fs::read_to_string(path).unwrap();
        }
    }
    panic!("no record in {}", folder.display());
}
