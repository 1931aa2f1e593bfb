//! Colours, normals and holes of voxels: within their bounds wherever they are tested, filtered, and equal on both sides of
//! thin sheets.

use std::collections::HashMap;
use std::sync::Arc;

use esvo_builder::{BuildSettings, LinearTexture, Material, Mesh, NormalMap, Texture, TextureTest, UvTransform, build};
use esvo_format::Octree;
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
}

fn run(mesh: &Mesh, settings: BuildSettings) -> Octree {
    build(mesh, &settings, &|_| ()).unwrap().octree
}

/// A leaf voxel: level, position in voxels of that level, decoded colour and normal.
struct Leaf {
    level: u32,
    at: [u32; 3],
    color: [f32; 3],
    normal: Vec3,
}

fn leaves(octree: &Octree) -> Vec<Leaf> {
    fn node(octree: &Octree, slot: u32, level: u32, at: [u32; 3], found: &mut Vec<Leaf>) {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
            let at = std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1));
            match octree.child(slot, child) {
                Some(next) => node(octree, next, level + 1, at, found),
                None => {
                    let (color, normal) = (octree.color(slot, child).unwrap(), octree.normal(slot, child).unwrap());
                    found.push(Leaf { level: level + 1, at, color, normal });
                }
            }
        }
    }
    let mut found = Vec::new();
    node(octree, octree.objects()[0].root_slot as u32, 0, [0; 3], &mut found);
    found
}

