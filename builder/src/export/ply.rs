//! Points of a `.ply` file, binary, little-endian.

use std::io::{self, Write};

use esvo_format::Octree;
use glam::DVec3;

use super::cubes::visit;

/// Writes a point for each voxel of the level and each leaf above it; there are `points` of them.
pub(super) fn write(out: &mut dyn Write, octree: &Octree, object: usize, level: u32, points: u64) -> io::Result<()> {
    let needs = octree.needs();
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment voxels of an octree at level {level}, at their centres\n\
         element vertex {points}\nproperty float x\nproperty float y\nproperty float z\n"
    );
    if needs.normals {
        header += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if needs.colors {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    header += "property float size\nend_header\n";
    out.write_all(header.as_bytes())?;
    let to_mesh = octree.octree_to_mesh(object);
    // Of a cube that is stretched, the geometric mean of its edges.
    let edge = to_mesh.determinant().abs().cbrt();
    visit(octree, object, level, &mut |voxel, _| {
        let size = (-f64::from(voxel.level)).exp2();
        let centre = DVec3::from(voxel.position.map(|x| (f64::from(x) + 0.5) * size));
        let mut row = Vec::with_capacity(32);
        let mut floats = |values: [f32; 3]| values.iter().for_each(|x| row.extend_from_slice(&x.to_le_bytes()));
        floats(to_mesh.transform_point3(centre).as_vec3().to_array());
        if needs.normals {
            floats(voxel.normal.unwrap_or(glam::Vec3::Z).to_array());
        }
        if needs.colors {
            row.extend_from_slice(&voxel.color.unwrap_or([255; 3]));
        }
        row.extend_from_slice(&((size * edge) as f32).to_le_bytes());
        out.write_all(&row)
    })
}
