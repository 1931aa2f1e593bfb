//! Closed meshes stay closed, heights keep their bounds, normals follow the slopes.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::mesh::Material;
use crate::mesh::maps::{LinearTexture, UvTransform};

const OPTIONS: DisplaceOptions = DisplaceOptions { scale: 1.0, cell: 0.07, max_triangles: 1 << 20 };

/// A pseudo-random height texture from a fixed seed.
pub(crate) fn bumpy(side: u32) -> LinearTexture<1> {
    let mut state = 7u32;
    let texels = (0..side * side).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        [(state >> 16) as u16]
    });
    LinearTexture::new(side, side, texels.collect()).unwrap()
}

pub(crate) fn material(texture: LinearTexture<1>, amplitude: f32, bias: f32) -> Material {
    let texture = Arc::new(texture);
    let height_map = Some(HeightMap { texture, amplitude, bias, uv_transform: UvTransform::IDENTITY });
    Material { height_map, ..Material::default() }
}

/// A cube whose faces have their own vertices, normals and texture coordinates. Face `f` has material `f % materials`.
pub(crate) fn cube(materials: Vec<Material>) -> Mesh {
    let mut mesh = Mesh::default();
    for face in 0..6u32 {
        let (axis, side) = ((face / 2) as usize, if face % 2 == 0 { -1.0 } else { 1.0 });
        let mut normal = [0.0f32; 3];
        normal[axis] = side as f32;
        let first = mesh.positions.len() as u32;
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let mut p = [0.0; 3];
            p[axis] = side;
            p[(axis + 1) % 3] = 2.0 * u - 1.0;
            p[(axis + 2) % 3] = 2.0 * v - 1.0;
            mesh.positions.push(p);
            mesh.normals.push(normal);
            mesh.uvs.push([u as f32, (v * 0.8) as f32]);
            mesh.colors.push([u as f32, v as f32, 0.5]);
            mesh.tangents.push([1.0, 0.0, 0.0, 1.0]);
        }
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| first + k);
        let faces = if side > 0.0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
        mesh.triangles.extend(faces);
        mesh.triangle_materials.extend([face % materials.len() as u32; 2]);
    }
    mesh.materials = materials;
    mesh
}

/// An octahedron with smooth normals at its corners; texture coordinates by longitude, with a seam.
pub(crate) fn ball(materials: Vec<Material>) -> Mesh {
    let mut mesh = Mesh::default();
    for octant in 0..8u32 {
        let sign = |bit: u32| if octant >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let first = mesh.positions.len() as u32;
        for axis in 0..3 {
            let mut p = [0.0; 3];
            p[axis] = sign(axis as u32);
            mesh.positions.push(p);
            mesh.normals.push(p.map(|x| x as f32));
            let quarter = f64::from(octant & 3);
            mesh.uvs.push([(quarter * 0.25 + 0.1 * axis as f64) as f32, (0.5 - 0.5 * p[2]) as f32]);
        }
        let mirrored = sign(0) * sign(1) * sign(2) < 0.0;
        mesh.triangles.push(if mirrored { [first, first + 2, first + 1] } else { [first, first + 1, first + 2] });
        mesh.triangle_materials.push(octant % materials.len() as u32);
    }
    mesh.materials = materials;
    mesh
}

/// The number of sides of triangles, by place, without exactly one opposite side of another triangle.
fn open_sides(mesh: &Mesh) -> usize {
    let place = |v: u32| mesh.positions[v as usize].map(|x| (x + 0.0).to_bits());
    let mut sides: HashMap<_, i32> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (place(t[k]), place(t[(k + 1) % 3]));
            let entry = sides.entry(if a < b { (a, b) } else { (b, a) }).or_default();
            // A plain sum would hide a side with more than one pair.
            *entry += if a < b { 1 } else { 1 << 16 };
        }
    }
    sides.values().filter(|&&n| n != 1 + (1 << 16)).count()
}

fn area(mesh: &Mesh) -> f64 {
    let corner = |v: u32| DVec3::from(mesh.positions[v as usize]);
    mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum()
}

fn check_attributes(mesh: &Mesh) {
    mesh.validate().unwrap();
    for n in &mesh.normals {
        assert!((DVec3::from(n.map(f64::from)).length() - 1.0).abs() < 1e-5, "{n:?}");
    }
}

