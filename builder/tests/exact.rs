//! The voxels of a build are those whose closed cubes meet a closed triangle: all of them, and no others except some that
//! come within [`TOLERANCE`] of one. Compared on every level with a test in integers that shares no code with the builder.

#[path = "exact/integers.rs"]
mod integers;
#[path = "exact/overlap.rs"]
mod overlap;
#[path = "exact/random.rs"]
mod random;
#[path = "exact/triangles.rs"]
mod triangles;

use std::collections::HashSet;

use esvo_builder::{BuildError, BuildSettings, build};
use esvo_format::Octree;
use glam::DVec3;
use num_bigint::BigInt;

use integers::{Integer, cross, sub};
use overlap::{Cube, Projected, Space, Voxel, voxels};
use random::Random;
use triangles::{Triangle, crumbs, grazing, mesh_of, on_corners, pinned, slivers, walls};

/// How far from its cube the surface of an extra voxel may be, in edges of the root cube: `2^-TOLERANCE`, as the builder
/// documents.
const TOLERANCE: u32 = 45;

/// All voxels of an octree.
fn voxels_of(octree: &Octree) -> HashSet<Voxel> {
    let mut found = HashSet::new();
    let mut stack = vec![(octree.objects()[0].root_slot as u32, (0, [0; 3]))];
    while let Some((slot, (level, at))) = stack.pop() {
        let valid = octree.descriptor(slot).valid_mask();
        for child in (0..8u8).filter(|c| valid >> c & 1 != 0) {
            let voxel = (level + 1, std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1)));
            found.insert(voxel);
            stack.extend(octree.child(slot, child).map(|next| (next, voxel)));
        }
    }
    found
}

/// Result of a comparison.
#[derive(Debug, PartialEq, Eq)]
struct Found {
    voxels: usize,
    missed: Vec<Voxel>,
    extra: Vec<Voxel>,
}

/// The triangles that count by the definition: those with an area, in the octree's own placement of the mesh.
struct Truth<T> {
    space: Space<T>,
    triangles: Vec<Projected<T>>,
}

impl<T: Integer> Truth<T> {
    fn new(triangles: &[Triangle], octree: &Octree, levels: u32, extra_bits: i32) -> Self {
        let to_mesh = octree.octree_to_mesh(0);
        let points = triangles.iter().flatten().copied();
        let space = Space::new(to_mesh.w_axis.truncate(), to_mesh.x_axis.x, points, levels, extra_bits);
        let triangles = (triangles.iter())
            .map(|t| t.map(|p| space.point(p)))
            .filter(|[a, b, c]| cross(&sub(b, a), &sub(c, a)).iter().any(|x| *x != T::from(0)))
            .map(|t| Projected::new(&t))
            .collect();
        Self { space, triangles }
    }
}

fn compare<T: Integer>(triangles: &[Triangle], octree: &Octree, built: &HashSet<Voxel>, levels: u32) -> Found {
    let truth = Truth::<T>::new(triangles, octree, levels, 0);
    let expected = voxels(&truth.space, &truth.triangles, levels, Cube::Closed);
    let mut missed: Vec<_> = expected.difference(built).copied().collect();
    let mut extra: Vec<_> = built.difference(&expected).copied().collect();
    missed.sort_unstable();
    extra.sort_unstable();
    Found { voxels: expected.len(), missed, extra }
}

/// Whether one of the triangles comes within the tolerance of a voxel.
fn is_near(truth: &Truth<BigInt>, (level, at): Voxel) -> bool {
    let (edge, tolerance) = (truth.space.edge(level), truth.space.edge(TOLERANCE));
    let corner = std::array::from_fn(|axis| &truth.space.origin[axis] + &edge * at[axis] - &tolerance);
    let edge = edge + 2 * tolerance;
    truth.triangles.iter().any(|t| t.meets(&corner, &edge, Cube::Closed))
}

/// Builds, and compares all levels. `T` is the type of integers that the test computes in.
fn check<T: Integer>(name: &str, triangles: &[Triangle], levels: u32) -> Found {
    let settings = BuildSettings { levels, contours: false, ..BuildSettings::default() };
    let octree = build(&mesh_of(triangles), &settings, &|_| ()).unwrap().octree;
    octree.sound().unwrap();
    let built = voxels_of(&octree);
    let found = compare::<T>(triangles, &octree, &built, levels);
    println!("{name}: {} voxels, {} missed, {} extra", found.voxels, found.missed.len(), found.extra.len());
    assert!(found.voxels > 0, "{name}");
    assert!(
        found.missed.is_empty(),
        "{name}: {} of {} voxels missed, (level, position) {:?} ...",
        found.missed.len(),
        found.voxels,
        found.missed[0]
    );
    if !found.extra.is_empty() {
        let truth = Truth::<BigInt>::new(triangles, &octree, levels, TOLERANCE as i32);
        for voxel in &found.extra {
            assert!(is_near(&truth, *voxel), "{name}: no surface within the tolerance of voxel {voxel:?}");
        }
    }
    found
}

