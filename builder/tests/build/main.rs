//! Properties of every build: no voxel is missing, no surface is outside its contours, the bytes do not depend on the number
//! of threads, and colours and normals are right.

mod files;

use std::collections::HashSet;
use std::sync::Arc;

use esvo_builder::{BuildError, BuildSettings, Built, Material, Mesh, Texture, TextureTest, build};
use esvo_format::{AssembleOptions, Octree};
use glam::{DVec3, Vec3};

/// A small deterministic generator (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// In `0.0..1.0`.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }
}

fn mesh_of(triangles: &[[DVec3; 3]]) -> Mesh {
    let positions: Vec<[f64; 3]> = triangles.iter().flatten().map(|p| p.to_array()).collect();
    let count = triangles.len() as u32;
    Mesh {
        positions,
        triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; triangles.len()],
        materials: vec![Material::default()],
        ..Mesh::default()
    }
}

fn run(mesh: &Mesh, settings: BuildSettings) -> Built {
    let built = build(mesh, &settings, &|_| ()).unwrap();
    built.octree.sound().unwrap();
    built
}

/// Settings under which every voxel that meets the surface exists down to this level.
fn every_voxel(levels: u32) -> BuildSettings {
    BuildSettings { levels, contours: false, ..BuildSettings::default() }
}

/// Calls `visit` with (level, position in voxels of that level, parent slot, child) for every voxel.
fn walk(octree: &Octree, visit: &mut dyn FnMut(u32, [u32; 3], u32, u8)) {
    fn node(octree: &Octree, slot: u32, level: u32, at: [u32; 3], visit: &mut dyn FnMut(u32, [u32; 3], u32, u8)) {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let at = std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1));
            visit(level + 1, at, slot, child);
            if let Some(next) = octree.child(slot, child) {
                node(octree, next, level + 1, at, visit);
            }
        }
    }
    node(octree, octree.objects()[0].root_slot as u32, 0, [0; 3], visit);
}

/// The separating axis test in its textbook form: thirteen axes, projections of all corners. Independent of the builder.
fn overlaps(triangle: &[DVec3; 3], centre: DVec3, half: f64) -> bool {
    let v = triangle.map(|p| p - centre);
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    let axes = DVec3::AXES;
    let mut candidates = vec![edges[0].cross(edges[1])];
    candidates.extend(axes);
    candidates.extend(edges.iter().flat_map(|e| axes.iter().map(move |a| e.cross(*a))));
    candidates.iter().all(|axis| {
        let p = v.map(|v| v.dot(*axis));
        let reach = half * axis.abs().element_sum();
        p.iter().copied().fold(f64::MAX, f64::min) <= reach && p.iter().copied().fold(f64::MIN, f64::max) >= -reach
    })
}

fn check_exact(triangles: &[[DVec3; 3]], levels: u32) {
    let built = run(&mesh_of(triangles), every_voxel(levels));
    let to_mesh = built.octree.octree_to_mesh(0);
    let to_octree = to_mesh.inverse();
    let moved: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|p| to_octree.transform_point3(p))).collect();
    let mut found = HashSet::new();
    walk(&built.octree, &mut |level, at, _, _| {
        if level == levels {
            found.insert(at);
        }
    });
    let n = 1u32 << levels;
    let half = 0.5 / f64::from(n);
    // Allows for rounding in this test and in the transform: far below a voxel, above the builder's tolerance.
    let slack = 1e-12;
    let (mut missed, mut extra) = (0, 0);
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                let centre = (DVec3::new(x.into(), y.into(), z.into()) + 0.5) / f64::from(n);
                let is = found.contains(&[x, y, z]);
                if !is && moved.iter().any(|t| overlaps(t, centre, half - slack)) {
                    missed += 1;
                }
                if is && !moved.iter().any(|t| overlaps(t, centre, half + slack)) {
                    extra += 1;
                }
            }
        }
    }
    assert_eq!((missed, extra), (0, 0), "voxels missed, extra, of {}", found.len());
    assert!(!found.is_empty());
}

