//! The convex polyhedron that a voxel's cube and the contours of its ancestors leave (paper section 3.4).

use glam::Vec3;

/// Most contours that are kept as bounds of one voxel; further ones are forgotten, which only makes the shape larger.
pub const MAX_SLABS: usize = 12;
/// Most edges; a cut that would need more leaves the polyhedron as it is.
const MAX_EDGES: usize = 96;

/// An edge between two faces. Faces 0..6 are the cube's; 6 + 2k and 7 + 2k are the planes of slab k.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [Vec3; 2],
    faces: [u8; 2],
}

/// A convex polyhedron inside the unit cube around the origin, as its edges.
#[derive(Clone)]
pub struct Polyhedron {
    edges: Vec<Edge>,
    scratch: Vec<Edge>,
}

impl Default for Polyhedron {
    fn default() -> Self {
        Self { edges: Vec::with_capacity(MAX_EDGES), scratch: Vec::with_capacity(MAX_EDGES) }
    }
}

impl Polyhedron {
    /// Becomes the whole cube `[-1/2, 1/2]³`.
    pub fn reset(&mut self) {
        self.edges.clear();
        for axis in 0..3 {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            for corner in 0..4u8 {
                let (hb, hc) = (corner & 1, corner >> 1);
                let mut end = Vec3::ZERO;
                end[b] = f32::from(hb) - 0.5;
                end[c] = f32::from(hc) - 0.5;
                let mut ends = [end; 2];
                ends[0][axis] = -0.5;
                ends[1][axis] = 0.5;
                self.edges.push(Edge { ends, faces: [2 * b as u8 + hb, 2 * c as u8 + hc] });
            }
        }
    }

    /// Cuts away where `normal·p > limit`; the new face gets the number `face`.
    pub fn cut(&mut self, normal: Vec3, limit: f32, face: u8) {
        // A cut that removes nothing is the common case: look before touching anything.
        if self.edges.iter().all(|e| normal.dot(e.ends[0]) <= limit && normal.dot(e.ends[1]) <= limit) {
            return;
        }
        self.scratch.clear();
        // Where the new face meets an old one: two points each, on edges that the plane crosses.
        let mut open: [Option<Vec3>; 6 + 2 * MAX_SLABS] = [None; 6 + 2 * MAX_SLABS];
        for edge in &self.edges {
            let [a, b] = edge.ends;
            let (da, db) = (normal.dot(a) - limit, normal.dot(b) - limit);
            if da > 0.0 && db > 0.0 {
                continue;
            }
            if da <= 0.0 && db <= 0.0 {
                self.scratch.push(*edge);
                continue;
            }
            let crossing = a + (b - a) * (da / (da - db)).clamp(0.0, 1.0);
            let kept = if da <= 0.0 { a } else { b };
            self.scratch.push(Edge { ends: [kept, crossing], faces: edge.faces });
            for old in edge.faces {
                match open[old as usize].take() {
                    Some(other) => self.scratch.push(Edge { ends: [other, crossing], faces: [old, face] }),
                    None => open[old as usize] = Some(crossing),
                }
            }
        }
        if self.scratch.len() <= MAX_EDGES {
            std::mem::swap(&mut self.edges, &mut self.scratch);
        }
    }

    /// All vertices, each several times.
    pub fn vertices(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.edges.iter().flat_map(|e| e.ends)
    }

    /// Extent along a direction.
    pub fn extent(&self, direction: Vec3) -> (f32, f32) {
        self.vertices().fold((f32::MAX, f32::MIN), |(lo, hi), v| {
            let d = direction.dot(v);
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
        assert_eq!(p.edges.len(), 15);
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
        assert!(p.edges.is_empty() || p.extent(Vec3::X).0 >= -0.25, "nothing below 1/4 may be left");
    }
}
