use esvo_core::Camera;
use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use glam::DVec3;

use super::exact::{NOTHING, Sheared, nearer};
use super::testing::{Random, camera, mixed, ray, sphere};
use super::*;

/// Tests every triangle, one after the other.
fn brute_force(scene: &TriangleScene, ray: &ExactRay) -> TriangleHit {
    let Some(sheared) = Sheared::new(ray) else { return TriangleHit::MISS };
    let hits = scene
        .triangles()
        .iter()
        .enumerate()
        .filter_map(|(index, triangle)| sheared.meet(triangle).map(|t| TriangleHit { t, triangle: index as u32 }));
    let hit = hits.fold(NOTHING, nearer);
    if hit.is_miss() { TriangleHit::MISS } else { hit }
}

#[test]
fn the_tree_finds_what_trying_every_triangle_finds() {
    let mut random = Random(7);
    for count in [1, 2, 3, 10, 100, 700] {
        for offset in [DVec3::ZERO, DVec3::new(1e6, -3e5, 7e4)] {
            let moved = |p: [f64; 3]| (DVec3::from(p) + offset).into();
            let triangles = mixed(&mut random, count).into_iter().map(|t| t.map(moved)).collect();
            let scene = TriangleScene::new(triangles).unwrap();
            let mut hits = 0;
            for k in 0..2000 {
                let mut ray = ray(&mut random, k);
                ray.origin += offset;
                let hit = scene.cast_exact_ray(&ray);
                assert_eq!(hit, brute_force(&scene, &ray), "{count} triangles, {ray:?}");
                hits += usize::from(!hit.is_miss());
            }
            assert!(count < 100 || hits > 100, "{hits} of 2000 rays hit {count} triangles: the test tests nothing");
        }
    }
}

/// Compares with another method: the point where the ray meets the plane, by Cramer's rule, away from the edges.
#[test]
fn the_triangle_test_agrees_with_cramers_rule() {
    let mut random = Random(99);
    let (mut inside, mut outside) = (0, 0);
    for k in 0..20_000 {
        let triangle = [random.vector(), random.vector(), random.vector()];
        let ray = ExactRay { t_max: f64::MAX, ..ray(&mut random, 3 * k + 1) };
        let [a, b, c] = triangle;
        let (e, f, s) = (b - a, c - a, ray.origin - a);
        let normal = e.cross(f);
        let down = -ray.direction.dot(normal);
        let (t, turn) = (s.dot(normal) / down, s.cross(ray.direction));
        let (u, v) = (turn.dot(f) / down, -turn.dot(e) / down);
        let edge = u.min(v).min(1.0 - u - v);
        if down.abs() < 1e-3 || edge.abs() < 1e-6 || t.abs() < 1e-6 {
            continue;
        }
        let met = Sheared::new(&ray).unwrap().meet(&triangle);
        assert_eq!(met.is_some(), edge > 0.0 && t > 0.0, "{triangle:?} {ray:?} {u} {v} {t}");
        if let Some(met) = met {
            assert!((met - t).abs() < 1e-7 * t.max(1.0), "{met} {t}");
            inside += 1;
        } else {
            outside += 1;
        }
    }
    assert!(inside > 500 && outside > 500, "{inside} {outside}");
}

#[test]
fn no_ray_leaves_a_closed_sphere() {
    let mut random = Random(3);
    let triangles = sphere(4);
    let scene = TriangleScene::new(triangles.clone()).unwrap();
    let leaks = |direction: DVec3, origin: DVec3| {
        scene.cast_exact_ray(&ExactRay { origin, direction, t_min: 0.0, t_max: 1e9 }).is_miss()
    };
    for origin in [DVec3::ZERO, DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.0, 0.5, 0.0), DVec3::new(-0.9, 0.1, 0.2)] {
        // Rays to every corner and to points of every edge, where rounding decides.
        for triangle in &triangles {
            for k in 0..3 {
                let (a, b) = (DVec3::from(triangle[k]), DVec3::from(triangle[(k + 1) % 3]));
                for at in [0.0, 0.5, random.number(), random.number() * 1e-12] {
                    assert!(!leaks(a + (b - a) * at - origin, origin), "{origin} {a} {b} {at}");
                }
            }
        }
        for _ in 0..20_000 {
            let direction = random.vector();
            assert!(!leaks(direction, origin), "{origin} {direction}");
        }
    }
}

