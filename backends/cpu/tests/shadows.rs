//! Shadow rays of surfaces that lie in no shadow.

use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::glam::DVec3;
use esvo_core::lights::{Light, shade_lit};
use esvo_core::testing::sample::Noise;
use esvo_core::{Camera, CastOptions, Caster, HitPoint, Nearest, Object, Ray, View};
use esvo_cpu::CpuCaster;

/// A flat floor, 10 wide, and a board above it, so that the floor's normals are stored with their usual errors.
fn floor() -> Mesh {
    facing(true)
}

/// The same, facing upwards or downwards.
fn facing(up: bool) -> Mesh {
    let square = |low: f64, high: f64, height: f64| {
        [[low, height, low], [low, height, high], [high, height, high], [high, height, low]]
    };
    let positions = [square(0.0, 10.0, 0.0), square(3.8, 6.2, 2.0)].concat();
    let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let triangles = triangles.map(|[a, b, c]| if up { [a, b, c] } else { [a, c, b] });
    Mesh::from_triangles(positions, triangles.to_vec()).unwrap()
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

/// The floor and the board from above, lit from above: the floor is dark exactly where the board is between it and the light.
#[test]
fn boards_cast_shadows_where_they_should() {
    boards_cast_shadows(true);
}

/// Sides that face away are lit as those that are seen.
#[test]
fn boards_that_face_away_cast_the_same_shadows() {
    boards_cast_shadows(false);
}

fn boards_cast_shadows(up: bool) {
    let settings = BuildSettings { levels: 8, ..BuildSettings::default() };
    let octree = Arc::new(build(&facing(up), &settings, &|_| ()).unwrap().octree);
    let mut caster = CpuCaster::new(None).unwrap();
    caster.load(&octree).unwrap();
    let camera = Camera {
        eye: [5.0, 9.0, 5.001],
        forward: [0.0, -1.0, 0.0],
        up: [0.0, 0.0, 1.0],
        fov_degrees: 50.0,
        near: 0.1,
        far: 20.0,
    };
    let size = (96, 96);
    let root = octree.objects()[0].root_slot as u32;
    let view = View::new(&camera, octree.octree_to_mesh(0), root, size, &CastOptions::default()).unwrap();
    let nearest = Nearest::cast(&mut caster, &[view]).unwrap();
    let object = Object::of(&octree, 0);
    for light in [
        Light::Directional { to_light: DVec3::new(1.0, 1.0, 0.3) },
        Light::Point { position: DVec3::new(2.0, 6.0, 5.0) },
        Light::Spot {
            position: DVec3::new(2.0, 6.0, 5.0),
            direction: DVec3::new(1.0, -2.0, 0.0),
            angle_degrees: 150.0,
        },
    ] {
        let mut shade = |shadows| shade_lit(&mut caster, &octree, &[view], &nearest, &[light], shadows).unwrap();
        let (with, without) = (shade(true), shade(false));
        let mut counts = [0; 2];
        for (pixel, hit) in nearest.hits.iter().enumerate() {
            let (x, y) = (pixel as u32 % size.0, pixel as u32 / size.0);
            let Some(point) = HitPoint::new(&object, &view.ray(x, y), hit) else { continue };
            let place = point.position();
            let way = match light {
                Light::Directional { to_light } => to_light,
                Light::Point { position } | Light::Spot { position, .. } => position - place,
                Light::Sky => continue,
            };
            // Where the way to the light passes the board's height.
            let over = place + way * ((2.0 - place.y) / way.y);
            let inside = |margin: f64| [over.x, over.z].iter().all(|c| (3.8 + margin..6.2 - margin).contains(c));
            let dark = with.pixel(x, y) != without.pixel(x, y);
            if place.y < 1.0 && inside(0.15) {
                assert!(dark, "{light:?}: {place} is in the shadow");
                counts[0] += 1;
            } else if place.y > 1.0 || !inside(-0.15) {
                assert!(!dark, "{light:?}: {place} is not in the shadow");
                counts[1] += 1;
            }
        }
        assert!(counts[0] > 100 && counts[1] > 1000, "{light:?}: {counts:?}");
    }
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
