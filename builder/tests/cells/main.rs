//! Cells: the triangles that meet them, one by one and all together, are those of a build; and octrees that are made of them.

mod octree;
#[path = "../exact/random.rs"]
mod random;
#[path = "../exact/triangles.rs"]
mod triangles;

use std::collections::BTreeSet;

use esvo_builder::cells::{morton, morton_place};
use esvo_builder::{BuildSettings, PreparedMesh, build};
use esvo_format::Octree;
use glam::DVec3;

use random::Random;
use triangles::{Triangle, crumbs, grazing, mesh_of, on_corners, pinned, slivers, walls};

/// Triangles of every kind, with their name. In octree space they are where they are here: the unit cube is the root cube.
fn soups() -> Vec<(&'static str, Vec<Triangle>)> {
    let mut random = Random(21);
    let r = &mut random;
    let anywhere = (0..16).map(|_| [0; 3].map(|_| r.point(30))).collect();
    let small = (0..200)
        .map(|_| {
            let at = r.point(40) * 0.9;
            [0; 3].map(|_| at + r.point(40) * 0.1)
        })
        .collect();
    [
        ("anywhere", anywhere),
        ("small", small),
        ("on corners of voxels", on_corners(r, 3, 16)),
        ("in planes of faces", walls(r, 3, 16)),
        ("slivers", slivers(r, 20, 1e-3, 16)),
        ("needles", slivers(r, 20, 2.0f64.powi(-45), 16)),
        ("around corners", crumbs(r, 4, 60)),
        ("almost in planes of faces", grazing(r, 4, 16)),
    ]
    .map(|(name, triangles)| (name, pinned(triangles)))
    .into()
}

fn prepared(triangles: &[Triangle], levels: u32) -> PreparedMesh {
    PreparedMesh::new(&mesh_of(triangles), levels).unwrap()
}

/// Whether the bounding box of a triangle meets a cell: too coarse a test.
fn box_meets(triangle: &Triangle, at: [u32; 3], level: u32) -> bool {
    let [a, b, c] = *triangle;
    let edge = (-f64::from(level)).exp2();
    let low = DVec3::from(at.map(f64::from)) * edge;
    a.min(b).min(c).cmple(low + edge).all() && a.max(b).max(c).cmpge(low).all()
}

/// Voxels of an octree on every level: (level, code, whether it is a leaf).
pub(crate) fn topology(octree: &Octree) -> BTreeSet<(u32, u64, bool)> {
    octree.sound().unwrap();
    let mut found = BTreeSet::new();
    let mut waiting = vec![(octree.objects()[0].root_slot as u32, 1, 0)];
    while let Some((slot, level, parent)) = waiting.pop() {
        let valid = octree.descriptor(slot).valid_mask();
        for child in (0..8u8).filter(|c| valid >> c & 1 != 0) {
            let code = parent << 3 | u64::from(child);
            let next = octree.child(slot, child);
            found.insert((level, code, next.is_none()));
            waiting.extend(next.map(|next| (next, level + 1, code)));
        }
    }
    found
}

#[test]
fn one_triangle_and_one_cell_as_all_together() {
    const LEVEL: u32 = 5;
    let all: Vec<u64> = (0..1 << (3 * LEVEL)).collect();
    let mut wrong = 0;
    for (name, triangles) in soups() {
        let prepared = prepared(&triangles, LEVEL);
        let meeting = prepared.triangles_in(LEVEL, &all).unwrap();
        for &code in &all {
            let at = morton_place(code);
            let kept = prepared.corners().iter().enumerate();
            let expected: Vec<u32> =
                kept.clone().filter(|(t, _)| prepared.meets(*t, at, LEVEL)).map(|(t, _)| t as u32).collect();
            assert_eq!(meeting.of(code as usize), expected, "{name}: {at:?}");
            wrong += kept.filter(|(t, c)| box_meets(c, at, LEVEL) != expected.contains(&(*t as u32))).count();
        }
        let met: Vec<u64> = all.iter().copied().filter(|&code| !meeting.of(code as usize).is_empty()).collect();
        assert_eq!(prepared.cells(LEVEL).unwrap(), met, "{name}");
        // Only around some of the cells.
        let some: Vec<u64> = all.iter().copied().filter(|code| code % 7 == 3).collect();
        let around = prepared.triangles_in(LEVEL, &some).unwrap();
        for (i, &code) in some.iter().enumerate() {
            assert_eq!(around.of(i), meeting.of(code as usize), "{name}");
        }
    }
    assert!(wrong > 1000, "a coarser test would be noticed: {wrong}");
}

#[test]
fn a_mesh_of_one_triangle() {
    // Placed by its own bounding box, so that nothing is dyadic.
    let mut random = Random(22);
    for level in [1, 2, 4, 6] {
        for kind in 0..6 {
            let flat = |p: DVec3| if kind == 1 { p.with_y(0.25) } else { p };
            let mut triangle = [0; 3].map(|_| flat(random.point(53)));
            if kind == 2 {
                triangle[2] = triangle[0] + (triangle[1] - triangle[0]) * 0.7 + (random.point(53) - 0.5) * 1e-9;
            }
            let prepared = prepared(&[triangle], level);
            let all = 0..1u64 << (3 * level);
            let met: Vec<u64> = all.filter(|&code| prepared.meets(0, morton_place(code), level)).collect();
            assert!(!met.is_empty());
            assert_eq!(prepared.cells(level).unwrap(), met, "{triangle:?}");
        }
    }
}

