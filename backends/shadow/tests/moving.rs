//! Objects that move, against a world made from nothing; shapes against definitions that are slower and simpler.

use esvo_shadow::{Cubes, Grid, Mesh, Pose, Rule, Shape, Volume, World};
use glam::{DQuat, DVec3, EulerRot};
use proptest::prelude::*;

const GRID: Grid = Grid { origin: DVec3::new(-1.0, 0.5, 2.0), voxel: 0.1 };
const VOXELS: [u32; 3] = [45, 38, 31];

/// A box with its faces outwards.
fn cuboid(size: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| DVec3::from_array([0, 1, 2].map(|axis| f64::from(i >> axis & 1) - 0.5)) * size;
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

/// A ring, whose hole a solid must leave free.
fn ring(around: u32, across: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let turn = std::f64::consts::TAU;
    let corner = |i: u32| {
        let (a, b) =
            (turn * f64::from(i / across) / f64::from(around), turn * f64::from(i % across) / f64::from(across));
        let far = 0.7 + 0.25 * b.cos();
        DVec3::new(far * a.cos(), far * a.sin(), 0.25 * b.sin())
    };
    let at = |i: u32, j: u32| (i % around) * across + j % across;
    let quads = (0..around * across).flat_map(|n| {
        let (i, j) = (n / across, n % across);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    ((0..around * across).map(corner).collect(), quads.collect())
}

fn model(rule: Rule) -> Shape {
    let cubes = (0..9 * 5 * 4).map(|i| [i % 9, i / 9 % 5, i / 45]).filter(|[x, y, z]| (x * 7 + y * 5 + z * 3) % 5 > 0);
    Shape::Cubes(Cubes::new(cubes, 0.13, rule).unwrap())
}

fn shape(which: u32) -> Shape {
    let (corners, triangles) = if which.is_multiple_of(2) { cuboid(DVec3::new(0.5, 1.1, 0.7)) } else { ring(9, 7) };
    match which {
        0 | 1 => Shape::Mesh(Mesh::solid(corners, triangles).unwrap()),
        2 | 3 => Shape::Mesh(Mesh::surface(corners, triangles).unwrap()),
        4 => model(Rule::Middle),
        _ => model(Rule::Touch),
    }
}

fn pose() -> impl Strategy<Value = Pose> {
    let place = (-1.5..4.0f64, 0.0..4.5f64, 1.5..5.5f64);
    (place, -4.0..4.0f64, -4.0..4.0f64, -4.0..4.0f64, any::<bool>()).prop_map(|(place, a, b, c, straight)| {
        let rotation = if straight { DQuat::IDENTITY } else { DQuat::from_euler(EulerRot::XYZ, a, b, c) };
        Pose { rotation, position: place.into() }
    })
}

/// The union of shapes, from nothing.
fn made_anew(fixed: &[(Shape, Pose)], objects: impl Iterator<Item = (Shape, Pose)>, mips: u32) -> Volume {
    let mut volume = Volume::new(VOXELS, mips).unwrap();
    for (shape, pose) in fixed.iter().cloned().chain(objects) {
        let stamp = shape.voxels(&pose, &GRID).unwrap();
        let [low, high] = [stamp.extent().low.map(|c| 2 * c), stamp.extent().high.map(|c| 2 * c)];
        let all = (low[2]..high[2])
            .flat_map(|z| (low[1]..high[1]).flat_map(move |y| (low[0]..high[0]).map(move |x| [x, y, z])));
        volume.set(all.filter(|voxel| stamp.get(*voxel)));
    }
    volume
}

#[derive(Clone, Debug)]
enum Step {
    Insert(u32, Pose),
    Move(usize, Pose),
    Nudge(usize, f64),
    Remove(usize),
    Update(u64),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        2 => (0..6u32, pose()).prop_map(|(shape, pose)| Step::Insert(shape, pose)),
        3 => (any::<prop::sample::Index>(), pose()).prop_map(|(i, pose)| Step::Move(i.index(64), pose)),
        3 => (any::<prop::sample::Index>(), -0.2..0.2f64).prop_map(|(i, by)| Step::Nudge(i.index(64), by)),
        1 => any::<prop::sample::Index>().prop_map(|i| Step::Remove(i.index(64))),
        2 => (0..3000u64).prop_map(Step::Update),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// After any moves the volume is what it would be if it were made from nothing, and every change lies in a region.
    #[test]
    fn the_volume_is_as_if_made_from_nothing(steps in prop::collection::vec(step(), 1..40), mips in 0..=3u32) {
        let fixed = vec![(shape(2), Pose { position: DVec3::new(1.0, 2.0, 3.0), ..Pose::IDENTITY }), (shape(5), Pose { position: DVec3::new(-1.2, 1.0, 2.2), ..Pose::IDENTITY })];
        let mut world = World::new(GRID, VOXELS, mips).unwrap();
        for (shape, pose) in &fixed {
            world.add_fixed(shape, pose).unwrap();
        }
        let mut before = world.volume().clone();
        let mut there = Vec::new();
        for step in steps.into_iter().chain([Step::Update(100)]) {
            match step {
                Step::Insert(which, pose) => {
                    let shape = shape(which);
                    there.push((world.insert(shape.clone(), &pose).unwrap(), shape, pose));
                }
                Step::Move(i, pose) if !there.is_empty() => {
                    let i = i % there.len();
                    there[i].2 = pose;
                    world.move_to(&[(there[i].0, pose)]).unwrap();
                }
                Step::Nudge(i, by) if !there.is_empty() => {
                    let i = i % there.len();
                    there[i].2.position += by;
                    world.move_to(&[(there[i].0, there[i].2)]).unwrap();
                }
                Step::Remove(i) if !there.is_empty() => {
                    let (id, ..) = there.swap_remove(i % there.len());
                    world.remove(id).unwrap();
                    prop_assert!(world.remove(id).is_err());
                }
                Step::Update(each) => {
                    let changes = world.update(each);
                    let expected = made_anew(&fixed, there.iter().map(|(_, shape, pose)| (shape.clone(), *pose)), mips);
                    prop_assert!(*world.volume() == expected);
                    // A device that gets the regions has the same bytes.
                    for region in &changes.regions {
                        let now = world.volume();
                        before.rewrite(region, |cell, row| {
                            let (size, bytes) = now.level(0);
                            let at = cell[0] as usize + size[0] * (cell[1] as usize + size[1] * cell[2] as usize);
                            row.copy_from_slice(&bytes[at..at + row.len()]);
                        });
                    }
                    prop_assert!(before == expected);
                }
                _ => {}
            }
        }
    }

    /// The voxels of a surface are those that one of its triangles meets, tested along all thirteen axes in floating point, but for those so close that
    /// corners rounded to 1/256 of a voxel may decide otherwise.
    #[test]
    fn surfaces_are_what_their_triangles_meet(pose in pose(), which in 2..4u32) {
        let (corners, triangles) = if which == 2 { cuboid(DVec3::new(0.5, 1.1, 0.7)) } else { ring(9, 7) };
        let stamp = shape(which).voxels(&pose, &GRID).unwrap();
        let corners: Vec<DVec3> = corners.iter().map(|corner| GRID.to_voxels(pose.apply(*corner))).collect();
        let extent = stamp.extent();
        for z in 2 * extent.low[2]..2 * extent.high[2] {
            for y in 2 * extent.low[1]..2 * extent.high[1] {
                for x in 2 * extent.low[0]..2 * extent.high[0] {
                    let middle = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) + 0.5;
                    let meets = |half: f64| triangles.iter().any(|t| meets(&t.map(|c| corners[c as usize] - middle), half));
                    if stamp.get([x, y, z]) {
                        prop_assert!(meets(0.5 + 0.01), "{:?} is extra", [x, y, z]);
                    } else {
                        prop_assert!(!meets(0.5 - 0.01), "{:?} is missing", [x, y, z]);
                    }
                }
            }
        }
    }

    /// A solid has the middles that lie inside; a box and a ring know by themselves which do.
    #[test]
    fn solids_have_what_they_enclose(pose in pose(), which in 0..2u32) {
        let stamp = shape(which).voxels(&pose, &GRID).unwrap();
        let surface = shape(which + 2).voxels(&pose, &GRID).unwrap();
        let size = DVec3::new(0.5, 1.1, 0.7);
        let mut inner = 0;
        for (cell, _) in stamp.cells() {
            for i in 0..8 {
                let voxel: [i32; 3] = std::array::from_fn(|axis| 2 * cell[axis] + (i >> axis & 1));
                if surface.get(voxel) {
                    prop_assert!(stamp.get(voxel));
                    continue;
                }
                let at = pose.undo(GRID.to_world(DVec3::from(voxel.map(f64::from)) + 0.5));
                let depth = if which == 0 {
                    (size * 0.5 - at.abs()).min_element()
                } else {
                    0.25 - (at.truncate().length() - 0.7).hypot(at.z)
                };
                // The ring of few pieces is thinner than a round one.
                if which == 1 && (0.0..0.09).contains(&depth) {
                    continue;
                }
                let inside = depth > 0.0;
                inner += u32::from(inside);
                prop_assert_eq!(stamp.get(voxel), inside, "{:?} at {}", voxel, at);
            }
        }
        prop_assert!(inner > 0);
    }

    /// Voxels whose middle is in a cube are filled by both rules, and voxels that are filled are no farther from the model than half a diagonal.
    #[test]
    fn cubes_fill_what_they_meet(pose in pose()) {
        let [middle, touch] = [model(Rule::Middle), model(Rule::Touch)].map(|model| model.voxels(&pose, &GRID).unwrap());
        let full = |at: DVec3| {
            let cube = (at / 0.13).floor().as_ivec3();
            let inside = cube.cmpge(glam::IVec3::ZERO).all() && cube.cmplt(glam::IVec3::new(9, 5, 4)).all();
            inside && (cube.x * 7 + cube.y * 5 + cube.z * 3) % 5 > 0
        };
        let extent = touch.extent();
        for z in 2 * extent.low[2]..2 * extent.high[2] {
            for y in 2 * extent.low[1]..2 * extent.high[1] {
                for x in 2 * extent.low[0]..2 * extent.high[0] {
                    let voxel = [x, y, z];
                    let low = DVec3::from(voxel.map(f64::from));
                    let local = |offset: DVec3| pose.undo(GRID.to_world(low + offset));
                    let here = local(DVec3::splat(0.5));
                    if (here / 0.13 - (here / 0.13).round()).abs().min_element() > 1e-6 {
                        prop_assert_eq!(middle.get(voxel), full(here));
                    }
                    // A voxel with a point of a cube is filled.
                    let points = (0..125).map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25)) / 4.0);
                    let mut points = points.map(|p| p.clamp(DVec3::splat(1e-4), DVec3::splat(1.0 - 1e-4)));
                    if points.any(|offset| full(local(offset))) {
                        prop_assert!(touch.get(voxel), "{voxel:?} has a point of a cube");
                    }
                    prop_assert!(!middle.get(voxel) || touch.get(voxel));
                }
            }
        }
    }
}

