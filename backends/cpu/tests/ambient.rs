//! Ambient occlusion compared with values that can be computed by hand.

use std::f64::consts::PI;
use std::sync::Arc;

use esvo_builder::{BuildSettings, Material, Mesh, build};
use esvo_core::Caster;
use esvo_core::ambient::{Ambient, AmbientError, AmbientSettings};
use esvo_core::reference::ReferenceCaster;
use esvo_cpu::{CpuCaster, InstructionSet};
use esvo_format::Octree;
use esvo_scenes::generate::{bumpy_sphere_on_plane, cube};
use glam::{DMat4, DQuat, DVec3};

/// A mesh of parallelograms, each a corner and two edges; they face the cross product of the edges.
fn parallelograms(all: &[[DVec3; 3]]) -> Mesh {
    let corners = all.iter().flat_map(|[p, u, v]| [*p, *p + *u, *p + *u + *v, *p + *v]);
    let count = all.len() as u32;
    Mesh {
        positions: corners.map(|p| p.to_array()).collect(),
        triangles: (0..count).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k))).collect(),
        triangle_materials: vec![0; 2 * all.len()],
        materials: vec![Material::default()],
        ..Mesh::default()
    }
}

fn octree_of(mesh: &Mesh, levels: u32, contours: bool) -> Arc<Octree> {
    Arc::new(build(mesh, &BuildSettings { levels, contours, ..BuildSettings::default() }, &|_| ()).unwrap().octree)
}

fn compute(octree: &Arc<Octree>, settings: AmbientSettings) -> Ambient {
    let mut caster = CpuCaster::new(None).unwrap();
    let mut last = 0.0;
    let ambient = Ambient::compute(octree, &mut caster, &settings, &mut |done| {
        assert!(done >= last, "progress goes forward");
        last = done;
    });
    assert_eq!(last, 1.0);
    ambient.unwrap()
}

/// Every voxel: centre and edge in the root cube `[0, 1]³`, descriptor, child slot, whether it is a leaf.
fn voxels(octree: &Octree) -> Vec<(DVec3, f64, u32, u8, bool)> {
    let mut all = Vec::new();
    let mut stack = vec![(octree.objects()[0].root_slot as u32, DVec3::ZERO, 0.5)];
    while let Some((slot, corner, edge)) = stack.pop() {
        let valid = octree.descriptor(slot).valid_mask();
        for child in (0..8u8).filter(|c| valid >> c & 1 != 0) {
            let at = corner + DVec3::from(std::array::from_fn(|axis| f64::from(child >> axis & 1))) * edge;
            let next = octree.child(slot, child);
            all.push((at + edge * 0.5, edge, slot, child, next.is_none()));
            stack.extend(next.map(|next| (next, at, edge * 0.5)));
        }
    }
    all
}

fn leaves(octree: &Octree) -> Vec<(DVec3, f64, u32, u8, bool)> {
    voxels(octree).into_iter().filter(|v| v.4).collect()
}