#[test]
fn random_triangles() {
    let mut random = Random(1);
    let triangles = pinned((0..24).map(|_| [0; 3].map(|_| random.point(30))).collect());
    check::<i128>("random", &triangles, 6);
}

#[test]
fn every_number_of_levels() {
    let mut random = Random(2);
    let triangles = pinned((0..3).map(|_| [0; 3].map(|_| random.point(24) * 0.2 + 0.4)).collect());
    for levels in 1..=10 {
        check::<BigInt>(&format!("{levels} levels"), &triangles, levels);
    }
}

#[test]
fn corners_and_edges_on_those_of_voxels() {
    let mut random = Random(3);
    for bits in [1, 2, 4, 5] {
        let found = check::<i128>("on corners", &pinned(on_corners(&mut random, bits, 20)), 5);
        assert!(found.extra.is_empty());
    }
}

#[test]
fn walls_on_faces() {
    let mut random = Random(4);
    for bits in [1, 3, 6] {
        let found = check::<i128>("walls", &pinned(walls(&mut random, bits, 12)), 6);
        assert!(found.extra.is_empty());
    }
}

#[test]
fn slivers_and_needles() {
    let mut random = Random(5);
    for (width, levels) in [(1e-2, 6), (1e-5, 8)] {
        check::<BigInt>("slivers", &pinned(slivers(&mut random, 20, width, 16)), levels);
    }
    for power in [-30, -40, -50, -52] {
        check::<BigInt>("needles", &pinned(slivers(&mut random, 20, 2.0f64.powi(power), 16)), 8);
    }
}

#[test]
fn smaller_than_a_voxel() {
    let mut random = Random(6);
    for level in [3, 8, 12, 18] {
        check::<i128>("crumbs", &pinned(crumbs(&mut random, level, 60)), level.min(16));
    }
}

#[test]
fn as_deep_as_it_goes() {
    let mut random = Random(7);
    let around = DVec3::new(0.3, 0.7, 0.55);
    let small = (0..20).map(|_| [0; 3].map(|_| around + (random.point(20) - 0.5) * 2.0f64.powi(-19))).collect();
    let triangles = pinned(small);
    check::<BigInt>("23 levels", &triangles, 23);
}

#[test]
fn as_large_as_the_scene() {
    let diagonal = [DVec3::ZERO, DVec3::ONE, DVec3::new(1.0, 0.0, 1.0)];
    let slanted = [DVec3::X, DVec3::Y, DVec3::Z];
    let found = check::<i128>("large", &[diagonal, slanted], 7);
    assert!(found.extra.is_empty());
}

#[test]
fn twice_the_same_and_some_without_area() {
    let mut random = Random(8);
    let mut triangles = pinned(on_corners(&mut random, 12, 6));
    let once = check::<i128>("once", &triangles, 6);
    triangles.extend(triangles.clone());
    let a = random.point(12);
    triangles.push([a; 3]);
    triangles.push([DVec3::ZERO, DVec3::splat(0.5), DVec3::ONE]);
    assert_eq!(check::<i128>("twice", &triangles, 6), once, "the same surface has the same voxels");
}

#[test]
fn far_from_the_origin() {
    let mut random = Random(9);
    let offset = DVec3::new(1e6, -1e6, 7e6);
    let mut triangles = pinned((0..16).map(|_| [0; 3].map(|_| random.point(25))).collect());
    triangles.extend(
        walls(&mut random, 5, 6).into_iter().map(|t| t.map(|p| (p * (1 << 25) as f64).round() / (1 << 25) as f64)),
    );
    triangles.iter_mut().flatten().for_each(|p| *p += offset);
    check::<BigInt>("far", &triangles, 6);
}

