//! Shapes that the generators share: boxes, patches, tubes, surfaces of revolution.

use esvo_builder::mesh::{Material, Mesh};
use glam::{DAffine3, DVec2, DVec3, dvec3};

use super::numeric::{tangents, turn};

/// Collects triangles into a [`Mesh`]. The current material and frame apply to everything that is added later.
pub(crate) struct Shapes {
    mesh: Mesh,
    material: u32,
    /// Placement of the shapes that are added next. Only rotation, uniform scale and translation, as it transforms normals too.
    pub(crate) frame: DAffine3,
}

impl Shapes {
    /// An empty mesh with room for `triangles` triangles.
    pub(crate) fn with_capacity(triangles: usize) -> Self {
        let mut mesh = Mesh::default();
        mesh.triangles.reserve_exact(triangles);
        mesh.triangle_materials.reserve_exact(triangles);
        mesh.positions.reserve(triangles / 2);
        mesh.normals.reserve(triangles / 2);
        Self { mesh, material: 0, frame: DAffine3::IDENTITY }
    }

    /// Triangles so far.
    pub(crate) fn count(&self) -> usize {
        self.mesh.triangles.len()
    }

    pub(crate) fn finish(self) -> Mesh {
        self.mesh
    }

    /// Adds a plain material of the given linear RGB and returns its index.
    pub(crate) fn add_material(&mut self, name: &str, rgb: [f32; 3]) -> u32 {
        let [r, g, b] = rgb;
        self.mesh.materials.push(Material { name: name.into(), base_color: [r, g, b, 1.0], ..Material::default() });
        self.mesh.materials.len() as u32 - 1
    }

    /// Uses this material for the shapes that are added next.
    pub(crate) fn paint(&mut self, material: u32) {
        self.material = material;
    }

    pub(crate) fn vertex(&mut self, p: DVec3, n: DVec3) -> u32 {
        let p = self.frame.transform_point3(p);
        let n = self.frame.transform_vector3(n).normalize_or(DVec3::Y);
        self.mesh.positions.push(p.to_array());
        self.mesh.normals.push(n.as_vec3().to_array());
        self.mesh.positions.len() as u32 - 1
    }

    pub(crate) fn face(&mut self, a: u32, b: u32, c: u32) {
        self.mesh.triangles.push([a, b, c]);
        self.mesh.triangle_materials.push(self.material);
    }

    /// One flat triangle, counter-clockwise from outside.
    pub(crate) fn triangle(&mut self, a: DVec3, b: DVec3, c: DVec3) {
        let n = (b - a).cross(c - a);
        let [a, b, c] = [a, b, c].map(|p| self.vertex(p, n));
        self.face(a, b, c);
    }

    /// A flat quad of two triangles, counter-clockwise from outside.
    pub(crate) fn quad(&mut self, a: DVec3, b: DVec3, c: DVec3, d: DVec3) {
        let n = (c - a).cross(d - b);
        let [a, b, c, d] = [a, b, c, d].map(|p| self.vertex(p, n));
        self.face(a, b, c);
        self.face(a, c, d);
    }

    /// An axis-aligned box of 12 triangles.
    pub(crate) fn cuboid(&mut self, min: DVec3, max: DVec3) {
        self.cuboid_without(min, max, None);
    }

    /// A box around `centre` with the given full edge lengths.
    pub(crate) fn block(&mut self, centre: DVec3, size: DVec3) {
        self.cuboid(centre - size * 0.5, centre + size * 0.5);
    }

    /// A box without its bottom (`Some(-DVec3::Y)`) or another face named by its outward normal.
    pub(crate) fn cuboid_without(&mut self, min: DVec3, max: DVec3, missing: Option<DVec3>) {
        let corner = |bits: usize| {
            dvec3(
                if bits & 1 != 0 { max.x } else { min.x },
                if bits & 2 != 0 { max.y } else { min.y },
                if bits & 4 != 0 { max.z } else { min.z },
            )
        };
        const FACES: [(DVec3, [usize; 4]); 6] = [
            (DVec3::NEG_X, [0, 4, 6, 2]),
            (DVec3::X, [1, 3, 7, 5]),
            (DVec3::NEG_Y, [0, 1, 5, 4]),
            (DVec3::Y, [2, 6, 7, 3]),
            (DVec3::NEG_Z, [0, 2, 3, 1]),
            (DVec3::Z, [4, 5, 7, 6]),
        ];
        for (normal, [a, b, c, d]) in FACES {
            if missing != Some(normal) {
                self.quad(corner(a), corner(b), corner(c), corner(d));
            }
        }
    }

