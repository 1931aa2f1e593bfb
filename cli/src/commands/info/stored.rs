//! What `esvo info` says of metadata and instances, and of how a file is stored.

use std::fmt::Write;

use esvo_bench::text::TextTable;
use esvo_format::file::{FEATURE_COMPRESSED, FEATURE_PARTS, SECTION_OWN_CHECKSUMS, SECTION_REQUIRED};
use esvo_format::{Bounds, Handedness, Metadata, Octree, Storage, UpAxis};
use serde_json::{Value, json};

use crate::words::{count, size};

/// Unit, up axis and handedness, as far as they are known.
pub(super) fn space(metadata: &Metadata) -> String {
    let unit = metadata.unit.map(|unit| format!("a unit is {unit} m"));
    let up = metadata.up.map(|up| {
        let axis = match up {
            UpAxis::X => "+x",
            UpAxis::MinusX => "-x",
            UpAxis::Y => "+y",
            UpAxis::MinusY => "-y",
            UpAxis::Z => "+z",
            UpAxis::MinusZ => "-z",
        };
        format!("{axis} is up")
    });
    let hand = metadata.handedness.map(|hand| match hand {
        Handedness::Right => "right-handed".to_owned(),
        Handedness::Left => "left-handed".to_owned(),
    });
    let known: Vec<String> = [unit, up, hand].into_iter().flatten().collect();
    if known.is_empty() { String::new() } else { format!("space: {}\n", known.join(", ")) }
}

/// Name and bounds of an object, as far as they are known. Names are text from strangers: what a terminal may act on is escaped.
pub(super) fn object(metadata: &Metadata, index: usize) -> String {
    let Some(known) = metadata.objects.get(index) else { return String::new() };
    let name = known.name.as_ref().map(|name| format!("named {name:?}"));
    let bounds = known
        .bounds
        .map(|Bounds { low: [a, b, c], high: [d, e, f] }| format!("surface within {a}, {b}, {c} and {d}, {e}, {f}"));
    let known: Vec<String> = [name, bounds].into_iter().flatten().collect();
    if known.is_empty() { String::new() } else { format!("  {}\n", known.join(", ")) }
}

/// Instances that are listed; the others are counted.
const LISTED: usize = 8;

/// The instances, if the file has any.
pub(super) fn instances(octree: &Octree, metadata: &Metadata) -> String {
    let instances = octree.instances();
    if instances.is_empty() {
        return String::new();
    }
    let mut text = format!("scene of {}\n", count(instances.len() as u64, "instance"));
    for (index, one) in instances.iter().enumerate().take(LISTED) {
        let name = metadata.instances.get(index).and_then(|known| known.name.as_ref());
        let name = name.map_or(String::new(), |name| format!(" {name:?}"));
        let m = one.mesh_to_scene;
        let rows: Vec<String> = (0..3).map(|r| format!("{} {} {} {}", m[r], m[r + 3], m[r + 6], m[r + 9])).collect();
        let _ = writeln!(text, "instance {index}{name}: object {} by {}", one.object, rows.join(" | "));
    }
    if instances.len() > LISTED {
        let _ = writeln!(text, "and {} more: --json, or esvo dump", instances.len() - LISTED);
    }
    text
}

/// How the file is stored.
pub(super) fn file(storage: &Storage) -> String {
    let [major, minor] = storage.version;
    let mut text = format!(
        "{} in the file, {:.2} bytes per voxel, version {major}.{minor}",
        size(storage.file_bytes),
        storage.bytes_per_voxel
    );
    let features = [(FEATURE_COMPRESSED, "compressed blocks"), (FEATURE_PARTS, "parts")];
    let needed: Vec<&str> =
        features.iter().filter(|(bit, _)| storage.required_features & bit != 0).map(|f| f.1).collect();
    if !needed.is_empty() {
        let _ = write!(text, ", readers need {}", needed.join(" and "));
    }
    text.push('\n');
    let blocks = storage.blocks;
    let codecs =
        [(blocks.raw, "as in memory"), (blocks.zstd, "as a Zstandard frame"), (blocks.fields, "as streams of fields")];
    let codecs: Vec<String> = (codecs.iter().filter(|(number, _)| *number > 0))
        .map(|(number, how)| format!("{} {how}", count(*number, "block")))
        .collect();
    match storage.parts {
        Some(parts) => {
            let _ = writeln!(text, "stored in {} by level: {}", count(parts, "part"), codecs.join(", "));
        }
        None => {
            let _ = writeln!(text, "stored: {}", codecs.join(", "));
        }
    }
    if let Some(index) = storage.index {
        let (head, pages) = (size(index.head_bytes.into()), size(index.page_bytes));
        let _ = writeln!(
            text,
            "index of {} in the root page and {pages} in others, head of {head}",
            size(index.root_bytes)
        );
    }
    text
}

/// SHA-256 and id, if the file has them.
pub(super) fn hash(octree: &Octree) -> String {
    let Some(hash) = octree.file_hash() else { return String::new() };
    let id = octree.file_id().map_or("none".to_owned(), |id| hex(&id));
    format!("SHA-256 {}, id {id}\n", hex(&hash.sha256))
}

pub(super) fn hash_json(octree: &Octree) -> Value {
    octree
        .file_hash()
        .map_or(Value::Null, |hash| json!({ "sha256": hex(&hash.sha256), "id": octree.file_id().map(|id| hex(&id)) }))
}

/// Bytes of the file by section.
pub(super) fn sections(storage: &Storage) -> TextTable {
    let mut table = TextTable::new("\nBytes by section", 2, &["section", "flags", "offset", "bytes", "share"]);
    let share = |bytes: u64| format!("{:.1}%", 100.0 * bytes as f64 / storage.file_bytes.max(1) as f64);
    for section in &storage.sections {
        let flags = [(SECTION_REQUIRED, "required"), (SECTION_OWN_CHECKSUMS, "own checksums")];
        let flags: Vec<&str> = flags.iter().filter(|(bit, _)| section.flags & bit != 0).map(|flag| flag.1).collect();
        let (offset, bytes) = (section.offset.to_string(), section.bytes.to_string());
        table.rows.push(vec![section.tag.clone(), flags.join(", "), offset, bytes, share(section.bytes)]);
    }
    let other = storage.other_bytes;
    let rest = "header, directory, padding".to_owned();
    table.rows.push(vec![rest, String::new(), String::new(), other.to_string(), share(other)]);
    table
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
