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

/// What a scene has in addition to, or instead of, its mesh.
const STAND_IN: &str = r#"
[scene.stand_in]
generator = "cube"
seed = 1
triangles = 12
cameras = []
"#;

#[test]
fn the_stand_in_of_an_own_scene_is_used_if_it_is_asked_for_or_the_mesh_is_missing() {
    let own = ["--scene", "shed", "--manifest", "own/scenes.toml"];
    let build = |folder: &Folder, more: &[&str]| {
        let out = folder.run(&[&["build", "-o", "shed.esvo", "-l", "3"], &own[..], more].concat());
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{error}");
        (folder.ok(&["info", "shed.esvo"]), error)
    };
    let both = folder(&format!("{MANIFEST}{STAND_IN}"));
    let (info, error) = build(&both, &[]);
    assert!(info.contains("shed.obj") && !error.contains("warning"), "{info}{error}");
    let (info, error) = build(&both, &["--stand-in"]);
    assert!(info.contains("generator cube") && !error.contains("warning"), "{info}{error}");
    std::fs::remove_file(both.path("own/meshes/shed.obj")).unwrap();
    let (info, error) = build(&both, &[]);
    let warning = "warning: --scene SHED: its stand-in is built: own/meshes/shed.obj does not exist\n";
    assert!(info.contains("generator cube") && error.contains(warning), "{info}{error}");
    let alone = folder(MANIFEST);
    let arguments = [&["build", "-o", "x.esvo", "--stand-in"], &own[..]].concat();
    alone.fails(&arguments, 1, "SHED: it has no stand-in\n");
}

#[test]
fn viewpoints_of_own_scenes_that_do_not_exist() {
    let own = ["--scene", "shed", "--manifest", "own/scenes.toml"];
    let arguments = [&["render", "a.esvo", "-o", "a.png", "--size", "9x9"], &own[..]].concat();
    let render = |manifest: &str| {
        let folder = folder(manifest);
        folder.ok(&["build", "own/meshes/shed.obj", "-o", "a.esvo", "-l", "3"]);
        folder
    };
    let camera = &MANIFEST[MANIFEST.find("cameras").unwrap()..];
    let without_cameras = MANIFEST.replace(camera, "");
    render(&without_cameras).fails(&arguments, 1, "--scene shed: the manifest has no cameras for it; add `cameras`");
    let missing = MANIFEST.replace("shed.obj", "barn.obj");
    render(&missing).fails(&arguments, 1, "it has no stand-in, and own/meshes/barn.obj does not exist\n");
    // With the viewpoints of the stand-in.
    let folder = render(&format!("{missing}{}", STAND_IN.replace("[]", camera.trim_start_matches("cameras = "))));
    let out = folder.run(&arguments);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{error}");
    assert!(error.contains("viewpoint of its stand-in: own/meshes/barn.obj does not exist\n"), "{error}");
}

#[test]
fn the_manifest_s_scenes_replace_those_of_a_matrix_for_other_scenes() {
    let other = "[[scene]]\nname = \"BARN\"\n[[scene.mesh]]\nfile = \"meshes/shed.obj\"\n";
    let cameras = &MANIFEST[MANIFEST.find("cameras").unwrap()..];
    let folder = folder(&format!("{MANIFEST}{other}{cameras}"));
    let matrix = |scene: &str| {
        format!(
            "name = \"m\"\nviews = 1\nrounds = 1\nwarm_up = 0\nmemory_gb = 4\nresolutions = [[16, 16]]\n\
             variants = [\"cubical\"]\nbackends = [\"cpu\"]\n[[scene]]\nname = \"{scene}\"\nlevels = [3]\n"
        )
    };
    folder.put("sibenik.toml", matrix("SIBENIK"));
    folder.put("shed.toml", matrix("SHED"));
    let bench = |matrix| folder.ok(&["bench", "--manifest", "own/scenes.toml", "--matrix", matrix]);
    let text = bench("sibenik.toml");
    assert!(text.contains("SHED") && text.contains("BARN") && !text.contains("SIBENIK"), "{text}");
    let text = bench("shed.toml");
    assert!(text.contains("SHED") && !text.contains("BARN"), "{text}");
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
