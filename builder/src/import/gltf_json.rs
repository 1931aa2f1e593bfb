//! The JSON of a glTF document as it is written: where extensions are used, and the document without parts that the parser of
//! the `gltf` crate rejects.

use gltf::json;

use super::error::one_line;

/// The extensions that are in use and not known, each with the first place in the document that has it.
pub(super) fn ignored_extensions(root: &json::Root, text: &[u8], is_known: fn(&str) -> bool) -> Vec<(String, String)> {
    let unknown = root.extensions_used.iter().filter(|name| !is_known(name));
    let unknown: Vec<&String> = unknown.filter(|name| !root.extensions_required.contains(name)).collect();
    if unknown.is_empty() {
        return Vec::new();
    }
    let Ok(document) = json::deserialize::from_slice::<json::Value>(text) else { return Vec::new() };
    let place = |name: &String| Some((one_line(name), first_use(&document, name)?));
    unknown.into_iter().filter_map(place).collect()
}

/// Where the extension `name` is first used, e.g. `node 3 (lamp)` or `material 0, normalTexture`.
fn first_use(document: &json::Value, name: &str) -> Option<String> {
    let has = |value: &json::Value| value.get("extensions").is_some_and(|e| e.get(name).is_some());
    let mut in_document = None;
    // The path to each value on the stack. The depth of JSON that the parser accepts is limited.
    let mut stack = vec![(String::new(), document)];
    while let Some((path, value)) = stack.pop() {
        if has(value) {
            if !path.is_empty() {
                return Some(path);
            }
            in_document = Some("the document".to_owned());
        }
        let joined = |more: &str| if path.is_empty() { more.to_owned() } else { format!("{path}, {more}") };
        for (key, child) in value.as_object().into_iter().flatten().rev() {
            // What is in an extension belongs to the object that has it.
            if key == "extensions" || key == "extras" {
                continue;
            }
            match child.as_array() {
                Some(list) => {
                    let single = match key.as_str() {
                        "meshes" => "mesh",
                        other => other.strip_suffix('s').unwrap_or(other),
                    };
                    for (index, entry) in list.iter().enumerate().rev().filter(|(_, entry)| entry.is_object()) {
                        let name = entry.get("name").and_then(json::Value::as_str);
                        let name = name.map_or(String::new(), |name| format!(" ({})", one_line(name)));
                        stack.push((joined(&format!("{} {index}{name}", one_line(single))), entry));
                    }
                }
                None if child.is_object() => stack.push((joined(&one_line(key)), child)),
                None => {}
            }
        }
    }
    in_document
}

/// The document without the parts `unused`, which are not needed here. Reads files that the parser rejects only because of these parts:
/// they are invalid, or newer than the parser. `None` if the rest is rejected, too.
pub(super) fn without_unused_parts(text: &[u8], unused: &[&str]) -> Option<json::Root> {
    let mut document: json::Value = json::deserialize::from_slice(text).ok()?;
    let root = document.as_object_mut()?;
    for part in unused {
        root.remove(*part);
    }
    // A scene may be empty, but the parser requires its list of nodes.
    for scene in root.get_mut("scenes").and_then(json::Value::as_array_mut).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| json::Value::Array(Vec::new()));
        }
    }
    json::deserialize::from_value(document).ok()
}