#[test]
fn closed_meshes_stay_closed() {
    let bumps = || material(bumpy(32), 0.1, -0.03);
    let flat = Material::default;
    let coarse = || material(bumpy(5), 0.2, 0.0);
    for mesh in [
        cube(vec![bumps()]),
        cube(vec![bumps(), flat()]),
        cube(vec![bumps(), flat(), coarse(), flat()]),
        ball(vec![bumps()]),
        ball(vec![bumps(), coarse(), flat()]),
    ] {
        assert_eq!(open_sides(&mesh), 0, "the test needs a closed mesh");
        let displaced = displace(&mesh, &OPTIONS).unwrap();
        check_attributes(&displaced);
        assert!(displaced.triangle_count() > 20 * mesh.triangle_count(), "{}", displaced.triangle_count());
        assert_eq!(open_sides(&displaced), 0);
        assert_eq!(displaced.warnings, [""; 0]);
        // If each vertex moved by itself, the seams would open: proves that the check above notices that.
        let torn = displace_with(&mesh, &OPTIONS, false).unwrap();
        assert!(open_sides(&torn) > 50, "{}", open_sides(&torn));
    }
}

#[test]
fn heights_keep_their_bounds() {
    let mesh = cube(vec![material(bumpy(16), 0.25, 0.125)]);
    let displaced = displace(&mesh, &DisplaceOptions { scale: 0.5, ..OPTIONS }).unwrap();
    let mut highest = 0.0f64;
    for p in &displaced.positions {
        // Outside of the cube by at most bias plus amplitude; where two faces meet, by half of that along each.
        let out = DVec3::from(*p).abs().max_element() - 1.0;
        assert!((0.03..=0.1876).contains(&out), "{p:?}");
        highest = highest.max(out);
    }
    assert!(highest > 0.15, "{highest}");
    let inwards = displace(&mesh, &DisplaceOptions { scale: -0.5, ..OPTIONS }).unwrap();
    assert!(inwards.positions.iter().all(|p| DVec3::from(*p).abs().max_element() < 0.97));
}

#[test]
fn no_height_leaves_the_surface_where_it_is() {
    let zero = || LinearTexture::new(64, 64, vec![[0]; 64 * 64]).unwrap();
    for mesh in [cube(vec![material(zero(), 1.0, 0.0)]), ball(vec![material(zero(), 1.0, 0.0)])] {
        let displaced = displace(&mesh, &OPTIONS).unwrap();
        assert!(displaced.triangle_count() > 20 * mesh.triangle_count());
        assert!((area(&displaced) - area(&mesh)).abs() < 1e-9);
        assert_eq!(displaced.positions[..mesh.positions.len()], mesh.positions);
        assert_eq!(displaced.normals[..mesh.normals.len()], mesh.normals);
        check_attributes(&displaced);
    }
    let cube = cube(vec![material(zero(), 1.0, 0.0)]);
    let displaced = displace(&cube, &OPTIONS).unwrap();
    for (t, corners) in displaced.triangles.iter().enumerate() {
        for &v in corners {
            let (p, n) = (displaced.positions[v as usize], displaced.normals[v as usize]);
            let axis = n.iter().position(|x| x.abs() == 1.0).unwrap_or_else(|| panic!("{t}: {n:?}"));
            assert!((p[axis] - f64::from(n[axis])).abs() < 1e-12, "{p:?} {n:?}");
            // The other attributes are linear over the face.
            let (u, v01) = ((p[(axis + 1) % 3] + 1.0) / 2.0, (p[(axis + 2) % 3] + 1.0) / 2.0);
            let (uv, color) = (displaced.uvs[v as usize], displaced.colors[v as usize]);
            assert!((f64::from(uv[0]) - u).abs() < 1e-6 && (f64::from(uv[1]) - 0.8 * v01).abs() < 1e-6);
            assert!((f64::from(color[0]) - u).abs() < 1e-6 && color[2] == 0.5);
            assert_eq!(displaced.tangents[v as usize], [1.0, 0.0, 0.0, 1.0]);
        }
    }
}

