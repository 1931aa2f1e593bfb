//! The reference caster: the paper's Figure 8, one ray at a time. It defines what a correct hit is.
//!
//! Numbers in the comments are lines of the figure, and functions have the names that the figure gives them. Two things
//! are as section 4.1 of the paper suggests: the octree is mirrored so that every component of the direction is negative,
//! and positions are in `[1, 2]`, so that their bits are the path of a voxel from the root.
//!
//! Two things differ from the figure, because of rays that rounding led astray:
//! - PUSH always writes a frame. The figure leaves it out where the ray leaves voxel and parent at the same `t`, and calls the two
//!   planes one. In voxels finer than the resolution of `t` they may be two, and POP read a frame that was not written: rays missed
//!   what is behind such voxels.
//! - ADVANCE never lets `t` go back. The plane between two children is computed in two ways, from the corner of either, and where
//!   they disagree, the ray crossed it before it had come there. Along an axis where the ray hardly moves, that was far before.
//!
//! [`oracle`](crate::testing::oracle) derives how far off hits may be, and a test holds millions of hard rays against it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_format::{ChildDescriptor, Octree};
use glam::Vec3;

use crate::frame::mad;
use crate::hit::exp2;
pub use crate::ray::{MAX_COMPONENT, MAX_ORIGIN};
use crate::{CastError, Caster, Checked, Device, DeviceKind, Fans, FrameTime, Hit, Ray, Rays, Roots, View};

/// Scale of the root cube: the paper's `s_max`.
pub const MAX_SCALE: u32 = 23;
/// A traversal that takes more steps is a miss. No ray of a valid octree of moderate size comes near.
pub const MAX_ITERATIONS: u32 = 1 << 20;
/// Smallest absolute value of a direction component, and of the product of a contour's normal (in the units of its word)
/// with the direction. Smaller ones are replaced by it, with their sign, so that nothing divides by zero.
pub const EPSILON: f32 = 1.0 / (1u32 << MAX_SCALE) as f32;

/// Casts one ray against the octree below the descriptor at slot `root`.
///
/// The octree must be [sound](Octree::sound), and `root` the root slot of one of its objects.
pub fn cast_ray(octree: &Octree, root: u32, ray: &Ray, contours: bool) -> Hit {
    if !ray.is_cast() {
        return Hit::miss(0);
    }
    let mirrored = MirroredRay::new(ray);

    // 1-3: the active span, where the ray is inside the root.
    let root_cube =
        Span { min: mirrored.t_at(Vec3::splat(2.0)).max_element(), max: mirrored.t_at(Vec3::splat(1.0)).min_element() };
    let mut t = root_cube.intersect(Span { min: ray.t_min, max: ray.t_max });
    // 5-7: the child of the root that the ray enters first.
    let mut parent = root;
    let mut scale = MAX_SCALE - 1;
    let mut size = 0.5f32;
    let mut idx = select_child(mirrored.t_at(Vec3::splat(1.5)), t.min);
    let mut pos = child_cube(Vec3::ONE, idx, size);
    let mut stack = [(root, t.max); MAX_SCALE as usize + 1];

    // 8
    for iteration in 1..=MAX_ITERATIONS {
        // 9: in mirrored space the ray leaves the cube by the planes at its lower corner. Where it enters is known: t.min.
        let t_corner = mirrored.t_at(pos);
        let tc_max = t_corner.min_element();
        let descriptor = octree.descriptor(parent);
        let child = (idx ^ mirrored.mirror) as u8;

        // 10
        if descriptor.valid_mask() >> child & 1 != 0 && t.min <= t.max {
            // 11
            if mad(tc_max, ray.size_per_t, ray.size_at_origin) >= size {
                return Hit::new(t.min, parent, child.into(), scale, iteration);
            }
            // 12
            let mut tv = Span { min: t.min, max: t.max.min(tc_max) };
            let t_centre = mad3(Vec3::splat(size * 0.5), mirrored.coef, t_corner);
            // 13-16
            if contours && descriptor.contour_mask() >> child & 1 != 0 {
                let word = contour_word(octree, parent, descriptor, child);
                tv = tv.intersect(project_contour(word, mirrored.direction, t_centre, size));
            }
            // 17
            if tv.min <= tv.max {
                // 18
                if descriptor.leaf_mask() >> child & 1 != 0 {
                    return Hit::new(tv.min, parent, child.into(), scale, iteration);
                }
                // 19-25: PUSH
                stack[scale as usize] = (parent, t.max);
                parent = find_child_descriptor(octree, parent, descriptor, child);
                scale -= 1;
                size *= 0.5;
                idx = select_child(t_centre, tv.min);
                pos = child_cube(pos, idx, size);
                t = tv;
                continue;
            }
        }
        // 28-30: ADVANCE
        let old_pos = pos;
        let step;
        (pos, step) = step_along_ray(pos, size, t_corner, tc_max);
        idx ^= step;
        t.min = t.min.max(tc_max);

        // 31: in mirrored space, a flip that sets a bit disagrees with the ray: it has left the parent.
        if idx & step != 0 {
            // 32-37: POP
            scale = highest_differing_bit(pos, old_pos);
            if scale >= MAX_SCALE {
                return Hit::miss(iteration);
            }
            size = exp2(scale as i32 - MAX_SCALE as i32);
            (parent, t.max) = stack[scale as usize];
            pos = round_position(pos, scale);
            idx = extract_child_slot_index(pos, scale);
        }
    }
    Hit::miss(MAX_ITERATIONS)
}