/// The sheet `z = height(x, y)` over the unit square, with smooth normals.
fn sheet(cells: usize, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let at = |i: usize| i as f64 / cells as f64;
    let mut mesh = Mesh { materials: vec![Material::default()], ..Mesh::default() };
    for j in 0..=cells {
        for i in 0..=cells {
            let (x, y, e) = (at(i), at(j), 1e-4);
            mesh.positions.push([x, y, height(x, y)]);
            let (dx, dy) = (height(x + e, y) - height(x - e, y), height(x, y + e) - height(x, y - e));
            mesh.normals.push(DVec3::new(-dx, -dy, 2.0 * e).normalize().as_vec3().to_array());
        }
    }
    let row = cells as u32 + 1;
    for j in 0..cells as u32 {
        for i in 0..cells as u32 {
            let a = j * row + i;
            mesh.triangles.extend([[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
        }
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    mesh
}

/// A flat square with texture coordinates that cover the image once.
fn square() -> Mesh {
    let mut mesh = sheet(1, |_, _| 0.0);
    mesh.normals.clear();
    mesh.uvs = mesh.positions.iter().map(|p| [p[0] as f32, p[1] as f32]).collect();
    mesh
}

fn srgb(linear: f32) -> f32 {
    if linear <= 0.0031308 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A point of the surface with its colour and normal.
struct Point {
    position: DVec3,
    color: [f32; 3],
    normal: Vec3,
}

/// Random points of the surface in octree space.
fn points(mesh: &Mesh, octree: &Octree, count: usize) -> Vec<Point> {
    let to_octree = octree.octree_to_mesh(0).inverse();
    let mut random = Random(9);
    (0..count)
        .map(|_| {
            let t = (random.next() % mesh.triangles.len() as u64) as usize;
            let [a, b, c] = mesh.triangles[t].map(|v| v as usize);
            let (mut u, mut v) = (random.unit(), random.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let mix = |a: DVec3, b: DVec3, c: DVec3| a + (b - a) * u + (c - a) * v;
            let wide = |x: [f32; 3]| Vec3::from(x).as_dvec3();
            let p = mix(mesh.positions[a].into(), mesh.positions[b].into(), mesh.positions[c].into());
            let n = mix(wide(mesh.normals[a]), wide(mesh.normals[b]), wide(mesh.normals[c]));
            let base = mesh.materials[mesh.triangle_materials[t] as usize].base_color;
            let base = Vec3::new(base[0], base[1], base[2]);
            let vertex = if mesh.colors.is_empty() {
                Vec3::ONE
            } else {
                mix(wide(mesh.colors[a]), wide(mesh.colors[b]), wide(mesh.colors[c])).as_vec3()
            };
            let color = (base * vertex).to_array();
            let position = to_octree.transform_point3(p);
            Point { position, color: color.map(srgb), normal: n.normalize().as_vec3() }
        })
        .collect()
}

/// Checks that what every leaf above the deepest level decodes to is within the error bounds of the surface in it. Returns the number
/// of points that were checked.
fn check_bounds(mesh: &Mesh, settings: BuildSettings) -> usize {
    let octree = run(mesh, settings);
    let leaves: HashMap<(u32, [u32; 3]), Leaf> =
        leaves(&octree).into_iter().map(|leaf| ((leaf.level, leaf.at), leaf)).collect();
    let points = points(mesh, &octree, 30_000);
    let cell = |p: DVec3, level: u32| p.to_array().map(|x| (x * f64::from(1u32 << level)) as u32);
    let mut checked = 0;
    for point in &points {
        let found = (1..settings.levels).find_map(|level| leaves.get(&(level, cell(point.position, level))));
        let Some(leaf) = found else { continue };
        checked += 1;
        let off = (Vec3::from(leaf.color) - Vec3::from(point.color)).abs().max_element() * 256.0;
        // Ranges are of bytes: half a step, and that of the tables between bytes and light.
        let bound = settings.color_error as f32 + 1.5;
        assert!(off <= bound, "colour off by {off} of {bound} on level {} at {:?}", leaf.level, leaf.at);
        let off = (leaf.normal - point.normal).abs().max_element();
        let bound = settings.normal_error as f32 + 0.001;
        assert!(off <= bound, "normal off by {off} of {bound} on level {} at {:?}", leaf.level, leaf.at);
    }
    checked
}

fn hills(x: f64, y: f64) -> f64 {
    0.08 * (5.0 * x).sin() * (4.0 * y).cos()
}

#[test]
fn decoded_attributes_of_varying_surfaces_are_within_their_bounds() {
    let mut mesh = sheet(16, hills);
    mesh.colors = mesh.positions.iter().map(|p| [p[0] as f32, 0.5, (p[1] * 0.5) as f32]).collect();
    let settings = BuildSettings {
        levels: 8,
        contour_error: 5.0,
        normal_error: 0.1,
        texture_test: TextureTest::Texels,
        ..BuildSettings::default()
    };
    let checked = check_bounds(&mesh, settings);
    assert!(checked > 10_000, "{checked}");
}

#[test]
fn decoded_normals_that_vary_over_a_large_triangle_are_within_their_bounds() {
    let mut mesh = sheet(1, |x, y| 0.1 * x + 0.2 * y);
    mesh.normals = [[0.3, 0.0, 1.0], [-0.5, 0.2, 1.0], [0.1, -0.6, 1.0], [0.4, 0.5, 1.0]]
        .map(|n| Vec3::from(n).normalize().to_array())
        .to_vec();
    let settings = BuildSettings { levels: 8, contour_error: 5.0, normal_error: 0.05, ..BuildSettings::default() };
    let checked = check_bounds(&mesh, settings);
    assert!(checked > 10_000, "{checked}");
}

#[test]
fn voxels_that_fit_have_contours_that_bring_them_nearer() {
    // A plane, and a bound so wide that the cubes of level 1 fit as they are.
    let mesh = sheet(1, |x, y| 0.3 * x + 0.2 * y);
    let settings = BuildSettings { levels: 6, contour_error: 0.0, ..BuildSettings::default() };
    let octree = run(&mesh, settings);
    let (mut leaves, mut with_contour) = (0, 0);
    let mut open = vec![octree.objects()[0].root_slot as u32];
    while let Some(slot) = open.pop() {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
            match octree.child(slot, child) {
                Some(next) => open.push(next),
                None => {
                    leaves += 1;
                    with_contour += u32::from(descriptor.contour_mask() >> child & 1);
                }
            }
        }
    }
    assert!(leaves > 3 && with_contour == leaves, "{with_contour} of {leaves}");
}

#[test]
fn decoded_attributes_of_patchwork_are_within_their_bounds() {
    let mut mesh = sheet(12, |x, y| 0.1 * x + 0.2 * y);
    let mut random = Random(2);
    mesh.materials = (0..9)
        .map(|_| Material { base_color: [0; 4].map(|_| 0.3 + 0.1 * random.unit() as f32), ..Material::default() })
        .collect();
    mesh.triangle_materials = mesh.triangles.iter().map(|_| (random.next() % 9) as u32).collect();
    for texture_test in [TextureTest::Centroids, TextureTest::Averages, TextureTest::Texels] {
        let settings =
            BuildSettings { levels: 7, contour_error: 5.0, color_error: 12.0, texture_test, ..Default::default() };
        let checked = check_bounds(&mesh, settings);
        assert!(checked > 2_000, "{checked}");
    }
}

#[test]
fn one_look_everywhere_is_never_refined_for_its_attributes() {
    let mut mesh = sheet(6, |x, y| 0.1 * x + 0.2 * y);
    mesh.normals.clear();
    let settings = BuildSettings { levels: 8, contour_error: 5.0, ..BuildSettings::default() };
    let loose = BuildSettings { color_error: 256.0, normal_error: 2.0, ..settings };
    let tight = BuildSettings { color_error: 0.0, normal_error: 0.0001, ..settings };
    let count = |settings| leaves(&run(&mesh, settings)).len();
    assert_eq!(count(tight), count(loose));
    assert!(count(loose) < 2000);
}

/// The square with a texture of `size` x `size` texels.
fn textured(size: u32, texel: impl Fn(u32) -> u8) -> Mesh {
    let texels: Vec<u8> = (0..size * size).flat_map(|i| [texel(i), texel(i), texel(i), 255]).collect();
    let mut mesh = square();
    mesh.materials[0] = Material {
        base_color: [1.0; 4],
        texture: Some(Arc::new(Texture::from_rgba8(size, size, &texels).unwrap())),
        ..Material::default()
    };
    mesh
}

#[test]
fn textures_are_tested_by_centroid_average_or_texel() {
    let settings = BuildSettings { levels: 6, contour_error: 4.0, ..BuildSettings::default() };
    let of = |mesh: &Mesh, texture_test| leaves(&run(mesh, BuildSettings { texture_test, ..settings }));
    // Two triangles with a chequered texture of 8 x 8: a voxel of the finest level contains one or two of its squares.
    let chequered = textured(8, |i| if (i + i / 8) % 2 == 0 { 200 } else { 90 });
    let centroids = of(&chequered, TextureTest::Centroids).len();
    for test in [TextureTest::Averages, TextureTest::Texels] {
        let texels = of(&chequered, test);
        assert!(centroids * 4 < texels.len(), "{test:?}: {centroids} against {}", texels.len());
        let dark = texels.iter().filter(|leaf| leaf.level == 6 && leaf.color[0] < 0.5).count();
        let light = texels.iter().filter(|leaf| leaf.level == 6 && leaf.color[0] > 0.7).count();
        // The square takes one layer of voxels.
        assert!(dark > 100 && light > 100, "{test:?}: {dark} dark, {light} light");
    }
    // Texels eight times finer than the finest voxels: their averages differ little, so only the texels themselves ask for
    // more than the shape.
    let fine = textured(512, |i| if (i + i / 512) % 2 == 0 { 200 } else { 90 });
    let count = |test| of(&fine, test).len();
    let (centroids, averages, texels) =
        (count(TextureTest::Centroids), count(TextureTest::Averages), count(TextureTest::Texels));
    assert!(centroids <= averages && averages * 10 < texels, "{centroids}, {averages}, {texels}");
    assert_eq!(texels, 64 * 64);
}

#[test]
fn what_is_decoded_is_within_the_bounds_of_all_texels() {
    // Smooth enough for leaves on several levels.
    let wave = |i: u32| {
        let (x, y) = (f64::from(i % 64) / 64.0, f64::from(i / 64) / 64.0);
        (128.0 + 100.0 * (6.0 * x * x).sin() * (5.0 * y).cos()) as u8
    };
    let mesh = textured(64, wave);
    let texture = mesh.materials[0].texture.clone().unwrap();
    let settings = BuildSettings { levels: 8, contour_error: 5.0, ..BuildSettings::default() };
    // With the test by centroids, some voxel must break the bound: otherwise the comparison is worth nothing.
    for (test, keeps) in [(TextureTest::Texels, true), (TextureTest::Centroids, false)] {
        let octree = run(&mesh, BuildSettings { texture_test: test, ..settings });
        let to_mesh = octree.octree_to_mesh(0);
        let (mut worst, mut coarse) = (0f32, 0);
        for leaf in leaves(&octree).iter().filter(|leaf| leaf.level < 8) {
            coarse += 1;
            let size = (-f64::from(leaf.level)).exp2();
            for i in 0..81 {
                let place = |k: usize, step: i32| (f64::from(leaf.at[k]) + f64::from(step) / 8.0) * size;
                let p = to_mesh.transform_point3(DVec3::new(place(0, i % 9), place(1, i / 9), 0.5));
                if !(0.0..=1.0).contains(&p.x) || !(0.0..=1.0).contains(&p.y) {
                    continue;
                }
                let color = texture.sample([p.x as f32, p.y as f32], 1.0);
                worst = (0..3).map(|k| (leaf.color[k] - srgb(color[k])).abs() * 256.0).fold(worst, f32::max);
            }
        }
        assert!(coarse > 10, "{test:?}: {coarse} leaves above the deepest level");
        // One step for rounding the bounds to bytes.
        assert_eq!(worst <= settings.color_error as f32 + 1.0, keeps, "{test:?}: off by {worst}");
    }
}

#[test]
fn both_sides_of_a_thin_sheet_have_one_normal() {
    for (thickness, both_windings) in [(0.0, true), (1e-4, true), (0.004, true), (0.0, false)] {
        // The second side lies below the first and faces down. In the last case, every other triangle is turned instead.
        let mut mesh = sheet(8, |x, y| 0.3 * x + 0.1 * y);
        let axis = Vec3::from(mesh.normals[0]);
        mesh.normals.clear();
        if both_windings {
            let (count, below) = (mesh.positions.len() as u32, axis.as_dvec3() * thickness);
            let second: Vec<_> = mesh.positions.iter().map(|p| (DVec3::from(*p) - below).to_array()).collect();
            mesh.positions.extend(second);
            let second: Vec<_> = mesh.triangles.iter().map(|&[a, b, c]| [a + count, c + count, b + count]).collect();
            mesh.triangles.extend(second);
        } else {
            mesh.triangles.iter_mut().step_by(2).for_each(|t| t.swap(1, 2));
        }
        mesh.triangle_materials = vec![0; mesh.triangles.len()];
        let octree = run(&mesh, BuildSettings { levels: 7, contour_error: 4.5, ..BuildSettings::default() });
        let found = leaves(&octree);
        let along = found.iter().filter(|leaf| leaf.normal.dot(axis).abs() > 0.99).count();
        assert!(along * 100 > found.len() * 98, "thickness {thickness}: {along} of {} along the axis", found.len());
        if both_windings {
            let up = found.iter().filter(|leaf| leaf.normal.dot(axis) > 0.99).count();
            assert!(up * 10 > found.len() * 9, "thickness {thickness}: {up} of {} look up", found.len());
            // Sides that no voxel can separate are not refined; sides that some voxel can separate are.
            let coarse = found.iter().filter(|leaf| leaf.level < 7).count();
            assert!(coarse * 2 > found.len(), "thickness {thickness}: {coarse} of {} are coarse", found.len());
        }
    }
}

/// A normal map of `size` x `size` texels.
fn normal_map(size: u32, normal: impl Fn(u32, u32) -> [f64; 3]) -> NormalMap {
    let texels = (0..size * size)
        .map(|i| DVec3::from(normal(i % size, i / size)).normalize().to_array().map(|c| ((c + 1.0) * 32767.5) as u16))
        .collect();
    let texture = Arc::new(LinearTexture::new(size, size, texels).unwrap());
    NormalMap { texture, scale: 1.0, uv_transform: UvTransform::IDENTITY }
}

#[test]
fn normal_maps_turn_normals_and_are_filtered() {
    let mut mesh = square();
    let settings = BuildSettings { levels: 5, contours: false, ..BuildSettings::default() };
    let check = |mesh: &Mesh, expected: Vec3| {
        for leaf in leaves(&run(mesh, settings)) {
            assert!(leaf.normal.dot(expected) > 0.9995, "{} for {expected} at {:?}", leaf.normal, leaf.at);
        }
    };
    // u is x. v, which grows downwards in the image, is y, so the bitangent is -y.
    mesh.materials[0].normal_map = Some(normal_map(8, |_, _| [0.6, 0.0, 0.8]));
    check(&mesh, Vec3::new(0.6, 0.0, 0.8));
    mesh.materials[0].normal_map = Some(normal_map(8, |_, _| [0.0, 0.6, 0.8]));
    check(&mesh, Vec3::new(0.0, -0.6, 0.8));
    // Tangents of the mesh take precedence over its texture coordinates.
    mesh.tangents = vec![[0.0, 1.0, 0.0, 1.0]; 4];
    check(&mesh, Vec3::new(-0.6, 0.0, 0.8));
    // Bumps far smaller than the voxels average out.
    mesh.tangents.clear();
    let bumps = |x: u32, y: u32| [if x & 1 == 0 { 0.6 } else { -0.6 }, if y & 1 == 0 { 0.6 } else { -0.6 }, 1.0];
    mesh.materials[0].normal_map = Some(normal_map(256, bumps));
    check(&mesh, Vec3::Z);
}

#[test]
fn normal_maps_are_refined_texel_for_texel_if_wanted() {
    let mut mesh = square();
    // The left half leans to one side, the right half to the other.
    mesh.materials[0].normal_map = Some(normal_map(16, |x, _| [if x < 8 { 0.6 } else { -0.6 }, 0.0, 0.8]));
    let settings = BuildSettings { levels: 6, contour_error: 4.0, ..BuildSettings::default() };
    let centroids = leaves(&run(&mesh, BuildSettings { texture_test: TextureTest::Centroids, ..settings })).len();
    let texels = leaves(&run(&mesh, settings));
    assert!(centroids < texels.len(), "{centroids} against {}", texels.len());
    assert!(texels.iter().any(|leaf| leaf.level == 6) && texels.iter().any(|leaf| leaf.level < 6));
    for leaf in texels.iter().filter(|leaf| leaf.level < 6) {
        assert!(leaf.normal.x.abs() > 0.55, "{} on level {} at {:?}", leaf.normal, leaf.level, leaf.at);
    }
}

/// A square with holes cut by a texture of `size` x `size` texels.
fn cut_out(size: u32, solid: impl FnMut(u32, u32) -> bool) -> Mesh {
    let mut mesh = square();
    let mut solid = solid;
    let texels: Vec<u8> =
        (0..size * size).flat_map(|i| [255, 255, 255, if solid(i % size, i / size) { 255 } else { 0 }]).collect();
    mesh.materials[0] = Material {
        texture: Some(Arc::new(Texture::from_rgba8(size, size, &texels).unwrap())),
        alpha_cutoff: Some(0.5),
        ..Material::default()
    };
    mesh
}

/// The area of the square covered by leaves, as a share of all columns of voxels of this level.
fn covered(octree: &Octree, level: u32) -> f64 {
    let mut columns = std::collections::HashSet::new();
    for leaf in leaves(octree) {
        let up = level - leaf.level;
        for x in leaf.at[0] << up..(leaf.at[0] + 1) << up {
            for y in leaf.at[1] << up..(leaf.at[1] + 1) << up {
                columns.insert((x, y));
            }
        }
    }
    columns.len() as f64 / f64::from(1u32 << (2 * level))
}

#[test]
fn cut_outs_keep_their_coverage_at_every_resolution() {
    for share in [0.2, 0.5, 0.8] {
        let mut random = Random(7);
        let mesh = cut_out(256, |_, _| random.unit() < share);
        for levels in [4, 6, 8] {
            let covered = covered(&run(&mesh, BuildSettings { levels, contours: false, ..Default::default() }), levels);
            println!("share {share}, {levels} levels: {covered}");
            assert!((covered - share).abs() < 0.2, "{covered} of {share} with {levels} levels");
        }
    }
}

#[test]
fn coarse_leaves_do_not_fill_holes() {
    // Stripes four voxels wide on a flat square, whose shape alone requires only a few voxels.
    let mesh = cut_out(64, |x, _| x / 4 % 2 == 0);
    let octree = run(&mesh, BuildSettings { levels: 6, contour_error: 3.0, ..BuildSettings::default() });
    let covered = covered(&octree, 6);
    assert!((covered - 0.5).abs() < 0.15, "{covered}");
}

#[test]
fn plain_attributes_are_stored_as_they_are() {
    let mut mesh = square();
    mesh.colors = mesh.positions.iter().map(|[x, y, _]| [*x as f32 * 0.9, 0.1 + *y as f32 * 0.7, 0.3]).collect();
    mesh.materials[0].base_color = [1.0; 4];
    let settings = |plain_attributes| BuildSettings { levels: 6, plain_attributes, ..BuildSettings::default() };
    let [plain, blocks] = [true, false].map(|plain| build(&mesh, &settings(plain), &|_| ()).unwrap().octree);
    assert!(esvo_format::validate(&plain).findings.is_empty());
    let slot = plain.objects()[0].root_slot as u32;
    let differ = (0..8u8).filter(|child| plain.descriptor(slot).valid_mask() >> child & 1 != 0).filter(|&child| {
        let color = plain.color(slot, child);
        let [r, g, b] = color.expect("a colour").map(|c| c * 255.0);
        // Whole steps of 1/255: the value has not been quantized further.
        assert!([r, g, b].iter().all(|c| (c - c.round()).abs() < 1e-3), "{r} {g} {b}");
        Some([r, g, b]) != blocks.color(slot, child).map(|c| c.map(|c| c * 255.0))
    });
    assert!(differ.count() > 0, "blocks would have been as exact");
    assert!(plain.slots().len() > blocks.slots().len());
}
