//! A closed mesh gives a closed octree: no ray from inside leaves it, contours or not, at any level.

use std::sync::Arc;

use esvo_builder::{
    BuildSettings, DisplaceOptions, HeightMap, LinearTexture, Mesh, UvTransform, build, build_displaced,
};
use esvo_core::reference::cast_ray;
use esvo_core::{Caster, Fan, Fans, Ray};
use esvo_cpu::CpuCaster;
use esvo_format::Octree;
use esvo_scenes::generate::{cube, sphere};
use glam::{DMat4, DQuat, DVec3, Mat3, Vec3};

/// Deterministic numbers in `-1.0..1.0` (splitmix64).
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

    /// In the unit ball, not at its centre.
    fn in_ball(&mut self) -> Vec3 {
        loop {
            let v = self.vector();
            if (1e-3..=1.0).contains(&v.length()) {
                return v;
            }
        }
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

/// Number of the special rays that leave.
fn leaks(octree: &Octree, count: usize) -> usize {
    let root = octree.objects()[0].root_slot as u32;
    rays(count).filter(|ray| cast_ray(octree, root, ray, true).is_miss()).count()
}

/// Rays per origin: one packet of the caster.
const FAN: usize = 16;

/// Number of rays that leave, of `count` with random directions that start at random within a quarter of the root cube's
/// edge from its middle.
fn leaving(octree: &Arc<Octree>, caster: &mut CpuCaster, count: usize, seed: u64) -> usize {
    caster.load(octree).unwrap();
    let root = octree.objects()[0].root_slot as u32;
    let mut random = Random(seed);
    let (mut left, mut leaving, mut hits) = (count / FAN, 0, Vec::new());
    while left > 0 {
        // 4096 origins share a bundle of directions, which is turned and stretched for each origin.
        let directions: [Vec3; FAN] = std::array::from_fn(|_| random.in_ball().normalize());
        let fans: Vec<Fan> = (0..left.min(4096))
            .map(|_| {
                let (a, b, c) = (random.in_ball(), random.in_ball(), random.in_ball());
                let axes = Mat3::from_cols(a, b, c);
                let axes = if axes.determinant().abs() > 0.05 { axes * 100.0 } else { Mat3::IDENTITY * 4.0 };
                Fan { origin: Vec3::splat(1.5) + random.in_ball() * 0.25, axes }
            })
            .collect();
        caster.cast_fans(&Fans { root, contours: true, fans: &fans, directions: &directions }, &mut hits).unwrap();
        leaving += hits.iter().filter(|hit| hit.is_miss()).count();
        left -= fans.len();
    }
    leaving
}

/// The mesh, turned so that its faces lie in no plane between voxels.
fn turned(mut mesh: Mesh) -> Mesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    mesh.transform(&DMat4::from_scale_rotation_translation(DVec3::splat(3.7), turn, DVec3::new(12.0, -5.0, 900.0)));
    mesh
}

/// Settings under which only the shape decides where voxels are split. Colours and normals would split along every edge.
fn shape_only(levels: u32, contour_error: f64) -> BuildSettings {
    BuildSettings { levels, contour_error, color_error: 256.0, normal_error: 2.0, ..BuildSettings::default() }
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    for (name, mesh) in
        [("cube", cube()), ("turned cube", turned(cube())), ("sphere", sphere(3)), ("turned sphere", turned(sphere(2)))]
    {
        for levels in [1, 2, 5, 8, 11, 14, 23] {
            // Coarse error bounds cut the shapes of voxels as far as they may be cut, and keep deep octrees small.
            let contour_error = f64::from(levels.min(9)) - 1.0;
            for contour_error in [contour_error, 9.0] {
                let octree = build(&mesh, &shape_only(levels, contour_error), &|_| ()).unwrap().octree;
                assert!(levels < 5 || contour_error < 9.0 || octree.needs().contours, "{name}, {levels} levels");
                let count = leaks(&octree, 20_000);
                assert_eq!(count, 0, "{name}, {levels} levels, contour error {contour_error}");
            }
        }
    }
}

