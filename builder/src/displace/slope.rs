//! Slopes of the displacement, by which normals are corrected.

use glam::DVec3;

use super::join::Moved;
use super::patch::{Normals, Patch, on_triangle};
use super::plan::Plan;

/// The slope of the displacement around a vertex: sums over small triangles, weighted by area.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slope {
    gradient: DVec3,
    area: f64,
}

impl Slope {
    pub(super) fn add(&mut self, other: &Self) {
        self.gradient += other.gradient;
        self.area += other.area;
    }

    /// The unit `normal` corrected by the mean slope; `as_it_was` if the slope is zero.
    pub(super) fn lean(&self, normal: DVec3, as_it_was: [f32; 3]) -> [f32; 3] {
        if self.gradient == DVec3::ZERO || self.area <= 0.0 {
            return as_it_was;
        }
        match (normal - self.gradient / self.area).try_normalize() {
            Some(n) => n.as_vec3().to_array(),
            None => as_it_was,
        }
    }
}

/// What a patch adds to the slopes at its border, and its finished vertices inside.
pub(super) struct Slopes {
    pub(super) border: Vec<Slope>,
    pub(super) inside_positions: Vec<[f64; 3]>,
    /// Only of vertices around which no part was left out.
    pub(super) inside_normals: Vec<[f32; 3]>,
}

impl Slopes {
    pub(super) fn of(plan: &Plan<'_>, i: usize, patch: &Patch, moved: &Moved) -> Self {
        let normals = Normals::of(plan, i);
        let corners = plan.positions_of(i);
        let inside = patch.inside();
        let count = inside + patch.diced.interior.len();
        let mut positions = Vec::with_capacity(count);
        let mut heights = Vec::with_capacity(count);
        for (local, w) in patch.borders.all_weights().enumerate() {
            positions.push(on_triangle(&corners, w));
            heights.push(normals.at(w).dot(moved.of(plan, i, &patch.borders, local)));
        }
        let mut inside_positions = Vec::with_capacity(count - inside);
        let mut unit = Vec::with_capacity(count - inside);
        for k in 0..count - inside {
            let (position, normal, height) = patch.vertex_inside(&corners, &normals, k);
            positions.push(position);
            heights.push(height);
            inside_positions.push((position + normal * height).to_array());
            unit.push(normal);
        }
        let mut slopes = vec![Slope::default(); count];
        for t in &patch.diced.triangles {
            let t = t.map(|v| v as usize);
            let [a, b, c] = t.map(|v| positions[v]);
            let [ha, hb, hc] = t.map(|v| heights[v]);
            let area = 0.5 * (b - a).cross(c - a).dot(normals.flat);
            if area <= 0.0 {
                continue;
            }
            // The gradient times the area: half the sum of each height times the opposite side, rotated inwards.
            let turned = (c - b) * ha + (a - c) * hb + (b - a) * hc;
            let slope = Slope { gradient: normals.flat.cross(turned) * 0.5, area };
            for v in t {
                slopes[v].add(&slope);
            }
        }
        let inside_normals =
            slopes[inside..].iter().zip(&unit).map(|(s, n)| s.lean(*n, n.as_vec3().to_array())).collect();
        slopes.truncate(inside);
        Self { border: slopes, inside_positions, inside_normals }
    }
}
