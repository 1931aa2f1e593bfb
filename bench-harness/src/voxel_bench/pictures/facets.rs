//! Pictures of faces that one can see through.

use esvo_core::{Camera, CastOptions, Picture, View};
use glam::{DMat4, DVec3};

use super::{SIZE, SKY, smooth};
use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Color and opacity of a point of a facet, by its coordinates along the two sides.
type Paint<'a> = Box<dyn Fn(f64, f64) -> [f32; 4] + Sync + 'a>;

/// A parallelogram, or the half of it on this side of the diagonal.
pub(super) struct Facet<'a> {
    corner: DVec3,
    sides: [DVec3; 2],
    is_triangle: bool,
    paint: Paint<'a>,
}

impl<'a> Facet<'a> {
    /// A parallelogram.
    pub(super) fn new(corner: DVec3, sides: [DVec3; 2], paint: impl Fn(f64, f64) -> [f32; 4] + Sync + 'a) -> Self {
        Self { corner, sides, is_triangle: false, paint: Box::new(paint) }
    }

    /// A triangle of one color, dark along its edges. Faces that face different axes get different light.
    pub(super) fn triangle([a, b, c]: [DVec3; 3], color: [f32; 3], opacity: f32) -> Self {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let light = 0.72 + 0.28 * normal.dot(DVec3::new(0.5, 0.3, 0.81)).abs() as f32;
        let paint = move |s: f64, t: f64| {
            let on_edge = s.min(t).min(1.0 - s - t) < 0.012;
            tint(if on_edge { EDGE } else { color.map(|c| c * light) }, if on_edge { 1.0 } else { opacity })
        };
        Self { corner: a, sides: [b - a, c - a], is_triangle: true, paint: Box::new(paint) }
    }

    /// The six faces of a box, dark along their edges.
    pub(super) fn faces_of_box(low: DVec3, size: DVec3, color: [f32; 3], opacity: f32) -> Vec<Self> {
        let mut faces = Vec::with_capacity(6);
        for axis in 0..3 {
            let along = |k: usize| DVec3::AXES[k] * size[k];
            let sides = [along((axis + 1) % 3), along((axis + 2) % 3)];
            let light = [0.80, 0.66, 1.0][axis];
            // Edges of the same width on all sides.
            let width = sides.map(|side| 0.02 * size.min_element() / side.length());
            let paint = move |s: f64, t: f64| {
                let on_edge = s.min(1.0 - s) < width[0] || t.min(1.0 - t) < width[1];
                tint(if on_edge { EDGE } else { color.map(|c| c * light) }, if on_edge { 0.9 } else { opacity })
            };
            faces.push(Self::new(low, sides, paint));
            faces.push(Self::new(low + along(axis), sides, paint));
        }
        faces
    }

    /// Where a ray meets the facet, in lengths of its direction, and what it sees there.
    fn seen(&self, origin: DVec3, direction: DVec3) -> Option<(f64, [f32; 4])> {
        let [a, b] = self.sides;
        let normal = a.cross(b);
        let at = normal.dot(self.corner - origin) / normal.dot(direction);
        if !(at.is_finite() && at > 0.0) {
            return None;
        }
        let from_corner = origin + direction * at - self.corner;
        let over = normal.length_squared();
        let (s, t) = (from_corner.cross(b).dot(normal) / over, a.cross(from_corner).dot(normal) / over);
        let inside = s >= 0.0 && t >= 0.0 && if self.is_triangle { s + t <= 1.0 } else { s.max(t) <= 1.0 };
        inside.then(|| (at, (self.paint)(s, t)))
    }
}

const EDGE: [f32; 3] = [0.12, 0.12, 0.22];

/// A color with an opacity.
pub(super) fn tint([r, g, b]: [f32; 3], opacity: f32) -> [f32; 4] {
    [r, g, b, opacity]
}

/// Draws facets in the unit cube, the nearest over those behind.
///
/// # Errors
/// A camera that is not possible.
pub(super) fn draw(facets: &[Facet<'_>], camera: &Camera) -> Result<Picture, BenchError> {
    let size = (SIZE.0 * 2, SIZE.1 * 2);
    let options = CastOptions { contours: false, beam: false, max_voxel_pixels: 0.0 };
    let view = View::new(camera, DMat4::IDENTITY, 0, size, &options).map_err(|e| failed("picture", e))?;
    Ok(smooth(|x, y| {
        let ray = view.ray(x, y);
        // The unit cube is from 1 to 2 in the space of rays.
        let (origin, direction) = (ray.origin.as_dvec3() - 1.0, ray.direction.as_dvec3());
        let mut seen: Vec<_> = facets.iter().filter_map(|facet| facet.seen(origin, direction)).collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        seen.into_iter().fold(SKY, |behind, (_, [r, g, b, opacity])| {
            let front = [r, g, b];
            std::array::from_fn(|c| behind[c] + (front[c] - behind[c]) * opacity)
        })
    }))
}
