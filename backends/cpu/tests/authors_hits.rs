//! Every instruction set compared with the authors' caster, on octrees that the authors' builder made.
//!
//! As lists, the authors' rays are cast themselves. They cannot be the rays of a [`View`]: each starts on the near plane, at a
//! point of its own, where its voxel size is not zero; rays of a view start at the eye. So pictures are cast with the view
//! of the same camera, whose rays are the authors' up to rounding, and compared in every bit with the picture of the
//! reference caster, and by the voxels with the authors' hits.
//!
//! Without the files, which are not in the repository, the tests are skipped.

use std::sync::Arc;

use esvo_core::reference::{ReferenceCaster, cast_ray};
use esvo_core::testing::authors::{Difference, Record, SIZE, Scene, scenes};
use esvo_core::{Caster, FLAG_BEAM, FLAG_CONTOURS, Hit, Ray, Rays, View};
use esvo_cpu::{CpuCaster, InstructionSet};
use glam::{DVec3, Vec3};

/// What of a hit must be equal; `iterations` of pictures are those of packets.
fn bits(hits: &[Hit]) -> Vec<(u32, u32, u32)> {
    hits.iter().map(|hit| (hit.raw_t.to_bits(), hit.slot, hit.voxel)).collect()
}

/// A caster for each instruction set of this processor.
fn casters() -> impl Iterator<Item = (InstructionSet, CpuCaster)> {
    InstructionSet::available().map(|set| (set, CpuCaster::with_instructions(Some(2), set).expect("is available")))
}

/// The view of the camera of these rays, from the left of the top row.
///
/// Where the voxel size of a ray is zero, it is at the eye: at the `t` of `eye`. From there to the far plane it is `1 - eye`
/// times as long as from the near plane.
fn view(scene: &Scene, records: &[Record], flags: u32) -> View {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let ray = |x: usize, y: usize| &records[(height - 1 - y) * width + x].ray;
    let Ray { size_at_origin, size_per_t, .. } = *ray(0, 0);
    let eye = -f64::from(size_at_origin) / f64::from(size_per_t);
    let direction = |x: usize, y: usize| ray(x, y).direction.as_dvec3() * (1.0 - eye);
    let (first, right, below) = (direction(0, 0), direction(width - 1, 0), direction(0, height - 1));
    let (dx, dy) = ((right - first) / (width - 1) as f64, (below - first) / (height - 1) as f64);
    let origins = records.iter().map(|r| r.ray.origin.as_dvec3() + r.ray.direction.as_dvec3() * eye);
    let single = |v: DVec3| v.as_vec3().to_array();
    View {
        origin: single(origins.sum::<DVec3>() / records.len() as f64),
        t_near: (-eye / (1.0 - eye)) as f32,
        base: single(first - (dx + dy) * 0.5),
        pixel_size: size_at_origin + size_per_t,
        dx: single(dx),
        max_voxel_pixels: 1.0,
        dy: single(dy),
        t_per_depth: (1.0 / dx.cross(dy).normalize().dot(first).abs()) as f32,
        width: SIZE.0,
        height: SIZE.1,
        root: scene.octree.objects()[0].root_slot as u32,
        flags,
        first_row: 0,
        padding: [0; 3],
    }
}

#[test]
fn lists_of_rays_hit_what_the_authors_hit() {
    for scene in scenes(env!("CARGO_MANIFEST_DIR")).into_iter().flatten() {
        let root = scene.octree.objects()[0].root_slot as u32;
        let octree = Arc::new(scene.octree);
        for (set, mut caster) in casters() {
            caster.load(&octree).expect("can be addressed");
            for (camera, records) in scene.cameras.iter().enumerate() {
                let rays: Vec<Ray> = records.iter().map(|record| record.ray).collect();
                let mut hits = Vec::new();
                caster.cast_rays(&Rays { root, contours: true, rays: &rays }, &mut hits).expect("are cast");
                let reference: Vec<Hit> = rays.iter().map(|ray| cast_ray(&octree, root, ray, true)).collect();
                assert_eq!(bits(&hits), bits(&reference), "{set}, {}, camera {camera}", scene.name);
                let difference = Difference::of(records, &hits);
                assert!(difference.hits > 12_000, "{difference:?}");
                assert_eq!(difference.wrong() + difference.t + difference.iterations, 0, "{set}: {difference:?}");
            }
        }
    }
}

#[test]
fn pictures_hit_what_the_reference_hits_and_nearly_always_what_the_authors_hit() {
    for mut scene in scenes(env!("CARGO_MANIFEST_DIR")).into_iter().flatten() {
        let cameras = std::mem::take(&mut scene.cameras);
        let views: Vec<Vec<View>> = [FLAG_CONTOURS, FLAG_CONTOURS | FLAG_BEAM, 0]
            .map(|flags| cameras.iter().map(|records| view(&scene, records, flags)).collect())
            .into();
        let octree = Arc::new(scene.octree);
        let mut reference = ReferenceCaster::default();
        reference.load(&octree).expect("is sound");
        for (set, mut caster) in casters() {
            caster.load(&octree).expect("can be addressed");
            for (camera, view) in views.iter().flat_map(|views| views.iter().enumerate()) {
                let (mut hits, mut expected) = (Vec::new(), Vec::new());
                caster.cast(view, &mut hits).expect("is cast");
                reference.cast(view, &mut expected).expect("is cast");
                assert_eq!(bits(&hits), bits(&expected), "{set}, {}, camera {camera}, {view:?}", scene.name);
                if view.flags & FLAG_CONTOURS == 0 {
                    continue;
                }
                // The authors' first row is at the bottom, and their `t` is 0 at the near plane and 1 at the far plane.
                let near = view.t_near;
                let turned: Vec<Hit> = hits.chunks(SIZE.0 as usize).rev().flatten().copied().collect();
                let turned: Vec<Hit> = turned
                    .into_iter()
                    .map(
                        |hit| if hit.is_miss() { hit } else { Hit { raw_t: (hit.raw_t - near) / (1.0 - near), ..hit } },
                    )
                    .collect();
                let difference = Difference::of(&cameras[camera], &turned);
                println!("{set}, {}, camera {camera}, flags {}: {difference:?}", scene.name, view.flags);
                assert!(difference.hits > 12_000, "{difference:?}");
                assert!(difference.wrong() <= 3, "{set}: {difference:?}");
                assert!(difference.worst_t < 1e-5, "{set}: {difference:?}");
            }
        }
    }
}

/// The comparison of lists notices a ray that is another one.
#[test]
fn rays_that_are_turned_hit_other_voxels() {
    for scene in scenes(env!("CARGO_MANIFEST_DIR")).into_iter().flatten() {
        let root = scene.octree.objects()[0].root_slot as u32;
        let mut caster = CpuCaster::new(Some(2)).expect("starts");
        caster.load(&Arc::new(scene.octree)).expect("can be addressed");
        let turn = |ray: Ray| Ray { direction: ray.direction + Vec3::splat(0.05), ..ray };
        let rays: Vec<Ray> = scene.cameras[0].iter().map(|record| turn(record.ray)).collect();
        let mut hits = Vec::new();
        caster.cast_rays(&Rays { root, contours: true, rays: &rays }, &mut hits).expect("are cast");
        let difference = Difference::of(&scene.cameras[0], &hits);
        assert!(difference.wrong() + difference.t > difference.rays / 2, "{difference:?}");
    }
}
