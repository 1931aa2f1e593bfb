//! Splits polygons into triangles.
//!
//! A fan from the first corner is used where all its triangles face the way of the polygon: convex polygons, and concave
//! ones that the first corner sees as a whole. All others are split by `earcut` in the plane of the polygon's normal, the
//! mean of its corners' (Newell's method), so that corners need not lie exactly in one plane.

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// How a polygon is split.
#[derive(Debug, PartialEq)]
pub(super) enum Split<'a> {
    /// Into the fan from its first corner.
    Fan,
    /// Into these triangles, given as places in the list of corners.
    Triangles(&'a [[u32; 3]]),
    /// As `Triangles`, but the polygon crosses itself: the triangles do not cover exactly its area.
    Crossing(&'a [[u32; 3]]),
}

/// Splits polygons, and keeps the memory for that.
pub(super) struct Splitter {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    places: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

/// A triangle of a fan may face the other way by this share of the polygon's area: corners on an edge are rarely exactly on
/// it.
const ROUNDING: f64 = 1e-9;

/// Triangles whose height is at most this share of the polygon's size are left out: their corners are on one line but for
/// rounding, and their direction means nothing.
const FLAT: f64 = 1e-12;

/// How far, as a share of the polygon's area, the triangles may miss it.
const COVERAGE: f64 = 1e-6;

impl Splitter {
    pub(super) fn new() -> Self {
        Self { earcut: Earcut::new(), flat: Vec::new(), places: Vec::new(), triangles: Vec::new() }
    }

    /// Splits the polygon with these corners.
    pub(super) fn split(&mut self, corners: &[DVec3]) -> Split<'_> {
        let [first, rest @ ..] = corners else { return Split::Fan };
        if rest.len() < 3 || !corners.iter().all(|p| p.is_finite()) {
            return Split::Fan;
        }
        // Relative to the first corner and to the size, so that neither places nor units matter.
        let size = rest.iter().map(|&p| (p - *first).abs().max_element()).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite()) {
            return Split::Fan;
        }
        let relative = |k: usize| (corners[k] - *first) / size;
        let area_of = |k: usize| relative(k).cross(relative(k + 1));
        let fan = 1..corners.len() - 1;
        let normal: DVec3 = fan.clone().map(area_of).sum();
        let area = normal.length();
        if area < ROUNDING || fan.clone().all(|k| area_of(k).dot(normal) >= -ROUNDING * area * area) {
            return Split::Fan;
        }
        let (u, v) = (normal / area).any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend((0..corners.len()).map(relative).map(|p| [p.dot(u), p.dot(v)]));
        self.earcut.earcut_slice(&self.flat, &[], &mut self.places);
        let mut covered = 0.0;
        self.triangles.clear();
        for &[a, b, c] in self.places.as_chunks::<3>().0 {
            let [p, q, r] = [a, b, c].map(|k| DVec2::from(self.flat[k as usize]));
            let twice = (q - p).perp_dot(r - p);
            covered += twice.abs();
            let longest = (q - p).length().max((r - q).length()).max((p - r).length());
            if twice.abs() > FLAT * longest {
                self.triangles.push(if twice > 0.0 { [a, b, c] } else { [a, c, b] });
            }
        }
        if self.triangles.is_empty() {
            return Split::Fan;
        }
        if (covered - area).abs() <= COVERAGE * area {
            Split::Triangles(&self.triangles)
        } else {
            Split::Crossing(&self.triangles)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3], triangles: &[[u32; 3]]) -> DVec3 {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| corners[k as usize]);
            (b - a).cross(c - a) * 0.5
        };
        triangles.iter().map(of).sum()
    }

    /// The triangles, none of which faces the other way than the polygon.
    fn split(corners: &[DVec3]) -> Vec<[u32; 3]> {
        let mut splitter = Splitter::new();
        let Split::Triangles(triangles) = splitter.split(corners) else { panic!("no clean split") };
        let whole = area(corners, triangles);
        assert!(triangles.iter().all(|t| area(corners, &[*t]).dot(whole) > 0.0));
        triangles.to_vec()
    }

    #[test]
    fn convex_polygons_become_fans() {
        for corners in 3..12 {
            let at = |k: i32| f64::from(k) / f64::from(corners) * std::f64::consts::TAU;
            let ring: Vec<DVec3> = (0..corners).map(|k| DVec3::new(at(k).cos(), 7.0, at(k).sin()) * 1e6).collect();
            assert_eq!(Splitter::new().split(&ring), Split::Fan);
        }
        // A corner in the middle of an edge, and one point repeated.
        let square = [[0.0, 0.0], [0.1, 0.0], [0.3, 0.0], [0.3, 0.3], [0.3, 0.3], [0.0, 0.3]];
        assert_eq!(Splitter::new().split(&square.map(|[x, y]| DVec3::new(x, y, x))), Split::Fan);
    }

    #[test]
    fn concave_polygons_keep_their_shape_in_every_plane_and_direction() {
        // A comb with three teeth, of area 1.0 * 5.0 + 3 * 2.0.
        let comb = [
            [0.0, 0.0],
            [5.0, 0.0],
            [5.0, 3.0],
            [4.0, 3.0],
            [4.0, 1.0],
            [3.0, 1.0],
            [3.0, 3.0],
            [2.0, 3.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        for turned in 0..comb.len() {
            for (u, v) in [(DVec3::X, DVec3::Y), (DVec3::Z, DVec3::X), (DVec3::new(0.6, 0.0, 0.8), DVec3::Y)] {
                let mut corners: Vec<DVec3> = comb.iter().map(|&[x, y]| u * x + v * y + DVec3::splat(1e3)).collect();
                corners.rotate_left(turned);
                for _ in 0..2 {
                    let triangles = split(&corners);
                    assert!((area(&corners, &triangles).length() - 11.0).abs() < 1e-9);
                    corners.reverse();
                }
            }
        }
    }

    #[test]
    fn a_ring_joined_by_a_cut_keeps_its_hole() {
        let outer = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0], [0.0, 0.0]];
        let hole = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0], [1.0, 1.0]];
        let corners: Vec<DVec3> = outer.iter().chain(&hole).map(|&[x, y]| DVec3::new(x, y, 0.0)).collect();
        assert!((area(&corners, &split(&corners)).z - 8.0).abs() < 1e-12);
    }

    #[test]
    fn bent_quads_are_split_along_the_edge_that_keeps_them_inside() {
        // A quad with a notch at its second corner; the corners are not in one plane.
        let notched = [[0.0, 0.0, 0.0], [0.5, 1.0, 0.1], [0.0, 3.0, 0.0], [3.0, 1.0, 0.2]].map(DVec3::from);
        let mut splitter = Splitter::new();
        let Split::Triangles(triangles) = splitter.split(&notched) else { panic!("the fan leaves the quad") };
        assert!(triangles.len() == 2 && triangles.iter().all(|t| t.contains(&1) && t.contains(&3)), "{triangles:?}");
    }

    #[test]
    fn polygons_that_cross_themselves_are_reported() {
        let bow = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        assert!(matches!(Splitter::new().split(&bow), Split::Crossing(_)));
        for odd in [DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e300)] {
            let _ = Splitter::new().split(&[DVec3::ZERO, DVec3::X, odd, DVec3::Y, DVec3::Z]);
        }
        assert_eq!(Splitter::new().split(&[DVec3::ONE; 5]), Split::Fan);
    }
}