#[test]
fn deep_cells_and_those_around_them() {
    let mut random = Random(23);
    for level in [9, 16, 21] {
        let edge = (-f64::from(level)).exp2();
        let triangles: Vec<Triangle> = (0..30)
            .map(|i| {
                let corner = (random.point(level) * 0.9).max(DVec3::splat(16.0 * edge));
                let corner = if i % 2 == 0 { (corner / edge).floor() * edge } else { corner };
                [0; 3].map(|_| {
                    let off = random.point(10) * 8.0 * edge;
                    corner + if i % 3 == 0 { off.with_z(0.0) } else { off }
                })
            })
            .collect();
        let prepared = prepared(&pinned(triangles), level);
        let cells = prepared.cells(level).unwrap();
        let around: BTreeSet<u64> = (cells.iter())
            .flat_map(|&code| {
                let at = morton_place(code);
                (0..27u32)
                    .map(move |i| [i % 3, i / 3 % 3, i / 9].map(|x| x.wrapping_sub(1)))
                    .map(move |step| std::array::from_fn(|k| at[k].wrapping_add(step[k]).min((1 << level) - 1)))
            })
            .map(morton)
            .collect();
        let around = Vec::from_iter(around);
        let meeting = prepared.triangles_in(level, &around).unwrap();
        let mut met = Vec::new();
        for (i, &code) in around.iter().enumerate() {
            let all = 0..prepared.corners().len();
            let expected: Vec<u32> =
                all.filter(|&t| prepared.meets(t, morton_place(code), level)).map(|t| t as u32).collect();
            assert_eq!(meeting.of(i), expected, "level {level}, {:?}", morton_place(code));
            met.extend((!expected.is_empty()).then_some(code));
        }
        assert_eq!(cells, met);
        assert!(cells.len() < around.len());
    }
}

#[test]
fn cells_are_the_voxels_of_a_build() {
    for levels in [1, 3, 7] {
        for (name, triangles) in soups().into_iter().filter(|(name, _)| !name.starts_with("almost")) {
            let mesh = mesh_of(&triangles);
            let settings = BuildSettings { levels, contours: false, ..BuildSettings::default() };
            let built = topology(&build(&mesh, &settings, &|_| ()).unwrap().octree);
            let prepared = PreparedMesh::new(&mesh, levels).unwrap();
            for level in 1..=levels {
                let expected: Vec<u64> = built.iter().filter(|voxel| voxel.0 == level).map(|voxel| voxel.1).collect();
                assert_eq!(prepared.cells(level).unwrap(), expected, "{name}, {levels} levels, level {level}");
            }
        }
    }
}

#[test]
fn triangles_without_an_area_are_left_out() {
    let line = [DVec3::ZERO, DVec3::splat(0.5), DVec3::ONE];
    let face = [DVec3::ZERO, DVec3::X, DVec3::ONE];
    let prepared = prepared(&[line, face, line, face], 4);
    assert_eq!((prepared.dropped(), prepared.corners().len()), (2, 2));
    assert_eq!((prepared.source(0), prepared.source(1)), (1, 3));
    assert_eq!(prepared.corners()[0], face);
    let error = PreparedMesh::new(&mesh_of(&[line]), 4).err().unwrap().to_string();
    assert!(error.contains("none of its triangles has an area"), "{error}");
}

#[test]
fn what_does_not_exist_is_refused() {
    let prepared = prepared(&[[DVec3::ZERO, DVec3::X, DVec3::ONE]], 4);
    for (at, level, met) in [
        ([0, 0, 0], 0, true),
        ([1, 0, 0], 0, false),
        ([15, 15, 15], 4, true),
        ([16, 15, 15], 4, false),
        ([0, 0, 0], 23, true),
        ([0, 0, 0], 24, false),
        ([u32::MAX; 3], 40, false),
    ] {
        assert_eq!(prepared.meets(0, at, level), met, "{at:?} on level {level}");
    }
    for level in [0, 22] {
        let error = prepared.cells(level).unwrap_err().to_string();
        assert_eq!(error, format!("level is {level}: it must be between 1 and 21"));
        assert!(prepared.triangles_in(level, &[0]).is_err());
    }
    let error = |cells: &[u64]| prepared.triangles_in(2, cells).unwrap_err().to_string();
    assert!(error(&[3, 3]).contains("code 3 of cell 1 is not above code 3 before it"), "{}", error(&[3, 3]));
    assert!(error(&[3, 64]).contains("outside of the root cube"), "{}", error(&[3, 64]));
    for levels in [0, 24] {
        let mesh = mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::ONE]]);
        assert!(PreparedMesh::new(&mesh, levels).is_err());
    }
}

#[test]
fn cells_do_not_depend_on_threads() {
    let (_, triangles) = soups().swap_remove(1);
    let prepared = prepared(&triangles, 8);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| prepared.cells(8).unwrap())
    };
    assert_eq!(with(1), with(4));
}
