//! One ray at a time, the three axes in one vector.
//!
//! The loop of the reference caster, which explains it, with the same floats: hits are equal in every bit. What differs:
//!  - A vector holds a number for each axis. The fourth lane's plane is infinitely far, so that it is never the least.
//!  - Where a ray crosses the planes at the lower corner is kept. On an axis on which a step changes nothing, it stays as it
//!    is; for the others, it is computed before it is known which they are. So a step waits for a compare and a
//!    select, and not for a sum, a product and a difference.
//!  - With contours, the child that a node is entered at is known late, after a division. A jump for each of the eight makes
//!    the processor guess it and go on. Without contours it is known early, and a wrong guess costs more than a right one gains.
//!  - The descriptor lies on the stack.
//!  - What a scene or a view does not use is compiled out.

use esvo_core::reference::{EPSILON, MAX_ITERATIONS, MAX_SCALE};
use esvo_core::{Hit, Ray, exp2};
use esvo_format::ChildDescriptor;
use fearless_simd::prelude::*;
use fearless_simd::{Fallback, Level, f32x4, i32x4, mask32x4, u32x4};

use super::counters::{What, count};
use super::scene::Scene;
use super::task::{CastRay, Task};

/// What [`run`] does tasks with.
pub(super) fn detail() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    return if Level::new().as_avx2().is_some() { "scalar, x86-64-v3" } else { "scalar, baseline" };
    #[cfg(not(target_arch = "x86_64"))]
    "scalar, baseline"
}

/// Does a task.
pub(super) fn run(scene: &Scene, task: Task) {
    #[cfg(any(target_arch = "aarch64", target_arch = "x86_64"))]
    let level = Level::new();
    #[cfg(target_arch = "aarch64")]
    if let Some(simd) = level.as_neon() {
        return task.run(scene, &Single { simd, scene });
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = level.as_avx2() {
        return task.run(scene, &Single { simd, scene });
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = level.as_sse2() {
        return task.run(scene, &Single { simd, scene });
    }
    task.run(scene, &Single { simd: Fallback::new(), scene });
}

struct Single<'a, S> {
    simd: S,
    scene: &'a Scene<'a>,
}

impl<S: Simd> CastRay for Single<'_, S> {
    #[inline(always)]
    fn cast<const CONTOURS: bool, const LOD: bool>(&self, ray: &Ray) -> Hit {
        cast::<S, CONTOURS, LOD>(self.simd, self.scene, ray)
    }
}

/// Casts a ray that a packet cannot cast.
#[cold]
pub(super) fn cast_one<S: Simd>(simd: S, scene: &Scene, ray: &Ray, contours: bool) -> Hit {
    if scene.clips(contours) {
        cast::<S, true, true>(simd, scene, ray)
    } else {
        cast::<S, false, true>(simd, scene, ray)
    }
}

/// Casts a ray. With `LOD`, it ends at small voxels.
fn cast<S: Simd, const CONTOURS: bool, const LOD: bool>(simd: S, scene: &Scene, ray: &Ray) -> Hit {
    if scene.has_far_pointers() {
        traverse::<S, CONTOURS, LOD, true>(simd, scene, ray)
    } else {
        traverse::<S, CONTOURS, LOD, false>(simd, scene, ray)
    }
}

/// A number for each axis, and the fourth lane.
type Axes<S> = f32x4<S>;

/// The lesser of two numbers. [`f32::min`] takes three instructions to be right about NaN, which does not occur.
#[inline(always)]
fn less(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two numbers; see [`less`].
#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn away_from_zero(x: f32) -> f32 {
    if x.abs() < EPSILON { too_small(x) } else { x }
}

/// A function of its own, so that the usual case waits for no select.
#[cold]
#[inline(never)]
fn too_small(x: f32) -> f32 {
    EPSILON.copysign(x)
}

/// The least number of the three axes, the fourth lane being infinite.
#[inline(always)]
fn least<S: Simd>(v: Axes<S>) -> f32 {
    let two = v.min(v.slide::<2>(v));
    less(two[0], v[1])
}

/// The sum over the axes, in the reference's order.
#[inline(always)]
fn sum<S: Simd>(v: Axes<S>) -> f32 {
    v[0] + v[1] + v[2]
}

/// The axes of a mask as bits.
#[inline(always)]
fn bits<S: Simd>(mask: mask32x4<S>) -> u32 {
    mask.to_bitmask() as u32 & 7
}