#[test]
fn random_triangles_are_voxelized_exactly() {
    let mut random = Random(1);
    for _ in 0..4 {
        let triangles: Vec<_> = (0..12).map(|_| [random.point(), random.point(), random.point()]).collect();
        check_exact(&triangles, 5);
    }
}

#[test]
fn needles_slivers_and_small_triangles_are_voxelized_exactly() {
    let mut random = Random(2);
    let mut triangles = Vec::new();
    for _ in 0..10 {
        let (a, b) = (random.point(), random.point());
        triangles.push([a, b, b + (random.point() - 0.5) * 1e-7]);
        triangles.push([a, a.lerp(b, 0.5) + (random.point() - 0.5) * 1e-9, b]);
        let c = random.point();
        triangles.push([c, c + (random.point() - 0.5) * 1e-3, c + (random.point() - 0.5) * 1e-3]);
    }
    check_exact(&triangles, 5);
}

#[test]
fn walls_exactly_on_voxel_faces_are_voxelized_exactly() {
    let mut triangles = Vec::new();
    for at in [0.0, 0.25, 0.5, 1.0] {
        for axis in 0..3 {
            let mut corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[u, v]| {
                let mut p = DVec3::splat(at);
                p[(axis + 1) % 3] = u;
                p[(axis + 2) % 3] = v;
                p
            });
            triangles.push(corners);
            corners[0][(axis + 1) % 3] = 0.75;
            triangles.push(corners);
        }
    }
    check_exact(&triangles, 4);
}

#[test]
fn far_from_the_origin_nothing_changes() {
    let mut random = Random(3);
    let offset = DVec3::new(4e6, -7e6, 1e6);
    let triangles: Vec<_> = (0..10).map(|_| [0; 3].map(|_| random.point() * 100.0 + offset)).collect();
    check_exact(&triangles, 5);
}

/// Two triangles that cover a square of this size in the plane where `axis` is `height`.
fn sheet(axis: usize, height: f64, origin: DVec3, size: f64) -> Vec<[DVec3; 3]> {
    let corner = |u: f64, v: f64| {
        let mut p = origin;
        p[(axis + 1) % 3] += u * size;
        p[(axis + 2) % 3] += v * size;
        p[axis] += height;
        p
    };
    let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
    vec![[a, b, c], [a, c, d]]
}

#[test]
fn a_flat_mesh_takes_one_layer_of_voxels() {
    for axis in 0..3 {
        for levels in 1..=7 {
            for (origin, size) in [(DVec3::ZERO, 1.0), (DVec3::new(4e5, 5e6, 120.0), 64.0), (DVec3::splat(-7.3), 0.7)] {
                let octree = run(&mesh_of(&sheet(axis, 0.25, origin, size)), every_voxel(levels)).octree;
                let mut counts = vec![0u64; levels as usize + 1];
                walk(&octree, &mut |level, _, _, _| counts[level as usize] += 1);
                for level in 1..=levels {
                    assert_eq!(counts[level as usize], 1 << (2 * level), "axis {axis}, level {level} of {levels}");
                }
            }
        }
    }
}