/// The separating axis test of a box around the origin.
fn meets(corners: &[DVec3; 3], half: f64) -> bool {
    let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
    let units = [DVec3::X, DVec3::Y, DVec3::Z];
    let axes = units
        .into_iter()
        .chain([edges[0].cross(edges[1])])
        .chain(edges.iter().flat_map(|edge| units.map(|unit| edge.cross(unit))));
    axes.into_iter().all(|axis| {
        let along = corners.map(|corner| corner.dot(axis));
        let reach = half * axis.abs().element_sum();
        along.iter().copied().fold(f64::INFINITY, f64::min) <= reach
            && along.iter().copied().fold(f64::NEG_INFINITY, f64::max) >= -reach
    })
}

#[test]
fn meshes_that_are_not_closed_have_no_inside() {
    let (corners, triangles) = cuboid(DVec3::ONE);
    assert!(Mesh::solid(corners.clone(), triangles[1..].to_vec()).is_err());
    let mut turned = triangles.clone();
    turned[3].swap(0, 1);
    let error = Mesh::solid(corners.clone(), turned).unwrap_err().to_string();
    assert!(error.contains("3 edges"), "{error}");
    assert!(Mesh::solid(corners.clone(), triangles.clone()).is_ok());
    // Each triangle with corners of its own.
    let apart: Vec<DVec3> = triangles.iter().flatten().map(|&c| corners[c as usize]).collect();
    let numbered = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    assert!(Mesh::solid(apart, numbered).is_ok());
    assert!(Mesh::surface(corners.clone(), vec![[0, 1, 8]]).is_err());
    assert!(Mesh::surface(vec![DVec3::NAN], vec![]).is_err());
}