#[test]
fn placements_that_round() {
    // Nothing is dyadic here: the transform to octree space rounds. The integers are in the mesh's own units.
    let mut random = Random(10);
    for (scale, offset) in [(1.0, 0.0), (0.1, 3.0), (1234.5, -99.9), (1e-7, 0.1), (3e9, 1e9)] {
        let triangles: Vec<Triangle> = (0..12)
            .map(|i| {
                let a = random.point(53);
                [a, a + (random.point(53) - 0.5) * 0.3, if i % 4 == 0 { a + 1e-9 } else { random.point(53) }]
                    .map(|p| p * scale + offset)
            })
            .collect();
        check::<BigInt>(&format!("times {scale}, plus {offset}"), &triangles, 6);
    }
}

#[test]
fn all_but_parallel_to_faces() {
    let mut random = Random(11);
    for level in [1, 2, 4] {
        check::<BigInt>("grazing", &pinned(grazing(&mut random, level, 24)), 8);
    }
}

#[test]
fn half_open_cubes_would_be_noticed() {
    // A builder that tested half-open cubes would fail on these scenes.
    let mut random = Random(12);
    for triangles in [pinned(walls(&mut random, 3, 6)), pinned(on_corners(&mut random, 2, 6))] {
        let settings = BuildSettings { levels: 5, contours: false, ..BuildSettings::default() };
        let octree = build(&mesh_of(&triangles), &settings, &|_| ()).unwrap().octree;
        let truth = Truth::<i128>::new(&triangles, &octree, 5, 0);
        let wrong = voxels(&truth.space, &truth.triangles, 5, Cube::HalfOpen);
        let found = compare::<i128>(&triangles, &octree, &wrong, 5);
        assert!(found.missed.len() > 100, "{} missed", found.missed.len());
        assert!(found.extra.is_empty());
    }
}

#[test]
fn extra_voxels_would_be_noticed() {
    let triangles = pinned(vec![[DVec3::splat(0.5), DVec3::new(0.6, 0.5, 0.5), DVec3::new(0.5, 0.6, 0.5)]]);
    let settings = BuildSettings { levels: 4, contours: false, ..BuildSettings::default() };
    let octree = build(&mesh_of(&triangles), &settings, &|_| ()).unwrap().octree;
    let truth = Truth::<BigInt>::new(&triangles, &octree, 4, TOLERANCE as i32);
    assert!(is_near(&truth, (4, [8, 8, 8])) && is_near(&truth, (4, [7, 7, 7])));
    assert!(!is_near(&truth, (4, [8, 8, 9])));
    // Less than the tolerance away, and more than it.
    let lifted = |by: f64| {
        let moved: Vec<Triangle> =
            triangles.iter().map(|t| if t[0].x == 0.5 { t.map(|p| p + DVec3::Z * by) } else { *t }).collect();
        is_near(&Truth::<BigInt>::new(&moved, &octree, 4, TOLERANCE as i32), (4, [8, 8, 7]))
    };
    assert!(lifted(0.9 * 2.0f64.powi(-45)) && !lifted(1.1 * 2.0f64.powi(-45)));
}

#[test]
fn a_vertex_that_is_not_finite_is_named() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut mesh = mesh_of(&pinned(Vec::new()));
            mesh.positions[4][axis] = bad;
            let error = build(&mesh, &BuildSettings::default(), &|_| ()).err().unwrap();
            assert!(matches!(error, BuildError::Mesh(_)));
            assert!(error.to_string().contains("vertex 4 is not finite"), "{error}");
        }
    }
}

#[test]
fn areas_that_round_to_nothing() {
    // Edges that are neighbours in the Fibonacci sequence: their cross product is one unit of 2^-104, far below the rounding
    // errors of its terms.
    let mut fibonacci = vec![1u64, 1];
    while fibonacci.last().unwrap() < &(1 << 51) {
        fibonacci.push(fibonacci[fibonacci.len() - 1] + fibonacci[fibonacci.len() - 2]);
    }
    let unit = 2.0f64.powi(-52);
    let mut triangles = Vec::new();
    for k in 3..12 {
        let at = |i: usize| fibonacci[fibonacci.len() - i] as f64 * unit;
        triangles.push([
            DVec3::new(0.0, 0.0, 0.3),
            DVec3::new(at(k), at(k + 1), 0.3),
            DVec3::new(at(k + 1), at(k + 2), 0.3),
        ]);
    }
    check::<BigInt>("all but collinear", &pinned(triangles), 6);
    // A width whose square is below the smallest double.
    let needle = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1e-170, 0.0)];
    check::<BigInt>("hardly wide", &pinned(vec![needle]), 6);
}