#[test]
fn a_mesh_that_is_flat_but_for_rounding_takes_one_layer_of_voxels() {
    use std::f64::consts::FRAC_PI_2;
    let leaves = |triangles: &[[DVec3; 3]]| run(&mesh_of(triangles), every_voxel(5)).octree.objects()[0].leaf_voxels;
    for turn in [glam::DQuat::from_rotation_x(FRAC_PI_2), glam::DQuat::from_rotation_y(-FRAC_PI_2)] {
        for origin in [DVec3::ZERO, DVec3::new(1000.5, 2000.25, 3.0)] {
            let turned: Vec<_> = sheet(2, 0.25, origin, 64.0).iter().map(|t| t.map(|p| turn * p)).collect();
            let (lo, hi) =
                turned.as_flattened().iter().fold((DVec3::MAX, DVec3::MIN), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
            assert!((hi - lo).min_element() > 0.0, "exactly flat");
            assert_eq!(leaves(&turned), 1024, "{turn} {origin}");
        }
    }
    // What is thicker keeps its place: on the border of two layers.
    let mut bent = sheet(2, 0.25, DVec3::ZERO, 1.0);
    let top = 0.25 + 1e-9;
    bent[0][0].z = top;
    bent[1][0].z = top;
    let octree = run(&mesh_of(&bent), every_voxel(5)).octree;
    assert_eq!(octree.octree_to_mesh(0).w_axis.z, (0.25 + top) * 0.5 - 0.5);
}

#[test]
fn a_flat_mesh_far_away_gives_the_same_voxels() {
    let at = |origin: DVec3| {
        let mut octree = run(&mesh_of(&sheet(2, 0.5, origin, 32.0)), every_voxel(8)).octree;
        octree.set_meta("{}".into());
        let mut places = Vec::new();
        walk(&octree, &mut |level, at, _, _| places.push((level, at)));
        places
    };
    assert!(at(DVec3::ZERO) == at(DVec3::new(431_872.0, 5_411_328.0, 256.0)));
}

#[test]
fn triangles_without_area_do_not_count_for_the_bounds() {
    let tetrahedron = [
        [DVec3::ZERO, DVec3::X, DVec3::Y],
        [DVec3::ZERO, DVec3::Y, DVec3::Z],
        [DVec3::ZERO, DVec3::Z, DVec3::X],
        [DVec3::X, DVec3::Z, DVec3::Y],
    ];
    let alone = run(&mesh_of(&tetrahedron), every_voxel(5)).octree.objects()[0].leaf_voxels;
    for far in [
        [DVec3::splat(1e6); 3],
        [DVec3::ZERO, DVec3::new(1e6, 0.0, 0.0), DVec3::new(3e6, 0.0, 0.0)],
        [DVec3::splat(-1e18), DVec3::splat(1e18), DVec3::splat(1e18)],
        // On a line, but not exactly so after it is scaled.
        [DVec3::ZERO, DVec3::new(1.0, 3.0, 7.0) * 1e3, DVec3::new(3.0, 9.0, 21.0) * 1e3],
    ] {
        let built = run(&mesh_of(&[&tetrahedron[..], &[far]].concat()), every_voxel(5));
        assert_eq!((built.octree.objects()[0].leaf_voxels, built.stats.dropped_triangles), (alone, 1), "{far:?}");
    }
}

/// A bumpy closed surface with sharp features: a subdivided cube with displaced vertices.
fn lump(cells: usize) -> Vec<[DVec3; 3]> {
    let bump = |p: DVec3| {
        let p = p.normalize();
        p * (1.0 + 0.15 * (7.0 * p.x).sin() * (5.0 * p.y).cos() + 0.1 * (9.0 * p.z).sin().abs())
    };
    let mut triangles = Vec::new();
    for face in 0..6 {
        for i in 0..cells {
            for j in 0..cells {
                let corner = |di: usize, dj: usize| {
                    let (u, v) =
                        ((i + di) as f64 / cells as f64 * 2.0 - 1.0, (j + dj) as f64 / cells as f64 * 2.0 - 1.0);
                    let mut p = DVec3::splat(if face < 3 { 1.0 } else { -1.0 });
                    p[(face + 1) % 3] = u;
                    p[(face + 2) % 3] = v;
                    bump(p)
                };
                triangles.push([corner(0, 0), corner(1, 0), corner(1, 1)]);
                triangles.push([corner(0, 0), corner(1, 1), corner(0, 1)]);
            }
        }
    }
    triangles
}

/// Whether a point of the surface is inside the shape of some leaf: inside all cubes and contours on the way down.
fn is_covered(octree: &Octree, slot: u32, p: DVec3) -> bool {
    // `p` is in units of this voxel, from its centre. Halving leaves a rounding error in the last bit; a point outside by
    // that much counts as inside.
    let slack = 1e-9;
    let descriptor = octree.descriptor(slot);
    (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0).any(|child| {
        let centre = DVec3::from(std::array::from_fn(|axis| if child >> axis & 1 != 0 { 0.25 } else { -0.25 }));
        let local = (p - centre) * 2.0;
        if local.abs().max_element() > 0.5 + slack {
            return false;
        }
        if let Some(contour) = octree.contour(slot, child) {
            let slab = contour.decode();
            let at = DVec3::from(slab.normal).dot(local);
            if at < slab.lo() || at > slab.hi() {
                return false;
            }
        }
        octree.child(slot, child).is_none_or(|next| is_covered(octree, next, local))
    })
}

fn uncovered(triangles: &[[DVec3; 3]], octree: &Octree, samples: usize) -> usize {
    let to_octree = octree.octree_to_mesh(0).inverse();
    let mut random = Random(4);
    let root = octree.objects()[0].root_slot as u32;
    (0..samples)
        .filter(|_| {
            let [a, b, c] = triangles[(random.next() % triangles.len() as u64) as usize];
            let (mut u, mut v) = (random.unit(), random.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let p = to_octree.transform_point3(a + (b - a) * u + (c - a) * v) - 0.5;
            !is_covered(octree, root, p)
        })
        .count()
}

#[test]
fn contours_never_cut_the_surface() {
    let mut random = Random(5);
    let soup: Vec<_> = (0..200)
        .map(|_| {
            let a = random.point();
            [a, a + (random.point() - 0.5) * 0.3, a + (random.point() - 0.5) * 0.3]
        })
        .collect();
    for (triangles, contour_error) in [(lump(12), 15.0), (lump(12), 6.0), (soup, 15.0)] {
        for levels in [3, 6, 9] {
            let built = run(&mesh_of(&triangles), BuildSettings { levels, contour_error, ..BuildSettings::default() });
            assert!(built.octree.needs().contours);
            assert_eq!(uncovered(&triangles, &built.octree, 20_000), 0, "levels {levels}, error {contour_error}");
        }
    }
}

#[test]
fn a_shifted_surface_is_noticed() {
    // The negative control of the test above: the same octree, with a surface that it was not built from.
    let triangles = lump(12);
    let built = run(&mesh_of(&triangles), BuildSettings { levels: 8, ..BuildSettings::default() });
    let shifted: Vec<_> = triangles.iter().map(|t| t.map(|p| p + DVec3::splat(0.02))).collect();
    assert!(uncovered(&shifted, &built.octree, 1000) > 500);
}

#[test]
fn contours_prune_flat_surfaces() {
    let quad = [DVec3::ZERO, DVec3::new(1.0, 0.13, 0.2), DVec3::new(0.1, 1.0, -0.3)];
    let settings = BuildSettings { levels: 9, contour_error: 10.0, ..BuildSettings::default() };
    let with = run(&mesh_of(&[quad]), settings);
    let without = run(&mesh_of(&[quad]), BuildSettings { contours: false, ..settings });
    let (with, without) = (with.octree.objects()[0].leaf_voxels, without.octree.objects()[0].leaf_voxels);
    assert!(with * 8 < without, "{with} against {without} leaves");
}

#[test]
fn bytes_do_not_depend_on_threads_and_survive_a_file() {
    let mesh = mesh_of(&lump(10));
    let settings = BuildSettings {
        levels: 8,
        assemble: AssembleOptions { block_slots: 2048, near_limit: 500 },
        ..BuildSettings::default()
    };
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut bytes = Vec::new();
        pool.install(|| run(&mesh, settings)).octree.write_to(&mut bytes).unwrap();
        bytes
    };
    let one = bytes(1);
    assert!(one == bytes(3), "one thread and three must give the same bytes");
    let octree = Octree::from_bytes(&one).unwrap();
    octree.sound().unwrap();
    assert!(octree.blocks().len() > 4 && octree.objects()[0].far_pointers > 4);
    assert!(octree.meta().contains("\"levels\":8"));
}

#[test]
fn colours_and_normals_are_those_of_the_surface() {
    // The left half of a square is red and faces up. The right half is green and stands upright.
    let triangles = [
        [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 1.0)],
        [DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 0.0, 1.0)],
    ];
    let mut mesh = mesh_of(&triangles);
    let colored = |r, g| Material { base_color: [r, g, 0.0, 1.0], ..Material::default() };
    mesh.materials = vec![colored(1.0, 0.0), colored(0.0, 1.0)];
    mesh.triangle_materials = vec![0, 1];
    let octree = run(&mesh, every_voxel(6)).octree;
    let (mut floor, mut wall) = (0, 0);
    walk(&octree, &mut |level, at, slot, child| {
        let n = 1u32 << level;
        let (color, normal) = (octree.color(slot, child).unwrap(), octree.normal(slot, child).unwrap());
        // Only voxels away from the edge between the halves.
        if level == 6 && at[0] + 2 < n {
            assert!(color[0] > 0.95 && color[1] < 0.05, "{color:?}");
            // Some voxels share a compression block with voxels of the other half.
            assert!(normal.dot(Vec3::NEG_Y) > 0.99, "{normal}");
            floor += 1;
        } else if level == 6 && at[1] > 33 {
            assert!(color[1] > 0.95 && color[0] < 0.05, "{color:?}");
            assert!(normal.dot(Vec3::X) > 0.99, "{normal}");
            wall += 1;
        }
    });
    assert!(floor > 500 && wall > 300, "{floor} and {wall} voxels");
}