#[test]
fn poses_that_are_no_poses_are_refused() {
    let mut world = World::new(GRID, VOXELS, 2).unwrap();
    let id = world.insert(shape(0), &Pose::IDENTITY).unwrap();
    world.update(0);
    let before = world.volume().clone();
    for pose in [
        Pose { position: DVec3::splat(f64::NAN), ..Pose::IDENTITY },
        Pose { position: DVec3::splat(1e12), ..Pose::IDENTITY },
        Pose { rotation: DQuat::from_xyzw(1.0, 1.0, 0.0, 0.0), ..Pose::IDENTITY },
    ] {
        assert!(world.move_to(&[(id, Pose::IDENTITY), (id, pose)]).is_err());
        assert!(world.insert(shape(5), &pose).is_err());
    }
    assert_eq!(world.update(0).cells, 0);
    assert!(*world.volume() == before);
    // The name of an object that was removed names no other.
    world.remove(id).unwrap();
    let other = world.insert(shape(0), &Pose::IDENTITY).unwrap();
    assert!(other != id && world.move_to(&[(id, Pose::IDENTITY)]).is_err() && world.objects() == 1);
    let large = Shape::Cubes(Cubes::new([[0; 3], [1 << 20; 3]], 1.0, Rule::Middle).unwrap());
    assert!(world.insert(large, &Pose::IDENTITY).is_err());
    assert!(Cubes::new([[0; 3]], 0.0, Rule::Touch).is_err());
    assert!(World::new(GRID, [0, 1, 1], 0).is_err() && World::new(GRID, [9000, 1, 1], 0).is_err());
    assert!(Volume::new([1; 3], 6).is_err());
}
