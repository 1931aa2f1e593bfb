//! Closest hits in double precision, watertight: the reference for errors.
//!
//! The intersection test is that of Woop, Benthin and Wald (Watertight Ray/Triangle Intersection, JCGT 2013): a shear takes
//! the ray to an axis, and the rest is two-dimensional. Rounding keeps the order of products, so that an edge function is zero
//! or has the sign that its rounded corners give it, and both triangles at an edge get opposite signs. Zero counts as inside,
//! so that no ray passes between two triangles that share an edge, or through a corner that triangles surround. In double
//! precision the zeros need no second test.
//!
//! Boxes are single precision, wider than their triangles by [`MARGIN`] on every side.

use esvo_core::exact::{ExactRay, TriangleHit};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;

use super::bvh::{Bvh, Node, Placement};

/// How far boxes reach beyond their triangles, in the space of the hierarchy, where the mesh is at most 2 wide.
///
/// Rounding a coordinate to single precision moves it by at most a sixteenth of this. The slab test in double precision loses
/// less, for an eye within 2^30 mesh sizes.
const MARGIN: f32 = 1.0 / (1 << 20) as f32;

/// The box of a triangle, widened.
pub(super) fn wide_box(triangle: &[DVec3; 3], placement: &Placement) -> Aabb {
    let corners = triangle.map(|p| Vec3A::from(placement.point(p).as_vec3()));
    let mut aabb = Aabb::from_points(&corners);
    aabb.min -= Vec3A::splat(MARGIN);
    aabb.max += Vec3A::splat(MARGIN);
    aabb
}

/// A ray sheared to its longest axis.
pub(super) struct Sheared {
    origin: DVec3,
    axes: [usize; 3],
    shear: DVec3,
    t_min: f64,
    t_max: f64,
}

impl Sheared {
    /// `None` for a ray that is not finite or has no direction: it hits nothing.
    pub(super) fn new(ray: &ExactRay) -> Option<Self> {
        let d = ray.direction;
        if !(ray.origin.is_finite() && d.is_finite() && d != DVec3::ZERO) {
            return None;
        }
        let kz = d.abs().max_position();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if d[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let shear = DVec3::new(d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]);
        Some(Self { origin: ray.origin, axes: [kx, ky, kz], shear, t_min: ray.t_min, t_max: ray.t_max })
    }

    /// `t` where the ray meets the triangle, if it does between its ends. Both sides count.
    #[inline]
    pub(super) fn meet(&self, triangle: &[DVec3; 3]) -> Option<f64> {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = triangle.map(|p| {
            let p = p - self.origin;
            DVec3::new(p[kx] - self.shear.x * p[kz], p[ky] - self.shear.y * p[kz], p[kz])
        });
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            // Seen edge-on, or without area: a neighbour is hit instead.
            return None;
        }
        let t = (u * a.z + v * b.z + w * c.z) / determinant * self.shear.z;
        (t >= self.t_min && t <= self.t_max).then_some(t)
    }
}

/// The nearer of two hits; of two at the same `t`, the one of the lower index, so that the answer does not depend on the
/// order of the search.
#[inline]
pub(super) fn nearer(a: TriangleHit, b: TriangleHit) -> TriangleHit {
    if (b.t, b.triangle) < (a.t, a.triangle) { b } else { a }
}

/// Farther than any hit, also of a ray that ends beyond `t` = 1.
pub(super) const NOTHING: TriangleHit = TriangleHit { t: f64::INFINITY, triangle: TriangleHit::NONE };

/// The closest hit of a ray. `stack` is kept between rays to save its making.
pub(super) fn closest(
    bvh: &Bvh,
    placement: &Placement,
    triangles: &[[DVec3; 3]],
    ray: &ExactRay,
    stack: &mut Vec<(u32, f64)>,
) -> TriangleHit {
    let mut hit = NOTHING;
    let Some(sheared) = Sheared::new(ray) else { return TriangleHit::MISS };
    if bvh.nodes.is_empty() {
        return TriangleHit::MISS;
    }
    let slabs = Slabs {
        origin: placement.point(ray.origin),
        inverse: (ray.direction * placement.scale).recip(),
        t_min: ray.t_min,
        t_max: ray.t_max,
    };
    stack.clear();
    stack.extend(slabs.enter(&bvh.nodes[0]).map(|t| (0, t)));
    while let Some((at, entry)) = stack.pop() {
        if entry > hit.t {
            continue;
        }
        let node = &bvh.nodes[at as usize];
        if node.count > 0 {
            for &triangle in &bvh.order[node.first as usize..(node.first + node.count) as usize] {
                if let Some(t) = sheared.meet(&triangles[triangle as usize]) {
                    hit = nearer(hit, TriangleHit { t, triangle });
                }
            }
            continue;
        }
        let child = |k: u32| slabs.enter(&bvh.nodes[(node.first + k) as usize]).map(|t| (node.first + k, t));
        match (child(0), child(1)) {
            (Some(a), Some(b)) => stack.extend(if a.1 < b.1 { [b, a] } else { [a, b] }),
            (a, b) => stack.extend(a.or(b)),
        }
    }
    if hit.is_miss() { TriangleHit::MISS } else { hit }
}

/// A ray as boxes meet it.
struct Slabs {
    origin: DVec3,
    inverse: DVec3,
    t_min: f64,
    t_max: f64,
}

impl Slabs {
    /// `t` where the ray enters the box, if it does.
    ///
    /// A ray in the very plane of a side makes a NaN and may be said to miss: the triangles lie [`MARGIN`] away from it.
    #[inline]
    fn enter(&self, node: &Node) -> Option<f64> {
        let t0 = (DVec3::from(node.lo.map(f64::from)) - self.origin) * self.inverse;
        let t1 = (DVec3::from(node.hi.map(f64::from)) - self.origin) * self.inverse;
        let enter = t0.min(t1).max_element().max(self.t_min);
        let leave = t0.max(t1).min_element().min(self.t_max);
        (enter <= leave).then_some(enter)
    }
}