#[test]
fn textures_are_refined_where_they_vary_and_averaged_above() {
    // Left half black, right half white, 64 texels wide. With contours the flat square would otherwise not be refined.
    let texels: Vec<u8> = (0..64 * 64).flat_map(|i| if i % 64 < 32 { [0, 0, 0, 255] } else { [255; 4] }).collect();
    let texture = Arc::new(Texture::from_rgba8(64, 64, &texels).unwrap());
    let mut mesh = mesh_of(&[
        [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)],
        [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
    ]);
    mesh.uvs = mesh.positions.iter().map(|p| [p[0] as f32 * 0.998 + 0.001, p[1] as f32 * 0.998 + 0.001]).collect();
    mesh.materials[0] = Material { base_color: [1.0; 4], texture: Some(texture), ..Material::default() };
    let texture_test = TextureTest::Texels;
    let settings = BuildSettings { levels: 7, contour_error: 9.0, texture_test, ..BuildSettings::default() };
    let octree = run(&mesh, settings).octree;
    let mut deep_at_edge = 0;
    walk(&octree, &mut |level, at, slot, child| {
        let color = octree.color(slot, child).unwrap();
        let n = 1u32 << level;
        let leaf = octree.child(slot, child).is_none();
        let distance = (f64::from(at[0]) + 0.5) / f64::from(n) - 0.5;
        if leaf && level == 7 && distance.abs() < 0.02 {
            deep_at_edge += 1;
        }
        if leaf && distance.abs() > 0.1 && distance.abs() < 0.4 {
            assert!(level < 7, "level {level} at {at:?}");
            let expected = if distance < 0.0 { 0.0 } else { 1.0 };
            assert!((color[1] - expected).abs() < 0.05, "{color:?} at {at:?}, level {level}");
        }
    });
    assert!(deep_at_edge > 100, "{deep_at_edge} leaves");
}

