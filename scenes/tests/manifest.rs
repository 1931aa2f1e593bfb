//! Reading manifests, refusing bad ones, and finding files.

use std::path::{Path, PathBuf};

use esvo_scenes::generate::GENERATORS;
use esvo_scenes::{
    BuildSettings, FileIdentity, ManifestError, SceneManifest, SceneVariant, find_scene_file, locate_scene_in,
    sha256_of,
};

fn builtin() -> SceneManifest {
    SceneManifest::builtin().expect("the built-in manifest is valid")
}

#[test]
fn the_built_in_manifest_holds_the_papers_scenes() {
    let manifest = builtin();
    let paper: Vec<_> = manifest.scenes.iter().filter(|s| s.paper).map(|s| s.name.as_str()).collect();
    assert_eq!(paper, ["CITY", "SIBENIK", "SIBENIK-D", "HAIRBALL", "FAIRY", "CONFERENCE"]);
    for scene in manifest.scenes.iter().filter(|s| s.paper && !s.displaced) {
        let stand_in = scene.stand_in.as_ref().unwrap_or_else(|| panic!("{} has no stand-in", scene.name));
        assert!(stand_in.cameras.len() >= 4, "{}", scene.name);
        // The manifest uses the generator's default seed.
        assert!(GENERATORS.iter().any(|g| g.name == stand_in.generator && g.seed == stand_in.seed));
    }
    let displaced: Vec<_> = manifest.scenes.iter().filter(|s| s.displaced).map(|s| s.name.as_str()).collect();
    assert_eq!(displaced, ["SIBENIK-D"]);
    let plain: Vec<_> = manifest.scenes.iter().filter(|s| !s.textures).map(|s| s.name.as_str()).collect();
    assert_eq!(plain, ["SIBENIK-PLAIN"]);
    let [with, without] = ["SIBENIK", "SIBENIK-PLAIN"].map(|name| &manifest.scene(name).expect("listed").meshes[0]);
    assert_eq!((&with.sha256, &with.cameras), (&without.sha256, &without.cameras));
    assert!(manifest.scenes.iter().all(|s| s.unsupported.is_none()));
    assert!(manifest.scene("SIBENIK").is_some_and(|s| s.cameras(SceneVariant::Real).len() >= 4));
    assert!(manifest.scene("CONFERENCE").is_some_and(|s| s.cameras(SceneVariant::Real).len() >= 4));
    assert!(manifest.scene("CITY-SMALL").is_some_and(|s| !s.publish));
    assert_eq!(
        manifest.scene("CONFERENCE").map(|s| s.build),
        Some(BuildSettings { color_error: 256.0, normal_error: 0.0101353, contour_error: 14.0421 })
    );
    let hairball = manifest.scene("HAIRBALL").expect("listed");
    assert_eq!(hairball.cameras(SceneVariant::Real), hairball.cameras(SceneVariant::StandIn));
    let first = &hairball.cameras(SceneVariant::Real)[0];
    assert_eq!((first.eye, first.fov_degrees), ([0.266297, 2.45482, 7.2675], 70.0));
    for camera in
        manifest.scenes.iter().flat_map(|s| [s.cameras(SceneVariant::Real), s.cameras(SceneVariant::StandIn)]).flatten()
    {
        let length = camera.forward.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-12, "{}", camera.name);
    }
}

