//! One ray at a time, compiled for what the processor has.
//!
//! The loop of the reference caster, which explains it. Here the features that a view does not use are compiled out, the
//! descriptor is kept while siblings are visited, and vectors are spelled out.

use esvo_core::reference::{EPSILON, MAX_ITERATIONS, MAX_SCALE};
use esvo_core::{Hit, Ray, exp2};
use esvo_format::ChildDescriptor;

use super::counters::{What, count};
use super::scene::Scene;
use super::tiles::{CastPacket, Found, LANES, Number, Packet, Task};

/// What [`run`] is compiled for.
pub(super) fn detail() -> &'static str {
    if has_v3() { "scalar, x86-64-v3" } else { "scalar, baseline" }
}

#[cfg(target_arch = "x86_64")]
fn has_v3() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

#[cfg(not(target_arch = "x86_64"))]
fn has_v3() -> bool {
    false
}

/// Does a task.
pub(super) fn run(scene: &Scene, task: Task) {
    #[cfg(target_arch = "x86_64")]
    if has_v3() {
        // SAFETY: the processor has the features that the function is compiled for.
        return unsafe { run_v3(scene, task) };
    }
    task.run(&Single(scene));
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn run_v3(scene: &Scene, task: Task) {
    task.run(&Single(scene));
}

/// Casts the lanes of a packet one after the other.
struct Single<'a>(&'a Scene<'a>);

impl CastPacket for Single<'_> {
    #[inline(always)]
    fn cast<N: Number, const CONTOURS: bool, const LOD: bool>(&self, packet: &Packet<N>) -> Found {
        let mut found = Found::new();
        for lane in (0..LANES).filter(|lane| packet.active >> lane & 1 != 0) {
            let ray = Ray {
                origin: packet.origin.each_ref().map(|number| number.lanes().get(lane)).into(),
                direction: packet.direction.map(|lanes| lanes[lane]).into(),
                t_min: packet.t_min.lanes().get(lane),
                t_max: packet.t_max.lanes().get(lane),
                size_at_origin: packet.size_at_origin.lanes().get(lane),
                size_per_t: packet.size_per_t.lanes().get(lane),
            };
            found.set(lane, cast::<CONTOURS, LOD>(self.0, &ray));
        }
        found
    }
}

#[inline(always)]
fn away_from_zero(x: f32) -> f32 {
    if x.abs() < EPSILON { EPSILON.copysign(x) } else { x }
}