#[test]
fn cut_outs_are_holes() {
    let texels: Vec<u8> = (0..16 * 16).flat_map(|i| [255, 255, 255, if i % 16 < 8 { 0 } else { 255 }]).collect();
    let mut mesh = mesh_of(&[
        [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)],
        [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
    ]);
    mesh.uvs = mesh.positions.iter().map(|p| [p[0] as f32, p[1] as f32]).collect();
    mesh.materials[0] = Material {
        texture: Some(Arc::new(Texture::from_rgba8(16, 16, &texels).unwrap())),
        alpha_cutoff: Some(0.5),
        ..Material::default()
    };
    let octree = run(&mesh, every_voxel(6)).octree;
    let mut voxels = 0;
    walk(&octree, &mut |level, at, _, _| {
        if level == 6 {
            voxels += 1;
            // Filtering and wrapping read one texel beyond the edges.
            assert!(at[0] >= 32 - 8 || at[0] < 8, "{at:?}");
        }
    });
    assert!(voxels > 1500);
}

#[test]
fn the_number_of_leaves_is_expected_from_the_mesh() {
    let mut random = Random(11);
    for (triangles, extent) in [(1usize, 1.0), (40, 1.0), (300, 0.3)] {
        let triangles: Vec<_> = (0..triangles)
            .map(|_| {
                let at = random.point();
                [0, 1, 2].map(|_| at + (random.point() - 0.5) * extent)
            })
            .collect();
        let mesh = mesh_of(&triangles);
        for levels in [5, 8] {
            let leaves = run(&mesh, every_voxel(levels)).octree.objects()[0].leaf_voxels as f64;
            let expected = esvo_builder::expected_leaves(&mesh, levels);
            // Random triangles cross here and there, and their voxels are shared: more so where voxels are large.
            let least = if levels == 8 { 0.95 } else { 0.45 };
            assert!(
                (least..1.05).contains(&(leaves / expected)),
                "{leaves} leaves, {expected} expected at {levels} levels"
            );
        }
    }
}

