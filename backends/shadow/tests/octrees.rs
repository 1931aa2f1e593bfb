//! Octrees as shapes of a world, against what their caster says.

use std::collections::HashSet;

use esvo_builder::cells::{Cells, build_cells, morton};
use esvo_builder::{BuildSettings, Mesh};
use esvo_core::reference::cast_ray;
use esvo_core::{Object, Ray};
use esvo_shadow::octree::{as_cubes, cells, look, world_of};
use esvo_shadow::{Grid, Shape, World};
use glam::{DMat4, DQuat, DVec3, Vec3};

/// Two triangles that form a slanted sheet.
fn sheet() -> Mesh {
    let positions = vec![[0.1, 0.1, 0.2], [0.9, 0.15, 0.35], [0.85, 0.9, 0.7], [0.05, 0.8, 0.5]];
    Mesh {
        positions,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_materials: vec![0; 2],
        materials: vec![esvo_builder::Material::default()],
        ..Mesh::default()
    }
}

/// Cells of an octree of cubes are the cells that it was made of, and at a coarser level those around them.
#[test]
fn cells_are_those_that_an_octree_was_made_of() {
    let all: Vec<[u32; 3]> = (0..4000u32).map(|i| [i * 7 % 61, i * 13 % 53, i * i % 59]).collect();
    let mut codes: Vec<u64> = all.iter().map(|cell| morton(*cell)).collect();
    codes.sort_unstable();
    codes.dedup();
    let list = Cells { levels: 6, codes, ..Cells::default() };
    let octree = build_cells(&list, DMat4::IDENTITY, &BuildSettings::default()).unwrap().octree;
    for level in [1, 4, 6] {
        let found: HashSet<[i32; 3]> = cells(&octree, 0, level).into_iter().collect();
        let expected: HashSet<[i32; 3]> = all.iter().map(|cell| cell.map(|c| (c >> (6 - level)) as i32)).collect();
        assert_eq!(found, expected, "level {level}");
    }
    // Below the leaves all parts are full: there are no contours.
    assert_eq!(cells(&octree, 0, 7).len(), 8 * list.codes.len());
}

/// Whatever a ray hits of an octree with contours lies in a voxel of the world, however the octree is placed.
#[test]
fn hits_lie_in_voxels() {
    let settings = BuildSettings { levels: 7, ..BuildSettings::default() };
    let octree = esvo_builder::build(&sheet(), &settings, &|_| ()).unwrap().octree;
    let turned = DMat4::from_scale_rotation_translation(
        DVec3::splat(3.0),
        DQuat::from_rotation_x(0.7) * DQuat::from_rotation_z(1.1),
        DVec3::new(1.0, 2.0, -0.5),
    );
    for place in [DMat4::from_scale(DVec3::splat(3.0)), turned] {
        let object = Object::of(&octree, 0).placed(place);
        let (cubes, pose) = as_cubes(&octree, 0, *object.octree_to_mesh(), 8).unwrap();
        let grid = Grid { origin: DVec3::splat(-6.03), voxel: 0.05 };
        let mut world = World::new(grid, [256; 3], 2).unwrap();
        world.add_fixed(&Shape::Cubes(cubes), &pose).unwrap();
        world.update(0);
        let mut hits = 0;
        for i in 0..4000 {
            let (x, y) = (f64::from(i % 64) / 63.0, f64::from(i / 64) / 63.0);
            let ray = Ray::new(glam::Vec3::new(1.0 + x as f32, 1.0 + y as f32, 0.9), glam::Vec3::Z);
            let hit = cast_ray(&octree, object.root(), &ray, true);
            let Some(t) = hit.t() else { continue };
            // A little inside, where the plane of the contour and rounding are behind.
            let at = object.from_cast((ray.origin + ray.direction * (t + 1e-5)).as_dvec3());
            let voxel = grid.to_voxels(at).floor().as_ivec3().to_array();
            assert!(world.volume().get(voxel), "{at} is not in the volume");
            hits += 1;
        }
        assert!(hits > 1500, "{hits}");
        // And not everything is full.
        let (_, bytes) = world.volume().level(0);
        let full: u32 = bytes.iter().map(|byte| byte.count_ones()).sum();
        assert!(full < 60_000, "{full}");
    }
}

