//! The convex polyhedron that a voxel's cube and the contours of its ancestors leave (paper section 3.4).

use glam::{Vec3, Vec4};

/// Most contours that are kept as bounds of one voxel; further ones are forgotten, which only makes the shape larger.
pub const MAX_SLABS: usize = 8;
/// Faces: 0..6 are the cube's; 6 + 2k and 7 + 2k are the planes of slab k.
const MAX_FACES: usize = 6 + 2 * MAX_SLABS;
/// Most vertices; a cut that would need more leaves the polyhedron as it is.
const MAX_VERTICES: usize = 64;
/// Most edges, likewise.
const MAX_EDGES: usize = 128;

/// An edge: its two vertices and the two faces that meet in it.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [u8; 2],
    faces: [u8; 2],
}

/// A convex polyhedron inside the unit cube around the origin, as its vertices and edges.
///
/// Vertices have places that they keep until they are cut away; the places that are free are used again.
#[derive(Clone)]
pub struct Polyhedron {
    /// Coordinates, four places to a vector.
    x: [Vec4; MAX_VERTICES / 4],
    y: [Vec4; MAX_VERTICES / 4],
    z: [Vec4; MAX_VERTICES / 4],
    /// One bit per place that holds a vertex.
    used: u64,
    edges: [Edge; MAX_EDGES],
    edge_count: usize,
}

impl Default for Polyhedron {
    fn default() -> Self {
        let mut polyhedron = Self {
            x: [Vec4::ZERO; MAX_VERTICES / 4],
            y: [Vec4::ZERO; MAX_VERTICES / 4],
            z: [Vec4::ZERO; MAX_VERTICES / 4],
            used: 0,
            edges: [Edge { ends: [0; 2], faces: [0; 2] }; MAX_EDGES],
            edge_count: 0,
        };
        polyhedron.reset();
        polyhedron
    }
}

/// The edges of the cube; vertex `i` has the coordinates of its bits.
const CUBE_EDGES: [Edge; 12] = {
    let mut edges = [Edge { ends: [0; 2], faces: [0; 2] }; 12];
    let mut i = 0;
    while i < 12 {
        let (axis, corner) = (i / 4, i % 4);
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let (high_b, high_c) = (corner & 1, corner >> 1);
        let start = high_b << b | high_c << c;
        edges[i] = Edge {
            ends: [start as u8, (start | 1 << axis) as u8],
            faces: [(2 * b + high_b) as u8, (2 * c + high_c) as u8],
        };
        i += 1;
    }
    edges
};

impl Polyhedron {
    /// Becomes the whole cube `[-1/2, 1/2]³`.
    pub fn reset(&mut self) {
        const LOW_HIGH: Vec4 = Vec4::new(-0.5, 0.5, -0.5, 0.5);
        (self.x[0], self.x[1]) = (LOW_HIGH, LOW_HIGH);
        let low_low_high_high = Vec4::new(-0.5, -0.5, 0.5, 0.5);
        (self.y[0], self.y[1]) = (low_low_high_high, low_low_high_high);
        (self.z[0], self.z[1]) = (Vec4::splat(-0.5), Vec4::splat(0.5));
        self.used = 0xff;
        self.edges[..12].copy_from_slice(&CUBE_EDGES);
        self.edge_count = 12;
    }

    /// How many vectors have vertices in them.
    fn vectors(&self) -> usize {
        (64 - self.used.leading_zeros() as usize).div_ceil(4)
    }

    fn vertex(&self, place: usize) -> Vec3 {
        let (i, k) = (place / 4, place % 4);
        Vec3::new(self.x[i][k], self.y[i][k], self.z[i][k])
    }