    /// The inside of a box, seen from within: six quads that face inwards.
    pub(crate) fn room(&mut self, min: DVec3, max: DVec3) {
        // Each face takes its corners in reverse order, which turns the box inside out.
        let before = self.count();
        self.cuboid(min, max);
        for t in before..self.count() {
            self.mesh.triangles[t].swap(1, 2);
            for v in self.mesh.triangles[t] {
                // Both triangles of a face share corners: the sign follows from the geometry, so that none is flipped twice.
                let p = DVec3::from_array(self.mesh.positions[v as usize]);
                let n = DVec3::from_array(self.mesh.normals[v as usize].map(f64::from));
                let centre = self.frame.transform_point3((min + max) * 0.5);
                if n.dot(p - centre) > 0.0 {
                    self.mesh.normals[v as usize] = (-n).as_vec3().to_array();
                }
            }
        }
    }

    /// A curved patch of `nu * nv` cells with two triangles each and shared vertices.
    ///
    /// `surface(u, v)` gives position and normal for `u, v` in 0..=1; the outside is where `d/du x d/dv` points.
    pub(crate) fn patch(&mut self, nu: usize, nv: usize, surface: impl Fn(f64, f64) -> (DVec3, DVec3)) {
        let first = self.mesh.positions.len() as u32;
        for j in 0..=nv {
            for i in 0..=nu {
                let (p, n) = surface(i as f64 / nu as f64, j as f64 / nv as f64);
                self.vertex(p, n);
            }
        }
        let row = nu as u32 + 1;
        for j in 0..nv as u32 {
            for i in 0..nu as u32 {
                let a = first + j * row + i;
                self.face(a, a + 1, a + row + 1);
                self.face(a, a + row + 1, a + row);
            }
        }
    }

    /// A surface of revolution around the vertical line through `centre`.
    ///
    /// `profile` holds (radius, height) from bottom to top. A radius of zero gives one triangle per segment instead of
    /// two; the outside is to the right of the profile as it is walked upwards.
    pub(crate) fn lathe(&mut self, centre: DVec3, profile: &[DVec2], segments: usize) {
        let first = self.mesh.positions.len() as u32;
        for (k, &p) in profile.iter().enumerate() {
            let before = profile[k.saturating_sub(1)];
            let after = profile[(k + 1).min(profile.len() - 1)];
            let along = (after - before).normalize_or(DVec2::Y);
            for i in 0..segments {
                let (s, c) = turn(i, segments);
                // Along (dr, dy), the outward normal is (dy, -dr).
                self.vertex(centre + dvec3(p.x * c, p.y, p.x * s), dvec3(along.y * c, -along.x, along.y * s));
            }
        }
        let n = segments as u32;
        for k in 0..profile.len() as u32 - 1 {
            let (low, high) = (profile[k as usize].x, profile[k as usize + 1].x);
            for i in 0..n {
                let (a, b) = (first + k * n + i, first + k * n + (i + 1) % n);
                if high > 0.0 {
                    self.face(a, a + n, b + n);
                }
                if low > 0.0 {
                    self.face(a, b + n, b);
                }
            }
        }
    }

    /// An ellipsoid with `2 * segments * (rings - 1)` triangles.
    pub(crate) fn ellipsoid(&mut self, centre: DVec3, radii: DVec3, rings: usize, segments: usize) {
        let first = self.mesh.positions.len() as u32;
        for k in 0..=rings {
            let (sin, cos) = turn(k, 2 * rings);
            for i in 0..segments {
                let (s, c) = turn(i, segments);
                let d = if k == 0 || k == rings { dvec3(0.0, -cos, 0.0) } else { dvec3(sin * c, -cos, sin * s) };
                self.vertex(centre + d * radii, d / radii);
            }
        }
        let n = segments as u32;
        for k in 0..rings as u32 {
            for i in 0..n {
                let (a, b) = (first + k * n + i, first + k * n + (i + 1) % n);
                if k + 1 < rings as u32 {
                    self.face(a, a + n, b + n);
                }
                if k > 0 {
                    self.face(a, b + n, b);
                }
            }
        }
    }

