//! The convex polyhedron that a voxel's cube and the contours of its ancestors leave (paper section 3.4).

use glam::{Vec3, Vec4};

/// Most contours that are kept as bounds of one voxel. The oldest is dropped if there are more, which only enlarges the
/// shape.
pub(crate) const MAX_SLABS: usize = 8;
/// Number of faces: 0..6 are the cube's; 6 + 2k and 7 + 2k are the planes of slab k. One more slab than is kept.
const MAX_FACES: usize = 6 + 2 * (MAX_SLABS + 1);
/// Most vertices. A cut that would need more leaves the polyhedron unchanged.
const MAX_VERTICES: usize = 64;
/// Number of places that are processed at once.
const LANES: usize = 4;

/// A convex polyhedron inside the unit cube around the origin: its vertices, and the edges and faces that meet in them.
///
/// A vertex keeps its place (index) until it is cut away; free places are reused. All vertices are simple: three edges and
/// three faces meet in each. A cut through a vertex makes several vertices at the same point.
#[derive(Clone)]
pub(crate) struct Polyhedron {
    /// Coordinates by place. `x` of a free place is NaN, so that no comparison finds it.
    x: [f32; MAX_VERTICES],
    y: [f32; MAX_VERTICES],
    z: [f32; MAX_VERTICES],
    /// One bit per place that holds a vertex.
    used: u64,
    /// Places from here on have not been used since the last reset.
    end: usize,
    /// For each vertex, one bit per place of the vertices at the other ends of its edges.
    neighbours: [u64; MAX_VERTICES],
    /// For each vertex, one bit per face that meets in it.
    faces: [u32; MAX_VERTICES],
    /// Distances of the vertices from the plane of the last cut. A field, so that a cut need not clear it first.
    distances: [f32; MAX_VERTICES],
}

impl Default for Polyhedron {
    fn default() -> Self {
        let mut polyhedron = Self {
            x: [f32::NAN; MAX_VERTICES],
            y: [0.0; MAX_VERTICES],
            z: [0.0; MAX_VERTICES],
            used: 0,
            end: 0,
            neighbours: [0; MAX_VERTICES],
            faces: [0; MAX_VERTICES],
            distances: [0.0; MAX_VERTICES],
        };
        polyhedron.reset();
        polyhedron
    }
}

/// The neighbours and the faces of the cube's vertices. The bits of a vertex's number are its coordinates.
const CUBE: ([u64; 8], [u32; 8]) = {
    let (mut neighbours, mut faces) = ([0; 8], [0; 8]);
    let mut i = 0;
    while i < 8 {
        let mut axis = 0;
        while axis < 3 {
            neighbours[i] |= 1 << (i ^ 1 << axis);
            faces[i] |= 1 << (2 * axis + (i >> axis & 1));
            axis += 1;
        }
        i += 1;
    }
    (neighbours, faces)
};

/// The positions of the bits in a mask, lowest first.
fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (bit < 64).then_some(bit)
    })
}

impl Polyhedron {
    /// Sets the polyhedron to the whole cube `[-1/2, 1/2]³`.
    pub(crate) fn reset(&mut self) {
        const HALVES: [f32; 2] = [-0.5, 0.5];
        for i in 0..8 {
            (self.x[i], self.y[i], self.z[i]) = (HALVES[i & 1], HALVES[i >> 1 & 1], HALVES[i >> 2]);
        }
        if self.end > 8 {
            self.x[8..self.end].fill(f32::NAN);
        }
        (self.used, self.end) = (0xff, 8);
        self.neighbours[..8].copy_from_slice(&CUBE.0);
        self.faces[..8].copy_from_slice(&CUBE.1);
    }

    fn vertex(&self, place: usize) -> Vec3 {
        Vec3::new(self.x[place], self.y[place], self.z[place])
    }

