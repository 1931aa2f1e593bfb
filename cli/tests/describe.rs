//! What files say about themselves: metadata, instances, SHA-256; and that no tool loses it.

mod common;

use std::path::{Path, PathBuf};

use common::Folder;
use esvo_format::{Metadata, Octree};
use serde_json::{Value, json};

fn specification(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1").join(name)
}

/// What the schema of the specification finds wrong.
fn errors(metadata: &Value) -> Vec<String> {
    let text = std::fs::read_to_string(specification("metadata.schema.json")).unwrap();
    let validator = jsonschema::draft202012::new(&serde_json::from_str(&text).unwrap()).unwrap();
    validator.iter_errors(metadata).map(|e| format!("{}: {e}", e.instance_path())).collect()
}

fn info(folder: &Folder, file: &str) -> Value {
    serde_json::from_str(&folder.ok(&["info", file, "--json"])).unwrap()
}

/// A triangle of one metre, as glTF.
fn gltf() -> String {
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{data}") }],
    })
    .to_string()
}

#[test]
fn builds_say_what_the_mesh_says_and_the_user() {
    let folder = Folder::with_octree();
    let of = |file: &str| {
        let meta = info(&folder, file)["meta"].clone();
        assert_eq!(errors(&meta), [""; 0], "{meta}");
        assert!(!folder.ok(&["validate", file]).contains("M00"));
        meta
    };
    let meta = of("box.esvo");
    assert_eq!((&meta["unit"], &meta["up"], &meta["objects"][0]["name"]), (&Value::Null, &Value::Null, &json!("box")));
    assert!(meta["objects"][0]["bounds"]["low"].is_array() && meta["settings"]["levels"] == 6, "{meta}");
    folder.put("tri.gltf", gltf());
    folder.ok(&["build", "tri.gltf", "-o", "tri.esvo", "--levels", "3"]);
    let meta = of("tri.esvo");
    assert_eq!([&meta["unit"], &meta["up"], &meta["handedness"]], [&json!(1.0), &json!("+y"), &json!("right")]);
    assert_eq!(
        meta["objects"],
        json!([{ "name": "tri", "bounds": { "low": [0.0, 0.0, 0.0], "high": [1.0, 1.0, 0.0] } }])
    );
    let given = ["--unit", "0.01", "--up", "-z", "--handedness", "left", "--name", "a \u{1b} name"];
    folder.ok(&[&["build", "tri.gltf", "-o", "given.esvo", "--levels", "3"], &given[..]].concat());
    let meta = of("given.esvo");
    assert_eq!([&meta["unit"], &meta["up"], &meta["handedness"]], [&json!(0.01), &json!("-z"), &json!("left")]);
    let text = folder.ok(&["info", "given.esvo"]);
    assert!(text.contains("space: a unit is 0.01 m, -z is up, left-handed\n") && !text.contains('\u{1b}'), "{text}");
    folder.ok(&["convert", "given.esvo", "-o", "given.esvo", "--up", "x", "--compress"]);
    let meta = of("given.esvo");
    assert_eq!(
        [&meta["unit"], &meta["up"], &meta["objects"][0]["name"]],
        [&json!(0.01), &json!("+x"), &json!("a \u{1b} name")]
    );
    folder.fails(&["build", "tri.gltf", "-o", "x.esvo", "--unit", "0"], 2, "expected a number above 0");
    folder.fails(&["build", "tri.gltf", "-o", "x.esvo", "--up", "w"], 2, "--up");
    folder.fails(&["convert", "box.esvo", "-o", "x.oct", "--unit", "1"], 1, "neither a hash nor metadata");
}

