//! Shadow rays of surfaces that lie in no shadow.

use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::glam::DVec3;
use esvo_core::testing::sample::Noise;
use esvo_core::{Caster, HitPoint, Object, Ray};
use esvo_cpu::CpuCaster;

/// A flat floor, 10 wide, and a board above it, so that the floor's normals are stored with their usual errors.
fn floor() -> Mesh {
    let square = |low: f64, high: f64, height: f64| {
        [[low, height, low], [low, height, high], [high, height, high], [high, height, low]]
    };
    let positions = [square(0.0, 10.0, 0.0), square(3.8, 6.2, 2.0)].concat();
    Mesh::from_triangles(positions, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]).unwrap()
}

/// Points of the floor out of the board's shadow that are dark: with shadow rays, and with rays that start at the voxel.
fn dark(contours: bool, lamp: DVec3) -> [usize; 2] {
    let settings = BuildSettings { levels: 8, contours, ..BuildSettings::default() };
    let octree = Arc::new(build(&floor(), &settings, &|_| ()).unwrap().octree);
    let mut caster = CpuCaster::new(None).unwrap();
    caster.load(&octree).unwrap();
    let object = Object::of(&octree, 0);
    let object = if contours { object } else { object.without_contours() };
    let mut noise = Noise(5);
    let mut place = || noise.number() * 1.9 + 0.05;
    let rays: Vec<Ray> = (0..20_000)
        .map(|_| object.ray(DVec3::new(place(), 1.0, place()), DVec3::new(0.2, -1.0, 0.3), 0.0..f64::INFINITY))
        .collect();
    let mut hits = Vec::new();
    caster.cast_rays(&object.rays(&rays), &mut hits).unwrap();
    let points: Vec<HitPoint> =
        rays.iter().zip(&hits).filter_map(|(ray, hit)| HitPoint::new(&object, ray, hit)).collect();
    assert_eq!(points.len(), rays.len());
    let to_lamp = |point: &HitPoint| (lamp - point.position(), (lamp - point.position()).length());
    let shadow_rays: Vec<Ray> = points
        .iter()
        .map(|point| {
            let (way, distance) = to_lamp(point);
            assert!(point.shadow_ray(-way, distance).is_none(), "a lamp below the floor");
            point.shadow_ray(way, distance).expect("the floor faces the lamp")
        })
        .collect();
    let next_rays: Vec<Ray> = points
        .iter()
        .map(|point| {
            let (way, distance) = to_lamp(point);
            point.next_ray(way, distance)
        })
        .collect();
    [shadow_rays, next_rays].map(|rays| {
        caster.cast_rays(&object.rays(&rays), &mut hits).unwrap();
        hits.iter().filter(|hit| !hit.is_miss()).count()
    })
}

#[test]
fn a_flat_floor_does_not_shadow_itself() {
    let mut steps = 0;
    for lamp in [DVec3::new(5.0, 10.0, 5.0), DVec3::new(30.0, 30.0, 17.0)] {
        for contours in [false, true] {
            let [shadow_rays, next_rays] = dark(contours, lamp);
            println!(
                "lamp at {lamp}, contours {contours}: {shadow_rays} dark; {next_rays} by rays that start at the voxel"
            );
            assert_eq!(shadow_rays, 0, "lamp at {lamp}, contours {contours}");
            steps += next_rays;
        }
    }
    // What shadow rays are for: without the distance, steps between contours shadow the floor.
    assert!(steps > 0, "no steps");
}
