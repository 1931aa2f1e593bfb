//! Casting a mesh with cut-outs: rays pass through points whose alpha is below the material's cutoff.

use esvo_builder::Mesh;
use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use esvo_cpu::triangles::TriangleScene;
use glam::DVec3;

use crate::picture_bench::mesh_picture::Looked;

/// Maximum number of holes that one ray passes. Without it, a ray in the plane of a cut-out triangle might never end.
const MOST_HOLES: usize = 256;

/// What the rays of a picture hit first that is no hole, in double precision: as [`TriangleScene::cast_exact`] where no
/// material of the mesh is cut out. Textures are read at
/// full resolution: averaged alpha would close small holes or open small leaves. `triangles` are those of the mesh.
pub(crate) fn cast_solid(mesh: &Mesh, triangles: &TriangleScene, rays: &CameraRays) -> Vec<TriangleHit> {
    let mut hits = triangles.cast_exact(rays);
    if mesh.materials.iter().all(|m| m.alpha_cutoff.is_none()) {
        return hits;
    }
    for (index, hit) in hits.iter_mut().enumerate() {
        *hit = through_holes(mesh, triangles, rays.ray_at(index), *hit);
    }
    hits
}

/// What one ray hits first that is no hole: see [`cast_solid`].
pub(crate) fn cast_solid_ray(mesh: &Mesh, triangles: &TriangleScene, ray: ExactRay) -> TriangleHit {
    through_holes(mesh, triangles, ray, triangles.cast_exact_ray(&ray))
}

/// Where a ray goes on to that hits something first.
fn through_holes(mesh: &Mesh, triangles: &TriangleScene, mut ray: ExactRay, mut hit: TriangleHit) -> TriangleHit {
    for _ in 0..MOST_HOLES {
        if hit.is_miss() || !is_hole(mesh, hit.triangle as usize, &ray, hit.t) {
            break;
        }
        // Continue from the next larger number: other triangles at exactly this depth count as part of the hole.
        ray.t_min = hit.t.next_up();
        hit = triangles.cast_exact_ray(&ray);
    }
    hit
}

/// Whether the point of a triangle that a ray hits at `t` is cut out.
fn is_hole(mesh: &Mesh, triangle: usize, ray: &ExactRay, t: f64) -> bool {
    let material = &mesh.materials[mesh.triangle_materials[triangle] as usize];
    let Some(cutoff) = material.alpha_cutoff else { return false };
    let point: DVec3 = ray.origin + ray.direction * t;
    Looked::at(mesh, triangle, point, 0.0).alpha() < cutoff
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_builder::{Material, MipLevel, Texture, Wrap};
    use esvo_core::Camera;

    use super::*;

    /// Two squares one behind the other; the nearer is cut out where its texture is, on the left half.
    fn mesh() -> Mesh {
        let square = |z: f64| [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]];
        let texels = vec![[255, 255, 255, 0], [255, 255, 255, 0], [255, 255, 255, 255], [255, 255, 255, 255]];
        let texture = Texture { mips: vec![MipLevel { width: 4, height: 1, texels }], wrap: [Wrap::Repeat; 2] };
        let cut = Material { texture: Some(Arc::new(texture)), alpha_cutoff: Some(0.5), ..Material::default() };
        Mesh {
            positions: [square(0.0), square(-1.0)].concat(),
            uvs: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].repeat(2),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            triangle_materials: vec![0, 0, 1, 1],
            materials: vec![cut, Material::default()],
            ..Mesh::default()
        }
    }

    #[test]
    fn rays_go_on_through_holes_and_only_there() {
        let mesh = mesh();
        let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        let triangles = TriangleScene::new(corners).unwrap();
        let camera = Camera {
            eye: [0.0, 0.0, 4.0],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 20.0,
            near: 0.1,
            far: 10.0,
        };
        let rays = CameraRays::new(&camera, (32, 32)).unwrap();
        let hits = cast_solid(&mesh, &triangles, &rays);
        let depth = |x: usize| hits[16 * 32 + x].t * 10.0;
        // From 0.25 to 0.75 of the texture alpha rises evenly from 0 to 1, and beyond it wraps to 0 again: x = 0 is 0.5.
        assert!((depth(4) - 5.0).abs() < 1e-9 && (depth(14) - 5.0).abs() < 1e-9, "{} {}", depth(4), depth(14));
        assert!((depth(17) - 4.0).abs() < 1e-9 && (depth(24) - 4.0).abs() < 1e-9, "{} {}", depth(17), depth(24));
        let whole = triangles.cast_exact(&rays);
        assert!((whole[16 * 32 + 4].t * 10.0 - 4.0).abs() < 1e-9, "there is something to go through");
    }
}
