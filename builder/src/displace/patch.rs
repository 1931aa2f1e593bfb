//! One triangle, diced, with the heights that its map asks for.

use glam::DVec3;

use super::dice::{Borders, Diced, Dicer, Part};
use super::plan::Plan;

/// A triangle of the mesh, diced: whole, or some of its parts.
pub(super) struct Patch {
    pub(super) borders: Borders,
    pub(super) diced: Diced,
    /// Displacements of the vertices inside, along their normals. Empty without a height map.
    pub(super) heights: Vec<f32>,
}

impl Patch {
    /// Dices touched triangle `i`, without the parts for which `keep` is false, and reads the heights of the vertices inside.
    pub(super) fn new(plan: &Plan<'_>, dicer: &mut Dicer, i: usize, keep: impl FnMut(&Part) -> bool) -> Self {
        let borders = plan.borders(i);
        let diced = dicer.dice(plan.positions_of(i), &borders, plan.step(i), keep);
        let heights = match Heights::of(plan, i) {
            Some(heights) => diced.interior.iter().map(|&w| heights.at(w) as f32).collect(),
            None => Vec::new(),
        };
        Self { borders, diced, heights }
    }

    /// The local number of the first vertex inside.
    pub(super) fn inside(&self) -> usize {
        self.borders.first()[3] as usize
    }

    /// Vertex `k` of those inside: where it was, its normal, and how far it moves along that.
    pub(super) fn vertex_inside(&self, corners: &[DVec3; 3], normals: &Normals, k: usize) -> (DVec3, DVec3, f64) {
        let w = self.diced.interior[k];
        (on_triangle(corners, w), normals.at(w), self.heights.get(k).map_or(0.0, |&h| f64::from(h)))
    }
}

/// The point of a triangle with these barycentric coordinates.
pub(super) fn on_triangle(corners: &[DVec3; 3], w: [f64; 3]) -> DVec3 {
    corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2]
}

/// The heights that the map of a triangle asks for.
pub(super) struct Heights<'p, 'a> {
    plan: &'p Plan<'a>,
    map: &'a crate::HeightMap,
    corners: [usize; 3],
    /// Texels that a height is averaged over.
    footprint: f32,
}

impl<'p, 'a> Heights<'p, 'a> {
    /// `None` without a height map.
    pub(super) fn of(plan: &'p Plan<'a>, i: usize) -> Option<Self> {
        let facet = &plan.facets[i];
        let (map, step) = (facet.height_map?, plan.step(i));
        let footprint = if step.is_finite() { (step * facet.density) as f32 } else { 1.0 };
        Some(Self { plan, map, corners: plan.corners(i).map(|v| v as usize), footprint })
    }

    /// The height at a point with these barycentric coordinates.
    pub(super) fn at(&self, w: [f64; 3]) -> f64 {
        let uv = mix(&self.plan.mesh.uvs, self.corners, w).map(|x| x as f32);
        f64::from(self.map.sample(uv, self.footprint)) * self.plan.options.scale
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

    /// A bound of the absolute components of all interpolated normals.
    pub(super) fn most(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        // A mixture of the corners' normals is at least as long as its part along any direction.
        let along = (a + b + c).normalize_or_zero();
        let shortest = a.dot(along).min(b.dot(along)).min(c.dot(along));
        let largest = a.abs().max(b.abs()).max(c.abs()) / shortest;
        if shortest > 0.0 { largest.min(DVec3::ONE) } else { DVec3::ONE }
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
