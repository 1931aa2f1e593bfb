//! Objects that are placed look as if the mesh had been there, stored normals included.

use std::sync::Arc;

use esvo_core::camera::viewpoint::{bounds_of, overview_of, planes_of};
use esvo_core::glam::{DMat4, DQuat, DVec3};
use esvo_core::lights::{Light, shade_placed_lit};
use esvo_core::reference::ReferenceCaster;
use esvo_core::{Camera, CastOptions, Caster, Instances, Nearest, Object, Picture, shading};
use esvo_format::{AssembleOptions, Octree, RawNormal, Tree, Voxel, assemble};

/// Two voxels with a stored normal each.
fn octree() -> Arc<Octree> {
    let mut tree = Tree::default();
    let mut children = [None; 8];
    let voxel = |color, normal: [f32; 3]| {
        let normal = Some(RawNormal::encode(normal.into()));
        Some(Voxel { leaf: true, color: Some(color), normal, ..Voxel::default() })
    };
    children[0] = voxel([200, 120, 40], [0.3, 0.8, 0.5]);
    children[6] = voxel([30, 90, 220], [-0.6, 0.1, 0.7]);
    let root = tree.open(&children);
    tree.close(root);
    Arc::new(assemble(&tree, DMat4::from_scale(DVec3::splat(2.0)), &AssembleOptions::default()).expect("a tree"))
}

fn camera() -> Camera {
    let (eye, forward) = ([3.0, 2.5, 5.0], [-2.0, -1.5, -4.0]);
    Camera { eye, forward, up: [0.0, 1.0, 0.0], fov_degrees: 40.0, near: 0.01, far: 20.0 }
}

/// The camera, moved.
fn moved(camera: &Camera, place: &DMat4) -> Camera {
    let vector = |v: [f64; 3]| place.transform_vector3(v.into()).to_array();
    let eye = place.transform_point3(camera.eye.into()).to_array();
    Camera { eye, forward: vector(camera.forward), up: vector(camera.up), ..*camera }
}

/// Shaded, lit, and its normals.
fn pictures(octree: &Arc<Octree>, objects: &[Object], camera: &Camera, sun: DVec3) -> [Picture; 3] {
    let mut caster = ReferenceCaster::default();
    caster.load(octree).expect("is sound");
    let views: Vec<_> = objects
        .iter()
        .map(|object| object.view(camera, (64, 64), &CastOptions::default()).expect("in range"))
        .collect();
    let mut nearest = Nearest::default();
    caster.cast_instances(&Instances::new(views.clone()).expect("one camera"), &mut nearest).expect("is cast");
    let lights = [Light::Directional { to_light: sun }];
    [
        shading::shade_placed(objects, &views, &nearest),
        shade_placed_lit(&mut caster, objects, &views, &nearest, &lights, true).expect("is shaded"),
        shading::normal_map_placed(objects, &views, &nearest),
    ]
}

/// Pixels that differ by more than rounding can explain.
fn differences(a: &Picture, b: &Picture) -> usize {
    let far = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 2);
    a.rgb8.chunks(3).zip(b.rgb8.chunks(3)).filter(|pair| far(*pair)).count()
}

#[test]
fn an_object_that_moves_with_its_camera_looks_the_same() {
    let octree = octree();
    let sun = DVec3::new(0.5, 1.0, 0.6);
    let own = Object::of(&octree, 0);
    let still = pictures(&octree, &[own], &camera(), sun);
    let place = DMat4::from_rotation_translation(
        DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 2.0),
        DVec3::new(-7.0, 3.0, 11.0),
    );
    let there = pictures(&octree, &[own.placed(place)], &moved(&camera(), &place), place.transform_vector3(sun));
    let pixels = 64 * 64;
    // The sky does not turn, and neither do the colours of normals.
    for (still, there) in still[..2].iter().zip(&there) {
        assert!(differences(still, there) < pixels / 100, "{} pixels", differences(still, there));
    }
    assert!(differences(&still[2], &there[2]) > 100);
    // The control: the object turned, but not the stored normals, as an octree of another transform would have them.
    let mut objects = octree.objects().to_vec();
    objects[0].octree_to_mesh = (place * octree.octree_to_mesh(0)).to_cols_array();
    let other =
        Octree::from_parts(objects, octree.blocks().to_vec(), octree.slots().to_vec()).expect("the same blocks");
    let other = Arc::new(other);
    let wrong = pictures(&other, &[Object::of(&other, 0)], &moved(&camera(), &place), place.transform_vector3(sun));
    assert!(differences(&still[0], &wrong[0]) > 100, "normals make no difference: the test tests nothing");
}

#[test]
fn placing_twice_is_placing_by_the_product() {
    let octree = octree();
    let (first, second) = (
        DMat4::from_rotation_x(0.4) * DMat4::from_scale(DVec3::new(1.0, 2.0, 0.5)),
        DMat4::from_rotation_z(1.1) * DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0)),
    );
    let own = Object::of(&octree, 0);
    let (twice, once) = (own.placed(first).placed(second), own.placed(second * first));
    assert!((*twice.octree_to_mesh() - *once.octree_to_mesh()).to_cols_array().iter().all(|x| x.abs() < 1e-12));
    let camera = overview_of(&[once], [0.0, 1.0, 0.0], 50.0, 1.0);
    let (a, b) = (pictures(&octree, &[twice], &camera, DVec3::Y), pictures(&octree, &[once], &camera, DVec3::Y));
    assert!(a.iter().zip(&b).all(|(a, b)| differences(a, b) < 10));
}

#[test]
fn cameras_see_placed_objects() {
    let octree = octree();
    let objects: Vec<Object> = (0..20)
        .map(|i| Object::of(&octree, 0).placed(DMat4::from_translation(DVec3::X * 3.0 * f64::from(i))))
        .collect();
    let (low, high) = bounds_of(&objects);
    assert_eq!((low, high), (DVec3::ZERO, DVec3::new(58.0, 2.0, 2.0)));
    let (_, far) = planes_of(&objects, [0.0; 3]);
    assert!(far > 59.0 && far < 61.0);
    let camera = overview_of(&objects, [0.0, 1.0, 0.0], 50.0, 2.0);
    let seen = |object: &Object| {
        let mut caster = ReferenceCaster::default();
        caster.load(&octree).expect("is sound");
        let mut hits = Vec::new();
        let view = object.view(&camera, (128, 64), &CastOptions::default()).expect("in range");
        caster.cast(&view, &mut hits).expect("is cast");
        hits.iter().any(|hit| !hit.is_miss())
    };
    assert!(seen(&objects[0]) && seen(&objects[19]));
}
