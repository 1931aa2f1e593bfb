//! Closest hits in single precision, fast: packets of 4 x 4 rays from one eye go down the hierarchy together.
//!
//! Every loop over the lanes of a packet is plain code that the compiler turns into vectors; the function is compiled for
//! several instruction sets and the best one that the processor has is picked when it runs.

use esvo_core::exact::{CameraRays, TriangleHit};
use glam::{DVec3, Vec3A};
use multiversion::multiversion;

use super::bvh::{Bvh, Node, Placement};

/// Edge of a packet in pixels.
pub(super) const EDGE: usize = 4;
/// Rays of a packet.
const LANES: usize = EDGE * EDGE;
type Lanes = [f32; LANES];

/// Factor on where a ray leaves a box, which covers the rounding of six products and differences.
const SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Rays from one eye, lane by lane.
struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
    /// Closest `t` found so far.
    t: Lanes,
    triangle: [u32; LANES],
    t_near: f32,
}

/// Casts the rows of a picture from `first_row` on that `hits` has room for.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+avx+bmi1+bmi2+lzcnt",
    "x86_64+avx2+avx+bmi1+bmi2+lzcnt",
    "aarch64+neon"
))]
pub(super) fn cast_rows(
    bvh: &Bvh,
    corners: &[[Vec3A; 3]],
    placement: &Placement,
    rays: &CameraRays,
    first_row: usize,
    hits: &mut [TriangleHit],
) {
    let width = rays.width as usize;
    let rows = hits.len() / width;
    let eye: [f32; 3] = placement.point(rays.origin).as_vec3().into();
    let mut stack = vec![(0u32, 0f32); bvh.depth + 1];
    for row in (0..rows).step_by(EDGE) {
        for column in (0..width).step_by(EDGE) {
            let mut packet = Packet::new(rays, placement.scale, column, first_row + row);
            packet.descend(bvh, corners, eye, &mut stack);
            for y in row..(row + EDGE).min(rows) {
                for x in column..(column + EDGE).min(width) {
                    let lane = (y - row) * EDGE + (x - column);
                    hits[y * width + x] = packet.hit(lane);
                }
            }
        }
    }
}

impl Packet {
    /// The packet whose first pixel is this one. Lanes beyond the picture have the rays of pixels beyond it.
    #[inline(always)]
    fn new(rays: &CameraRays, scale: f64, x: usize, y: usize) -> Self {
        let vector = |v: DVec3| (v * scale).as_vec3();
        let (corner, dx, dy) =
            (vector(rays.direction(x as f64 + 0.5, y as f64 + 0.5)), vector(rays.dx), vector(rays.dy));
        let mut direction = [[0.0; LANES]; 3];
        let mut inverse = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for lane in 0..LANES {
                let d = corner[axis] + dx[axis] * (lane % EDGE) as f32 + dy[axis] * (lane / EDGE) as f32;
                // For a ray that is parallel to a slab, the inverse is huge instead of infinite, so that nothing becomes NaN.
                let d = if d.abs() < f32::MIN_POSITIVE { f32::MIN_POSITIVE.copysign(d) } else { d };
                direction[axis][lane] = d;
                inverse[axis][lane] = 1.0 / d;
            }
        }
        let t_near = rays.t_near as f32;
        Self { direction, inverse, t: [1.0; LANES], triangle: [TriangleHit::NONE; LANES], t_near }
    }

    #[inline(always)]
    fn hit(&self, lane: usize) -> TriangleHit {
        if self.triangle[lane] == TriangleHit::NONE {
            return TriangleHit::MISS;
        }
        TriangleHit { t: f64::from(self.t[lane]), triangle: self.triangle[lane] }
    }

    /// Finds the closest hits.
    #[inline(always)]
    fn descend(&mut self, bvh: &Bvh, corners: &[[Vec3A; 3]], eye: [f32; 3], stack: &mut [(u32, f32)]) {
        let mut waiting = 0;
        let mut farthest = 1.0f32;
        let mut at = 0;
        if self.enter(&bvh.nodes[0], eye) == f32::INFINITY {
            return;
        }
        loop {
            let node = &bvh.nodes[at as usize];
            if node.count > 0 {
                for place in node.first..node.first + node.count {
                    self.meet(&corners[place as usize], place, eye);
                }
                farthest = self.t.iter().fold(0.0, |a, &b| a.max(b));
            } else {
                let (mut near, mut far) = (node.first, node.first + 1);
                let mut t_near = self.enter(&bvh.nodes[near as usize], eye);
                let mut t_far = self.enter(&bvh.nodes[far as usize], eye);
                if t_far < t_near {
                    (near, far, t_near, t_far) = (far, near, t_far, t_near);
                }
                if t_far < f32::INFINITY {
                    stack[waiting] = (far, t_far);
                    waiting += 1;
                }
                if t_near < f32::INFINITY {
                    at = near;
                    continue;
                }
            }
            at = loop {
                if waiting == 0 {
                    return;
                }
                waiting -= 1;
                if stack[waiting].1 <= farthest {
                    break stack[waiting].0;
                }
            };
        }
    }

    /// Least `t` at which a ray enters the box before its closest hit; infinite if no ray does.
    #[inline(always)]
    fn enter(&self, node: &Node, eye: [f32; 3]) -> f32 {
        let mut enter = [self.t_near; LANES];
        let mut leave = self.t;
        for (axis, inverse) in self.inverse.iter().enumerate() {
            let (lo, hi) = (node.lo[axis] - eye[axis], node.hi[axis] - eye[axis]);
            for lane in 0..LANES {
                let (a, b) = (lo * inverse[lane], hi * inverse[lane]);
                let (near, far) = if a < b { (a, b) } else { (b, a) };
                enter[lane] = if near > enter[lane] { near } else { enter[lane] };
                let far = far * SLACK;
                leave[lane] = if far < leave[lane] { far } else { leave[lane] };
            }
        }
        let mut first = [f32::INFINITY; LANES];
        for lane in 0..LANES {
            first[lane] = if enter[lane] <= leave[lane] { enter[lane] } else { f32::INFINITY };
        }
        least(first)
    }

    /// Records the triangle for the rays that hit it before their closest hit so far.
    ///
    /// With corners relative to the eye, the sign of `d · (a × b)` tells on which side of an edge a ray passes; the other
    /// triangle at the edge has the same number, negated. Both sides of the triangle count.
    #[inline(always)]
    fn meet(&mut self, corners: &[Vec3A; 3], place: u32, eye: [f32; 3]) {
        let [a, b, c] = corners.map(|p| p - Vec3A::from(eye));
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let normal = (b - a).cross(c - a);
        let distance = normal.dot(a);
        for lane in 0..LANES {
            let dot = |v: Vec3A| {
                v.x * self.direction[0][lane] + v.y * self.direction[1][lane] + v.z * self.direction[2][lane]
            };
            let (u, v, w) = (dot(bc), dot(ca), dot(ab));
            let t = distance / dot(normal);
            let inside = ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
            let closer = inside & (t >= self.t_near) & (t < self.t[lane]);
            self.t[lane] = if closer { t } else { self.t[lane] };
            self.triangle[lane] = if closer { place } else { self.triangle[lane] };
        }
    }
}

/// The least of the lanes.
#[inline(always)]
fn least(mut lanes: Lanes) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            lanes[lane] = if lanes[lane + half] < lanes[lane] { lanes[lane + half] } else { lanes[lane] };
        }
        half /= 2;
    }
    lanes[0]
}
