//! Triangles at which a voxelizer can go wrong, around and on the faces of voxels.

use esvo_builder::{Material, Mesh};
use glam::DVec3;

use crate::random::Random;

pub(crate) type Triangle = [DVec3; 3];

/// Two tiny triangles in opposite corners of the unit cube, so that it becomes the root cube.
pub(crate) fn pinned(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    let tiny = 1.0 / (1 << 20) as f64;
    for (corner, step) in [(DVec3::ZERO, tiny), (DVec3::ONE, -tiny)] {
        triangles.push([corner, corner + DVec3::X * step, corner + DVec3::Y * step]);
    }
    triangles
}

/// Triangles whose corners are corners of voxels of this level.
pub(crate) fn on_corners(random: &mut Random, bits: u32, count: usize) -> Vec<Triangle> {
    (0..count).map(|_| [0; 3].map(|_| random.point(bits))).collect()
}

/// Triangles in planes of voxel faces of this level, with corners anywhere in the planes or on corners of voxels.
pub(crate) fn walls(random: &mut Random, bits: u32, count: usize) -> Vec<Triangle> {
    (0..count)
        .map(|i| {
            let at = random.unit(bits);
            let fine = if i % 2 == 0 { bits } else { 30 };
            [0; 3].map(|_| {
                let mut p = random.point(fine);
                p[i % 3] = at;
                p
            })
        })
        .collect()
}

/// Long thin triangles of this width, and triangles whose third corner is almost on the line between the others.
pub(crate) fn slivers(random: &mut Random, bits: u32, width: f64, count: usize) -> Vec<Triangle> {
    (0..count)
        .map(|i| {
            let (a, b) = (random.point(bits) * 0.5, random.point(bits) * 0.5 + 0.5);
            let off = (random.point(3) - 0.5) * width;
            if i % 2 == 0 { [a, b, b + off] } else { [a, (a + b) * 0.5 + off, b] }
        })
        .collect()
}

/// Triangles smaller than a voxel of level `level`, around corners of such voxels.
pub(crate) fn crumbs(random: &mut Random, level: u32, count: usize) -> Vec<Triangle> {
    let voxel = (-f64::from(level)).exp2();
    (0..count)
        .map(|i| {
            let corner = random.point(level.min(10)).max(DVec3::splat(voxel));
            [0; 3].map(|_| {
                let mut off = (random.point(8) - 0.5) * voxel;
                // Some touch the voxels' corner, or a plane through it, with one of their corners or edges.
                if i % 3 == 0 {
                    off[i / 3 % 3] = off[i / 3 % 3].max(0.0);
                }
                corner + off
            })
        })
        .collect()
}

/// Triangles almost parallel to a plane between voxels that cross it at a slope of about `2^-44`.
pub(crate) fn grazing(random: &mut Random, level: u32, count: usize) -> Vec<Triangle> {
    (0..count)
        .map(|i| {
            let at = (random.unit(level - 1) * 2.0f64.powi(level as i32 - 1) * 2.0 + 1.0) / 2.0f64.powi(level as i32);
            let slope = 2.0f64.powi(-40 - (random.next() % 8) as i32);
            [0; 3].map(|_| {
                let mut p = random.point(53);
                p[i % 3] = at + (random.unit(8) - 0.5) * slope;
                p
            })
        })
        .collect()
}

/// A mesh of separate triangles.
pub(crate) fn mesh_of(triangles: &[Triangle]) -> Mesh {
    Mesh {
        positions: triangles.iter().flatten().map(|p| p.to_array()).collect(),
        triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; triangles.len()],
        materials: vec![Material::default()],
        ..Mesh::default()
    }
}
