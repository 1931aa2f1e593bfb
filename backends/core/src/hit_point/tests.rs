//! Positions and voxels of hits, and rays that go on from them.

use std::sync::Arc;

use esvo_format::{AssembleOptions, Contour, Octree, Tree, Voxel, assemble};
use glam::{DMat4, DVec3};

use super::*;
use crate::reference::cast_ray;
use crate::testing::rays::incoherent;
use crate::testing::sample::{Noise, Sample};

const NO_MARGINS: Margins = Margins { grid: 0.0, contour: 0.0 };

fn cast(object: &Object, ray: &Ray) -> Hit {
    cast_ray(object.octree(), object.root(), ray, object.contours())
}

/// Numbers from -1 to 1.
fn vector(noise: &mut Noise) -> DVec3 {
    DVec3::from(std::array::from_fn(|_| noise.number() * 2.0 - 1.0))
}

/// A direction at an angle to the plane with this normal: steep, grazing down to 1e-9, or within it.
fn grazing(noise: &mut Noise, normal: DVec3) -> DVec3 {
    let along = vector(noise).reject_from(normal).normalize();
    let rise = if noise.number() < 0.1 { 0.0 } else { 10f64.powf(-9.0 * noise.number()) };
    let along = if noise.number() < 0.2 {
        // Along an axis, as far as the plane allows.
        [DVec3::X, DVec3::Y, DVec3::Z][(noise.number() * 3.0) as usize].reject_from(normal).normalize_or(along)
    } else {
        along
    };
    along + normal * rise
}

fn samples() -> Vec<Arc<Octree>> {
    [Sample::plain(8, true), Sample::scattered(6, true), Sample::plain(7, false), Sample::plain(10, true)]
        .map(|sample| sample.octree().unwrap())
        .to_vec()
}

/// Shares of the secondary rays that meet their own voxel: rays away from the side that was entered, and all others.
fn own_hits(octree: &Octree, contours: bool, margins: &Margins, seed: u64) -> [f64; 2] {
    let object = Object::of(octree, 0);
    let object = if contours { object } else { object.without_contours() };
    let (mut rays, mut own) = ([0u32; 2], [0u32; 2]);
    let mut noise = Noise(seed);
    for ray in incoherent(4000, seed) {
        // Half of them end at large voxels too.
        let ray = if noise.number() < 0.5 { Ray { size_at_origin: 0.0, size_per_t: 0.0, ..ray } } else { ray };
        let mut point = HitPoint::new(&object, &ray, &cast(&object, &ray));
        // And from where the next ray ends, and so on.
        for _ in 0..4 {
            let Some(from) = point.take() else { break };
            let side = from.side().unwrap_or(DVec3::Y);
            for direction in [grazing(&mut noise, side), vector(&mut noise), -grazing(&mut noise, side)] {
                let away = usize::from(direction.dot(side) < 0.0 || from.side().is_none());
                let next = from.next_ray_with(direction, f64::INFINITY, margins);
                let hit = cast(&object, &next);
                let inside = hit.slot == from.hit.slot && hit.child() == from.hit.child();
                rays[away] += 1;
                own[away] += u32::from(!hit.is_miss() && inside);
                point = HitPoint::new(&object, &next, &hit).or(point);
            }
        }
    }
    assert!(rays.iter().all(|rays| *rays > 3000), "{rays:?}");
    std::array::from_fn(|way| f64::from(own[way]) / f64::from(rays[way]))
}

#[test]
fn no_ray_meets_the_voxel_that_it_comes_from() {
    for (seed, octree) in samples().iter().enumerate() {
        for contours in [false, true] {
            assert_eq!(own_hits(octree, contours, &Margins::DERIVED, seed as u64), [0.0; 2], "{seed} {contours}");
        }
    }
}

/// The negative control: without margins, many do.
#[test]
fn without_margins_rays_meet_the_voxel_that_they_come_from() {
    for (seed, octree) in samples().iter().enumerate() {
        let [away, _] = own_hits(octree, true, &NO_MARGINS, seed as u64);
        assert!(away > 0.05, "{seed}: {away}");
    }
}

