//! The real scenes, if they are found: in `$ESVO_SCENES`, or next to the repository.

use std::path::{Path, PathBuf};

use esvo_builder::import::load_mesh;

fn scenes_dir() -> PathBuf {
    match std::env::var_os("ESVO_SCENES") {
        Some(dir) => dir.into(),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
    }
}

#[test]
fn real_scenes_have_their_triangles() {
    let expected = [
        ("sibenik/sibenik.obj", 73_564, 14),
        ("conference/conference.obj", 331_179, 1),
        ("dragon/dragon_vrip_res2.ply", 202_520, 1),
        ("city/city.gltf", 81_631, 29),
        ("jungle/scene.gltf", 18_515, 16),
        ("flight-helmet/FlightHelmet.gltf", 94_722, 6),
    ];
    for (name, triangles, materials) in expected {
        let path = scenes_dir().join(name);
        if !path.exists() {
            eprintln!("{name} is not found; not checked");
            continue;
        }
        let mesh = load_mesh(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((mesh.triangle_count(), mesh.materials.len()), (triangles, materials), "{name}");
    }
}