/// The negative control of the two tests above: without one triangle, rays leave.
#[test]
fn a_missing_triangle_is_noticed() {
    let whole = TriangleScene::new(sphere(3)).unwrap();
    let mut triangles = sphere(3);
    let gone = triangles.swap_remove(100);
    let torn = TriangleScene::new(triangles).unwrap();
    let middle = gone.iter().map(|&p| DVec3::from(p)).sum::<DVec3>() / 3.0;
    let ray = ExactRay { origin: DVec3::ZERO, direction: middle, t_min: 0.0, t_max: 1e9 };
    assert!(!whole.cast_exact_ray(&ray).is_miss());
    assert!(torn.cast_exact_ray(&ray).is_miss());

    let eye = middle * 4.0;
    let camera = Camera { eye: eye.into(), forward: (-middle).into(), up: [0.3, 0.9, 0.2], ..camera() };
    let rays = CameraRays::new(&camera, (64, 64)).unwrap();
    let (a, b) = (whole.cast_exact(&rays), torn.cast_exact(&rays));
    let deeper = a.iter().zip(&b).filter(|(a, b)| b.t > a.t + 0.05).count();
    assert!(deeper > 5, "{deeper} pixels see through the hole");
    let mut fast = Vec::new();
    torn.cast(&rays, &mut fast);
    let agree = fast.iter().zip(&b).filter(|(a, b)| (a.t - b.t).abs() < 1e-4).count();
    assert!(agree > 64 * 64 - 20, "{agree}");
}

#[test]
fn the_fast_caster_agrees_but_for_a_few_rays() {
    let mut random = Random(11);
    let far_away = DVec3::new(4e5, -2e5, 1e5);
    let mut triangles = sphere(5);
    triangles.extend(mixed(&mut random, 3000));
    for (offset, size) in [(DVec3::ZERO, (200, 150)), (far_away, (131, 67)), (DVec3::ZERO, (1, 1)), (far_away, (3, 9))]
    {
        let moved = triangles.iter().map(|t| t.map(|p| (DVec3::from(p) + offset).into())).collect();
        let scene = TriangleScene::new(moved).unwrap();
        let camera = Camera { eye: (DVec3::from(camera().eye) + offset).into(), ..camera() };
        let rays = CameraRays::new(&camera, size).unwrap();
        let exact = scene.cast_exact(&rays);
        let mut fast = vec![TriangleHit::MISS; 5];
        scene.cast(&rays, &mut fast);
        assert_eq!(fast.len(), rays.pixels());
        let off = |(a, b): &(&TriangleHit, &TriangleHit)| a.is_miss() != b.is_miss() || (a.t - b.t).abs() > 1e-5;
        let differing = fast.iter().zip(&exact).filter(off).count();
        assert!(differing * 500 <= rays.pixels(), "{differing} of {} rays differ", rays.pixels());
        for (index, (fast, exact)) in fast.iter().zip(&exact).enumerate() {
            // The ray does meet the triangle of the fast caster at that place.
            if !fast.is_miss() && !off(&(fast, exact)) && fast.triangle != exact.triangle {
                let met = Sheared::new(&rays.ray_at(index)).unwrap().meet(&scene.triangles()[fast.triangle as usize]);
                assert!(met.is_none_or(|t| (t - exact.t).abs() < 1e-5), "{index} {fast:?} {exact:?}");
            }
        }
        if size.0 > 10 {
            let hits = exact.iter().filter(|hit| !hit.is_miss()).count();
            assert!(hits > rays.pixels() / 4 && hits < rays.pixels(), "{hits} hits");
        }
        assert!(scene.time(&rays) > Duration::ZERO);
    }
}

