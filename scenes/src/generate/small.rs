//! Small meshes for tests.

use std::collections::HashMap;

use esvo_builder::mesh::Mesh;
use glam::{DVec3, dvec3};

use super::numeric::{Rng, sin_cos};
use super::shape::{Shapes, plane};

/// One triangle, neither axis-aligned nor degenerate: (0, 0, 0), (1, 0.25, 0), (0.25, 1, 0.5).
pub fn single_triangle() -> Mesh {
    let mut shapes = Shapes::with_capacity(1);
    shapes.add_material("red", [0.8, 0.1, 0.1]);
    shapes.triangle(DVec3::ZERO, dvec3(1.0, 0.25, 0.0), dvec3(0.25, 1.0, 0.5));
    shapes.finish()
}

/// The cube 0..1 in each axis, closed: 12 triangles, flat normals (24 vertices), a material per pair of opposite faces.
pub fn cube() -> Mesh {
    let mut shapes = Shapes::with_capacity(12);
    for (name, rgb) in [("x", [0.8, 0.2, 0.2]), ("y", [0.2, 0.8, 0.2]), ("z", [0.2, 0.2, 0.8])] {
        shapes.add_material(name, rgb);
    }
    shapes.cuboid(DVec3::ZERO, DVec3::ONE);
    let mut mesh = shapes.finish();
    for (t, material) in mesh.triangle_materials.iter_mut().enumerate() {
        *material = t as u32 / 4;
    }
    mesh
}

/// A closed icosphere of radius 1 around the origin: `20 * 4^subdivisions` triangles, shared vertices, smooth normals.
///
/// `subdivisions` above 9 (5.2 million triangles) is treated as 9, so that a wrong argument cannot exhaust memory.
pub fn sphere(subdivisions: u32) -> Mesh {
    let mut shapes = Shapes::with_capacity(20 << (2 * subdivisions.min(9)));
    shapes.add_material("sphere", [0.7, 0.7, 0.7]);
    icosphere(&mut shapes, subdivisions.min(9), |d| d);
    shapes.finish()
}

/// Triangles of [`bumpy_sphere_on_plane`].
pub const BUMPY_SPHERE_ON_PLANE_TRIANGLES: usize = 20 * (1 << 10) + 2 * 64 * 64;

/// A closed bumpy sphere (20,480 triangles) over a plane (8,192 triangles): smooth curvature, a silhouette, a contact.
///
/// Extents: the plane is y = 0 over -2..2 in x and z, the sphere has a radius of about 0.8 around (0, 0.85, 0).
pub fn bumpy_sphere_on_plane() -> Mesh {
    let mut shapes = Shapes::with_capacity(BUMPY_SPHERE_ON_PLANE_TRIANGLES);
    let plane_material = shapes.add_material("plane", [0.5, 0.5, 0.45]);
    let sphere_material = shapes.add_material("sphere", [0.75, 0.35, 0.2]);
    shapes.paint(plane_material);
    shapes.patch(64, 64, plane(dvec3(-2.0, 0.0, 2.0), DVec3::X * 4.0, DVec3::Z * -4.0));
    shapes.paint(sphere_material);
    icosphere(&mut shapes, 5, |d| {
        let bump = sin_cos(9.0 * d.x).0 * sin_cos(8.0 * d.y + 1.0).0 * sin_cos(10.0 * d.z + 2.0).0;
        dvec3(0.0, 0.85, 0.0) + d * (0.8 + 0.05 * bump)
    });
    shapes.finish()
}

/// Triangles of [`slivers`].
pub const SLIVERS_TRIANGLES: usize = 64 + 3 * 16 + 32 + 32 + 64;

/// Difficult triangles for builders and casters, 240 of them within -1..1: a fan of 64 needles (1 long, 1e-3 down to 1e-9
/// wide); 16 triangles each with two equal corners, with three equal corners and with corners on one line; 32 coplanar
/// overlapping triangles in the plane z = 0.5; 16 pairs of the same triangle wound both ways; 64 specks of edge 1e-7.
pub fn slivers() -> Mesh {
    let mut rng = Rng::new(0x5115);
    let mut shapes = Shapes::with_capacity(SLIVERS_TRIANGLES);
    shapes.add_material("needles", [0.7, 0.6, 0.2]);
    let mut width = 1e-3;
    for k in 0..64 {
        let tip = rng.direction();
        let side = tip.cross(DVec3::new(0.3, 0.5, -0.8)).normalize();
        shapes.triangle(DVec3::ZERO, tip - side * width, tip * 0.999 + side * width);
        if k % 10 == 9 {
            width *= 0.1;
        }
    }
    for _ in 0..16 {
        let (a, b) = (rng.direction() * 0.9, rng.direction() * 0.9);
        shapes.triangle(a, b, b);
        shapes.triangle(a, a, a);
        shapes.triangle(a, (a + b) * 0.5, b);
    }
    let flat = |rng: &mut Rng| dvec3(rng.range(-0.8, 0.8), rng.range(-0.8, 0.8), 0.5);
    for _ in 0..32 {
        let (a, b, c) = (flat(&mut rng), flat(&mut rng), flat(&mut rng));
        shapes.triangle(a, b, c);
    }
    for _ in 0..16 {
        let (a, b, c) = (rng.direction() * 0.9, rng.direction() * 0.9, rng.direction() * 0.9);
        shapes.triangle(a, b, c);
        shapes.triangle(a, c, b);
    }
    for _ in 0..64 {
        let a = rng.direction() * 0.9;
        shapes.triangle(a, a + rng.direction() * 1e-7, a + rng.direction() * 1e-7);
    }
    shapes.finish()
}

/// A subdivided icosahedron with every vertex direction mapped by `place`; normals follow the mapped triangles.
pub(crate) fn icosphere(shapes: &mut Shapes, subdivisions: u32, place: impl Fn(DVec3) -> DVec3) {
    let phi = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut directions: Vec<DVec3> = [
        (-1.0, phi, 0.0),
        (1.0, phi, 0.0),
        (-1.0, -phi, 0.0),
        (1.0, -phi, 0.0),
        (0.0, -1.0, phi),
        (0.0, 1.0, phi),
        (0.0, -1.0, -phi),
        (0.0, 1.0, -phi),
        (phi, 0.0, -1.0),
        (phi, 0.0, 1.0),
        (-phi, 0.0, -1.0),
        (-phi, 0.0, 1.0),
    ]
    .map(|(x, y, z)| dvec3(x, y, z).normalize())
    .to_vec();
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..subdivisions {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::with_capacity(faces.len() * 3 / 2);
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                directions.push((directions[a as usize] + directions[b as usize]).normalize());
                directions.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let positions: Vec<DVec3> = directions.iter().map(|&d| place(d)).collect();
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for &[a, b, c] in &faces {
        let [p, q, r] = [a, b, c].map(|v| positions[v as usize]);
        for v in [a, b, c] {
            normals[v as usize] += (q - p).cross(r - p);
        }
    }
    let mut first = None;
    for (&p, &n) in positions.iter().zip(&normals) {
        let v = shapes.vertex(p, n);
        first.get_or_insert(v);
    }
    let first = first.unwrap_or(0);
    for [a, b, c] in faces {
        shapes.face(first + a, first + b, first + c);
    }
}