/// The square from 0 to 1 at z = 0, heights read at its own coordinates.
fn square(material: Material) -> Mesh {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    Mesh {
        positions: corners.map(|[x, y]| [x, y, 0.0]).to_vec(),
        uvs: corners.map(|[x, y]| [0.2 + 0.6 * x as f32, 0.2 + 0.6 * y as f32]).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_materials: vec![0; 2],
        materials: vec![material],
        ..Mesh::default()
    }
}

#[test]
fn normals_follow_the_slope() {
    // Heights rise linearly with u, by 0.6 over the square, away from the wrapping edge.
    let ramp: Vec<[u16; 1]> = (0..64 * 64).map(|i| [((i % 64) as f32 / 63.0 * 65535.0) as u16]).collect();
    let mesh = square(material(LinearTexture::new(64, 64, ramp).unwrap(), 0.5, 0.0));
    let displaced = displace(&mesh, &OPTIONS).unwrap();
    check_attributes(&displaced);
    let slope = 0.5 * 0.6 * 64.0 / 63.0;
    let expected = DVec3::new(-slope, 0.0, 1.0).normalize();
    for n in &displaced.normals {
        assert!(DVec3::from(n.map(f64::from)).distance(expected) < 2e-3, "{n:?} {expected}");
    }
    for p in &displaced.positions {
        let texel = ((0.2 + 0.6 * p[0]) * 64.0 - 0.5) / 63.0;
        assert!((p[2] - 0.5 * texel).abs() < 1e-3, "{p:?}");
    }
}

#[test]
fn a_smooth_mesh_stays_smooth_and_a_flat_one_flat() {
    let half = || LinearTexture::new(64, 64, vec![[32768]; 64 * 64]).unwrap();
    // Without normals every facet is flat: facets with different normals meet at the corners.
    let mut flat = ball(vec![material(half(), 0.0, 0.1)]);
    flat.normals.clear();
    let displaced = displace(&flat, &OPTIONS).unwrap();
    check_attributes(&displaced);
    assert_eq!(open_sides(&displaced), 0);
    let inside = |n: &[f32; 3]| n.iter().all(|x| (x.abs() - 0.577_35).abs() < 1e-3);
    assert!(displaced.normals.iter().filter(|n| inside(n)).count() > displaced.normals.len() / 2);
    // With normals, the new ones are those of the ball and agree across the edges of the octahedron.
    let displaced = displace(&ball(vec![material(half(), 0.0, 0.1)]), &OPTIONS).unwrap();
    let mut at: HashMap<_, [f32; 3]> = HashMap::new();
    for (p, n) in displaced.positions.iter().zip(&displaced.normals) {
        let first = at.entry(p.map(f64::to_bits)).or_insert(*n);
        assert!((0..3).all(|k| (first[k] - n[k]).abs() < 1e-5), "{p:?}: {first:?} {n:?}");
    }
    assert!(at.len() > 500);
}

#[test]
fn triangles_are_limited_with_a_warning() {
    let mesh = cube(vec![material(bumpy(256), 0.1, 0.0)]);
    let fine = DisplaceOptions { cell: 1e-9, max_triangles: 5000, ..OPTIONS };
    let displaced = displace(&mesh, &fine).unwrap();
    assert!((1000..=5000).contains(&displaced.triangle_count()), "{}", displaced.triangle_count());
    assert!(
        displaced.warnings[0].starts_with("displacement in cells of 0.000000001 would need more than 5000 triangles; ")
    );
    assert_eq!(open_sides(&displaced), 0);
    let least = displace(&mesh, &DisplaceOptions { max_triangles: 1, ..OPTIONS }).unwrap();
    assert_eq!(least.triangle_count(), mesh.triangle_count());
    // The texels limit the cells: each face is 2 units wide and has 256 texels.
    let displaced = displace(&mesh, &DisplaceOptions { cell: 1e-9, max_triangles: 1 << 22, ..OPTIONS }).unwrap();
    assert!((6 * 2 * 256 * 256..6 * 5 * 256 * 256).contains(&displaced.triangle_count()));
    assert_eq!(displaced.warnings, [""; 0]);
}

#[test]
fn threads_change_nothing() {
    let mesh = ball(vec![material(bumpy(32), 0.1, 0.0), Material::default()]);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (a, b) = (alone.install(|| displace(&mesh, &OPTIONS).unwrap()), displace(&mesh, &OPTIONS).unwrap());
    assert_eq!((a.positions, a.normals, a.triangles), (b.positions, b.normals, b.triangles));
}