    /// A tube along `points` (at least three), closed by a pointed tip at either end.
    ///
    /// The first and last point are the tips, each other point carries a ring of `sides` vertices with the radius
    /// `radius(i)`: `2 * sides * (points - 2)` triangles. Frames are carried along without twisting.
    pub(crate) fn tube(&mut self, points: &[DVec3], sides: usize, radius: impl Fn(usize) -> f64) {
        let last = points.len() - 1;
        let mut tangent = (points[1] - points[0]).normalize_or(DVec3::Y);
        let (mut a, _) = tangents(tangent);
        let tip = self.vertex(points[0], -tangent);
        let first = tip + 1;
        for i in 1..last {
            tangent = (points[i + 1] - points[i - 1]).normalize_or(tangent);
            a = (a - tangent * a.dot(tangent)).normalize_or(tangents(tangent).0);
            let b = tangent.cross(a);
            let r = radius(i);
            for k in 0..sides {
                let (s, c) = turn(k, sides);
                let n = a * c + b * s;
                self.vertex(points[i] + n * r, n);
            }
        }
        let end = self.vertex(points[last], tangent);
        let n = sides as u32;
        for k in 0..n {
            self.face(tip, first + (k + 1) % n, first + k);
        }
        for ring in 0..last as u32 - 2 {
            for k in 0..n {
                let (p, q) = (first + ring * n + k, first + ring * n + (k + 1) % n);
                self.face(p, q, q + n);
                self.face(p, q + n, p + n);
            }
        }
        for k in 0..n {
            self.face(end - n + k, end - n + (k + 1) % n, end);
        }
    }

    /// A straight rod: a tube of `pieces` equal pieces with very short tips, `2 * sides * (pieces + 1)` triangles.
    pub(crate) fn rod(&mut self, from: DVec3, to: DVec3, radius: f64, sides: usize, pieces: usize) {
        let mut points = vec![from];
        for i in 0..=pieces {
            points.push(from.lerp(to, 0.0005 + 0.999 * i as f64 / pieces as f64));
        }
        points.push(to);
        self.tube(&points, sides, |_| radius);
    }

    /// A patch that brings the whole mesh to exactly `total` triangles: a square grid of cells with two triangles each,
    /// some of which have a fifth vertex in the middle and four triangles.
    ///
    /// `paint(i, j)` gives the material of a cell. The number of missing triangles must be even and at least 18; the budgets of
    /// the generators ensure this for every seed.
    pub(crate) fn fill_grid(
        &mut self,
        total: usize,
        surface: impl Fn(f64, f64) -> (DVec3, DVec3),
        paint: impl Fn(usize, usize) -> u32,
    ) {
        let missing = total.checked_sub(self.count()).expect("a generator overran its triangle budget");
        assert!(missing >= 18 && missing.is_multiple_of(2), "{missing} triangles left for the last grid");
        // 2 n^2 <= missing < 2 (n + 1)^2 <= 4 n^2 for n >= 3, so that no cell needs more than four triangles.
        let n = (missing / 2).isqrt();
        let split = missing / 2 - n * n;
        let first = self.mesh.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (p, normal) = surface(i as f64 / n as f64, j as f64 / n as f64);
                self.vertex(p, normal);
            }
        }
        let row = n as u32 + 1;
        for j in 0..n {
            for i in 0..n {
                self.paint(paint(i, j));
                let cell = j * n + i;
                let a = first + j as u32 * row + i as u32;
                let corners = [a, a + 1, a + row + 1, a + row];
                // Cells with a middle vertex are spread evenly, like the steps of a line on a raster.
                if (cell + 1) * split / (n * n) > cell * split / (n * n) {
                    let (p, normal) = surface((i as f64 + 0.5) / n as f64, (j as f64 + 0.5) / n as f64);
                    let middle = self.vertex(p, normal);
                    for k in 0..4 {
                        self.face(corners[k], corners[(k + 1) % 4], middle);
                    }
                } else {
                    self.face(corners[0], corners[1], corners[2]);
                    self.face(corners[0], corners[2], corners[3]);
                }
            }
        }
    }
}

/// A flat rectangle as a surface for [`Shapes::patch`] and [`Shapes::fill_grid`]: `origin + u * du + v * dv`.
pub(crate) fn plane(origin: DVec3, du: DVec3, dv: DVec3) -> impl Fn(f64, f64) -> (DVec3, DVec3) {
    let n = du.cross(dv).normalize_or(DVec3::Y);
    move |u, v| (origin + du * u + dv * v, n)
}
