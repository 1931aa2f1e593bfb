//! Scenes of a manifest of the user's own.

mod common;

use common::{BOX, Folder};

const MANIFEST: &str = r#"
version = 1
[[scene]]
name = "SHED"
[[scene.mesh]]
file = "meshes/shed.obj"
transform = [[10, 0, 0, 100], [0, 10, 0, 0], [0, 0, 10, 0]]
cameras = [{ name = "front", eye = [110, 5, 60], target = [110, 5, 0], up = [0, 1, 0], fov = 60, near = 0.1, far = 500 }]
"#;

fn folder(manifest: &str) -> Folder {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("own/meshes")).unwrap();
    folder.put("own/meshes/shed.obj", BOX);
    folder.put("own/scenes.toml", manifest);
    folder
}

#[test]
fn own_scenes_are_built_drawn_and_measured() {
    let folder = folder(MANIFEST);
    let own = ["--scene", "shed", "--manifest", "own/scenes.toml"];
    folder.ok(&[&["build", "-o", "shed.esvo", "-l", "5"], &own[..]].concat());
    let text = folder.ok(&[&["render", "shed.esvo", "-o", "shed.png", "--size", "20x20"], &own[..]].concat());
    assert!(!text.contains(" 0.0 %"), "the camera is in the space behind the transform: {text}");
    let bench = "bench --manifest own/scenes.toml --levels 3 --backends cpu --resolutions 16x16 --views 1 --rounds 1";
    let text = folder.ok(&bench.split(' ').collect::<Vec<_>>());
    assert!(text.contains("SHED") && text.contains("other mesh") && !text.contains("SIBENIK"), "{text}");
    let bench = "bench build --manifest own/scenes.toml --levels 3 --contours on --repeats 1 --out builds";
    assert!(folder.ok(&bench.split(' ').collect::<Vec<_>>()).contains("SHED"));
}

#[test]
fn own_manifests_that_cannot_be_used() {
    let build = |manifest: &str, what: &str| {
        folder(manifest).fails(&["build", "-o", "x.esvo", "--scene", "shed", "--manifest", "own/scenes.toml"], 1, what);
    };
    build(&MANIFEST.replace("SHED", "sibenik"), "give another name");
    build(&MANIFEST.replace("shed.obj", "barn.obj"), "barn.obj does not exist");
    build(&MANIFEST.replace("100]", "inf]"), "`transform`");
    build(&MANIFEST.replace("meshes/shed.obj", "../shed.obj"), "relative path");
    build(&MANIFEST.replace("eye =", "eyes ="), "eyes");
    let folder = folder(MANIFEST);
    folder.fails(&["build", "-o", "x.esvo", "--scene", "barn", "--manifest", "own/scenes.toml"], 1, "shed");
    folder.fails(&["build", "-o", "x.esvo", "--scene", "shed", "--manifest", "absent.toml"], 1, "absent.toml");
    folder.fails(&["build", "-o", "x.esvo", "--manifest", "own/scenes.toml"], 2, "MESH");
}
