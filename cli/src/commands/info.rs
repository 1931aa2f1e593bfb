//! `esvo info`.

mod stored;

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use esvo_bench::text::TextTable;
use esvo_format::{Metadata, Octree, Stats, Storage};
use serde_json::{Value, json};

use crate::fail::{Failure, print};
use crate::files::{name_file, open, open_verified};
use crate::words::{count, size};

/// Show the contents of a file: levels, voxels, bytes by kind, metadata, and how it is stored.
#[derive(Debug, Args)]
#[command(after_help = "\
The checksums of all blocks are compared first, as all blocks are counted. A damaged file is
refused with exit code 1. A SHA-256 is shown, not compared: esvo validate does that.

Example:
  esvo info sibenik.esvo --json")]
pub(crate) struct InfoArguments {
    /// The file
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
}

pub(crate) fn run_info(arguments: &InfoArguments) -> Result<(), Failure> {
    let octree =
        if arguments.verify { open_verified(&arguments.file)? } else { open(&arguments.file, !arguments.no_verify)? };
    let stats = esvo_format::stats(&octree);
    let storage = (std::fs::File::open(&arguments.file).map_err(|error| error.to_string()))
        .and_then(|file| Storage::read(&file, octree.objects(), octree.blocks()).map_err(|error| error.to_string()))
        .map_err(|error| name_file(&arguments.file, error))?;
    let metadata = Metadata::parse(octree.meta()).unwrap_or_default();
    if arguments.json {
        return print(&(serde_json::to_string_pretty(&as_json(&octree, &stats, &metadata, &storage))? + "\n"));
    }
    let mut text = format!("{}\n", arguments.file.display());
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
    json!({
        "objects": objects,
        "instances": instances,
        "needs": octree.needs(),
        "stats": stats,
        "stored": storage,
        "hash": stored::hash_json(octree),
        "meta": meta,
    })
}