/// The bits of a mask of children for those before this one, counted.
#[inline(always)]
fn rank(mask: u32, child: u32) -> u32 {
    (mask & ((1 << child) - 1)).count_ones()
}

/// A ray in mirrored space: it crosses the planes at `x` at `t = x * coef - bias`.
struct Line<S: Simd> {
    coef: Axes<S>,
    bias: Axes<S>,
}

impl<S: Simd> Line<S> {
    #[inline(always)]
    fn t_at(&self, x: Axes<S>) -> Axes<S> {
        x * self.coef - self.bias
    }
}

/// The voxel that a ray is in, in mirrored space.
#[derive(Clone, Copy)]
struct Voxel<S: Simd> {
    /// Lower corner.
    pos: Axes<S>,
    /// Where the ray crosses the planes at the lower corner.
    corner: Axes<S>,
    /// Bits of the axes on which it is the upper half.
    idx: u32,
}

impl<S: Simd> Voxel<S> {
    /// The half of each axis that `upper` says, of the halves whose lower planes are at `self.pos` and `half.pos`.
    #[inline(always)]
    fn choose(self, half: Self, upper: mask32x4<S>, idx: u32) -> Self {
        Self { pos: upper.select(half.pos, self.pos), corner: upper.select(half.corner, self.corner), idx }
    }

    /// The same for a child that is known to the compiler.
    #[inline(always)]
    fn child<const IDX: u32>(self, half: Self) -> Self {
        // Without the black box, the compiler merges the children and selects by a mask, and all waits for it.
        let idx = std::hint::black_box(IDX);
        self.choose(half, mask32x4::from_bitmask(self.pos.token(), u64::from(IDX)), idx)
    }
}

#[inline(never)]
fn traverse<S: Simd, const CONTOURS: bool, const LOD: bool, const FAR: bool>(simd: S, scene: &Scene, ray: &Ray) -> Hit {
    simd.vectorize(
        #[inline(always)]
        || traverse_here::<S, CONTOURS, LOD, FAR>(simd, scene, ray),
    )
}

