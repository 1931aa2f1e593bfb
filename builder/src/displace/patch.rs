//! One triangle, diced, and the displacements that it demands.

use glam::DVec3;

use super::dice::{Borders, Diced, Dicer};
use super::plan::Plan;

/// A triangle of the mesh, diced.
pub(super) struct Patch {
    pub(super) borders: Borders,
    pub(super) diced: Diced,
    /// For each corner and each point on the edges: the triangle's normal there, and the distance along it by which the
    /// triangle asks the vertex to move. Empty without a height map.
    pub(super) wishes: Vec<(DVec3, f64)>,
    /// Displacements of the vertices inside, along their normals. Empty without a height map.
    pub(super) heights: Vec<f32>,
}

impl Patch {
    /// Dices touched triangle `i` and reads the heights of its vertices. `segments` is indexed by the edges of `plan.places`.
    pub(super) fn new(plan: &Plan<'_>, dicer: &mut Dicer, i: usize, segments: &[u32], factor: f64) -> Self {
        let places = plan.places_of(i);
        let facet = &plan.facets[i];
        let borders = Borders {
            segments: plan.places.of[i].map(|edge| segments[edge as usize]),
            reversed: std::array::from_fn(|e| places[e] > places[(e + 1) % 3]),
        };
        let positions = plan.positions_of(i);
        let step = facet.step * factor;
        let diced = dicer.dice(positions, &borders, step);
        let (mut wishes, mut heights) = (Vec::new(), Vec::new());
        if let Some(map) = facet.height_map {
            let corners = plan.corners(i).map(|v| v as usize);
            let footprint = if step.is_finite() { (step * facet.density) as f32 } else { 1.0 };
            let scale = plan.options.scale;
            let height = |w: [f64; 3]| {
                let uv = mix(&plan.mesh.uvs, corners, w).map(|x| x as f32);
                f64::from(map.sample(uv, footprint)) * scale
            };
            let normals = Normals::of(plan, i);
            wishes.extend(borders.all_weights().map(|w| (normals.at(w), height(w))));
            heights.extend(diced.interior.iter().map(|&w| height(w) as f32));
        }
        Self { borders, diced, wishes, heights }
    }
}

/// Shading normals on a triangle.
pub(super) struct Normals {
    corners: [DVec3; 3],
    pub(super) flat: DVec3,
}

impl Normals {
    pub(super) fn of(plan: &Plan<'_>, i: usize) -> Self {
        let corners = plan.corners(i).map(|v| DVec3::from(plan.mesh.normals[v as usize].map(f64::from)));
        let [a, b, c] = plan.positions_of(i);
        Self { corners, flat: (b - a).cross(c - a).normalize_or_zero() }
    }

    /// The interpolated normal, of unit length; zero on a triangle without area whose normals cancel out.
    pub(super) fn at(&self, [a, b, c]: [f64; 3]) -> DVec3 {
        (self.corners[0] * a + self.corners[1] * b + self.corners[2] * c).try_normalize().unwrap_or(self.flat)
    }
}

/// The weighted sum of an attribute over three vertices.
pub(super) fn mix<const N: usize>(values: &[[f32; N]], vertices: [usize; 3], weights: [f64; 3]) -> [f64; N] {
    std::array::from_fn(|c| (0..3).map(|k| f64::from(values[vertices[k]][c]) * weights[k]).sum())
}
