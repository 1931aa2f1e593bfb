//! The test vectors of the specification, in `spec/v1/vectors`: `valid` with what each decodes to, `invalid` with the rule
//! that each breaks, `streaming` with parts of octrees. Those in `streaming_parts` were made by the reader in Python.
//!
//! `ESVO_BLESS=1 cargo test -p esvo-format --test vectors` writes them anew. The bytes do not depend on the machine.

#[path = "../common/mod.rs"]
mod common;
mod expected;
mod invalid;
mod streaming;
mod streaming_parts;
mod valid;
mod writer;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use common::bytes_of;
use esvo_format::{Contour, CornerValue, FormatError, Octree, Region, StreamReader, file, validate, validate_bytes};
use esvo_spec::{Level, RULES, rule};
use glam::{DMat3, DMat4, DVec3};
use invalid::broken_vectors;
use serde_json::{Value, json};
use valid::vectors;

fn folder(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors").join(kind)
}

fn blessing() -> bool {
    std::env::var_os("ESVO_BLESS").is_some()
}

/// Compares generated files with the committed ones, byte by byte. When blessing, writes them first.
fn same_files(kind: &str, generated: &BTreeMap<String, Vec<u8>>) {
    let folder = folder(kind);
    if blessing() {
        fs::create_dir_all(&folder).unwrap();
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if !generated.contains_key(path.file_name().unwrap().to_str().unwrap()) {
                fs::remove_file(path).unwrap();
            }
        }
        for (name, bytes) in generated {
            fs::write(folder.join(name), bytes).unwrap();
        }
    }
    let there: BTreeSet<String> =
        fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    let expected: BTreeSet<String> = generated.keys().cloned().collect();
    assert_eq!(there, expected, "the files in {kind}");
    // The index of invalid vectors has offsets and causes as they were reported when it was blessed.
    for (name, bytes) in generated.iter().filter(|(name, _)| (kind, name.as_str()) != ("invalid", "index.json")) {
        let found = fs::read(folder.join(name)).unwrap();
        let differs = found.iter().zip(bytes).position(|(a, b)| a != b);
        assert_eq!((differs, found.len()), (None, bytes.len()), "{kind}/{name}: first byte that differs, and length");
    }
}

/// Makes the files in parts that are kept in `parts/` anew.
#[test]
#[cfg(feature = "zstd")]
#[ignore = "every version of Zstandard makes other frames"]
fn make_parts() {
    for (name, octree) in valid::in_parts() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/parts").join(name).with_extension("esvo");
        let options = esvo_format::WriteOptions { parts: true, ..esvo_format::WriteOptions::default() };
        octree.write_with(&path, &options).unwrap();
    }
}

/// Makes the frames that are kept in `frames/` anew.
#[test]
#[ignore = "every version of Zstandard makes other frames"]
fn make_frames() {
    let (block, ..) = valid::entropy_coded();
    for (name, checksum) in [("plain", false), ("checksum", true)] {
        let mut compressor = zstd::bulk::Compressor::new(19).unwrap();
        compressor.include_checksum(checksum).unwrap();
        let frame = compressor.compress(&block.image(0, &[0])).unwrap();
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/frames");
        fs::write(folder.join(name).with_extension("zst"), frame).unwrap();
    }
}

#[test]
fn valid_vectors_are_as_generated() {
    let mut files = BTreeMap::new();
    let mut total = 0;
    for vector in vectors() {
        assert!(vector.bytes.len() <= 32768, "{} has {} bytes", vector.name, vector.bytes.len());
        total += vector.bytes.len();
        let json = expected::describe(&vector.name, vector.about, &vector.bytes, &vector.image);
        serde_json::from_str::<Value>(&json).expect("JSON");
        assert!(files.insert(format!("{}.json", vector.name), json.into_bytes()).is_none(), "{} twice", vector.name);
        files.insert(format!("{}.esvo", vector.name), vector.bytes);
    }
    assert!(total < 5 << 19, "{total} bytes");
    same_files("valid", &files);
}

#[test]
fn the_page_lists_every_vector() {
    let path = folder("README.md");
    let mut page = fs::read_to_string(&path).unwrap();
    let rows: String = vectors().iter().map(|v| format!("| `{}` | {} |\n", v.name, v.about)).collect();
    let head = "| vector | what it is for |\n|---|---|\n";
    let start = page.find(head).expect("the table") + head.len();
    if blessing() {
        page.truncate(start);
        page += &rows;
        fs::write(&path, &page).unwrap();
    }
    assert_eq!(page[start..], rows, "the table in vectors/README.md");
}

/// Whether this library reads compressed blocks.
fn reads_compressed() -> bool {
    file::KNOWN_REQUIRED & file::FEATURE_COMPRESSED != 0
}

