//! Files of other programs that hold points, volumes or worlds: they are recognised, named, and refused with advice.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Advice for point clouds.
pub(super) const POINTS: &str =
    "a point cloud has no surface; make a mesh from it first, e.g. in MeshLab or CloudCompare";
/// Advice for volumes.
const VOLUME: &str = "volumes cannot be read; export its surface as a mesh, or its voxels as .vox";
/// Advice for worlds made of blocks.
const BLOCKS: &str = "block worlds cannot be read; convert it to .obj or to .vox first";

/// The first bytes of a file; none if it cannot be read.
pub(super) fn head(path: &Path) -> Vec<u8> {
    let mut head = Vec::new();
    if path.is_file()
        && let Ok(file) = File::open(path)
        // What could be read is enough.
        && file.take(4096).read_to_end(&mut head).is_err()
    {
        head.clear();
    }
    head
}

/// What a file is by its first bytes, and what to do.
pub(super) fn of_content(bytes: &[u8]) -> Option<String> {
    let head = &bytes[..bytes.len().min(4096)];
    let named = |name: &str, advice: &str| Some(format!("is {name}; {advice}"));
    if head.starts_with(b"LASF") {
        // The highest bit of the format of the points marks LASzip.
        let zipped = head.get(104).is_some_and(|format| format & 0x80 != 0);
        return named(if zipped { "a LAZ point cloud" } else { "a LAS point cloud" }, POINTS);
    }
    if head.starts_with(b"ASTM-E57") {
        return named("an E57 point cloud", POINTS);
    }
    if head.starts_with(b"#binvox") {
        return named("a binvox volume", VOLUME);
    }
    if head.starts_with(b"NanoVDB") {
        return named("a NanoVDB volume", VOLUME);
    }
    if head.starts_with(b" BDV\0\0\0\0") {
        return named("an OpenVDB volume", VOLUME);
    }
    let text =
        std::str::from_utf8(head).unwrap_or_else(|e| std::str::from_utf8(&head[..e.valid_up_to()]).unwrap_or(""));
    if is_pcd(text) {
        return named("a PCD point cloud", POINTS);
    }
    None
}

/// The header of a PCD file: comments, then the version and the fields.
fn is_pcd(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.next().is_some_and(|line| line.starts_with("VERSION"))
        && lines.next().is_some_and(|line| line.starts_with("FIELDS"))
}

/// What a PLY file is whose header declares vertices and nothing that connects them, and what to do.
pub(super) fn ply_points() -> String {
    format!("is a PLY point cloud (its header declares no element 'face'); {POINTS}")
}

/// What a file is by its extension, and what to do. For files without a mark in their first bytes.
pub(super) fn of_extension(path: &Path) -> Option<String> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    let (name, advice) = match extension.as_str() {
        "las" => ("a LAS point cloud", POINTS),
        "laz" => ("a LAZ point cloud", POINTS),
        "e57" => ("an E57 point cloud", POINTS),
        "pcd" => ("a PCD point cloud", POINTS),
        "xyz" | "pts" | "asc" => ("a text file of points", POINTS),
        "binvox" => ("a binvox volume", VOLUME),
        "nvdb" => ("a NanoVDB volume", VOLUME),
        "vdb" => ("an OpenVDB volume", VOLUME),
        "schem" | "schematic" | "litematic" | "nbt" => ("a schematic of Minecraft", BLOCKS),
        _ => return None,
    };
    Some(format!("is {name} by its extension; {advice}"))
}