const GOOD: &str = r#"
version = 1
[[scene]]
name = "A"
about = "a"
source = "s"
credit = "c"
publish = true
build = { color_error = 16, normal_error = 0.01, contour_error = 15 }
[[scene.mesh]]
file = "a/a.obj"
sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
parts = [{ file = "a/a.bin", sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" }]
cameras = [{ name = "one", eye = [0, 0, 0], target = [0, 0, -2], up = [0, 1, 0], fov = 60, near = 0.1, far = 10 }]
"#;

fn parse(text: &str) -> Result<SceneManifest, ManifestError> {
    SceneManifest::parse(text, Path::new("test.toml"))
}

#[test]
fn bad_manifests_are_refused_with_the_reason() {
    assert_eq!(parse(GOOD).expect("good").scenes[0].meshes[0].cameras[0].forward, [0.0, 0.0, -1.0]);
    let stand_in = "\n[scene.stand_in]\ngenerator = \"cube\"\nseed = 0\ntriangles = 13\ncameras = []\n";
    let wrong_count = format!("{GOOD}{stand_in}");
    let twice = format!("{GOOD}{}", GOOD.replace("version = 1", "").replace("\"A\"", "\"a\""));
    let cases: Vec<(String, &str)> = vec![
        (GOOD.replace("version = 1", "version = 2"), "version"),
        (GOOD.replace("about", "abuot"), "abuot"),
        (GOOD.replace("fov = 60", "fov = 60, zoom = 2"), "zoom"),
        (GOOD.replace("fov = 60", "fov = 180"), "fov"),
        (GOOD.replace("fov = 60", "fov = nan"), "finite"),
        (GOOD.replace("near = 0.1", "near = 0"), "near"),
        (GOOD.replace("far = 10", "far = 0.1"), "far"),
        (GOOD.replace("up = [0, 1, 0]", "up = [0, 0, 3]"), "parallel"),
        (GOOD.replace("up = [0, 1, 0]", "up = [0, 0, 0]"), "parallel"),
        (GOOD.replace("target = [0, 0, -2]", "target = [0, 0, 0]"), "no length"),
        (GOOD.replace("target =", "forward = [0, 0, 1], target ="), "only one"),
        (GOOD.replace("target = [0, 0, -2],", ""), "only one"),
        (GOOD.replace("a/a.obj", "../a.obj"), "relative path"),
        (GOOD.replace("a/a.obj", "/a.obj"), "relative path"),
        (GOOD.replace("ba7816", "BA7816"), "hexadecimal"),
        (GOOD.replace("ba7816", ""), "hexadecimal"),
        (GOOD.replace("contour_error = 15", "contour_error = 24"), "contour_error"),
        (GOOD.replace("normal_error = 0.01", "normal_error = -1"), "normal_error"),
        (GOOD.replace("name = \"A\"", "name = \"\""), "name is empty"),
        (wrong_count.clone(), "makes 12"),
        (wrong_count.replace("\"cube\"", "\"teapot\""), "no generator is called \"teapot\""),
        (wrong_count.replace("13", "12"), "no `cameras`"),
        (GOOD.replace("publish = true", "displaced = true\ntextures = false"), "leave one of them out"),
        (twice, "listed twice"),
        ("version = 1\nscene = 3".into(), "scene"),
        ("version = ".into(), "test.toml"),
    ];
    for (text, reason) in cases {
        let error = parse(&text).err().unwrap_or_else(|| panic!("accepted, should name \"{reason}\":\n{text}"));
        let message = error.to_string();
        assert!(message.contains(reason) && message.contains("test.toml"), "\"{reason}\" is not in: {message}");
    }
    let nowhere = SceneManifest::load(Path::new("no/such/manifest.toml"));
    assert!(matches!(nowhere, Err(ManifestError::Read { .. })));
}

#[test]
fn files_are_found_and_compared() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let dirs = [PathBuf::from("no/such/directory"), dir.path().to_owned()];
    let manifest = parse(GOOD).expect("good");
    let scene = &manifest.scenes[0];
    assert!(locate_scene_in(scene, &dirs).expect("readable").is_none());
    let write = |name: &str, text: &str| {
        std::fs::create_dir_all(dir.path().join("a")).expect("writable");
        std::fs::write(dir.path().join(name), text).expect("writable");
    };
    let identity = || locate_scene_in(scene, &dirs).expect("readable").expect("found").identity;

    write("a/a.obj", "abc");
    assert_eq!(sha256_of(&dir.path().join("a/a.obj")).expect("readable"), scene.meshes[0].sha256);
    // The part is missing.
    assert!(matches!(identity(), FileIdentity::Modified { found: None, .. }));
    write("a/a.bin", "abc");
    assert_eq!(identity(), FileIdentity::Listed);
    write("a/a.bin", "abd");
    let modified = identity();
    assert!(matches!(&modified, FileIdentity::Modified { found: Some(_), path, .. } if path.ends_with("a/a.bin")));
    assert!(modified.to_string().contains("not comparable"), "{modified}");
    write("a/a.bin", "abc");
    write("a/a.obj", "abcd");
    assert!(matches!(identity(), FileIdentity::Modified { found: Some(_), .. }));
    // What the file is called does not matter.
    let found = locate_scene_in(scene, &dirs).expect("readable").expect("found");
    assert_eq!(found.variant(), SceneVariant::Other);
    assert_eq!(found.other_name().as_deref(), Some("another mesh, a.obj, sha256 88d4266fd4e6"));
    assert_eq!(found.sha256, "88d4266fd4e6338d13b845fcf289579d209c897823b9217da3e161936f031589");
    assert_eq!(find_scene_file(scene, Some(dir.path())), Some(dir.path().join("a/a.obj")));
}

/// A listed copy under the name of another one is still the listed one, with its own cameras.
#[test]
fn the_content_decides_which_copy_a_file_is() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let second = GOOD.find("[[scene.mesh]]").map(|at| &GOOD[at..]).expect("a mesh");
    let second = second.replace("a/a.obj", "b.obj").replace("\"one\"", "\"two\"").replace("ba7816bf", "00000000");
    let without_parts = |text: &str| text.lines().filter(|l| !l.starts_with("parts")).collect::<Vec<_>>().join("\n");
    let manifest = parse(&without_parts(&format!("{GOOD}{second}"))).expect("good");
    let scene = &manifest.scenes[0];
    std::fs::write(dir.path().join("b.obj"), "abc").expect("writable");
    let found = locate_scene_in(scene, &[dir.path().to_owned()]).expect("readable").expect("found");
    assert_eq!((found.variant(), found.other_name()), (SceneVariant::Real, None));
    assert_eq!(found.mesh.cameras[0].name, "one");
}