/// A closed box with walls one voxel thick: cells 3 to 12 of 16. With `contours`, the walls between the edges are slabs.
fn closed_box(levels: u32, contours: bool) -> Octree {
    let cells = 1i64 << levels;
    let (low, high) = (cells * 3 / 16, cells * 12 / 16);
    let inside = |cell: [i64; 3]| cell.iter().all(|c| (low..=high).contains(c));
    let walls = |cell: [i64; 3]| [0, 1, 2].map(|axis| cell[axis] == low || cell[axis] == high);
    fn open(
        tree: &mut Tree,
        at: [i64; 3],
        size: i64,
        voxel: &dyn Fn([i64; 3]) -> Option<Voxel>,
        meets: &dyn Fn([i64; 3], i64) -> bool,
    ) {
        let half = size / 2;
        let places: [[i64; 3]; 8] =
            std::array::from_fn(|child| std::array::from_fn(|axis| at[axis] + (child as i64 >> axis & 1) * half));
        let children =
            places.map(|place| if half == 1 { voxel(place) } else { meets(place, half).then(Voxel::default) });
        let index = tree.open(&children);
        for (child, place) in children.iter().zip(places) {
            if half > 1 && child.is_some() {
                open(tree, place, half, voxel, meets);
            }
        }
        tree.close(index);
    }
    let voxel = |cell: [i64; 3]| {
        let on = walls(cell);
        if !inside(cell) || on == [false; 3] {
            return None;
        }
        // Only where one wall is: edges and corners stay cubes.
        let single = on.iter().filter(|on| **on).count() == 1;
        let contour = (contours && single).then(|| {
            let axis = on.iter().position(|on| *on).unwrap();
            let mut normal = [0.0; 3];
            normal[axis] = if cell[axis] == low { 1.0 } else { -1.0 };
            let bits = Contour::encode_normal(normal).unwrap();
            let length = DVec3::from(Contour::decode_normal(bits)).length();
            Contour::encode_bounds(bits, -0.3 * length, 0.1 * length).unwrap()
        });
        Some(Voxel { leaf: true, contour, ..Voxel::default() })
    };
    let meets = |at: [i64; 3], size: i64| {
        let touches = at.iter().all(|c| *c <= high && c + size > low);
        let hollow = at.iter().all(|c| *c > low && c + size <= high);
        touches && !hollow
    };
    let mut tree = Tree::default();
    open(&mut tree, [0; 3], cells, &voxel, &meets);
    let to_mesh = DMat4::from_translation(DVec3::new(5.0, -2.0, 1.0)) * DMat4::from_scale(DVec3::splat(3.0));
    assemble(&tree, to_mesh, &AssembleOptions::default()).unwrap()
}

/// Casts rays from the middle of a [`closed_box`] and lets each go on along the walls, from `skip` root cubes further on.
/// Returns the number of rays that went on from a wall, and the first one that started in its own wall, came to an outer half or left
/// the box.
fn bounce(levels: u32, contours: bool, margins: &Margins, skip: f32) -> (u32, Option<String>) {
    let octree = closed_box(levels, contours);
    let object = Object::of(&octree, 0);
    let centre = object.octree_to_mesh().transform_point3(DVec3::splat(0.5));
    let cells = f64::from(1u32 << levels);
    let (low, high) = (cells * 3.0 / 16.0, cells * 12.0 / 16.0);
    let mut noise = Noise(u64::from(levels));
    let mut bounces = 0;
    for start in 0..3000 {
        let mut direction = vector(&mut noise);
        if start % 2 == 0 {
            // Into an edge or a corner.
            direction = DVec3::from(direction.to_array().map(|c| if c.abs() > 0.5 { c.signum() } else { c }));
        }
        let mut ray = object.ray(centre, direction, 0.0..f64::INFINITY);
        let mut last = Hit::miss(0);
        for bounce in 0..8 {
            let hit = cast(&object, &ray);
            let Some(point) = HitPoint::new(&object, &ray, &hit) else {
                return (bounces, Some(format!("{ray:?} leaves after {bounce}")));
            };
            let Some(side) = point.side() else {
                // From a corner, a ray may start in the next wall, which is right. In its own wall it must not.
                if hit.same_voxel(&last) {
                    return (bounces, Some(format!("{ray:?} starts in its own wall after {bounce}")));
                }
                break;
            };
            last = hit;
            // How deep in the wall, in voxels. Slabs begin at 0.4; their encoded normals are tilted a little.
            let at = object.mesh_to_octree().transform_point3(point.position()) * cells;
            let depth = (low + 1.0 - at).max(at - high).max_element();
            if depth > if contours { 0.45 } else { 1e-3 } {
                return (bounces, Some(format!("{ray:?} comes to {depth} of the wall after {bounce}")));
            }
            ray = point.next_ray_with(grazing(&mut noise, side), f64::INFINITY, margins);
            ray.t_min += skip;
            bounces += 1;
        }
    }
    (bounces, None)
}