    /// Cuts away the part where `normal·p > limit`. The new face gets the number `face`.
    pub(crate) fn cut(&mut self, normal: Vec3, limit: f32, face: u8) {
        let mut outside = 0u64;
        for i in (0..self.end).step_by(LANES) {
            let of = |coordinates: &[f32; MAX_VERTICES]| Vec4::from_slice(&coordinates[i..i + LANES]);
            let distance = of(&self.x) * normal.x + of(&self.y) * normal.y + of(&self.z) * normal.z - limit;
            distance.write_to_slice(&mut self.distances[i..]);
            outside |= u64::from(distance.cmpgt(Vec4::ZERO).bitmask()) << i;
        }
        // The common case: the cut removes nothing.
        if outside == 0 {
            return;
        }
        let inside = self.used & !outside;
        let crossings: u32 = bits(outside).map(|v| (self.neighbours[v] & inside).count_ones()).sum();
        let mut free = !self.used;
        if crossings > free.count_ones() {
            return;
        }
        // Per old face: the new vertex on it that still lacks its neighbour. The plane crosses two edges of each face that
        // it meets, so the new vertices of a face come in pairs.
        const NONE: u8 = u8::MAX;
        let mut open = [NONE; MAX_FACES];
        for out in bits(outside) {
            let (from, distance, faces) = (self.vertex(out), self.distances[out], self.faces[out]);
            for kept in bits(self.neighbours[out] & inside) {
                let t = (distance / (distance - self.distances[kept])).clamp(0.0, 1.0);
                let p = from + (self.vertex(kept) - from) * t;
                let place = free.trailing_zeros() as usize;
                free &= free - 1;
                (self.x[place], self.y[place], self.z[place]) = (p.x, p.y, p.z);
                self.used |= 1 << place;
                self.neighbours[kept] ^= 1 << out | 1 << place;
                self.neighbours[place] = 1 << kept;
                let of_edge = faces & self.faces[kept];
                self.faces[place] = of_edge | 1 << face;
                for old in bits(of_edge.into()) {
                    let other = std::mem::replace(&mut open[old], place as u8);
                    if other != NONE {
                        self.neighbours[place] |= 1 << other;
                        self.neighbours[other as usize] |= 1 << place;
                        open[old] = NONE;
                    }
                }
            }
            self.x[out] = f32::NAN;
        }
        self.used &= !outside;
        self.end = self.end.max((64 - self.used.leading_zeros() as usize).next_multiple_of(LANES));
    }

    /// The vertices. Empty if nothing is left.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = Vec3> + '_ {
        bits(self.used).map(|place| self.vertex(place))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    impl Polyhedron {
        /// The smallest and the largest `direction·p` over the vertices.
        pub(crate) fn extent(&self, direction: Vec3) -> (f32, f32) {
            self.vertices().map(|v| direction.dot(v)).fold((f32::MAX, f32::MIN), |(lo, hi), d| (lo.min(d), hi.max(d)))
        }

        /// One bit per face that still has a vertex.
        fn faces(&self) -> u32 {
            bits(self.used).fold(0, |mask, place| mask | self.faces[place])
        }
    }

    fn edges(p: &Polyhedron) -> u32 {
        bits(p.used).map(|v| p.neighbours[v].count_ones()).sum::<u32>() / 2
    }

    #[test]
    fn a_cut_corner_has_three_new_edges() {
        let mut p = Polyhedron::default();
        p.reset();
        assert_eq!(edges(&p), 12);
        assert_eq!(p.faces(), 0b111111);
        p.cut(Vec3::ONE, 1.0, 6);
        assert_eq!((p.vertices().count(), edges(&p)), (10, 15));
        assert_eq!(p.faces(), 0b1111111);
        let (lo, hi) = p.extent(Vec3::ONE);
        assert!((lo + 1.5).abs() < 1e-6 && (hi - 1.0).abs() < 1e-6);
    }

    #[test]
    fn halving_the_cube_replaces_a_face() {
        let mut p = Polyhedron::default();
        p.reset();
        p.cut(Vec3::X, 0.0, 6);
        assert_eq!(edges(&p), 12);
        assert_eq!(p.faces(), 0b1111101);
        assert_eq!(p.extent(Vec3::X), (-0.5, 0.0));
        p.cut(Vec3::NEG_X, -0.25, 7);
        assert!(p.vertices().next().is_none() || p.extent(Vec3::X).0 >= -0.25, "nothing below 1/4 may be left");
    }

    proptest! {
        /// After cuts, each vertex has three edges and satisfies all limits, and the extents include all grid points that
        /// satisfy them.
        #[test]
        fn cuts_leave_what_is_inside_of_them(cuts in prop::collection::vec((prop::array::uniform3(-1.0f32..1.0), -0.3f32..0.6), 1..12)) {
            let mut p = Polyhedron::default();
            p.cut(Vec3::X, 0.1, 6);
            p.reset();
            for (k, (n, limit)) in cuts.iter().enumerate() {
                p.cut(Vec3::from(*n), *limit, 6 + k as u8);
            }
            let keeps = |v: Vec3, by: f32| cuts.iter().all(|(n, limit)| Vec3::from(*n).dot(v) <= limit + by);
            for v in bits(p.used) {
                prop_assert_eq!(p.neighbours[v].count_ones(), 3);
                prop_assert_eq!(p.neighbours[v] & !p.used, 0);
                prop_assert!(keeps(p.vertex(v), 1e-5), "{} is outside", p.vertex(v));
            }
            let grid = (0..9 * 9 * 9).map(|i| Vec3::new((i % 9) as f32, (i / 9 % 9) as f32, (i / 81) as f32) / 8.0 - 0.5);
            let inside: Vec<Vec3> = grid.filter(|v| keeps(*v, -1e-5)).collect();
            for direction in [Vec3::X, Vec3::ONE, Vec3::new(-0.3, 0.7, 0.2)] {
                let (lo, hi) = p.extent(direction);
                for v in &inside {
                    let d = direction.dot(*v);
                    prop_assert!(d >= lo - 1e-5 && d <= hi + 1e-5, "{v} is inside, {direction} reaches {lo} to {hi}");
                }
            }
        }
    }
}