#[test]
fn valid_vectors_break_no_rule_and_decode_as_expected() {
    for vector in vectors() {
        let name = &vector.name;
        if vector.bytes[16] & 3 != 0 && !reads_compressed() {
            let Err(FormatError::Broken(broken)) = Octree::from_bytes(&vector.bytes) else { panic!("{name}") };
            assert_eq!(broken.rule, "H003", "{name}");
            continue;
        }
        let report = validate_bytes(&vector.bytes).unwrap();
        assert!(report.findings.is_empty(), "{name}: {report}");
        let octree = Octree::from_bytes(&vector.bytes).unwrap();
        octree.sound().unwrap();
        let image: &[u8] = bytemuck::cast_slice(octree.slots());
        assert!(image == vector.image, "{name}: the image");
        let json = expected::describe(name, vector.about, &vector.bytes, &vector.image);
        let json: Value = serde_json::from_str(&json).unwrap();
        for (object, expected) in octree.objects().iter().zip(json["objects"].as_array().unwrap()) {
            let mut nodes = expected["nodes"].as_array().unwrap().iter();
            let transform = DMat4::from_cols_array(&object.octree_to_mesh);
            same_node(&octree, transform, object.root_slot as u32, "", &mut nodes, name);
            assert!(nodes.next().is_none(), "{name}: more nodes are expected");
        }
        if vector.canonical {
            assert!(bytes_of(&octree) == vector.bytes, "{name}: written anew");
        }
    }
}

/// Compares the descriptor at `slot` and all below it with the lines of the JSON.
fn same_node<'a>(
    octree: &Octree,
    transform: DMat4,
    slot: u32,
    path: &str,
    nodes: &mut impl Iterator<Item = &'a Value>,
    name: &str,
) {
    let expected = nodes.next().unwrap_or_else(|| panic!("{name}: {path} is not expected"));
    let node = expected;
    let descriptor = octree.descriptor(slot);
    let block = octree.block_of(slot);
    let found = json!({
        "path": path, "level": path.len(), "block": block, "slot": slot - octree.parts()[block as usize].start,
        "valid": descriptor.valid_mask(), "leaf": descriptor.leaf_mask(), "contours": descriptor.contour_mask(),
        "far": descriptor.far(),
    });
    for (key, value) in found.as_object().unwrap() {
        assert_eq!(*value, expected[key], "{name}: {key} of {path}");
    }
    let mut voxels = expected["voxels"].as_array().unwrap().iter();
    for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
        let voxel = voxels.next().unwrap_or_else(|| panic!("{name}: voxel {path}{child} is not expected"));
        assert_eq!(voxel["slot"], child, "{name}: voxel of {path}");
        assert_eq!(voxel["leaf"], descriptor.leaf_mask() >> child & 1 != 0, "{name}: {path}{child}");
        let word = octree.contour(slot, child).map(|Contour(word)| word);
        assert_eq!(word.map(u64::from), voxel["contour"]["word"].as_u64(), "{name}: contour of {path}{child}");
        if let Some(word) = word {
            let (slab, contour) = (Contour(word).decode(), &voxel["contour"]);
            let what = format!("{name}: contour of {path}{child}");
            // Exact apart from the JSON parser, which may be off by one unit in the last place.
            near(Some(slab.normal), &contour["normal"], 1e-14, &what);
            let rest = json!([contour["position"], contour["thickness"], 0.0]);
            near(Some([slab.position, slab.thickness, 0.0]), &rest, 5e-14, &what);
            let (position, edge) = (&node["position"], 2f64.powi(-1 - path.len() as i32));
            let centre =
                DVec3::from([0, 1, 2].map(|k| {
                    position[k].as_f64().unwrap() * 2f64.powi(-23) + edge * (f64::from(child >> k & 1) + 0.5)
                }));
            let n = DVec3::from(slab.normal);
            // Each plane of the slab by one of its points and the normal.
            let at = |side: f64| centre + n * (edge * (slab.position + side * slab.thickness) / n.length_squared());
            let m = DMat3::from_mat4(transform).inverse().transpose() * n;
            let [low, high] = [-0.5, 0.5].map(|side| transform.transform_point3(at(side)).dot(m) / m.length());
            near(Some((m / m.length()).to_array()), &contour["mesh"]["normal"], 1e-12, &what);
            let size = transform.to_cols_array().iter().fold(1.0, |max: f64, x| max.max(x.abs()));
            let planes = json!([contour["mesh"]["low"], contour["mesh"]["high"], 0.0]);
            near(Some([low, high, 0.0]), &planes, 1e-11 * size, &what);
        }
        let color = octree.color(slot, child).map(|c| c.map(f64::from));
        near(color, &voxel["color"], 1e-6, &format!("{name}: colour of {path}{child}"));
        let normal = octree.normal(slot, child);
        if voxel["normal"] == "any" {
            assert!(normal.is_some_and(|n| (n.length() - 1.0).abs() < 1e-6), "{name}: normal of {path}{child}");
        } else {
            let normal = normal.map(|n| n.as_dvec3().to_array());
            near(normal, &voxel["normal"], 2e-6, &format!("{name}: normal of {path}{child}"));
        }
        let ambient = octree.ambient(slot, child).map(|value| [f64::from(value), 0.0, 0.0]);
        let expected = voxel["ambient"].as_f64().map_or(Value::Null, |value| json!([value, 0.0, 0.0]));
        near(ambient, &expected, 1e-6, &format!("{name}: ambient light of {path}{child}"));
        for kind in (8..12).chain(16..32) {
            let found = octree.components(slot, child, kind).map(|c| json!(c.used())).unwrap_or_default();
            let expected = voxel["components"].get(kind.to_string()).cloned().unwrap_or_default();
            assert_eq!(found.is_null(), expected.is_null(), "{name}: components {kind} of {path}{child}");
            for (a, b) in found.as_array().into_iter().flatten().zip(expected.as_array().into_iter().flatten()) {
                let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
                // Exact apart from the JSON parser.
                assert!(
                    (a - b).abs() <= b.abs() * 1e-15,
                    "{name}: components {kind} of {path}{child}: {a}, expected {b}"
                );
            }
            assert_eq!(
                found.as_array().map(Vec::len),
                expected.as_array().map(Vec::len),
                "{name}: {kind} of {path}{child}"
            );
        }
        let corners = octree.corners(slot, child).map(|cell| {
            let value = |v: CornerValue| {
                let [r, g, b, alpha] = v.color.map(u32::from);
                [r, g, b, alpha, v.normal.0]
            };
            json!([cell.corners.map(value), cell.size == 1.0])
        });
        let expected = json!([voxel["corners"], voxel["own_corners"]]);
        assert_eq!(corners.unwrap_or(json!([null, null])), expected, "{name}: corners of {path}{child}");
        let plain = octree.plain_color(slot, child).filter(|_| voxel["alpha"] != Value::Null);
        let cell = octree.corners(slot, child).and_then(|cell| cell.middle());
        let alpha = plain.map(|color| f64::from(color[3]) / 255.0).or(cell.map(|(color, _)| color[3].into()));
        let expected = voxel["alpha"].as_f64().map_or(Value::Null, |value| json!([value, 0.0, 0.0]));
        near(alpha.map(|value| [value, 0.0, 0.0]), &expected, 1e-6, &format!("{name}: alpha of {path}{child}"));
    }
    assert!(voxels.next().is_none(), "{name}: more voxels of {path} are expected");
    for child in 0..8u8 {
        if let Some(below) = octree.child(slot, child) {
            same_node(octree, transform, below, &format!("{path}{child}"), nodes, name);
        }
    }
}