#[test]
fn no_ray_leaves_a_closed_box() {
    for levels in [4, 9] {
        for contours in [false, true] {
            let (bounces, leak) = bounce(levels, contours, &Margins::DERIVED, 0.0);
            assert_eq!(leak, None, "{levels} {contours}");
            assert!(bounces > 15_000, "{bounces}");
        }
    }
}

/// The negative control: rays that start half a voxel behind the wall's side come out, and so do rays that start two voxels
/// further on, in or behind another wall.
#[test]
fn with_other_offsets_rays_leave_a_closed_box() {
    let inwards = Margins { grid: -0.5 / 512.0, contour: -0.5 / 512.0 };
    for contours in [false, true] {
        for (margins, skip) in [(inwards, 0.0), (Margins::DERIVED, 2.0 / 512.0)] {
            assert!(bounce(9, contours, &margins, skip).1.is_some(), "{margins:?} {skip} {contours}");
        }
    }
}

#[test]
fn positions_and_voxels_are_where_the_ray_is() {
    for octree in samples() {
        for contours in [false, true] {
            let object = Object::of(&octree, 0);
            let object = if contours { object } else { object.without_contours() };
            let mut found = 0;
            for ray in incoherent(3000, 11) {
                let hit = cast(&object, &ray);
                let Some(point) = HitPoint::new(&object, &ray, &hit) else {
                    assert!(hit.is_miss(), "{ray:?}: {hit:?}");
                    continue;
                };
                found += 1;
                let (voxel, position) = (point.voxel(), point.position());
                assert_eq!((voxel.slot, voxel.child, voxel.level), (hit.slot, hit.child(), hit.level()));
                assert_eq!(voxel.octree_edge, f64::from(hit.size()));
                let inside = (position - voxel.corner) / voxel.octree_edge;
                assert!(inside.min_element() > -1e-4 && inside.max_element() < 1.0 + 1e-4, "{ray:?}: {inside}");
                let along = ray.origin.as_dvec3() - 1.0 + ray.direction.as_dvec3() * f64::from(hit.raw_t);
                let off = (position - along).reject_from(ray.direction.as_dvec3()).length();
                assert!(off < 1e-5, "{ray:?}: {off}");
                let distance = f64::from(hit.raw_t.abs() * ray.direction.length());
                assert!((point.distance() - distance).abs() < 1e-3 * distance.max(0.1), "{ray:?} {hit:?}");
                assert!((point.normal().length() - 1.0).abs() < 1e-6 && point.ambient() == 1.0);
            }
            assert!(found > 500, "{found}");
        }
    }
}

#[test]
fn misses_and_hits_of_others_are_no_points() {
    // Without contours: those of the large voxels leave a gap here.
    let octree = Sample::plain(5, false).octree().unwrap();
    let object = Object::of(&octree, 0);
    let ray = Ray::new(glam::Vec3::new(0.5, 1.5, 1.5), glam::Vec3::X);
    let hit = cast(&object, &ray);
    assert!(hit.t().is_some() && HitPoint::new(&object, &ray, &hit).is_some());
    assert!(Hit::miss(3).t().is_none() && HitPoint::new(&object, &ray, &Hit::miss(3)).is_none());
    let other = Ray::new(glam::Vec3::new(0.5, 1.9, 1.1), glam::Vec3::Y);
    assert!(HitPoint::new(&object, &other, &hit).is_none());
}