#[test]
fn nothing_is_in_the_way_of_a_plane() {
    for turn in [DQuat::IDENTITY, DQuat::from_rotation_x(0.6), DQuat::from_axis_angle(DVec3::ONE.normalize(), 0.955)] {
        let mut mesh = parallelograms(&[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
        mesh.transform(&DMat4::from_quat(turn));
        for contours in [true, false] {
            for levels in [4, 7] {
                let octree = octree_of(&mesh, levels, contours);
                for flip_normals in [false, true] {
                    let ambient = compute(&octree, AmbientSettings { flip_normals, ..AmbientSettings::default() });
                    for (centre, _, slot, child, _) in voxels(&octree) {
                        let value = ambient.value(slot, child);
                        assert_eq!(value, 255, "{centre}, {levels} levels, contours {contours}, {turn}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_wall_takes_away_the_light_that_came_from_there() {
    // A floor and a wall. The hemisphere of radius r projects to a disc, of which a wall at distance d hides a segment of the
    // share (acos c - c sqrt(1 - c²)) / π with c = d / r: one half at the corner.
    let mesh = parallelograms(&[[DVec3::ZERO, DVec3::X, DVec3::Y], [DVec3::ZERO, DVec3::Y, DVec3::Z]]);
    let radius = 0.2;
    for contours in [true, false] {
        let octree = octree_of(&mesh, 7, contours);
        let ambient = compute(&octree, AmbientSettings { radius, rays: 1024, ..AmbientSettings::default() });
        let (mut near, mut far, mut checked) = (0, 0, 0);
        for (centre, edge, slot, child, _) in leaves(&octree) {
            // Voxels of the floor, away from its ends; with cubes, away from those that belong to the wall too.
            let d = centre.x;
            if centre.z > edge || (centre.y - 0.5).abs() > 0.25 || d > 0.7 || d < 2.0 * edge {
                continue;
            }
            // Contours are within a few hundredths of a voxel of the wall; cubes are a voxel thick.
            let d = if contours { d } else { d - edge };
            let c = (d / radius).min(1.0);
            let expected = 1.0 - (c.acos() - c * (1.0 - c * c).sqrt()) / PI;
            let value = f64::from(ambient.value(slot, child)) / 255.0;
            assert!((value - expected).abs() < 0.03, "{value} at distance {d}, {expected} expected");
            near += usize::from(value < 0.6);
            far += usize::from(value == 1.0);
            checked += 1;
        }
        assert!(near > 20 && far > 100 && checked > 1000, "{near}, {far}, {checked}");
    }
}

#[test]
fn a_box_is_dark_inside_and_bright_outside() {
    let octree = octree_of(&cube(), 6, true);
    let inside = AmbientSettings { flip_normals: true, radius: 2.0, rays: 64, ..AmbientSettings::default() };
    let dark = compute(&octree, inside);
    let near = compute(&octree, AmbientSettings { radius: 0.1, ..inside });
    let bright = compute(&octree, AmbientSettings { flip_normals: false, ..inside });
    let (mut in_the_middle, mut at_edges) = (0, 0);
    for (centre, edge, slot, child, _) in leaves(&octree) {
        assert_eq!(dark.value(slot, child), 0, "{centre}");
        // Number of faces that are near: voxels at edges have a normal between those of the faces.
        let faces = (0..3).filter(|axis| (centre[*axis] - 0.5).abs() > 0.5 - 0.11 - edge).count();
        if faces == 1 {
            assert_eq!(near.value(slot, child), 255, "{centre}");
            assert_eq!(bright.value(slot, child), 255, "{centre}");
            in_the_middle += 1;
        } else if (0..3).filter(|axis| (centre[*axis] - 0.5).abs() > 0.5 - edge).count() > 1 {
            assert!(near.value(slot, child) < 245, "{} at {centre}", near.value(slot, child));
            at_edges += 1;
        }
    }
    assert!(in_the_middle > 10 && at_edges > 10, "{in_the_middle} {at_edges}");
}

#[test]
fn voxels_that_are_no_leaves_have_the_mean_of_their_children() {
    let octree = octree_of(&bumpy_sphere_on_plane(), 6, true);
    let ambient = compute(&octree, AmbientSettings { rays: 32, ..AmbientSettings::default() });
    let (mut shaded, mut inner) = (0, 0);
    for (_, edge, slot, child, leaf) in voxels(&octree) {
        shaded += usize::from(ambient.value(slot, child) < 250);
        let Some(next) = octree.child(slot, child).filter(|_| edge == 1.0 / 32.0 && !leaf) else { continue };
        let valid = octree.descriptor(next).valid_mask();
        let children = (0..8u8).filter(|c| valid >> c & 1 != 0);
        let sum: f64 = children.map(|c| f64::from(ambient.value(next, c))).sum();
        let mean = sum / f64::from(valid.count_ones());
        assert!((f64::from(ambient.value(slot, child)) - mean).abs() <= 0.5);
        inner += 1;
    }
    assert!(shaded > 100 && inner > 100, "{shaded} {inner}");
}

#[test]
fn every_engine_finds_the_same() {
    let octree = octree_of(&bumpy_sphere_on_plane(), 5, true);
    for contours in [true, false] {
        let settings = AmbientSettings { rays: 100, radius: 0.1, contours, ..AmbientSettings::default() };
        let run = |caster: &mut dyn Caster| {
            let ambient = Ambient::compute(&octree, caster, &settings, &mut |_| ()).unwrap();
            voxels(&octree).into_iter().map(|v| ambient.value(v.2, v.3)).collect::<Vec<_>>()
        };
        let expected = run(&mut ReferenceCaster::default());
        assert!(expected.iter().any(|v| *v < 200) && expected.contains(&255));
        for instructions in InstructionSet::available() {
            for threads in [1, 3] {
                let mut caster = CpuCaster::with_instructions(Some(threads), instructions).unwrap();
                assert!(run(&mut caster) == expected, "{instructions}");
            }
        }
    }
}

#[test]
fn values_go_into_the_octree() {
    let octree = octree_of(&bumpy_sphere_on_plane(), 6, true);
    let ambient = compute(&octree, AmbientSettings { rays: 64, radius: 0.2, ..AmbientSettings::default() });
    // Values from 1 to 255; a step of their encoding is a seventh of the range.
    let value = |slot, child| ambient.value(slot, child).max(1);
    let with = octree.with_ambient_occlusion(value).unwrap();
    with.sound().unwrap();
    assert!(with.needs().ambient && !octree.needs().ambient);
    let (before, after) = (voxels(&octree), voxels(&with));
    assert_eq!(before.len(), after.len());
    for (a, b) in before.iter().zip(&after) {
        assert_eq!((a.0, a.1), (b.0, b.1));
        let (value, stored) = (f32::from(value(a.2, a.3)) / 255.0, with.ambient(b.2, b.3).unwrap());
        assert!((value - stored).abs() <= 0.5 / 7.0 + 0.01, "{value} became {stored}");
    }
}

#[test]
fn an_octree_without_normals_is_refused() {
    let settings = BuildSettings { levels: 3, normals: false, ..BuildSettings::default() };
    let octree = Arc::new(build(&cube(), &settings, &|_| ()).unwrap().octree);
    let mut caster = CpuCaster::new(None).unwrap();
    let result = Ambient::compute(&octree, &mut caster, &AmbientSettings::default(), &mut |_| ());
    assert!(matches!(result, Err(AmbientError::NoNormals)));
}