fn near(found: Option<[f64; 3]>, expected: &Value, bound: f64, what: &str) {
    let numbers = expected.as_array().map(|list| [0, 1, 2].map(|k| list[k].as_f64().unwrap()));
    assert_eq!(found.is_some(), numbers.is_some(), "{what}");
    let Some((found, numbers)) = found.zip(numbers) else { return };
    assert!(found.iter().zip(numbers).all(|(a, b)| (a - b).abs() <= bound), "{what}: {found:?}, expected {numbers:?}");
}

/// Name, bytes and image of the valid vectors.
fn with_images() -> BTreeMap<String, (Vec<u8>, Vec<u8>)> {
    vectors().into_iter().map(|v| (v.name, (v.bytes, v.image))).collect()
}

#[test]
fn streaming_vectors_are_as_generated() {
    let whole = with_images();
    let mut files = BTreeMap::new();
    let mut lines = Vec::new();
    for case in streaming::cases(&whole) {
        lines.push(streaming::line(&case, &whole[case.vector].0).to_string());
        let json = expected::describe(&case.name, case.about, &case.bytes, &case.image);
        assert!(files.insert(format!("{}.json", case.name), json.into_bytes()).is_none());
        files.insert(format!("{}.esvo", case.name), case.bytes);
    }
    files.insert("index.json".into(), format!("[\n{}\n]\n", lines.join(",\n")).into_bytes());
    same_files("streaming", &files);
}