#[test]
fn the_schema_refuses_what_the_validator_warns_of() {
    let meta_of = |path: &Path| {
        let octree = Octree::open(path).unwrap();
        (!octree.meta().is_empty()).then(|| serde_json::from_str::<Value>(octree.meta()).unwrap())
    };
    let mut valid = 0;
    for entry in std::fs::read_dir(specification("vectors/valid")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "esvo")
            && let Some(meta) = meta_of(&path)
        {
            assert_eq!(errors(&meta), [""; 0], "{}", path.display());
            let typed = Metadata::parse(&meta.to_string()).unwrap();
            assert!(typed.members().len() + 1 >= meta.as_object().unwrap().len(), "nothing but an empty list is lost");
            valid += 1;
        }
    }
    assert!(valid >= 10, "{valid}");
    let index = std::fs::read_to_string(specification("vectors/invalid/index.json")).unwrap();
    let (mut refused, mut beyond) = (0, Vec::new());
    for case in serde_json::from_str::<Vec<Value>>(&index).unwrap() {
        if !["M002", "M003", "M004"].contains(&case["rule"].as_str().unwrap()) {
            continue;
        }
        let name = case["file"].as_str().unwrap();
        let meta = meta_of(&specification("vectors/invalid").join(name)).unwrap();
        match errors(&meta).is_empty() {
            false => refused += 1,
            true => beyond.push(meta.to_string()),
        }
    }
    // What a schema cannot say: low above high, more entries than there are objects and instances.
    let expected = [
        r#"{"objects":[{},{}]}"#,
        r#"{"objects":[{"bounds":{"high":[1,1,1],"low":[0,2,0]}}]}"#,
        r#"{"instances":[{}]}"#,
    ];
    assert_eq!(beyond, expected);
    assert!(refused >= 18, "{refused}");
}

#[test]
fn no_tool_loses_what_a_file_says() {
    let folder = Folder::with_octree();
    std::fs::copy(specification("vectors/valid/written_scene.esvo"), folder.path("scene.esvo")).unwrap();
    let before = info(&folder, "scene.esvo");
    assert_eq!(before["instances"].as_array().unwrap().len(), 3);
    let same = |file: &str, before: &Value, id: bool| {
        folder.ok(&["validate", file]);
        let after = info(&folder, file);
        for member in ["instances", "meta"] {
            assert_eq!(after[member], before[member], "{file}: {member}");
        }
        assert_eq!(after["hash"]["id"] == before["hash"]["id"], id, "{file}");
        assert!(after["hash"]["sha256"].is_string(), "{file}");
    };
    folder.ok(&["convert", "scene.esvo", "-o", "same.esvo"]);
    assert!(std::fs::read(folder.path("same.esvo")).unwrap() == std::fs::read(folder.path("scene.esvo")).unwrap());
    for (name, options) in [("zstd.esvo", "--compress"), ("parts.esvo", "--parts")] {
        folder.ok(&["convert", "scene.esvo", "-o", name, options]);
        same(name, &before, true);
        folder.ok(&["convert", name, "-o", "back.esvo"]);
        assert!(std::fs::read(folder.path("back.esvo")).unwrap() == std::fs::read(folder.path("scene.esvo")).unwrap());
        folder.ok(&["diff", name, "scene.esvo"]);
    }
    // Ambient occlusion makes other octrees, which need another id.
    folder.put("list.toml", "version = 1\n[[place]]\nfile = \"box.esvo\"\nname = \"here\"\nscale = 2\n");
    folder.ok(&["join", "list.toml", "-o", "placed.esvo", "--hash"]);
    let placed = info(&folder, "placed.esvo");
    assert_eq!(
        (&placed["instances"][0]["name"], &placed["meta"]["instances"][0]["name"]),
        (&json!("here"), &json!("here"))
    );
    folder.ok(&["ambient", "placed.esvo", "-o", "lit.esvo", "--rays", "4"]);
    same("lit.esvo", &placed, false);
    let lost = folder.ok(&["convert", "scene.esvo", "-o", "scene.oct"]);
    assert!(["the metadata", "the instances", "the SHA-256"].iter().all(|what| lost.contains(what)), "{lost}");
    // A second file: its objects come after, with what is known of them.
    folder.ok(&["convert", "scene.oct", "-o", "plain.esvo"]);
    let text = folder.ok(&["info", "plain.esvo"]);
    assert!(!text.contains("scene of"), "{text}");
    folder.fails(&["diff", "scene.esvo", "plain.esvo"], 1, "");
    folder.ok(&["join", "scene.esvo", "plain.esvo", "-o", "joined.esvo", "--hash"]);
    folder.ok(&["validate", "joined.esvo"]);
    let joined = info(&folder, "joined.esvo");
    let objects: Vec<_> = joined["instances"].as_array().unwrap().iter().map(|one| one["object"].clone()).collect();
    assert_eq!(objects, [0, 1, 0, 2, 3]);
    assert_eq!(joined["meta"]["objects"][3]["name"], "plain");
    assert_ne!(joined["hash"]["id"], before["hash"]["id"]);
}

