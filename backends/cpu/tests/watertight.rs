//! A closed mesh gives a closed octree: no ray from inside leaves it, contours or not, at any level.

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::Ray;
use esvo_core::reference::cast_ray;
use esvo_format::Octree;
use esvo_scenes::generate::{cube, sphere};
use glam::{DMat4, DQuat, DVec3, Vec3};

/// A small deterministic generator (splitmix64), in `-1.0..1.0`.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1u32 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}

/// Rays from around the middle of the root cube: at random, along axes and diagonals, in the planes between voxels, and
/// through their edges and corners.
fn rays(count: usize) -> impl Iterator<Item = Ray> {
    let mut random = Random(7);
    (0..count).map(move |i| {
        let snap = |v: Vec3, steps: f32| (v * steps).round() / steps;
        let mut origin = random.vector() * 0.1;
        let mut direction = random.vector();
        match i % 8 {
            0 => direction = Vec3::AXES[i / 8 % 3] * direction.x.signum(),
            1 => direction = snap(direction, 1.0),
            2 => direction[i / 8 % 3] = 0.0,
            // From one corner of a voxel towards another.
            3 => (origin, direction) = (snap(origin, 64.0), snap(direction, 256.0)),
            4 => origin = Vec3::ZERO,
            _ => {}
        }
        if direction == Vec3::ZERO {
            direction = Vec3::X;
        }
        let origin = Vec3::splat(1.5) + origin;
        Ray { origin, direction: direction * 4.0, t_min: 0.0, t_max: 1e6, size_at_origin: 0.0, size_per_t: 0.0 }
    })
}

fn leaks(octree: &Octree, count: usize) -> usize {
    let root = octree.objects()[0].root_slot as u32;
    rays(count).filter(|ray| cast_ray(octree, root, ray, true).is_miss()).count()
}

/// The mesh turned, so that its faces lie in no plane of voxels.
fn turned(mut mesh: Mesh) -> Mesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    mesh.transform(&DMat4::from_scale_rotation_translation(DVec3::splat(3.7), turn, DVec3::new(12.0, -5.0, 900.0)));
    mesh
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    for (name, mesh) in
        [("cube", cube()), ("turned cube", turned(cube())), ("sphere", sphere(3)), ("turned sphere", turned(sphere(2)))]
    {
        for levels in [1, 2, 5, 8, 11, 14, 23] {
            // Coarse bounds, so that the shapes of voxels are cut as far as they may be; few voxels at the deep end.
            let contour_error = f64::from(levels.min(9)) - 1.0;
            for contour_error in [contour_error, 9.0] {
                // Colours and normals would ask for the finest voxels along every edge.
                let attributes = BuildSettings { color_error: 256.0, normal_error: 2.0, ..BuildSettings::default() };
                let settings = BuildSettings { levels, contour_error, ..attributes };
                let octree = build(&mesh, &settings, &|_| ()).unwrap().octree;
                assert!(levels < 5 || contour_error < 9.0 || octree.needs().contours, "{name}, {levels} levels");
                let count = leaks(&octree, 20_000);
                assert_eq!(count, 0, "{name}, {levels} levels, contour error {contour_error}");
            }
        }
    }
}

#[test]
fn a_missing_triangle_is_a_leak() {
    let mut mesh = sphere(2);
    mesh.triangles.remove(17);
    mesh.triangle_materials.remove(17);
    let settings = BuildSettings { levels: 8, ..BuildSettings::default() };
    let octree = build(&mesh, &settings, &|_| ()).unwrap().octree;
    assert!(leaks(&octree, 20_000) > 10);
}