    /// Cuts away where `normal·p > limit`; the new face gets the number `face`.
    pub fn cut(&mut self, normal: Vec3, limit: f32, face: u8) {
        let mut distances = [Vec4::ZERO; MAX_VERTICES / 4];
        let mut outside = 0u64;
        for i in 0..self.vectors() {
            let d = self.x[i] * normal.x + self.y[i] * normal.y + self.z[i] * normal.z - limit;
            distances[i] = d;
            outside |= u64::from(d.cmpgt(Vec4::ZERO).bitmask()) << (4 * i);
        }
        outside &= self.used;
        // A cut that removes nothing is the common case.
        if outside == 0 {
            return;
        }
        let is_out = |vertex: u8| outside >> vertex & 1 != 0;
        let crossings = self.edges[..self.edge_count].iter().filter(|e| is_out(e.ends[0]) != is_out(e.ends[1])).count();
        if crossings > (!self.used).count_ones() as usize || self.edge_count + crossings > MAX_EDGES {
            return;
        }
        // Where the new face meets an old one: two points each, on edges that the plane crosses.
        let mut open = [u8::MAX; MAX_FACES];
        let mut added = [Edge { ends: [0; 2], faces: [0; 2] }; MAX_EDGES / 2];
        let (mut kept, mut added_count) = (0, 0);
        for i in 0..self.edge_count {
            let mut edge = self.edges[i];
            let [a, b] = edge.ends;
            match (is_out(a), is_out(b)) {
                (true, true) => continue,
                (false, false) => {}
                (a_is_out, _) => {
                    let (da, db) = (at(&distances, a), at(&distances, b));
                    let (pa, pb) = (self.vertex(a as usize), self.vertex(b as usize));
                    let crossing = (!self.used).trailing_zeros() as u8;
                    self.put(crossing, pa + (pb - pa) * (da / (da - db)).clamp(0.0, 1.0));
                    for old in edge.faces {
                        let other = std::mem::replace(&mut open[old as usize], crossing);
                        if other != u8::MAX {
                            added[added_count] = Edge { ends: [other, crossing], faces: [old, face] };
                            added_count += 1;
                            open[old as usize] = u8::MAX;
                        }
                    }
                    edge.ends[usize::from(!a_is_out)] = crossing;
                }
            }
            self.edges[kept] = edge;
            kept += 1;
        }
        self.edges[kept..kept + added_count].copy_from_slice(&added[..added_count]);
        self.edge_count = kept + added_count;
        self.used &= !outside;
    }

    fn put(&mut self, place: u8, p: Vec3) {
        let (i, k) = (place as usize / 4, place as usize % 4);
        (self.x[i][k], self.y[i][k], self.z[i][k]) = (p.x, p.y, p.z);
        self.used |= 1 << place;
    }

    /// The vertices; none if nothing is left.
    pub fn vertices(&self) -> impl Iterator<Item = Vec3> + '_ {
        let mut left = self.used;
        std::iter::from_fn(move || {
            let place = left.trailing_zeros();
            left &= left.wrapping_sub(1);
            (place < 64).then(|| self.vertex(place as usize))
        })
    }

    /// Extent along a direction.
    pub fn extent(&self, direction: Vec3) -> (f32, f32) {
        let (mut lo, mut hi) = (f32::MAX, f32::MIN);
        for v in self.vertices() {
            let d = direction.dot(v);
            (lo, hi) = (if d < lo { d } else { lo }, if d > hi { d } else { hi });
        }
        (lo, hi)
    }

    /// One bit per face that still bounds the polyhedron.
    pub fn faces(&self) -> u32 {
        self.edges[..self.edge_count].iter().fold(0, |mask, e| mask | 1 << e.faces[0] | 1 << e.faces[1])
    }
}

fn at(distances: &[Vec4; MAX_VERTICES / 4], vertex: u8) -> f32 {
    distances[vertex as usize / 4][vertex as usize % 4]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_corner_has_three_new_edges() {
        let mut p = Polyhedron::default();
        p.reset();
        assert_eq!(p.edge_count, 12);
        assert_eq!(p.faces(), 0b111111);
        p.cut(Vec3::ONE, 1.0, 6);
        assert_eq!((p.vertices().count(), p.edge_count), (10, 15));
        assert_eq!(p.faces(), 0b1111111);
        let (lo, hi) = p.extent(Vec3::ONE);
        assert!((lo + 1.5).abs() < 1e-6 && (hi - 1.0).abs() < 1e-6);
    }

    #[test]
    fn halving_the_cube_replaces_a_face() {
        let mut p = Polyhedron::default();
        p.reset();
        p.cut(Vec3::X, 0.0, 6);
        assert_eq!(p.edge_count, 12);
        assert_eq!(p.faces(), 0b1111101);
        assert_eq!(p.extent(Vec3::X), (-0.5, 0.0));
        p.cut(Vec3::NEG_X, -0.25, 7);
        assert!(p.vertices().next().is_none() || p.extent(Vec3::X).0 >= -0.25, "nothing below 1/4 may be left");
    }
}
