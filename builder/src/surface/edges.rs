//! Which edges of the triangles end or bend the surface.

use glam::DVec3;
use rayon::prelude::*;

/// What the edges of one triangle are: edge `i` goes from corner `i` to corner `i + 1`.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub(crate) struct Edges(u8);

impl Edges {
    const ALL_CREASES: Self = Self(0b111_000);

    /// Whether the edge belongs to no other triangle.
    pub(crate) fn is_boundary(self, edge: usize) -> bool {
        self.0 >> edge & 1 != 0
    }

    /// Whether some edge is a boundary.
    pub(crate) fn has_boundary(self) -> bool {
        self.0 & 0b111 != 0
    }

    /// Whether the surface ends or bends at the edge, or more than two triangles meet there. False only if exactly one other
    /// triangle continues in the same plane.
    pub(crate) fn is_crease(self, edge: usize) -> bool {
        self.0 >> (edge + 3) & 1 != 0
    }

    fn set_boundary(&mut self, edge: u32) {
        self.0 |= 1 << edge;
    }

    fn set_flat(&mut self, edge: u32) {
        self.0 &= !(8 << edge);
    }
}

/// Sine of the largest angle between triangles that count as one plane.
const FLAT: f64 = 1.0 / 16384.0;

/// Classifies the edges of all triangles. Corners at the same position are the same corner.
pub(crate) fn classify(corners: &[[DVec3; 3]]) -> Vec<Edges> {
    let point = points(corners);
    let mut sides: Vec<(u64, u32)> = (0..point.len() as u32)
        .into_par_iter()
        .map(|i| {
            let next = i - i % 3 + (i + 1) % 3;
            let (a, b) = (point[i as usize], point[next as usize]);
            (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), i)
        })
        .collect();
    sides.par_sort_unstable();
    let mut edges = vec![Edges::ALL_CREASES; corners.len()];
    for group in sides.chunk_by(|a, b| a.0 == b.0) {
        match *group {
            [(_, i)] => edges[i as usize / 3].set_boundary(i % 3),
            [(_, i), (_, j)] if is_flat(corners, i, j) => {
                edges[i as usize / 3].set_flat(i % 3);
                edges[j as usize / 3].set_flat(j % 3);
            }
            _ => {}
        }
    }
    edges
}

/// For each corner of each triangle, a number that all corners at the same position share.
fn points(corners: &[[DVec3; 3]]) -> Vec<u32> {
    let at = |i: u32| corners[i as usize / 3][i as usize % 3].to_array().map(|x| (x + 0.0).to_bits());
    // Sorted by a 64-bit hash of the position. Positions with the same hash are told apart below.
    let mix = |p: [u64; 3]| p.iter().fold(0u64, |h, x| (h ^ x).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
    let mut order: Vec<(u64, u32)> = (0..corners.len() as u32 * 3).into_par_iter().map(|i| (mix(at(i)), i)).collect();
    order.par_sort_unstable();
    let mut point = vec![0; order.len()];
    for same in order.chunk_by_mut(|a, b| a.0 == b.0) {
        let first = at(same[0].1);
        if same.iter().any(|(_, i)| at(*i) != first) {
            same.sort_unstable_by_key(|(_, i)| (at(*i), *i));
        }
        for of_point in same.chunk_by(|a, b| at(a.1) == at(b.1)) {
            of_point.iter().for_each(|(_, i)| point[*i as usize] = of_point[0].1);
        }
    }
    point
}

/// Whether the two triangles at an edge, which is side `i` of one and side `j` of the other, lie in one plane on different
/// sides of the edge.
fn is_flat(corners: &[[DVec3; 3]], i: u32, j: u32) -> bool {
    let [i, j] = [i, j].map(|side| {
        let t = &corners[side as usize / 3];
        [0, 1, 2].map(|k| t[(side as usize + k) % 3])
    });
    let along = i[1] - i[0];
    // Vectors from the edge to the third corners, perpendicular to the edge.
    let [x, y] = [i, j].map(|t| {
        let side = t[2] - t[0];
        side - along * (side.dot(along) / along.length_squared())
    });
    x.dot(y) < 0.0 && x.cross(y).length_squared() <= FLAT * FLAT * x.length_squared() * y.length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edges_of_a_folded_strip() {
        let p = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 1.0)];
        // Two triangles side by side, a third that stands up on the second, and the first once more, turned over.
        let strip = [[p[0], p[1], p[2]], [p[2], p[1], p[3]], [p[3], p[1], p[4]]];
        let found = classify(&strip);
        let creases = |e: Edges| [0, 1, 2].map(|i| e.is_crease(i));
        let boundaries = |e: Edges| [0, 1, 2].map(|i| e.is_boundary(i));
        assert_eq!(
            found.iter().map(|e| creases(*e)).collect::<Vec<_>>(),
            [[true, false, true], [false, true, true], [true, true, true]]
        );
        assert_eq!(
            found.iter().map(|e| boundaries(*e)).collect::<Vec<_>>(),
            [[true, false, true], [false, false, true], [false, true, true]]
        );
        let both_sides = [[p[0], p[1], p[2]], [p[0], p[2], p[1]]];
        assert!(classify(&both_sides).iter().all(|e| creases(*e) == [true; 3] && !e.has_boundary()));
    }
}