#[test]
fn degenerate_triangles_do_no_harm() {
    let mut mesh = cube(vec![material(bumpy(8), 0.1, 0.0)]);
    // A point, a line along an edge and back, and a triangle without area across a face.
    mesh.triangles.extend([[0, 0, 0], [0, 1, 0], [0, 2, 2]]);
    mesh.positions.push([0.0, -1.0, 0.0]);
    mesh.positions.push([0.5, -1.0, 0.0]);
    for _ in 0..2 {
        mesh.normals.push([0.0, -1.0, 0.0]);
        mesh.uvs.push([0.5, 0.5]);
        mesh.colors.push([0.5; 3]);
        mesh.tangents.push([0.0; 4]);
    }
    mesh.triangles.push([0, 24, 25]);
    mesh.triangle_materials.resize(mesh.triangles.len(), 0);
    check_attributes(&displace(&mesh, &OPTIONS).unwrap());
}

#[test]
fn what_cannot_be_done_is_said() {
    let mesh = cube(vec![material(bumpy(8), 0.1, 0.0)]);
    let message = |mesh: &Mesh, options| displace(mesh, &options).unwrap_err().to_string();
    for cell in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = message(&mesh, DisplaceOptions { cell, ..OPTIONS });
        assert!(found.ends_with("it must be above zero and finite"), "{found}");
    }
    let found = message(&mesh, DisplaceOptions { scale: f64::NAN, ..OPTIONS });
    assert_eq!(found, "displacement scale is NaN: it must be a finite number");
    let found = message(&mesh, DisplaceOptions { scale: 1e300, ..OPTIONS });
    let expected = "in a mesh whose largest extent is 2.0: it must be at most 1000 times that extent";
    assert!(
        found.starts_with("displacement is up to 1.0") && found.contains("e299") && found.ends_with(expected),
        "{found}"
    );
    assert!(displace(&mesh, &DisplaceOptions { scale: -1e4, ..OPTIONS }).is_ok());
    assert!(message(&mesh, DisplaceOptions { max_triangles: 0, ..OPTIONS }).contains("between 1 and"));
    let mut bare = mesh.clone();
    bare.uvs.clear();
    let found = message(&bare, OPTIONS);
    assert_eq!(found, "mesh: it has height maps, but no texture coordinates to read them with");
    bare.positions[3][0] = f64::NAN;
    assert_eq!(message(&bare, OPTIONS), "mesh: vertex 3 is not finite; repair or remove it");
    let plain = displace(&cube(vec![Material::default()]), &OPTIONS).unwrap();
    assert_eq!(plain.triangle_count(), 12);
    assert_eq!(
        plain.warnings,
        ["nothing was displaced: no triangle has a height map with an amplitude or bias other than 0"]
    );
}

#[test]
fn cells_follow_the_levels() {
    let options = DisplaceOptions::for_levels(&cube(vec![Material::default()]), 3, 0.5);
    assert_eq!((options.cell, options.scale), (0.5, 0.5));
    assert!(DisplaceOptions::for_levels(&Mesh::default(), 3, 1.0).cell > 0.0);
}

#[test]
fn the_number_of_triangles_is_known_before_they_are_made() {
    let bumps = || material(bumpy(32), 0.1, -0.03);
    let meshes = [
        cube(vec![bumps()]),
        cube(vec![bumps(), Material::default()]),
        ball(vec![bumps(), material(bumpy(5), 0.2, 0.0)]),
    ];
    for (k, mesh) in meshes.iter().enumerate() {
        for cell in [0.2, 0.07, 0.061, 0.053, 0.047, 0.041] {
            let options = DisplaceOptions { cell, ..OPTIONS };
            let expected = displace(mesh, &options).unwrap().triangle_count() as f64;
            let found = displaced_triangles(mesh, &options).unwrap();
            assert!((found / expected - 1.0).abs() < 0.05, "mesh {k}, {cell}: {found}, not {expected}");
        }
    }
    let flat = cube(vec![Material::default()]);
    assert_eq!(displaced_triangles(&flat, &OPTIONS).unwrap(), 12.0);
}
