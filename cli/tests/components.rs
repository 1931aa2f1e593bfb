//! Emission, roughness and metalness, opacity and materials: built, shown, converted, and in pictures.

mod common;

use common::Folder;
use serde_json::Value;

/// A glowing square before a wall.
const SCENE: &str =
    "mtllib a.mtl\nv 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nv 0.5 0.5 -0.4\nv 1.5 0.5 -0.4\nv 1.5 1.5 -0.4\nv 0.5 1.5 -0.4
usemtl wall\nf 1 2 3 4\nusemtl lamp\nf 5 6 7 8\n";
const MATERIALS: &str = "newmtl wall\nKd 0.5 0.5 0.5\nPr 0.25\nnewmtl lamp\nKd 0.1 0.1 0.1\nKe 0 1 0\nd 0.5\n";

/// One triangle that glows and is half metal.
const TRIANGLE: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
"buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAA/"}],
"bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
"materials": [{"emissiveFactor": [1, 0.5, 0], "pbrMetallicRoughness": {"metallicFactor": 0.5}}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}]}"#;

fn with_scene() -> Folder {
    let folder = Folder::new();
    folder.put("a.obj", SCENE);
    folder.put("a.mtl", MATERIALS);
    folder.ok(&["build", "a.obj", "-o", "plain.esvo", "--levels", "6"]);
    folder.ok(&["build", "a.obj", "-o", "all.esvo", "--levels", "6", "--components", "all"]);
    folder
}

/// Names of the components that a file has.
fn has(folder: &Folder, name: &str) -> Vec<String> {
    let text = folder.ok(&["info", name, "--json"]);
    let json: Value = serde_json::from_str(&text).unwrap();
    let list = json["components"].as_array().cloned().unwrap_or_default();
    list.iter().map(|entry| entry["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn components_are_built_shown_and_kept() {
    let folder = with_scene();
    assert_eq!(has(&folder, "plain.esvo"), [""; 0], "an OBJ file has none without the option");
    let all = ["emission", "roughness and metalness", "opacity", "material"];
    assert_eq!(has(&folder, "all.esvo"), all);
    let text = folder.ok(&["info", "all.esvo"]);
    for line in ["emission: 3 rgb9e5 in 1 of 1 block, ", "material: 1 u16 in 1 of 1 block, ", "\n  components "] {
        assert!(text.contains(line), "{line}: {text}");
    }
    assert!(text.contains(r#""components":["emission","roughness","opacity","material"]"#), "{text}");
    folder.ok(&["validate", "all.esvo"]);
    for options in [&["--compress"][..], &["--parts"]] {
        folder.ok(&[&["convert", "all.esvo", "-o", "other.esvo"][..], options].concat());
        folder.ok(&["diff", "all.esvo", "other.esvo"]);
        assert_eq!(has(&folder, "other.esvo"), all, "{options:?}");
    }
    folder.ok(&["join", "plain.esvo", "all.esvo", "-o", "joined.esvo"]);
    assert_eq!(has(&folder, "joined.esvo"), all);
    let difference = folder.run(&["diff", "plain.esvo", "all.esvo"]);
    assert!(!difference.status.success(), "components are compared");
    assert!(folder.ok(&["dump", "all.esvo", "--path", "0"]).contains("; material (11) "));
    // What is asked for, and no more.
    folder.ok(&["build", "a.obj", "-o", "two.esvo", "--levels", "5", "--components", "opacity,material"]);
    assert_eq!(has(&folder, "two.esvo"), ["opacity", "material"]);
}

#[test]
fn a_gltf_file_has_them_unless_it_should_not() {
    let folder = Folder::new();
    folder.put("a.gltf", TRIANGLE);
    folder.ok(&["build", "a.gltf", "-o", "look.esvo", "--levels", "5"]);
    assert_eq!(has(&folder, "look.esvo"), ["emission", "roughness and metalness"]);
    folder.ok(&["build", "a.gltf", "-o", "none.esvo", "--levels", "5", "--components", "none"]);
    assert_eq!(has(&folder, "none.esvo"), [""; 0]);
}

#[test]
fn pictures_show_them() {
    let folder = with_scene();
    let picture = |file: &str, mode: &str| {
        let view =
            ["--view-mode", mode, "--size", "48x48", "--camera=1,1,-3,0,0,1", "--up", "0,1,0", "--filter", "off"];
        let out = folder.run(&[&["render", file, "-o", "p.png"][..], &view].concat());
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let picture = esvo_core::picture::read_picture(&folder.path("p.png")).unwrap();
        // The middle of the lamp, and the wall beside it.
        let warned = !out.stderr.is_empty();
        (picture.pixel(24, 24), picture.pixel(14, 24), warned)
    };
    let (lit, wall, _) = picture("all.esvo", "shaded");
    let (dark, same, _) = picture("plain.esvo", "shaded");
    assert!(lit[1] == 255 && dark[1] < 200 && lit[0].abs_diff(dark[0]) < 4, "{lit:?} {dark:?}");
    assert_eq!(wall, same, "what emits nothing looks the same");
    let near = |found: [u8; 3], expected: [u8; 3]| (0..3).all(|k| found[k].abs_diff(expected[k]) <= 1);
    for (mode, lamp, beside) in [
        ("emission", [0, 255, 0], [0; 3]),
        ("roughness", [255; 3], [64; 3]),
        ("metalness", [0; 3], [0; 3]),
        ("opacity", [128; 3], [255; 3]),
    ] {
        let (found, wall, warned) = picture("all.esvo", mode);
        assert!(near(found, lamp) && near(wall, beside) && !warned, "{mode}: {found:?} {wall:?}");
    }
    let (lamp, wall, _) = picture("all.esvo", "material");
    assert_ne!(lamp, wall);
    let (lamp, wall, warned) = picture("plain.esvo", "material");
    assert!(lamp == wall && warned, "the default, with a warning");
}
