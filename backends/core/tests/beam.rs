//! The beam changes no hit, however small an object is in the picture and however it is placed.

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::Comparison;
use esvo_core::testing::sample::Sample;
use esvo_core::{Camera, CastOptions, Caster, FLAG_BEAM, Hit, View};
use esvo_format::Octree;
use glam::{DMat4, DVec3};

const SIZE: (u32, u32) = (96, 80);

/// The object lies about two pixels beside the middle of the picture, where a coarse ray is.
fn view(octree: &Octree, eye: DVec3, placement: DMat4, beam: bool) -> View {
    let middle = DVec3::splat(0.5);
    let aside = (eye - middle).any_orthogonal_vector().normalize() * eye.distance(middle) * 0.03;
    let camera = Camera {
        eye: eye.into(),
        forward: (middle + aside - eye).into(),
        up: [0.0, 1.0, 0.0],
        fov_degrees: 50.0,
        near: 0.01,
        far: 1000.0,
    };
    let root = octree.objects()[0].root_slot as u32;
    let options = CastOptions { beam, ..CastOptions::default() };
    View::new(&camera, placement * octree.octree_to_mesh(0), root, SIZE, &options).expect("is valid")
}

fn hits(caster: &mut dyn Caster, view: &View) -> Vec<Hit> {
    let mut hits = Vec::new();
    caster.cast(view, &mut hits).expect("casts");
    hits
}

/// Pixels that the beam changes, without and with wide blocks.
fn changed(caster: &mut dyn Caster, with: &View, without: &View) -> [u64; 2] {
    let right = hits(caster, without);
    [false, true].map(|wide| Comparison::of(&hits(caster, &with.with_wide_beam(wide)), &right).mismatches())
}

#[test]
fn small_objects_are_seen_with_the_beam() {
    let octree = Sample::plain(5, true).octree().expect("assembles");
    let mut caster = ReferenceCaster::default();
    caster.load(&octree).expect("loads");
    let mut forced = 0;
    let mut with_beam = 0;
    for distance in [2.0, 4.0, 7.0, 9.0, 12.0, 17.0, 25.0, 40.0, 70.0] {
        for direction in [DVec3::new(0.3, 0.2, 1.0), DVec3::new(-1.0, 0.7, -0.4), DVec3::new(0.5, 1.0, 0.49)] {
            let eye = DVec3::splat(0.5) + direction.normalize() * distance;
            let [with, without] = [true, false].map(|beam| view(&octree, eye, DMat4::IDENTITY, beam));
            assert_eq!(changed(&mut caster, &with, &without), [0, 0], "at {distance}");
            with_beam += u32::from(with.beam());
            // The negative control: a beam where it is not safe.
            let beam = View { flags: without.flags | FLAG_BEAM, ..without };
            forced += changed(&mut caster, &beam, &without).iter().sum::<u64>();
        }
    }
    assert!(with_beam >= 3, "close objects have the beam");
    assert!(forced > 0, "without the condition, the beam loses small objects");
}

#[test]
fn stretched_objects_are_cast_without_the_beam() {
    let octree = Sample::plain(5, true).octree().expect("assembles");
    let mut caster = ReferenceCaster::default();
    caster.load(&octree).expect("loads");
    let shear = DMat4::from_cols_array(&[1., 0., 0., 0., 0.4, 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]);
    for placement in [DMat4::from_scale(DVec3::new(1.0, 0.2, 1.0)), DMat4::from_scale(DVec3::new(3.0, 1.0, 1.0)), shear]
    {
        for eye in [DVec3::new(0.4, 0.9, 3.0), DVec3::new(2.0, 2.0, 2.0), DVec3::new(-0.2, 0.3, 0.5)] {
            let [with, without] = [true, false].map(|beam| view(&octree, eye, placement, beam));
            assert!(!with.beam());
            assert_eq!(changed(&mut caster, &with, &without), [0, 0]);
        }
    }
    let turned = DMat4::from_scale(DVec3::splat(2.5)) * DMat4::from_rotation_y(0.7);
    assert!(view(&octree, DVec3::new(0.4, 0.9, 3.0), turned, true).beam(), "turned and scaled, pixels stay square");
}