/// A span of `t`, empty if `min` is above `max`.
#[derive(Clone, Copy)]
struct Span {
    min: f32,
    max: f32,
}

impl Span {
    #[inline(always)]
    fn intersect(self, other: Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }
}

/// A ray in the space that is mirrored so that it runs against every axis.
struct MirroredRay {
    /// As given, but for components that are too close to zero.
    direction: Vec3,
    /// The ray crosses the plane at `x` at `t = x * coef.x - bias.x`; likewise for `y` and `z`.
    coef: Vec3,
    bias: Vec3,
    /// The axes that are mirrored, as bits of a child slot.
    mirror: u32,
}

impl MirroredRay {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        let direction = Vec3::from(ray.direction.to_array().map(away_from_zero));
        let coef = direction.abs().map(|d| 1.0 / -d);
        let mut bias = coef * ray.origin;
        let mut mirror = 0;
        for axis in 0..3 {
            if direction[axis] > 0.0 {
                mirror |= 1 << axis;
                bias[axis] = 3.0 * coef[axis] - bias[axis];
            }
        }
        Self { direction, coef, bias, mirror }
    }

    /// Where the ray crosses the three planes through a point.
    #[inline(always)]
    fn t_at(&self, p: Vec3) -> Vec3 {
        Vec3::from(std::array::from_fn(|i| mad(p[i], self.coef[i], -self.bias[i])))
    }
}

/// The child that the ray is in at `t_min`: on each axis the upper half if the ray crosses the middle plane, at `t_centre`,
/// later.
#[inline(always)]
fn select_child(t_centre: Vec3, t_min: f32) -> u32 {
    (0..3).fold(0, |idx, axis| idx | u32::from(t_centre[axis] > t_min) << axis)
}

/// Lower corner of the cube of child `idx`, of edge `size`, in the cube at `pos`.
#[inline(always)]
fn child_cube(mut pos: Vec3, idx: u32, size: f32) -> Vec3 {
    for axis in 0..3 {
        if idx >> axis & 1 != 0 {
            pos[axis] += size;
        }
    }
    pos
}

/// Slot of the child's own descriptor.
#[inline(always)]
fn find_child_descriptor(octree: &Octree, parent: u32, descriptor: ChildDescriptor, child: u8) -> u32 {
    octree.first_child(parent) + descriptor.child_rank(child)
}

/// The next cube of the same size: crosses every plane that the ray meets at `tc_max`. Returns its lower corner and the
/// axes that were crossed.
#[inline(always)]
fn step_along_ray(mut pos: Vec3, size: f32, t_corner: Vec3, tc_max: f32) -> (Vec3, u32) {
    let mut step = 0;
    for axis in 0..3 {
        if t_corner[axis] <= tc_max {
            step |= 1 << axis;
            pos[axis] -= size;
        }
    }
    (pos, step)
}

/// Scale of the highest voxel that the ray has left between two positions, which differ.
#[inline(always)]
fn highest_differing_bit(pos: Vec3, old_pos: Vec3) -> u32 {
    31 - (0..3).fold(0, |bits, axis| bits | (pos[axis].to_bits() ^ old_pos[axis].to_bits())).leading_zeros()
}

