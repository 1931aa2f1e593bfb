//! Where vertices move that several triangles share: the places of the mesh, and the points on its edges.
//!
//! At such a vertex, each triangle with a height map demands that its surface move by a height along its normal, and each
//! triangle without one that its surface stay in its plane. A demand only concerns the component along one normal, so most
//! demands can be satisfied together: the corner of two walls moves to where the moved walls meet, and the foot of a wall
//! slides along a floor that does not move. Contradicting demands, as at the border of a height map within a plane, are
//! resolved by least squares, in favour of the surfaces that do not move.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::dice::Borders;
use super::patch::{Heights, Normals};
use super::plan::Plan;

/// Weight of a surface that does not move, relative to one that does.
const AT_REST: f64 = 50.0;
/// Weight of the common direction of all demands relative to each single demand. Without it, demands along nearly the same
/// direction with different heights (as where a texture's edges meet) would be satisfied only far away.
const DAMPING: f64 = 0.03;
/// Largest displacement of a vertex, relative to the largest demanded height: prevents spikes at sharp edges.
const LONGEST: f64 = 2.0;

/// The demands on one vertex.
#[derive(Clone, Copy, Debug, Default)]
struct Demands {
    /// Sum of `weight n nᵀ`, upper half row by row: xx, xy, xz, yy, yz, zz.
    squares: [f64; 6],
    /// Sum of `weight height n`.
    heights: DVec3,
    /// Sum of `weight n` of the surfaces that move.
    normals: DVec3,
    /// Sum of the weights of the surfaces that move.
    weight: f64,
    /// Largest absolute height.
    greatest: f64,
    /// Whether some surface must not move.
    at_rest: bool,
}

impl Demands {
    /// Adds a demand: the surface with this unit normal must move along it by `height`, or, for `None`, stay in its plane.
    fn add(&mut self, normal: DVec3, height: Option<f64>, weight: f64) {
        let square = weight * if height.is_some() { 1.0 } else { AT_REST };
        let DVec3 { x, y, z } = normal;
        for (sum, product) in self.squares.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum += square * product;
        }
        match height {
            Some(height) => {
                self.heights += normal * (weight * height);
                self.normals += normal * weight;
                self.weight += weight;
                self.greatest = self.greatest.max(height.abs());
            }
            None => self.at_rest = true,
        }
    }

    /// The displacement of the vertex.
    fn settle(&self) -> DVec3 {
        if self.greatest == 0.0 {
            return DVec3::ZERO;
        }
        let [xx, xy, xz, yy, yz, zz] = self.squares;
        let squares = DMat3::from_cols_array_2d(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
        let damping = DAMPING * self.weight;
        let along = self.normals.normalize_or_zero();
        let common = along.dot(squares * along);
        // The best displacement along the mean normal. If all normals agree, or for equal walls, it is already the result.
        let start = if self.at_rest || common <= 1e-6 * self.weight {
            DVec3::ZERO
        } else {
            along * (self.heights.dot(along) / common)
        };
        let damped = squares + DMat3::from_diagonal(DVec3::splat(damping));
        let moved = damped.inverse() * (self.heights + start * damping);
        if moved.is_finite() { moved.clamp_length_max(LONGEST * self.greatest) } else { DVec3::ZERO }
    }
}

/// Displacements of places, and of the points on edges between places.
pub(super) struct Moved {
    pub(super) places: Vec<DVec3>,
    pub(super) points: Vec<DVec3>,
}

/// What a triangle asks for at one of its vertices: its normal there, and the height or, for `None`, to stay in its plane.
type Wish = (DVec3, Option<f64>);

/// What one triangle asks for.
struct Wishes<'p, 'a> {
    heights: Option<Heights<'p, 'a>>,
    normals: Normals,
}

impl<'p, 'a> Wishes<'p, 'a> {
    fn of(plan: &'p Plan<'a>, i: usize) -> Self {
        Self { heights: Heights::of(plan, i), normals: Normals::of(plan, i) }
    }

    fn at(&self, w: [f64; 3]) -> Wish {
        match &self.heights {
            Some(heights) => (self.normals.at(w), Some(heights.at(w))),
            None => (self.normals.flat, None),
        }
    }
}

impl Moved {
    /// Computes them from the demands of all triangles around: weighted at a place by the angles of the triangles there, at
    /// an edge equally. No triangle needs to be diced for that.
    pub(super) fn together(plan: &Plan<'_>) -> Self {
        Self { places: settled_places(plan), points: settled_points(plan) }
    }

    /// The displacement of a local vertex of a patch, at a corner or on an edge.
    pub(super) fn of(&self, plan: &Plan<'_>, i: usize, borders: &Borders, local: usize) -> DVec3 {
        if local < 3 {
            return self.places[plan.places_of(i)[local] as usize];
        }
        let (e, k) = borders.edge_of(local);
        self.points[plan.places.first[plan.places.of[i][e] as usize] + k]
    }
}

