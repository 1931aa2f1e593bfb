//! Embree finds what the exact caster finds. Runs with the feature `embree` only.
#![cfg(feature = "embree")]

use esvo_builder::Mesh;
use esvo_core::Camera;
use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use esvo_cpu::triangles::{EmbreeRays, EmbreeScene, TriangleScene};
use esvo_scenes::generate::{bumpy_sphere_on_plane, sphere};
use glam::DVec3;

/// Largest relative error of `t` in single precision.
const TOLERANCE: f64 = 2e-5;
/// How far from a ray, in pixels, the ray may pass that finds what Embree found: single precision decides there at edges.
const NEAR: f64 = 0.005;

fn triangles(mesh: &Mesh) -> Vec<[[f64; 3]; 3]> {
    mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect()
}

/// A camera that looks at the middle of the triangles from outside their bounds.
fn camera(triangles: &[[[f64; 3]; 3]], from: DVec3) -> Camera {
    let corners = || triangles.iter().flatten().map(|&p| DVec3::from(p));
    let (lo, hi) = (corners().reduce(DVec3::min).unwrap(), corners().reduce(DVec3::max).unwrap());
    let reach = (hi - lo).length();
    let eye = (lo + hi) * 0.5 + from.normalize() * reach * 0.7;
    let forward = (lo + hi) * 0.5 - eye;
    Camera {
        eye: eye.into(),
        forward: forward.into(),
        up: [0.1, 1.0, 0.2],
        fov_degrees: 50.0,
        near: reach * 1e-3,
        far: reach * 3.0,
    }
}

/// The rays for which Embree found what the exact caster finds neither for the ray nor close to it, and the number of those for
/// which it finds it only close to it.
fn compare(scene: &TriangleScene, rays: &CameraRays, found: &[TriangleHit]) -> (Vec<usize>, usize) {
    let same = |ray: &ExactRay, found: &TriangleHit| {
        let exact = scene.cast_exact_ray(ray);
        exact.triangle == found.triangle && (found.is_miss() || (found.t - exact.t).abs() <= TOLERANCE * exact.t)
    };
    let (mut wrong, mut close) = (Vec::new(), 0);
    for (index, found) in found.iter().enumerate() {
        let ray = rays.ray_at(index);
        if same(&ray, found) {
            continue;
        }
        let around = (0..16).map(|k| (f64::from(k) * std::f64::consts::TAU / 16.0).sin_cos());
        let mut moved =
            around.map(|(y, x)| ExactRay { direction: ray.direction + (rays.dx * x + rays.dy * y) * NEAR, ..ray });
        if moved.any(|ray| same(&ray, found)) {
            close += 1;
        } else {
            wrong.push(index);
        }
    }
    (wrong, close)
}

fn cast(scene: &TriangleScene, at_once: EmbreeRays, rays: &CameraRays) -> Vec<TriangleHit> {
    // What an earlier picture left must not remain.
    let mut hits = vec![TriangleHit { t: 0.5, triangle: 0 }; 7];
    EmbreeScene::new(scene).unwrap().cast(at_once, rays, &mut hits);
    hits
}

#[test]
fn embree_finds_what_the_exact_caster_finds() {
    for (mesh, from) in [(sphere(4), DVec3::new(0.3, 0.4, 1.0)), (bumpy_sphere_on_plane(), DVec3::new(1.0, 0.5, -0.4))]
    {
        let triangles = triangles(&mesh);
        // From outside with an odd size; with a near plane that cuts the mesh; and a picture smaller than a tile.
        let outside = camera(&triangles, from);
        let cut = Camera { near: outside.far * 0.7 / 3.0, ..outside };
        let scene = TriangleScene::new(triangles).unwrap();
        for (camera, size) in [(outside, (211, 149)), (cut, (94, 61)), (outside, (3, 1))] {
            let rays = CameraRays::new(&camera, size).unwrap();
            for at_once in EmbreeRays::ALL {
                let found = cast(&scene, at_once, &rays);
                assert_eq!(found.len(), rays.pixels());
                let hits = found.iter().filter(|hit| !hit.is_miss()).count();
                assert!(hits * 10 > rays.pixels(), "{hits} of {} rays hit: the test tests little", rays.pixels());
                let (wrong, close) = compare(&scene, &rays, &found);
                assert_eq!(wrong, [0; 0], "{}: {} pixels", at_once.name(), rays.pixels());
                assert!(close * 200 <= rays.pixels(), "{}: {close} of {} at edges", at_once.name(), rays.pixels());
            }
        }
    }
}

/// A triangle takes 40 bytes at least (nine numbers and its index), and its share of nodes.
#[test]
fn the_size_of_the_hierarchy_is_known() {
    let triangles = triangles(&sphere(4));
    let least = triangles.len() as u64 * 40;
    let bytes = EmbreeScene::new(&TriangleScene::new(triangles).unwrap()).unwrap().resident_bytes();
    assert!((least..least * 6).contains(&bytes), "{bytes} bytes, at least {least}");
}

/// The negative controls of the test above: a triangle left out, and one moved by a thousandth of the mesh.
#[test]
fn one_wrong_triangle_is_noticed() {
    let whole = triangles(&sphere(4));
    let camera = camera(&whole, DVec3::new(0.3, 0.4, 1.0));
    let rays = CameraRays::new(&camera, (211, 149)).unwrap();
    let scene = TriangleScene::new(whole.clone()).unwrap();
    let middle = scene.cast_exact(&rays)[rays.pixels() / 2].triangle as usize;
    let seen = |hit: &TriangleHit| hit.triangle as usize == middle;
    let pixels = scene.cast_exact(&rays).iter().filter(|hit| seen(hit)).count();
    assert!(pixels > 10, "the triangle in the middle of the picture covers {pixels} pixels");

    let mut torn = whole.clone();
    torn[middle] = [torn[middle][0]; 3];
    let mut moved = whole;
    let towards = (DVec3::from(camera.eye) - DVec3::from(moved[middle][0])).normalize() * 2e-3;
    moved[middle] = moved[middle].map(|p| (DVec3::from(p) + towards).into());
    for (broken, how) in [(torn, "left out"), (moved, "moved")] {
        let broken = TriangleScene::new(broken).unwrap();
        for at_once in EmbreeRays::ALL {
            let (wrong, _) = compare(&scene, &rays, &cast(&broken, at_once, &rays));
            // Pixels at the edges of the triangle may count as close to a neighbour.
            assert!(wrong.len() * 2 > pixels, "{how}, {}: {} of {pixels} pixels", at_once.name(), wrong.len());
        }
    }
}

#[test]
fn scenes_without_triangles_or_area_are_missed() {
    let camera = camera(&triangles(&sphere(0)), DVec3::Z);
    let rays = CameraRays::new(&camera, (5, 3)).unwrap();
    for triangles in [Vec::new(), vec![[[0.0; 3]; 3], [[0.0; 3], [0.5; 3], [1.0; 3]]]] {
        let scene = TriangleScene::new(triangles).unwrap();
        for at_once in EmbreeRays::ALL {
            assert_eq!(cast(&scene, at_once, &rays), [TriangleHit::MISS; 15]);
        }
        let embree = EmbreeScene::new(&scene).unwrap();
        assert!(embree.is_native(EmbreeRays::Single));
        assert!(embree.resident_bytes() < 10_000, "{} bytes", embree.resident_bytes());
    }
}