#[test]
fn bad_settings_and_meshes_are_errors() {
    let message = |mesh: &Mesh, settings: BuildSettings| match build(mesh, &settings, &|_| ()) {
        Ok(_) => panic!("must fail"),
        Err(error) => error.to_string(),
    };
    let good = mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    for levels in [0, 24, 30] {
        let text = message(&good, BuildSettings { levels, ..BuildSettings::default() });
        assert_eq!(text, format!("levels is {levels}: it must be between 1 and 23"));
    }
    let text = message(&good, BuildSettings { color_error: f64::NAN, ..BuildSettings::default() });
    assert_eq!(text, "color-error is NaN: it must be 0 to 256 steps");
    let mut bad = good.clone();
    bad.positions[2][1] = f64::NAN;
    let text = message(&bad, BuildSettings::default());
    assert!(text.contains("vertex 2") && text.contains("finite"), "{text}");
    let text = message(&Mesh::default(), BuildSettings::default());
    assert!(text.contains("no triangles"), "{text}");
    // The cube of the extent is the determinant of the octree's transform, which must be a normal number.
    let mut leaves = Vec::new();
    for (size, good) in [
        (1.0, true),
        (1e100, true),
        (1.1e100, false),
        (1e300, false),
        (1.7e308, false),
        (1e-100, true),
        (1e-320, false),
    ] {
        let mesh = mesh_of(&[[DVec3::ZERO, DVec3::X * size, DVec3::new(0.0, size, size)]]);
        match build(&mesh, &BuildSettings { levels: 4, ..BuildSettings::default() }, &|_| ()) {
            Ok(built) => {
                assert!(good, "{size:e}");
                leaves.push(built.octree.objects()[0].leaf_voxels);
            }
            Err(error) => assert!(!good && error.to_string().contains("between 1e-100 and 1e100"), "{size:e}: {error}"),
        }
    }
    assert!(leaves[0] > 0 && leaves == [leaves[0]; 3], "{leaves:?}");
    let mesh = mesh_of(&[[DVec3::splat(1e300), DVec3::splat(1e300), DVec3::splat(-1e300)]]);
    assert!(message(&mesh, BuildSettings::default()).contains("it must be between 1e-100 and 1e100"));
    let far = DVec3::splat(1e15);
    let text = message(&mesh_of(&[[far, far + DVec3::X, far + DVec3::Y]]), BuildSettings::default());
    assert!(
        text.contains("largest extent is 1e0, with coordinates up to 1") && text.contains("closer to the origin"),
        "{text}"
    );
    let text = message(&mesh_of(&[[DVec3::ONE; 3]]), BuildSettings::default());
    assert_eq!(text, "mesh: all its vertices lie at one point; a mesh needs at least one triangle with an area");
    let line = mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]]);
    assert!(matches!(build(&line, &BuildSettings::default(), &|_| ()), Err(BuildError::Mesh(_))));
}

#[test]
fn one_level_and_twenty_three_levels_work() {
    let tiny = mesh_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    let one = run(&tiny, every_voxel(1)).octree;
    assert_eq!((one.objects()[0].levels, one.objects()[0].descriptors), (1, 1));
    // A triangle of the size of a finest voxel, and one far away that makes the root cube large.
    let e = 1.0 / f64::from(1 << 23);
    let speck = |p: DVec3| [p, p + DVec3::X * e * 0.4, p + DVec3::Y * e * 0.4];
    let deep = run(&mesh_of(&[speck(DVec3::ZERO), speck(DVec3::ONE - e)]), every_voxel(23)).octree;
    assert_eq!(deep.objects()[0].levels, 23);
}