/// At every level from 1 to 12, with contours as tight as the level allows and with coarse ones.
fn check_random_rays(count: usize) {
    let mut caster = CpuCaster::new(None).unwrap();
    for (name, mesh) in [("turned cube", turned(cube())), ("turned sphere", turned(sphere(3)))] {
        for levels in 1..=12 {
            for contour_error in [f64::from(levels), f64::from(levels) - 1.0] {
                let octree = Arc::new(build(&mesh, &shape_only(levels, contour_error), &|_| ()).unwrap().octree);
                let leaving = leaving(&octree, &mut caster, count, u64::from(levels));
                println!(
                    "| {name} | {levels} | {contour_error} | {} | {} | {count} | {leaving} |",
                    octree.objects()[0].leaf_voxels,
                    octree.parts().iter().map(|p| u64::from(p.contour_count)).sum::<u64>()
                );
                assert_eq!(leaving, 0, "{name}, {levels} levels, contour error {contour_error}");
            }
        }
    }
}

#[test]
fn no_random_ray_leaves_a_closed_mesh_at_any_level() {
    check_random_rays(1 << 16);
}

#[test]
#[ignore = "long: a minute in release"]
fn ten_million_random_rays_never_leave() {
    check_random_rays(10_000_000);
}

/// A sphere with bumps of about a tenth of its radius.
fn bumpy_sphere() -> Mesh {
    let mut mesh = sphere(2);
    mesh.uvs = mesh.positions.iter().map(|p| [p[0] as f32, p[1] as f32 + 0.3 * p[2] as f32]).collect();
    let mut random = Random(5);
    let texels = (0..32 * 32).map(|_| [(random.next() * 32767.0 + 32767.0) as u16]).collect();
    let texture = Arc::new(LinearTexture::new(32, 32, texels).unwrap());
    let map = HeightMap { texture, amplitude: 0.1, bias: -0.05, uv_transform: UvTransform::IDENTITY };
    mesh.materials.iter_mut().for_each(|material| material.height_map = Some(map.clone()));
    mesh
}

/// In subtrees of some 4000 small triangles, of which there are many on the deeper levels.
fn displaced(mesh: &Mesh, levels: u32) -> Arc<Octree> {
    let options = DisplaceOptions { max_triangles: 4000, ..DisplaceOptions::for_levels(mesh, levels, 1.0) };
    Arc::new(build_displaced(mesh, &options, &shape_only(levels, f64::from(levels)), &|_| ()).unwrap().octree)
}

#[test]
fn no_ray_leaves_a_closed_mesh_that_is_displaced_subtree_by_subtree() {
    let mut caster = CpuCaster::new(None).unwrap();
    for levels in [5, 7, 9] {
        let octree = displaced(&bumpy_sphere(), levels);
        assert_eq!(leaks(&octree, 20_000), 0, "{levels} levels");
        assert_eq!(leaving(&octree, &mut caster, 1 << 17, u64::from(levels)), 0, "{levels} levels");
    }
}

#[test]
fn a_missing_displaced_triangle_is_a_leak() {
    let mut mesh = bumpy_sphere();
    mesh.triangles.remove(17);
    mesh.triangle_materials.remove(17);
    let octree = displaced(&mesh, 8);
    assert!(leaving(&octree, &mut CpuCaster::new(None).unwrap(), 20_000, 1) > 10);
}

#[test]
fn a_missing_triangle_is_a_leak() {
    let mut mesh = sphere(2);
    mesh.triangles.remove(17);
    mesh.triangle_materials.remove(17);
    let settings = BuildSettings { levels: 8, ..BuildSettings::default() };
    let octree = Arc::new(build(&mesh, &settings, &|_| ()).unwrap().octree);
    assert!(leaks(&octree, 20_000) > 10);
    assert!(leaving(&octree, &mut CpuCaster::new(None).unwrap(), 20_000, 1) > 10);
}