#[test]
fn transforms_that_are_no_poses_are_refused() {
    let list = Cells { levels: 1, codes: vec![0], ..Cells::default() };
    let octree = build_cells(&list, DMat4::IDENTITY, &BuildSettings::default()).unwrap().octree;
    for scale in [DVec3::new(1.0, 2.0, 1.0), DVec3::new(1.0, 1.0, -1.0), DVec3::ZERO, DVec3::NAN] {
        assert!(as_cubes(&octree, 0, DMat4::from_scale(scale), 3).is_err(), "{scale}");
        // Neither as the one object of a world, whose cells would be its voxels, nor among others.
        let placed = Object::of(&octree, 0).placed(DMat4::from_scale(scale));
        for objects in [vec![placed], vec![Object::of(&octree, 0), placed]] {
            assert!(world_of(&objects, 0.1, 2).is_err(), "{scale}, {}", objects.len());
        }
    }
}

/// An octree that is not turned gets voxels that are its own cells, and no more volume than they need.
#[test]
fn a_world_of_one_octree_has_its_cells() {
    let settings = BuildSettings { levels: 6, ..BuildSettings::default() };
    let octree = esvo_builder::build(&sheet(), &settings, &|_| ()).unwrap().octree;
    let object = Object::of(&octree, 0);
    let edge = object.octree_to_mesh().x_axis.truncate().length();
    let world = world_of(&[object], edge / 60.0, 2).unwrap();
    let voxel = world.grid().voxel;
    assert!((edge / voxel - 64.0).abs() < 1e-9);
    let all = cells(&octree, 0, 6);
    let (_, bytes) = world.volume().level(0);
    assert_eq!(bytes.iter().map(|byte| byte.count_ones()).sum::<u32>(), all.len() as u32);
    for cell in &all {
        let middle = object.octree_to_mesh().transform_point3((DVec3::from(cell.map(f64::from)) + 0.5) / 64.0);
        assert!(world.volume().get(world.grid().to_voxels(middle).floor().as_ivec3().to_array()));
    }
    let thin = world.volume().voxels()[2];
    assert!(thin < 60, "the sheet is not as high as the root cube, and the volume has {thin} voxels there");
    // Two of them, one turned, share a volume in which both are.
    let turned = object.placed(DMat4::from_rotation_z(0.4));
    let world = world_of(&[object, turned], edge / 60.0, 2).unwrap();
    for (object, i) in [(object, 0), (turned, 1)] {
        let inside = all.iter().filter(|cell| {
            let middle = object.octree_to_mesh().transform_point3((DVec3::from(cell.map(f64::from)) + 0.5) / 64.0);
            world.volume().get(world.grid().to_voxels(middle).floor().as_ivec3().to_array())
        });
        assert_eq!(inside.count(), all.len(), "object {i}");
    }
    assert!(world_of(&[], 1.0, 2).is_err() && world_of(&[object], 0.0, 2).is_err());
}

/// A place that a ray met has the normal and colour of the octree there; of two objects, those of the nearer. Where nothing is, there is none.
#[test]
fn what_a_ray_met_has_the_colours_of_octrees() {
    let mut mesh = sheet();
    mesh.materials[0].base_color = [0.8, 0.2, 0.1, 1.0];
    let settings = BuildSettings { levels: 7, ..BuildSettings::default() };
    let octree = esvo_builder::build(&mesh, &settings, &|_| ()).unwrap().octree;
    let object = Object::of(&octree, 0);
    let corners = mesh.positions.iter().map(|corner| Vec3::from(corner.map(|x| x as f32)));
    let middle = corners.sum::<Vec3>() / 4.0;
    let lower = object.placed(DMat4::from_translation(DVec3::new(0.0, 0.0, -0.05)));
    for (objects, height) in [(vec![object], 0.0), (vec![lower, object], 0.0), (vec![lower], -0.05)] {
        // The ray's end is a little off, as that of a ray through voxels is.
        for off in [-0.02, 0.0, 0.02] {
            let place = middle + Vec3::Z * (height + off);
            let (normal, color) = look(&objects, place, -Vec3::Z, 0.04).unwrap();
            assert!(normal.z.abs() > 0.7 && (color.x - 0.8).abs() < 0.02 && color.z < 0.12, "{normal} {color}");
        }
    }
    assert_eq!(look(&[object], middle + Vec3::Z * 0.2, -Vec3::Z, 0.04), None);
    assert_eq!(look(&[object], middle + Vec3::X * 3.0, -Vec3::Z, 0.04), None);
    assert_eq!(look(&[], middle, -Vec3::Z, 0.04), None);
}
