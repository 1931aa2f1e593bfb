//! The reference caster: the paper's Figure 8, one ray at a time. It defines what a correct hit is.
//!
//! Line numbers in the comments are those of the figure. As section 4.1 suggests, the octree is mirrored so that every
//! component of the direction is negative, and positions are in `[1, 2]` so that their bits are the path of a voxel.

use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_format::{ChildDescriptor, Octree};
use glam::Vec3;

use crate::frame::mad;
use crate::hit::exp2;
use crate::{CastError, Caster, Device, DeviceKind, Fans, FrameTime, Hit, Ray, View};

/// Scale of the root cube.
pub const MAX_SCALE: u32 = 23;
/// A traversal that takes more steps is given up as a miss; no ray of a valid octree of moderate size comes near.
pub const MAX_ITERATIONS: u32 = 1 << 20;
/// Smallest absolute value of a direction component, and of the product of a contour's normal (in the units of its word)
/// with the direction: what is nearer to zero is replaced by it, so that nothing divides by zero.
pub const EPSILON: f32 = 1.0 / (1u32 << MAX_SCALE) as f32;
/// Largest direction component that is cast; longer rays miss, as those that are not finite do.
pub const MAX_COMPONENT: f32 = (1u32 << 20) as f32;

/// Casts one ray against the octree below the descriptor at slot `root`.
///
/// The octree must be [sound](Octree::sound).
pub fn cast_ray(octree: &Octree, root: u32, ray: &Ray, contours: bool) -> Hit {
    if !(ray.origin.is_finite() && ray.direction.is_finite() && ray.direction.abs().max_element() <= MAX_COMPONENT) {
        return Hit::miss(0);
    }
    let direction = Vec3::from(ray.direction.to_array().map(away_from_zero));

    // The plane at x is crossed at t(x) = x * coef - bias, likewise for y and z.
    let coef = direction.abs().map(|d| 1.0 / -d);
    let mut bias = coef * ray.origin;
    let mut mirror = 0;
    for axis in 0..3 {
        if direction[axis] > 0.0 {
            mirror |= 1 << axis;
            bias[axis] = 3.0 * coef[axis] - bias[axis];
        }
    }
    let t_at = |p: Vec3| Vec3::from(std::array::from_fn(|i| mad(p[i], coef[i], -bias[i])));

    // 1-3: the active span of the ray is where it is inside the root.
    let mut t_min = t_at(Vec3::splat(2.0)).max_element();
    let mut t_max = t_at(Vec3::splat(1.0)).min_element();
    let mut h = t_max;
    t_min = t_min.max(ray.t_min);
    t_max = t_max.min(ray.t_max);

    // 5-7: the first child of the root.
    let mut parent = root;
    let mut stack: [Option<(u32, f32)>; MAX_SCALE as usize + 1] = [None; MAX_SCALE as usize + 1];
    let mut scale = MAX_SCALE - 1;
    let mut size = 0.5f32;
    let (mut idx, mut pos) = select_child(t_at(Vec3::splat(1.5)), t_min, Vec3::ONE, size);

    for iteration in 1..=MAX_ITERATIONS {
        // 9: in the mirrored space the ray leaves a cube through the planes at its lower corner.
        let t_corner = t_at(pos);
        let tc_max = t_corner.min_element();
        let descriptor = octree.descriptor(parent);
        let child = (idx ^ mirror) as u8;

        // 10: process the voxel if it exists and the active span is not empty.
        if descriptor.valid_mask() >> child & 1 != 0 && t_min <= t_max {
            // 11: small enough to end here.
            if mad(tc_max, ray.size_per_t, ray.size_at_origin) >= size {
                return Hit::new(t_min, parent, child.into(), scale, iteration);
            }
            // 12-16: intersect the span with the cube and with the contour.
            let mut tv_min = t_min;
            let mut tv_max = t_max.min(tc_max);
            let t_centre = mad3(Vec3::splat(size * 0.5), coef, t_corner);
            if contours && descriptor.contour_mask() >> child & 1 != 0 {
                let (enter, leave) = project_contour(octree, parent, descriptor, child, direction, t_centre, size);
                tv_min = tv_min.max(enter);
                tv_max = tv_max.min(leave);
            }
            // 17: process the children if the span is not empty.
            if tv_min <= tv_max {
                // 18: a leaf ends the ray.
                if descriptor.leaf_mask() >> child & 1 != 0 {
                    return Hit::new(tv_min, parent, child.into(), scale, iteration);
                }
                // 19-25: PUSH.
                if tc_max < h {
                    stack[scale as usize] = Some((parent, t_max));
                }
                h = tc_max;
                parent = octree.first_child(parent) + descriptor.child_rank(child);
                scale -= 1;
                size *= 0.5;
                (idx, pos) = select_child(t_centre, tv_min, pos, size);
                (t_min, t_max) = (tv_min, tv_max);
                continue;
            }
        }
        // 28-30: ADVANCE along every axis whose plane is reached first.
        let mut step = 0;
        let mut differing = 0;
        for axis in 0..3 {
            if t_corner[axis] <= tc_max {
                step |= 1 << axis;
                let next = pos[axis] - size;
                differing |= pos[axis].to_bits() ^ next.to_bits();
                pos[axis] = next;
            }
        }
        t_min = tc_max;
        idx ^= step;

        // 31: flips that set a bit go against the ray: it has left the parent.
        if idx & step != 0 {
            // 32-37: POP to the highest voxel whose bit changed.
            scale = 31 - differing.leading_zeros();
            if scale >= MAX_SCALE {
                return Hit::miss(iteration);
            }
            size = exp2(scale as i32 - MAX_SCALE as i32);
            // A frame is left out when the ray leaves voxel and parent together. Where rounding makes two planes of a
            // far-off octree coincide it may be asked for all the same: nothing is known there.
            let Some(frame) = stack[scale as usize] else { return Hit::miss(iteration) };
            (parent, t_max) = frame;
            idx = 0;
            for axis in 0..3 {
                let path = pos[axis].to_bits() >> scale;
                pos[axis] = f32::from_bits(path << scale);
                idx |= (path & 1) << axis;
            }
            h = 0.0;
        }
    }
    Hit::miss(MAX_ITERATIONS)
}

