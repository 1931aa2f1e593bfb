//! `esvo info`.

mod stored;

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use esvo_bench::text::TextTable;
use esvo_format::file::attachment;
use esvo_format::{ComponentStats, Metadata, Octree, Stats, Storage, component_stats};
use serde_json::{Value, json};

use super::info_served::run_info_served;
use crate::fail::{Failure, print};
use crate::files::{name_file, open, open_verified};
use crate::remote::{Local, RemoteArguments, is_address, shown};
use crate::words::{count, size};

/// Show the contents of a file: levels, voxels, bytes by kind, metadata, and how it is stored.
#[derive(Debug, Args)]
#[command(after_help = "\
The checksums of all blocks are compared first, as all blocks are counted. A damaged file is
refused with exit code 1. A SHA-256 is shown, not compared: esvo validate does that.

The file may be on a web server or in an object store (http://, https://, s3://, gs://, az://), if the
program was built with --features remote: then only its head is read, or its tables if it has no index,
and the bytes and requests are printed; --verify reads all of it.

Examples:
  esvo info sibenik.esvo --json
  esvo info https://example.org/sibenik.esvo")]
pub(crate) struct InfoArguments {
    /// The file, or its address
    pub(crate) file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    /// Check the file against every rule of the specification first
    #[arg(long, conflicts_with = "no_verify")]
    pub(crate) verify: bool,
    /// Do not compare the checksums of the blocks: for a file that was verified before
    #[arg(long)]
    pub(crate) no_verify: bool,
    #[command(flatten)]
    pub(crate) remote: RemoteArguments,
}

pub(crate) fn run_info(arguments: &InfoArguments) -> Result<(), Failure> {
    if is_address(&arguments.file) && !arguments.verify {
        return run_info_served(arguments);
    }
    let local = Local::of(&arguments.file, &arguments.remote)?;
    let opened = if arguments.verify { open_verified(local.path()) } else { open(local.path(), !arguments.no_verify) };
    let octree = opened.map_err(|failure| local.rename(failure, &arguments.file))?;
    let stats = esvo_format::stats(&octree);
    let storage = (std::fs::File::open(local.path()).map_err(|error| error.to_string()))
        .and_then(|file| Storage::read(&file, octree.objects(), octree.blocks()).map_err(|error| error.to_string()))
        .map_err(|error| name_file(&arguments.file, error))?;
    let metadata = Metadata::parse(octree.meta()).unwrap_or_default();
    if arguments.json {
        return print(&(serde_json::to_string_pretty(&as_json(&octree, &stats, &metadata, &storage))? + "\n"));
    }
    let mut text = format!("{}\n", shown(&arguments.file));
    text += &stored::space(&metadata);
    for (index, object) in octree.objects().iter().enumerate() {
        let to_mesh = octree.octree_to_mesh(index);
        let corner = to_mesh.transform_point3(glam::DVec3::ZERO);
        let edge = to_mesh.determinant().abs().cbrt();
        let _ = writeln!(
            text,
            "object {index}: {}, root cube of edge {edge} at {corner}, finest voxel {}",
            count(object.levels, "level"),
            edge * (-f64::from(object.levels)).exp2()
        );
        text += &stored::object(&metadata, index);
    }
    text += &stored::instances(&octree, &metadata);
    let needs = octree.needs();
    let has = [
        (needs.contours, "contours"),
        (needs.colors, "colours"),
        (needs.normals, "normals"),
        (needs.far_pointers, "far pointers"),
    ];
    let parts: Vec<_> = has.iter().filter(|(has, _)| *has).map(|(_, name)| *name).collect();
    let _ = writeln!(text, "has {}", if parts.is_empty() { "nothing but voxels".into() } else { parts.join(", ") });
    for found in component_stats(&octree) {
        let _ = writeln!(
            text,
            "{}: {} {} in {} of {}, {}",
            name_of(&octree, &found),
            found.format.components,
            found.format.number.name(),
            found.blocks,
            count(stats.blocks, "block"),
            size(found.bytes)
        );
    }
    let _ = writeln!(
        text,
        "{}, {} of them leaves; {}, {}, {}, {}",
        count(stats.voxels, "voxel"),
        stats.leaf_voxels,
        count(stats.descriptors, "descriptor"),
        count(stats.contours, "contour"),
        count(stats.far_pointers, "far pointer"),
        count(stats.blocks, "block")
    );
    let _ = writeln!(text, "{} in memory, {:.2} bytes per voxel", size(stats.image_bytes), stats.bytes_per_voxel);
    text += &stored::file(&storage);
    text += &stored::hash(&octree);
    if !octree.meta().is_empty() {
        let _ = writeln!(text, "metadata {}", octree.meta());
    }
    let mut kinds = TextTable::new("\nBytes by kind", 1, &["kind", "bytes", "per voxel", "share"]);
    for (kind, bytes) in stats.bytes.named().into_iter().filter(|(_, bytes)| *bytes > 0) {
        let per = bytes as f64 / stats.voxels.max(1) as f64;
        let share = 100.0 * bytes as f64 / stats.image_bytes.max(1) as f64;
        kinds.rows.push(vec![kind.into(), bytes.to_string(), format!("{per:.3}"), format!("{share:.1}%")]);
    }
    text += &kinds.to_text();
    text += &stored::sections(&storage).to_text();
    let mut levels = TextTable::new("\nVoxels by level", 1, &["level", "voxels"]);
    levels.rows.extend(stats.voxels_per_level.iter().enumerate().map(|(l, n)| vec![l.to_string(), n.to_string()]));
    text += &levels.to_text();
    print(&text)
}

fn as_json(octree: &Octree, stats: &Stats, metadata: &Metadata, storage: &Storage) -> Value {
    let objects: Vec<_> = (octree.objects().iter())
        .map(|o| json!({ "levels": o.levels, "octree_to_mesh": o.octree_to_mesh.to_vec() }))
        .collect();
    let instances: Vec<_> = (octree.instances().iter().enumerate())
        .map(|(index, one)| {
            let name = metadata.instances.get(index).and_then(|known| known.name.as_deref());
            json!({ "object": one.object, "mesh_to_scene": one.mesh_to_scene, "name": name })
        })
        .collect();
    // Metadata that is not valid JSON is shown as text.
    let meta = serde_json::from_str(octree.meta()).unwrap_or_else(|_| Value::from(octree.meta()));
    let mut value = json!({
        "objects": objects,
        "instances": instances,
        "needs": octree.needs(),
        "stats": stats,
        "stored": storage,
        "hash": stored::hash_json(octree),
        "meta": meta,
    });
    let components = component_stats(octree);
    if !components.is_empty() {
        value["components"] = json!(components);
    }
    value
}

/// What components are: that of the specification, or the name in the metadata, with the unit.
fn name_of(octree: &Octree, found: &ComponentStats) -> String {
    if found.kind < attachment::NAMED_FIRST {
        return found.name.into();
    }
    let meta: Value = serde_json::from_str(octree.meta()).unwrap_or_default();
    let entry = &meta["attachments"][found.kind.to_string()];
    let unit = entry["unit"].as_str().map_or(String::new(), |unit| format!(", {unit}"));
    match entry["name"].as_str() {
        Some(name) => format!("components {} ({}{})", found.kind, printable(name), printable(&unit)),
        None => format!("components {} (without a name)", found.kind),
    }
}

/// A text from a file as it can be shown: at most 80 characters, none of which moves the cursor.
fn printable(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(80).collect()
}