#[inline(always)]
fn traverse_here<S: Simd, const CONTOURS: bool, const LOD: bool, const FAR: bool>(
    simd: S,
    scene: &Scene,
    ray: &Ray,
) -> Hit {
    /// Frames of the stack: one for each scale, rounded up to a power of two.
    const FRAMES: usize = 32;

    let (slots, words) = (scene.slots(), scene.words());
    if !ray.is_cast() {
        return Hit::miss(0);
    }
    let d: [f32; 3] = ray.direction.to_array().map(away_from_zero);
    let mut mirror = 0u32;
    let mut coef = [0.0f32; 4];
    let mut bias = [0.0, 0.0, 0.0, f32::NEG_INFINITY];
    for axis in 0..3 {
        coef[axis] = 1.0 / -d[axis].abs();
        bias[axis] = coef[axis] * ray.origin[axis];
        if d[axis] > 0.0 {
            mirror |= 1 << axis;
            bias[axis] = 3.0 * coef[axis] - bias[axis];
        }
    }
    let (coef, bias) = (Axes::simd_from(simd, coef), Axes::simd_from(simd, bias));
    // The fourth lane is for the position of a contour.
    let d = Axes::simd_from(simd, [d[0], d[1], d[2], 1.0]);
    let line = Line { coef, bias };
    let all = |x: f32| Axes::splat(simd, x);
    let upper = line.t_at(all(2.0));
    let mut t_min = greater(ray.t_min, greater(greater(upper[0], upper[1]), upper[2]));
    let mut t_max = less(ray.t_max, least(line.t_at(all(1.0))));

    let mut parent = scene.root();
    let mut descriptor = ChildDescriptor(slots[parent as usize]);
    let mut stack = [(descriptor, 0u32, 0.0f32); FRAMES];
    let mut scale = MAX_SCALE - 1;
    let mut size = 0.5f32;
    let above = line.t_at(all(1.5)).simd_gt(all(t_min));
    let pos = above.select(all(1.5), all(1.0));
    let mut voxel = Voxel { pos, corner: line.t_at(pos), idx: bits(above) };
    let mut iteration = 0;
    'visit: while iteration < MAX_ITERATIONS {
        iteration += 1;
        count(What::Visits, 1);
        let tc_max = least(voxel.corner);
        let child = (voxel.idx ^ mirror) & 7;
        // The bits of this child are the lowest of the masks.
        let own = descriptor.0 >> child;
        'advance: {
            if own & 1 << 8 == 0 {
                break 'advance;
            }
            if LOD && tc_max * ray.size_per_t + ray.size_at_origin >= size {
                if t_min > t_max {
                    break 'advance;
                }
                return Hit::new(t_min, parent, child, scale, iteration);
            }
            let half = size * 0.5;
            let centre = all(half) * coef + voxel.corner;
            let mut tv_min = t_min;
            let mut tv_max = less(t_max, tc_max);
            if CONTOURS && own & 1 << 32 != 0 {
                count(What::ContourTests, 1);
                count(What::Bytes, 4);
                let at = 2 * parent + descriptor.contour_ptr() + rank(descriptor.high(), child);
                let word = words[at as usize];
                let fields: i32x4<S> = (u32x4::splat(simd, word) << u32x4::simd_from(simd, [14, 20, 26, 7])).bitcast();
                let fields: Axes<S> = fields.to_float();
                let normal = fields * d;
                let inverse = 1.0 / away_from_zero(sum(normal));
                // Products with `size` are exact, so that their order makes no difference.
                let middle = (sum(normal * centre) + fields[3] * (size * 1.5)) * inverse;
                let reach = (word as f32 * (size * 0.75) * inverse).abs();
                tv_min = greater(tv_min, middle - reach);
                tv_max = less(tv_max, middle + reach);
            }
            // Also if `t_min > t_max`.
            if tv_min > tv_max {
                break 'advance;
            }
            if own & 1 != 0 {
                return Hit::new(tv_min, parent, child, scale, iteration);
            }
            stack[scale as usize % FRAMES] = (descriptor, parent, t_max);
            count(What::Pushes, 1);
            count(What::Bytes, 8);
            let mut first = parent + descriptor.child_ptr();
            if FAR && descriptor.far() {
                count(What::Bytes, 8);
                first = parent.wrapping_add(slots[first as usize] as u32);
            }
            // Valid, no leaf.
            let inner = descriptor.low() >> 8 & !descriptor.low();
            parent = first + rank(inner, child);
            descriptor = ChildDescriptor(slots[parent as usize]);
            scale -= 1;
            size = half;
            let pos = voxel.pos + all(half);
            let halves = Voxel { pos, corner: line.t_at(pos), idx: 0 };
            let above = centre.simd_gt(all(tv_min));
            let idx = bits(above);
            voxel = if CONTOURS {
                match idx {
                    0 => voxel.child::<0>(halves),
                    1 => voxel.child::<1>(halves),
                    2 => voxel.child::<2>(halves),
                    3 => voxel.child::<3>(halves),
                    4 => voxel.child::<4>(halves),
                    5 => voxel.child::<5>(halves),
                    6 => voxel.child::<6>(halves),
                    _ => voxel.child::<7>(halves),
                }
            } else {
                voxel.choose(halves, above, idx)
            };
            (t_min, t_max) = (tv_min, tv_max);
            continue 'visit;
        }
        count(What::Advances, 1);
        let crossed = voxel.corner.simd_le(all(tc_max));
        let step = bits(crossed);
        let pos = voxel.pos - all(size);
        let old = voxel;
        voxel = old.choose(Voxel { pos, corner: line.t_at(pos), idx: 0 }, crossed, old.idx ^ step);
        t_min = greater(t_min, tc_max);
        if voxel.idx & step != 0 {
            let changed = old.pos.bitcast::<u32x4<S>>() ^ voxel.pos.bitcast::<u32x4<S>>();
            scale = 31 - (changed[0] | changed[1] | changed[2]).leading_zeros();
            if scale >= MAX_SCALE {
                return Hit::miss(iteration);
            }
            count(What::Pops, 1);
            count(What::Bytes, 8);
            size = exp2(scale as i32 - MAX_SCALE as i32);
            (descriptor, parent, t_max) = stack[scale as usize % FRAMES];
            let path = voxel.pos.bitcast::<u32x4<S>>();
            let upper = (path << (31 - scale)).bitcast::<i32x4<S>>().simd_lt(i32x4::splat(simd, 0));
            let pos: Axes<S> = (path & u32x4::splat(simd, u32::MAX << scale)).bitcast();
            voxel = Voxel { pos, corner: line.t_at(pos), idx: bits(upper) };
        }
    }
    Hit::miss(MAX_ITERATIONS)
}