#[test]
fn parts_are_read_as_the_streaming_vectors_say() {
    let whole = with_images();
    for case in streaming::cases(&whole) {
        let (name, mut bytes) = (&case.name, whole[case.vector].0.clone());
        if bytes[16] & 3 != 0 && !reads_compressed() {
            continue;
        }
        let line = streaming::line(&case, &bytes);
        // A streaming reader must not look at other blocks.
        let kept: Vec<(u64, u64)> = serde_json::from_value(line["ranges"].clone()).unwrap();
        let stored = |b: &file::BlockEntry| (b.file_offset, b.stored_size);
        let all: Vec<(u64, u64)> = StreamReader::open(&bytes).unwrap().blocks().iter().map(stored).collect();
        for (offset, size) in all.into_iter().filter(|range| !kept.contains(range)) {
            bytes[offset as usize..(offset + size) as usize].fill(0xa5);
        }
        let reader = StreamReader::open(&bytes).unwrap();
        if let streaming::Wanted::Region { object, low, high, level } = case.wanted {
            let region = Region { low: low.into(), high: high.into() };
            assert_eq!(reader.blocks_for(object as usize, &region, level), case.blocks, "{name}");
        }
        let part = reader.partial(&case.blocks).unwrap();
        let image: &[u8] = bytemuck::cast_slice(part.slots());
        assert!(image == case.image, "{name}: the image");
        assert!(validate(&part).findings.is_empty(), "{name}: {}", validate(&part));
        let expected = Octree::from_bytes(&case.bytes).unwrap();
        assert!(validate(&expected).findings.is_empty(), "{name}: {}", validate(&expected));
        assert_eq!(part.objects(), expected.objects(), "{name}");
        assert_eq!(bytes_of(&part), case.bytes, "{name}: written");
    }
}

#[test]
fn invalid_vectors_are_as_generated() {
    let mut files = BTreeMap::new();
    let mut index = Vec::new();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for broken in broken_vectors() {
        let count = counts.entry(broken.rule).or_default();
        *count += 1;
        if broken.bytes[16] & 3 != 0 && !reads_compressed() {
            // This build cannot say what is wrong with it: the index is not compared.
            let name = format!("{}_{count}.esvo", broken.rule);
            files.insert(name, broken.bytes);
            continue;
        }
        let report = validate_bytes(&broken.bytes).unwrap();
        let rules: BTreeSet<&str> = report.findings.iter().map(|f| f.broken.rule).collect();
        let name = format!("{}_{count}.esvo", broken.rule);
        assert_eq!(rules, BTreeSet::from([broken.rule]), "{name}");
        let finding = &report.findings[0].broken;
        let level = if rule(broken.rule).unwrap().level == Level::Must { "must" } else { "should" };
        index.push(json!({
            "file": name, "rule": broken.rule, "level": level, "offset": finding.offset, "cause": finding.what,
        }));
        files.insert(name, broken.bytes);
    }
    // Files and rules in it are compared by the next test.
    let lines: Vec<String> = index.iter().map(Value::to_string).collect();
    files.insert("index.json".into(), format!("[\n{}\n]\n", lines.join(",\n")).into_bytes());
    same_files("invalid", &files);
}

#[test]
fn every_rule_has_vectors_and_every_vector_a_rule() {
    let text = fs::read_to_string(folder("invalid").join("index.json")).unwrap();
    let index: Vec<Value> = serde_json::from_str(&text).unwrap();
    let mut broken = BTreeSet::new();
    let listed: BTreeSet<&str> = index.iter().map(|entry| entry["file"].as_str().unwrap()).collect();
    assert_eq!(listed.len() + 1, fs::read_dir(folder("invalid")).unwrap().count(), "files beside index.json");
    for entry in &index {
        let (name, id) = (entry["file"].as_str().unwrap(), entry["rule"].as_str().unwrap());
        assert!(rule(id).is_some(), "{name}: no rule {id}");
        assert!(name.starts_with(&format!("{id}_")), "{name}");
        assert!(!entry["cause"].as_str().unwrap().is_empty(), "{name}");
        broken.insert(id);
        // Validates the committed bytes, not those of the generator.
        let bytes = fs::read(folder("invalid").join(name)).unwrap();
        if bytes.len() > 16 && bytes[16] & 3 != 0 && !reads_compressed() {
            assert!(matches!(Octree::from_bytes(&bytes), Err(FormatError::Broken(broken)) if broken.rule == "H003"));
            continue;
        }
        let report = validate_bytes(&bytes).unwrap();
        assert!(!report.findings.is_empty() && report.findings.iter().all(|f| f.broken.rule == id), "{name}: {report}");
        assert_eq!(report.is_ok(), rule(id).unwrap().level == Level::Should, "{name}");
    }
    for rule in RULES {
        assert_eq!(broken.contains(rule.id), rule.no_vector.is_none(), "{}: a vector or a reason for none", rule.id);
    }
}
