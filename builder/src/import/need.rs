//! How much memory a file needs to be read, told before it is parsed: never more than it takes, so that nothing is refused that would
//! fit.

use std::path::Path;

use super::error::ImportError;
use super::file::Format;
use super::{ply_file, stl};

/// Bytes of a vertex of a mesh: its position alone.
const VERTEX: u64 = 24;
/// Bytes of a triangle of a mesh: its corners and its material.
const TRIANGLE: u64 = 16;

/// Refuses what needs more than the limit.
pub(super) fn check(path: &Path, least: u64, limit: u64) -> Result<(), ImportError> {
    if least <= limit { Ok(()) } else { Err(ImportError::Memory { path: path.into(), limit, least }) }
}

/// Bytes of an STL file of `length` bytes with this head. A closed mesh has half as many vertices as triangles; while it is read,
/// their numbers are looked up by their positions. Text takes at least 170 bytes for a triangle, and is held as a whole.
pub(super) fn of_stl(head: &[u8], length: u64) -> u64 {
    if stl::is_text(head, length) {
        return length + length / 300 * (TRIANGLE + VERTEX / 2);
    }
    // The header may be wrong about the number, and is then refused or ignored later.
    let triangles = length.saturating_sub(stl::HEADER as u64) / stl::FACET as u64;
    triangles * (TRIANGLE + (VERTEX + 32) / 2)
}

/// Bytes of any other file with this content.
pub(super) fn of_bytes(format: Format, bytes: &[u8]) -> u64 {
    let length = bytes.len() as u64;
    let mesh = match format {
        Format::Obj => of_obj(bytes),
        Format::Ply => of_ply(bytes),
        // The buffers may be elsewhere, and what they hold may be shown many times: known only when all is read.
        Format::Gltf | Format::Glb | Format::Stl | Format::Vox => 0,
    };
    length + mesh
}

/// What an OBJ file takes besides its text, which is written anew for the parser while the old one is there: while it is parsed,
/// 24 bytes for a position, 12 for a normal and at least 72 for a face.
fn of_obj(bytes: &[u8]) -> u64 {
    let (mut vertices, mut faces) = (0, 0);
    for line in bytes.split(|&byte| byte == b'\n') {
        match line {
            [b'v', b' ' | b'\t', ..] => vertices += 1,
            [b'f', b' ' | b'\t', ..] => faces += 1,
            _ => {}
        }
    }
    let lines: u64 = 8 * (vertices + faces);
    lines + (vertices * VERTEX).max(faces * 72)
}

fn of_ply(bytes: &[u8]) -> u64 {
    let Ok((header, _)) = ply_file::read_header(bytes) else { return 0 };
    let count = |name: &str| -> u64 {
        // Not more than the bytes could hold, whatever the header says.
        header.elements.iter().filter(|e| e.name == name).map(|e| (e.count as u64).min(bytes.len() as u64)).sum()
    };
    count("vertex") * VERTEX + count("face") * TRIANGLE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_follow_the_counts() {
        let obj = b"v 0 0 0\nv\t1 0 0\nvn 0 0 1\nf 1 2 1\nf 1 2 2\nfo 1 1 1\n# f 1\n";
        assert_eq!(of_bytes(Format::Obj, obj), obj.len() as u64 + 8 * 4 + 2 * 72);
        let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nelement face 2\nproperty list uchar int vertex_index\nend_header\n";
        assert_eq!(of_bytes(Format::Ply, ply), ply.len() as u64 + 3 * 24 + 2 * 16);
        assert_eq!(of_bytes(Format::Glb, &[0; 7]), 7);
        assert_eq!(of_stl(&[0; 84], 84 + 50 * 1000), 44_000);
        assert!(of_stl(b"solid x\nfacet normal 0 0 0", 3_000_000) > 3_000_000);
        let path = Path::new("m.obj");
        assert!(check(path, 5, 5).is_ok());
        let text = check(path, 6_000_001, 5_999_999).unwrap_err().to_string();
        assert_eq!(text, "m.obj: a memory limit of 5 MB is too small to read it: that needs at least 7 MB");
    }
}