/// Casts a ray that a packet cannot cast.
#[cold]
#[inline(never)]
pub(super) fn cast_one(scene: &Scene, ray: &Ray, contours: bool) -> Hit {
    if contours { cast::<true, true>(scene, ray) } else { cast::<false, true>(scene, ray) }
}

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
fn cast<const CONTOURS: bool, const LOD: bool>(scene: &Scene, ray: &Ray) -> Hit {
    let (slots, words) = (scene.slots(), scene.words());
    if !ray.is_cast() {
        return Hit::miss(0);
    }
    let d: [f32; 3] = ray.direction.to_array().map(away_from_zero);
    let mut mirror = 0u32;
    let mut coef = [0.0f32; 3];
    let mut bias = [0.0f32; 3];
    for axis in 0..3 {
        coef[axis] = 1.0 / -d[axis].abs();
        bias[axis] = coef[axis] * ray.origin[axis];
        if d[axis] > 0.0 {
            mirror |= 1 << axis;
            bias[axis] = 3.0 * coef[axis] - bias[axis];
        }
    }
    let t_at = |axis: usize, x: f32| x * coef[axis] - bias[axis];
    let mut t_min = greater(greater(t_at(0, 2.0), t_at(1, 2.0)), t_at(2, 2.0));
    let mut t_max = less(less(t_at(0, 1.0), t_at(1, 1.0)), t_at(2, 1.0));
    let mut h = t_max;
    t_min = greater(ray.t_min, t_min);
    t_max = less(ray.t_max, t_max);

    let mut parent = scene.root();
    let mut descriptor = ChildDescriptor(slots[parent as usize]);
    let mut stack = [(0u32, 0.0f32); MAX_SCALE as usize + 1];
    // Bit s: the frame of scale s was written.
    let mut pushed = 0u32;
    let mut scale = MAX_SCALE - 1;
    let mut size = 0.5f32;
    let mut idx = 0u32;
    let mut pos = [1.0f32; 3];
    for axis in 0..3 {
        if t_at(axis, 1.5) > t_min {
            idx |= 1 << axis;
            pos[axis] = 1.5;
        }
    }
    let mut iteration = 0;
    while iteration < MAX_ITERATIONS {
        iteration += 1;
        count(What::Visits, 1);
        let corner: [f32; 3] = std::array::from_fn(|axis| t_at(axis, pos[axis]));
        let tc_max = less(less(corner[0], corner[1]), corner[2]);
        let child = idx ^ mirror;
        if descriptor.valid_mask() as u32 >> child & 1 != 0 && t_min <= t_max {
            if LOD && tc_max * ray.size_per_t + ray.size_at_origin >= size {
                return Hit::new(t_min, parent, child, scale, iteration);
            }
            let half = size * 0.5;
            let centre: [f32; 3] = std::array::from_fn(|axis| half * coef[axis] + corner[axis]);
            let mut tv_min = t_min;
            let mut tv_max = less(t_max, tc_max);
            if CONTOURS && descriptor.contour_mask() as u32 >> child & 1 != 0 {
                count(What::ContourTests, 1);
                count(What::Bytes, 4);
                let at = 2 * parent + descriptor.contour_ptr() + descriptor.contour_rank(child as u8);
                let word = words[at as usize];
                let field = |shift: u32| (word << shift) as i32 as f32;
                let (a, b, c) = (field(14) * d[0], field(20) * d[1], field(26) * d[2]);
                let inverse = 1.0 / away_from_zero(a + b + c);
                let offset = field(7) * size * 1.5;
                let middle = (centre[0] * a + centre[1] * b + centre[2] * c + offset) * inverse;
                let reach = (word as f32 * size * 0.75 * inverse).abs();
                tv_min = greater(tv_min, middle - reach);
                tv_max = less(tv_max, middle + reach);
            }
            if tv_min <= tv_max {
                if descriptor.leaf_mask() as u32 >> child & 1 != 0 {
                    return Hit::new(tv_min, parent, child, scale, iteration);
                }
                if tc_max < h {
                    stack[scale as usize] = (parent, t_max);
                    pushed |= 1 << scale;
                }
                h = tc_max;
                count(What::Pushes, 1);
                count(What::Bytes, 8);
                let mut first = parent + descriptor.child_ptr();
                if descriptor.far() {
                    count(What::Bytes, 8);
                    first = parent.wrapping_add(slots[first as usize] as u32);
                }
                parent = first + descriptor.child_rank(child as u8);
                descriptor = ChildDescriptor(slots[parent as usize]);
                scale -= 1;
                size = half;
                idx = 0;
                for axis in 0..3 {
                    if centre[axis] > tv_min {
                        idx |= 1 << axis;
                        pos[axis] += size;
                    }
                }
                (t_min, t_max) = (tv_min, tv_max);
                continue;
            }
        }
        count(What::Advances, 1);
        let mut step = 0;
        let mut differing = 0;
        for axis in 0..3 {
            if corner[axis] <= tc_max {
                step |= 1 << axis;
                let next = pos[axis] - size;
                differing |= pos[axis].to_bits() ^ next.to_bits();
                pos[axis] = next;
            }
        }
        t_min = tc_max;
        idx ^= step;
        if idx & step != 0 {
            scale = 31 - differing.leading_zeros();
            if scale >= MAX_SCALE || pushed >> scale & 1 == 0 {
                return Hit::miss(iteration);
            }
            count(What::Pops, 1);
            count(What::Bytes, 8);
            size = exp2(scale as i32 - MAX_SCALE as i32);
            (parent, t_max) = stack[scale as usize];
            descriptor = ChildDescriptor(slots[parent as usize]);
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
