//! The convex polyhedron that a voxel's cube and the contours of its ancestors leave (paper section 3.4).

use glam::Vec3;

/// Most contours that are kept as bounds of one voxel; further ones are forgotten, which only makes the shape larger.
pub const MAX_SLABS: usize = 8;
/// Faces: 0..6 are the cube's; 6 + 2k and 7 + 2k are the planes of slab k.
const MAX_FACES: usize = 6 + 2 * MAX_SLABS;
/// Most vertices; a cut that would need more leaves the polyhedron as it is.
const MAX_VERTICES: usize = 64;

/// An edge: its two vertices and the two faces that meet in it.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [u8; 2],
    faces: [u8; 2],
}

/// A convex polyhedron inside the unit cube around the origin, as its vertices and edges.
#[derive(Clone)]
pub struct Polyhedron {
    vertices: Vec<Vec3>,
    edges: Vec<Edge>,
    // Scratch of `cut`.
    distances: Vec<f32>,
    new_edges: Vec<Edge>,
}

impl Default for Polyhedron {
    fn default() -> Self {
        let mut polyhedron = Self {
            vertices: Vec::with_capacity(MAX_VERTICES),
            edges: Vec::new(),
            distances: Vec::new(),
            new_edges: Vec::new(),
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
        self.vertices.clear();
        let side = |i: u32, axis: u32| if i >> axis & 1 != 0 { 0.5 } else { -0.5 };
        self.vertices.extend((0..8).map(|i| Vec3::new(side(i, 0), side(i, 1), side(i, 2))));
        self.edges.clear();
        self.edges.extend_from_slice(&CUBE_EDGES);
    }

    /// Cuts away where `normal·p > limit`; the new face gets the number `face`.
    pub fn cut(&mut self, normal: Vec3, limit: f32, face: u8) {
        self.distances.clear();
        self.distances.extend(self.vertices.iter().map(|v| normal.dot(*v) - limit));
        // A cut that removes nothing is the common case.
        if self.distances.iter().all(|d| *d <= 0.0) {
            return;
        }
        let crossings =
            self.edges.iter().filter(|e| (self.distance(e.ends[0]) > 0.0) != (self.distance(e.ends[1]) > 0.0));
        if self.vertices.len() + crossings.count() > MAX_VERTICES {
            return;
        }
        self.new_edges.clear();
        // Where the new face meets an old one: two points each, on edges that the plane crosses.
        let mut open = [u8::MAX; MAX_FACES];
        for i in 0..self.edges.len() {
            let edge = self.edges[i];
            let [a, b] = edge.ends;
            let (da, db) = (self.distance(a), self.distance(b));
            if da > 0.0 && db > 0.0 {
                continue;
            }
            if da <= 0.0 && db <= 0.0 {
                self.new_edges.push(edge);
                continue;
            }
            let (pa, pb) = (self.vertices[a as usize], self.vertices[b as usize]);
            let crossing = self.vertices.len() as u8;
            self.vertices.push(pa + (pb - pa) * (da / (da - db)).clamp(0.0, 1.0));
            self.distances.push(0.0);
            self.new_edges.push(Edge { ends: [if da <= 0.0 { a } else { b }, crossing], faces: edge.faces });
            for old in edge.faces {
                let other = std::mem::replace(&mut open[old as usize], crossing);
                if other != u8::MAX {
                    self.new_edges.push(Edge { ends: [other, crossing], faces: [old, face] });
                    open[old as usize] = u8::MAX;
                }
            }
        }
        std::mem::swap(&mut self.edges, &mut self.new_edges);
        // Close the gaps that the vertices cut away leave.
        let mut moved = [0u8; MAX_VERTICES];
        let mut kept = 0;
        for i in 0..self.vertices.len() {
            if self.distances[i] <= 0.0 {
                moved[i] = kept as u8;
                self.vertices[kept] = self.vertices[i];
                kept += 1;
            }
        }
        self.vertices.truncate(kept);
        for edge in &mut self.edges {
            edge.ends = edge.ends.map(|end| moved[end as usize]);
        }
    }

    fn distance(&self, vertex: u8) -> f32 {
        self.distances[vertex as usize]
    }

    /// The vertices; none if nothing is left.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Extent along a direction.
    pub fn extent(&self, direction: Vec3) -> (f32, f32) {
        self.vertices.iter().fold((f32::MAX, f32::MIN), |(lo, hi), v| {
            let d = direction.dot(*v);
            (lo.min(d), hi.max(d))
        })
    }

    /// One bit per face that still bounds the polyhedron.
    pub fn faces(&self) -> u32 {
        self.edges.iter().fold(0, |mask, e| mask | 1 << e.faces[0] | 1 << e.faces[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_corner_has_three_new_edges() {
        let mut p = Polyhedron::default();
        p.reset();
        assert_eq!(p.edges.len(), 12);
        assert_eq!(p.faces(), 0b111111);
        p.cut(Vec3::ONE, 1.0, 6);
        assert_eq!((p.vertices.len(), p.edges.len()), (10, 15));
        assert_eq!(p.faces(), 0b1111111);
        let (lo, hi) = p.extent(Vec3::ONE);
        assert!((lo + 1.5).abs() < 1e-6 && (hi - 1.0).abs() < 1e-6);
    }

    #[test]
    fn halving_the_cube_replaces_a_face() {
        let mut p = Polyhedron::default();
        p.reset();
        p.cut(Vec3::X, 0.0, 6);
        assert_eq!(p.edges.len(), 12);
        assert_eq!(p.faces(), 0b1111101);
        assert_eq!(p.extent(Vec3::X), (-0.5, 0.0));
        p.cut(Vec3::NEG_X, -0.25, 7);
        assert!(p.vertices.is_empty() || p.extent(Vec3::X).0 >= -0.25, "nothing below 1/4 may be left");
    }
}