/// Lower corner of the cube of this scale that holds `pos`.
#[inline(always)]
fn round_position(pos: Vec3, scale: u32) -> Vec3 {
    Vec3::from(pos.to_array().map(|x| f32::from_bits(x.to_bits() >> scale << scale)))
}

/// Which child of its parent the cube of this scale at `pos` is.
#[inline(always)]
fn extract_child_slot_index(pos: Vec3, scale: u32) -> u32 {
    (0..3).fold(0, |idx, axis| idx | (pos[axis].to_bits() >> scale & 1) << axis)
}

/// The contour of a child that has one.
#[inline(always)]
fn contour_word(octree: &Octree, parent: u32, descriptor: ChildDescriptor, child: u8) -> u32 {
    octree.words()[(2 * parent + descriptor.contour_ptr() + descriptor.contour_rank(child)) as usize]
}

/// The span of `t` between the planes of a contour (spec section 7), of a voxel of edge `size` whose middle planes the ray
/// crosses at `t_centre`.
///
/// With `c` the voxel's centre, `n·(o + t d - c) = q` gives `t = (q + Σ n d (c - o) / d) / n·d`, and `(c - o) / d` is the
/// `t` of the plane through the centre, mirrored or not. Everything is in the units of the contour word, 2^26 of `n`.
#[inline(always)]
fn project_contour(word: u32, direction: Vec3, t_centre: Vec3, size: f32) -> Span {
    let field = |shift: u32| (word << shift) as i32 as f32;
    let a = field(14) * direction.x;
    let b = field(20) * direction.y;
    let c = field(26) * direction.z;
    let inverse = 1.0 / away_from_zero(a + b + c);
    // From left to right, as the authors' own caster adds: hits equal theirs bit for bit.
    let middle = (t_centre.x * a + t_centre.y * b + t_centre.z * c + field(7) * size * 1.5) * inverse;
    let half = (word as f32 * size * 0.75 * inverse).abs();
    Span { min: middle - half, max: middle + half }
}

/// A component of a direction as casters read it.
#[inline(always)]
pub(crate) fn away_from_zero(x: f32) -> f32 {
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
    if hit.is_miss() { 1.0 } else { view.coarse_start(hit.raw_t, hit.size()) }
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
    loaded: Option<(Arc<Octree>, Roots)>,
}

impl Default for ReferenceCaster {
    fn default() -> Self {
        let device =
            Device { name: "processor".into(), kind: DeviceKind::Cpu, detail: "scalar reference, 1 thread".into() };
        Self { device, loaded: None }
    }
}

impl ReferenceCaster {
    /// The octree, and what was checked against it.
    fn open<'a, T>(&'a self, checked: &'a Checked<T>) -> Result<(&'a Octree, &'a T), CastError> {
        let (octree, roots) = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        Ok((octree, roots.open(checked)?))
    }
}

impl Caster for ReferenceCaster {
    fn name(&self) -> &'static str {
        "reference"
    }

    fn device(&self) -> &Device {
        &self.device
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |(octree, _)| size_of_val(octree.slots()) as u64)
    }

    fn roots(&self) -> Option<&Roots> {
        self.loaded.as_ref().map(|(_, roots)| roots)
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.loaded = Some((octree.clone(), roots));
        Ok(())
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, view) = self.open(&view)?;
        let coarse = if view.beam() { cast_coarse(octree, view) } else { Vec::new() };
        cast_fine(octree, view, &coarse, hits);
        Ok(())
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let (octree, view) = self.open(&view)?;
        let mut hits = Vec::with_capacity(view.pixels());
        let start = Instant::now();
        let values = if view.beam() { cast_coarse(octree, view) } else { Vec::new() };
        let coarse = if view.beam() { start.elapsed() } else { Duration::ZERO };
        cast_fine(octree, view, &values, &mut hits);
        std::hint::black_box(&hits);
        Ok(FrameTime { total: start.elapsed(), coarse })
    }

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, rays) = self.open(&rays)?;
        hits.clear();
        hits.extend(rays.rays.iter().map(|ray| cast_ray(octree, rays.root, ray, rays.contours)));
        Ok(())
    }

    fn cast_fans_checked(&mut self, fans: Checked<Fans<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, fans) = self.open(&fans)?;
        hits.clear();
        hits.extend(fans.rays().map(|ray| cast_ray(octree, fans.root, &ray, fans.contours)));
        Ok(())
    }
}