#[test]
fn a_bit_outside_of_all_checksums_is_found() {
    let folder = Folder::with_octree();
    for (name, more) in [("raw.esvo", &[][..]), ("parts.esvo", &["--parts"]), ("zstd.esvo", &["--compress"])] {
        folder.ok(&[&["build", "box.obj", "-o", name, "--levels", "6", "--hash"], more].concat());
        folder.ok(&["validate", name]);
        let mut bytes = std::fs::read(folder.path(name)).unwrap();
        let last = bytes.len() - 1; // of the id
        bytes[last] ^= 1;
        folder.put("damaged.esvo", &bytes);
        let out = folder.run(&["validate", "damaged.esvo"]);
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(out.status.code() == Some(1) && text.contains("F002") && text.lines().count() == 1, "{text}");
    }
    let text = folder.ok(&["info", "raw.esvo"]);
    assert!(text.contains("SHA-256 ") && text.contains(", id "), "{text}");
    // Built twice, the file is the same; without the option it has no hash.
    folder.ok(&["build", "box.obj", "-o", "again.esvo", "--levels", "6", "--hash"]);
    assert!(std::fs::read(folder.path("raw.esvo")).unwrap() == std::fs::read(folder.path("again.esvo")).unwrap());
    assert_eq!(info(&folder, "box.esvo")["hash"], Value::Null);
}

#[test]
fn info_says_how_a_file_is_stored() {
    let folder = Folder::new();
    let stored = |name: &str| {
        std::fs::copy(specification(&format!("vectors/valid/{name}.esvo")), folder.path("it.esvo")).unwrap();
        (info(&folder, "it.esvo")["stored"].clone(), folder.ok(&["info", "it.esvo"]))
    };
    let (json, text) = stored("hash");
    let section = |tag: &str, flags: u32, offset: u64, bytes: u64| json!({ "tag": tag, "flags": flags, "offset": offset, "bytes": bytes });
    assert_eq!(
        json,
        json!({
            "file_bytes": 16384, "version": [1, 0], "required_features": 0, "optional_features": 0, "bytes_per_voxel": 16384.0,
            "blocks": { "raw": 1, "zstd": 0, "fields": 0 }, "parts": null, "index": null, "other_bytes": 7880,
            "sections": [section("OBJT", 1, 192, 192), section("BLKT", 1, 384, 72), section("HASH", 2, 456, 48), section("BLKS", 3, 8192, 8192)],
        })
    );
    assert!(
        text.contains("16.0 KiB in the file, 16384.00 bytes per voxel, version 1.0\nstored: 1 block as in memory\n"),
        "{text}"
    );
    assert!(text.contains("header, directory, padding"), "{text}");
    let (json, text) = stored("parts_scene");
    assert_eq!(
        [&json["required_features"], &json["blocks"]["fields"], &json["parts"]],
        [&json!(3), &json!(2), &json!(2)]
    );
    assert!(json["index"]["head_bytes"].as_u64().unwrap() > 500 && json["index"]["page_bytes"] == 0, "{json}");
    assert!(text.contains("readers need compressed blocks and parts\nstored in 2 parts by level: 2 blocks as streams of fields\nindex of "), "{text}");
    let all: u64 = json["sections"].as_array().unwrap().iter().map(|section| section["bytes"].as_u64().unwrap()).sum();
    assert_eq!(all + json["other_bytes"].as_u64().unwrap(), json["file_bytes"].as_u64().unwrap());
}