#[test]
fn all_vectors_find_the_same() {
    let scene = TriangleScene::new(mixed(&mut Random(7), 900)).unwrap();
    for size in [(93, 61), (5, 3)] {
        let rays = CameraRays::new(&camera(), size).unwrap();
        let mut expected = Vec::new();
        scene.cast_with(Vectors::Arrays, &rays, &mut expected);
        assert!(expected.iter().any(|hit| !hit.is_miss()));
        for vectors in Vectors::available() {
            let mut hits = Vec::new();
            scene.cast_with(vectors, &rays, &mut hits);
            let same =
                |(a, b): (&TriangleHit, &TriangleHit)| a.t.to_bits() == b.t.to_bits() && a.triangle == b.triangle;
            assert!(hits.len() == expected.len() && hits.iter().zip(&expected).all(same), "{vectors:?}");
        }
    }
}

#[test]
fn depth_of_a_plane_is_its_distance() {
    let plane = |z: f64| {
        vec![[[-9.0, -9.0, z], [9.0, -9.0, z], [9.0, 9.0, z]], [[-9.0, -9.0, z], [9.0, 9.0, z], [-9.0, 9.0, z]]]
    };
    let camera = Camera { eye: [0.0; 3], forward: [0.0, 0.0, -2.0], ..camera() };
    let rays = CameraRays::new(&camera, (40, 30)).unwrap();
    for z in [-2.0, -7.5] {
        let scene = TriangleScene::new(plane(z)).unwrap();
        let mut fast = Vec::new();
        scene.cast(&rays, &mut fast);
        for (exact, fast) in scene.cast_exact(&rays).iter().zip(&fast) {
            assert!((exact.t - z / -10.0).abs() < 1e-15, "{exact:?}");
            assert!((fast.t - z / -10.0).abs() < 1e-6, "{fast:?}");
        }
    }
    // In front of the near plane, beyond the far plane, behind the eye.
    for z in [-0.005, -10.5, 1.0] {
        let scene = TriangleScene::new(plane(z)).unwrap();
        let mut fast = Vec::new();
        scene.cast(&rays, &mut fast);
        assert!(scene.cast_exact(&rays).iter().chain(&fast).all(|hit| *hit == TriangleHit::MISS), "{z}");
    }
}

#[test]
fn odd_input_is_refused_or_misses() {
    let scene = TriangleScene::new(Vec::new()).unwrap();
    let rays = CameraRays::new(&camera(), (5, 3)).unwrap();
    let mut hits = Vec::new();
    scene.cast(&rays, &mut hits);
    assert_eq!(hits, vec![TriangleHit::MISS; 15]);
    assert_eq!(scene.cast_exact(&rays), hits);

    let flat = TriangleScene::new(vec![[[0.5; 3]; 3], [[0.0; 3], [1.0; 3], [2.0; 3]]]).unwrap();
    flat.cast(&rays, &mut hits);
    assert_eq!(hits, vec![TriangleHit::MISS; 15]);
    assert_eq!(flat.cast_exact(&rays), hits);
    assert_eq!(flat.normal(0), DVec3::ZERO);

    for bad in [f64::NAN, f64::INFINITY, 1e200] {
        let error = TriangleScene::new(vec![[[0.0; 3], [1.0; 3], [0.0, bad, 1.0]]]).err().unwrap();
        assert!(error.to_string().contains("triangle 0"), "{error}");
    }
    let sphere = TriangleScene::new(sphere(0)).unwrap();
    for bad in [DVec3::NAN, DVec3::INFINITY, DVec3::ZERO] {
        let ray = ExactRay { origin: DVec3::ZERO, direction: bad, t_min: 0.0, t_max: 1.0 };
        assert_eq!(sphere.cast_exact_ray(&ray), TriangleHit::MISS);
    }
    assert_eq!(sphere.normal(0).length().round(), 1.0);
}

/// No box separates triangles in the same place.
#[test]
fn a_pile_of_equal_triangles_is_cast() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let scene = TriangleScene::new(vec![triangle; 5000]).unwrap();
    let rays = CameraRays::new(&camera(), (16, 16)).unwrap();
    let exact = scene.cast_exact(&rays);
    let mut fast = Vec::new();
    scene.cast(&rays, &mut fast);
    assert!(exact.iter().all(|hit| hit.is_miss() || hit.triangle == 0));
    assert!(exact.iter().any(|hit| !hit.is_miss()));
    assert!(exact.iter().zip(&fast).all(|(a, b)| a.is_miss() == b.is_miss() && (a.t - b.t).abs() < 1e-6));
}