/// The half of the voxel that the ray enters first on each axis: the upper one if its middle plane, at `t_centre`, comes
/// later. `pos` is the voxel's lower corner, `size` the child's edge.
#[inline(always)]
fn select_child(t_centre: Vec3, t_min: f32, mut pos: Vec3, size: f32) -> (u32, Vec3) {
    let mut idx = 0;
    for axis in 0..3 {
        if t_centre[axis] > t_min {
            idx |= 1 << axis;
            pos[axis] += size;
        }
    }
    (idx, pos)
}

/// The span of `t` between the planes of a child's contour (spec section 7).
///
/// With `c` the voxel's centre, `n·(o + t d - c) = q` gives `t = (q + Σ n d (c - o) / d) / n·d`, and `(c - o) / d` is the
/// `t` of the plane through the centre, mirrored or not. Everything is in the units of the contour word, 2^26 of `n`.
#[inline(always)]
fn project_contour(
    octree: &Octree,
    parent: u32,
    descriptor: ChildDescriptor,
    child: u8,
    direction: Vec3,
    t_centre: Vec3,
    size: f32,
) -> (f32, f32) {
    let at = 2 * parent + descriptor.contour_ptr() + descriptor.contour_rank(child);
    let word = octree.words()[at as usize];
    let field = |shift: u32| (word << shift) as i32 as f32;
    let a = field(14) * direction.x;
    let b = field(20) * direction.y;
    let c = field(26) * direction.z;
    let inverse = 1.0 / away_from_zero(a + b + c);
    // From left to right, as the authors' own caster adds it up: hits equal theirs bit for bit.
    let middle = (t_centre.x * a + t_centre.y * b + t_centre.z * c + field(7) * size * 1.5) * inverse;
    let half = (word as f32 * size * 0.75 * inverse).abs();
    (middle - half, middle + half)
}

#[inline(always)]
fn away_from_zero(x: f32) -> f32 {
    if x.abs() < EPSILON { EPSILON.copysign(x) } else { x }
}

#[inline(always)]
fn mad3(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    Vec3::new(mad(a.x, b.x, c.x), mad(a.y, b.y, c.y), mad(a.z, b.z, c.z))
}

/// The coarse pass of the beam optimization (paper section 4.2): one start value per corner, row by row.
pub fn cast_coarse(octree: &Octree, view: &View) -> Vec<f32> {
    let (columns, rows) = view.coarse_size();
    (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))).map(|(i, j)| coarse_value(octree, view, i, j)).collect()
}

/// One value of the coarse pass. Contours are off: they would let a ray pass through voxels that others hit.
pub fn coarse_value(octree: &Octree, view: &View, i: u32, j: u32) -> f32 {
    let hit = cast_ray(octree, view.root, &view.coarse_ray(i, j), false);
    if hit.is_miss() { 1.0 } else { view.coarse_start(hit.t, hit.size()) }
}

/// The main pass; `coarse` is what [`cast_coarse`] returned, or empty for a view without beam optimization.
pub fn cast_fine(octree: &Octree, view: &View, coarse: &[f32], hits: &mut Vec<Hit>) {
    hits.clear();
    for y in 0..view.height {
        for x in 0..view.width {
            let mut ray = view.ray(x, y);
            if view.beam() {
                ray.t_min = view.beam_start(coarse, x, y);
            }
            hits.push(cast_ray(octree, view.root, &ray, view.contours()));
        }
    }
}

/// The reference caster on one thread.
pub struct ReferenceCaster {
    device: Device,
    octree: Option<Arc<Octree>>,
}

impl Default for ReferenceCaster {
    fn default() -> Self {
        let device =
            Device { name: "processor".into(), kind: DeviceKind::Cpu, detail: "scalar reference, 1 thread".into() };
        Self { device, octree: None }
    }
}

impl Caster for ReferenceCaster {
    fn name(&self) -> &'static str {
        "reference"
    }

    fn device(&self) -> &Device {
        &self.device
    }

    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        octree.sound()?;
        self.octree = Some(octree.clone());
        Ok(())
    }

    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        let coarse = if view.beam() { cast_coarse(octree, view) } else { Vec::new() };
        cast_fine(octree, view, &coarse, hits);
        Ok(())
    }

    fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        let mut hits = Vec::with_capacity(view.pixels());
        let start = Instant::now();
        let values = if view.beam() { cast_coarse(octree, view) } else { Vec::new() };
        let coarse = if view.beam() { start.elapsed() } else { Duration::ZERO };
        cast_fine(octree, view, &values, &mut hits);
        std::hint::black_box(&hits);
        Ok(FrameTime { total: start.elapsed(), coarse })
    }

    fn cast_fans(&mut self, fans: &Fans, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        hits.clear();
        hits.extend(fans.rays().map(|ray| cast_ray(octree, fans.root, &ray, fans.contours)));
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        self.octree.as_ref().map_or(0, |octree| std::mem::size_of_val(octree.slots()) as u64)
    }
}