fn settled_places(plan: &Plan<'_>) -> Vec<DVec3> {
    let wishes: Vec<[(Wish, f64); 3]> = (0..plan.touched.len())
        .into_par_iter()
        .map(|i| {
            let (positions, wishes) = (plan.positions_of(i), Wishes::of(plan, i));
            std::array::from_fn(|k| {
                let (to_next, to_last) = (positions[(k + 1) % 3] - positions[k], positions[(k + 2) % 3] - positions[k]);
                // Triangles without area get a tiny weight: they matter only if there are no others.
                let angle = to_next.cross(to_last).length().atan2(to_next.dot(to_last)).max(1e-9);
                let mut corner = [0.0; 3];
                corner[k] = 1.0;
                (wishes.at(corner), angle)
            })
        })
        .collect();
    let mut places = vec![Demands::default(); plan.vertices.positions.len()];
    for (i, wishes) in wishes.iter().enumerate() {
        for (place, ((normal, height), weight)) in plan.places_of(i).into_iter().zip(wishes) {
            places[place as usize].add(*normal, *height, *weight);
        }
    }
    places.iter().map(Demands::settle).collect()
}

/// Edge by edge, so that the demands on all points need not be kept at once.
fn settled_points(plan: &Plan<'_>) -> Vec<DVec3> {
    let users = plan.places.users();
    (0..plan.places.ends.len())
        .into_par_iter()
        .flat_map_iter(|edge| {
            let count = plan.places.first[edge + 1] - plan.places.first[edge];
            let mut points = vec![Demands::default(); count];
            for &slot in if count > 0 { users.of(edge) } else { &[] } {
                let (i, e) = (slot as usize / 3, slot as usize % 3);
                let (wishes, borders) = (Wishes::of(plan, i), plan.borders(i));
                let weight = if wishes.normals.flat == DVec3::ZERO { 1e-9 } else { 1.0 };
                for (k, point) in points.iter_mut().enumerate() {
                    let (normal, height) = wishes.at(borders.weights(e, k as u32 + 1));
                    point.add(normal, height, weight);
                }
            }
            points.into_iter().map(|point| point.settle())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(demands: &[(DVec3, Option<f64>)]) -> DVec3 {
        let mut all = Demands::default();
        demands.iter().for_each(|&(normal, height)| all.add(normal, height, 0.7));
        all.settle()
    }

    fn close(a: DVec3, b: DVec3, tolerance: f64) -> bool {
        a.distance(b) <= tolerance
    }

    #[test]
    fn surfaces_that_agree_go_where_they_are_asked_to() {
        let n = DVec3::new(1.0, 2.0, -0.5).normalize();
        assert!(close(settled(&[(n, Some(0.3)); 5]), n * 0.3, 1e-14));
        assert!(close(settled(&[(n, Some(0.2)), (n, Some(0.4))]), n * 0.3, 1e-14));
        let walls = [(DVec3::X, Some(0.3)), (DVec3::Y, Some(0.3)), (DVec3::Z, Some(0.3))];
        assert!(close(settled(&walls), DVec3::splat(0.3), 1e-14), "corners are where the moved walls meet");
        assert_eq!(settled(&[(DVec3::X, Some(0.0)), (DVec3::Y, None)]), DVec3::ZERO);
    }

    #[test]
    fn what_does_not_move_stays_in_its_plane() {
        let foot = settled(&[(DVec3::X, Some(0.3)), (DVec3::Y, None)]);
        assert!(close(foot, DVec3::X * 0.3, 0.01) && foot.y == 0.0, "a wall slides along the floor: {foot}");
        let border = settled(&[(DVec3::Y, Some(0.3)), (DVec3::Y, None)]);
        assert!(border.length() < 0.01, "within a plane the border stays: {border}");
    }

    #[test]
    fn contradictions_are_settled_nearby() {
        assert_eq!(settled(&[(DVec3::X, Some(0.2)), (-DVec3::X, Some(0.2))]), DVec3::ZERO);
        for degrees in [0.01f64, 1.0, 10.0, 20.0, 60.0, 120.0, 170.0, 179.9] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let other = DVec3::new(cos, sin, 0.0);
            for [a, b] in [[0.3, 0.0], [0.3, 0.3], [0.3, -0.3]] {
                let found = settled(&[(DVec3::X, Some(a)), (other, Some(b))]);
                assert!(found.length() <= 0.6 + 1e-12, "{degrees} {a} {b}: {found}");
                assert!((DVec3::X.dot(found) - a).abs() <= 0.3 + 1e-12, "{degrees} {a} {b}: {found}");
            }
        }
    }
}
