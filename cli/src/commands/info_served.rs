//! `esvo info` of a file on a server: what its head or its tables say, without the blocks.

use std::fmt::Write;

use glam::{DMat4, DVec3};
use serde_json::json;

use super::info::InfoArguments;
use crate::fail::{Failure, print};
use crate::remote::{Served, shown};
use crate::words::{count, size};

pub(crate) fn run_info_served(arguments: &InfoArguments) -> Result<(), Failure> {
    let served = Served::open(&arguments.file, &arguments.remote)?;
    let (bytes, requests, file_bytes) = served.counts();
    let objects = served.objects();
    if arguments.json {
        let object = |o: &esvo_format::file::ObjectEntry| {
            json!({
                "levels": o.levels,
                "octree_to_mesh": o.octree_to_mesh.to_vec(),
                "descriptors": o.descriptors,
                "leaf_voxels": o.leaf_voxels,
                "contours": o.contours,
                "far_pointers": o.far_pointers,
            })
        };
        let value = json!({
            "objects": objects.iter().map(object).collect::<Vec<_>>(),
            "file_bytes": file_bytes,
            "index": served.has_index(),
            "read": { "bytes": bytes, "requests": requests },
        });
        return print(&(serde_json::to_string_pretty(&value)? + "\n"));
    }
    let mut text = format!("{}\n", shown(&arguments.file));
    for (index, object) in objects.iter().enumerate() {
        let to_mesh = DMat4::from_cols_array(&object.octree_to_mesh);
        let corner = to_mesh.transform_point3(DVec3::ZERO);
        let edge = to_mesh.determinant().abs().cbrt();
        let _ = writeln!(
            text,
            "object {index}: {}, root cube of edge {edge} at {corner}, finest voxel {}",
            count(object.levels, "level"),
            edge * (-f64::from(object.levels)).exp2()
        );
        let _ = writeln!(
            text,
            "{}, {} of them leaves; {}, {}, {}",
            count(object.voxels(), "voxel"),
            object.leaf_voxels,
            count(object.descriptors, "descriptor"),
            count(object.contours, "contour"),
            count(object.far_pointers, "far pointer")
        );
    }
    let index = if served.has_index() { "with an index" } else { "without an index" };
    let _ = writeln!(text, "{} in the file, {index}", size(file_bytes));
    let _ = writeln!(text, "{}; all of it, for metadata, bytes by kind and voxels by level: --verify", served.about());
    print(&text)
}
