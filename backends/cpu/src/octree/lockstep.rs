//! Sixteen rays in lockstep: the reference's operations, lane by lane.
//!
//! Every lane has its own voxel, span and stack; lanes that a step does not concern keep what they have. Each lane computes
//! exactly what the reference computes for its ray, in the same order and without fused operations, so that hits are equal
//! bit for bit. It is for rays that do not stay together: `shared` is faster for those that do.

use esvo_core::reference::{MAX_ITERATIONS, MAX_SCALE};
use esvo_core::{Hit, Ray};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, mask32x16, u32x16};
use glam::Vec3;

use super::counters::{What, count};
use super::scene::Scene;
use super::shared::fault;
use super::task::{Found, LANES};
use crate::vectors::away_from_zero;

type Floats<S> = f32x16<S>;
type Words<S> = u32x16<S>;
type Mask<S> = mask32x16<S>;

/// Lanes that still have a ray when those that have none get the next ones. Measured with AVX2.
const LEAST_RUNNING: u32 = 12;

/// Casts rays.
pub(super) fn cast<S: Simd>(simd: S, scene: &Scene, rays: &[Ray], contours: bool, hits: &mut [Hit]) {
    match (scene.clips(contours), scene.rays_have_sizes(rays)) {
        (true, true) => cast_all::<S, true, true>(simd, scene, rays, hits),
        (true, false) => cast_all::<S, true, false>(simd, scene, rays, hits),
        (false, true) => cast_all::<S, false, true>(simd, scene, rays, hits),
        (false, false) => cast_all::<S, false, false>(simd, scene, rays, hits),
    }
}

/// A function of its own, so that it is compiled once.
#[inline(never)]
fn cast_all<S: Simd, const CONTOURS: bool, const LOD: bool>(simd: S, scene: &Scene, rays: &[Ray], hits: &mut [Hit]) {
    simd.vectorize(
        #[inline(always)]
        || cast_here::<S, CONTOURS, LOD>(simd, scene, rays, hits),
    );
}

/// Lanes whose rays have ended get the next ones, so that no lane waits for the longest ray.
#[inline(always)]
fn cast_here<S: Simd, const CONTOURS: bool, const LOD: bool>(simd: S, scene: &Scene, rays: &[Ray], hits: &mut [Hit]) {
    let none = Ray { t_min: 0.0, t_max: -1.0, ..Ray::new(Vec3::ONE, Vec3::ONE) };
    let mut stack = Stack([[(0, 0); LANES]; Stack::FRAMES]);
    let mut state = State::start(simd, scene, &[none; LANES], 0);
    // The ray of each lane.
    let mut number: [Option<usize>; LANES] = [None; LANES];
    let mut next = 0;
    loop {
        let running = state.active.to_bitmask() as u32;
        let enough = if next < rays.len() { LEAST_RUNNING } else { 1 };
        if running.count_ones() < enough {
            let ended = (0..LANES).filter(|lane| running >> lane & 1 == 0);
            let mut new = [none; LANES];
            let (mut fresh, mut cast) = (0, 0);
            let found = state.found();
            for lane in ended {
                if let Some(number) = number[lane] {
                    hits[number] = found.get(lane);
                }
                number[lane] = (next < rays.len()).then_some(next);
                if let Some(ray) = rays.get(next) {
                    new[lane] = *ray;
                    fresh |= 1 << lane;
                    cast |= u64::from(ray.is_cast()) << lane;
                    next += 1;
                }
            }
            if fresh != 0 {
                state.replace(Mask::from_bitmask(simd, fresh), State::start(simd, scene, &new, cast));
            } else if running == 0 {
                return;
            }
            continue;
        }
        state.step::<CONTOURS, LOD>(scene, &mut stack);
    }
}

/// Whether a bit of each lane is set.
#[inline(always)]
fn test<S: Simd>(words: Words<S>, bits: Words<S>) -> Mask<S> {
    !(words & bits).simd_eq(Words::splat(words.token(), 0))
}

/// The words of an image at these places.
#[inline(always)]
fn gather<S: Simd>(simd: S, words: &[u32], at: Words<S>) -> Words<S> {
    let at: [u32; LANES] = at.into();
    let mut found = [0; LANES];
    for lane in 0..LANES {
        found[lane] = words[at[lane] as usize];
    }
    Words::simd_from(simd, found)
}

/// The low and the high words of these slots.
#[inline(always)]
fn descriptors<S: Simd>(simd: S, slots: &[u64], at: Words<S>) -> [Words<S>; 2] {
    let at: [u32; LANES] = at.into();
    let [mut low, mut high] = [[0; LANES]; 2];
    for lane in 0..LANES {
        let descriptor = slots[at[lane] as usize];
        (low[lane], high[lane]) = (descriptor as u32, (descriptor >> 32) as u32);
    }
    [Words::simd_from(simd, low), Words::simd_from(simd, high)]
}

/// The field of contours whose highest bit is this number of bits below the highest of the word.
#[inline(always)]
fn field<S: Simd>(word: Words<S>, shift: u32) -> Floats<S> {
    (word << shift).bitcast::<i32x16<S>>().to_float()
}

/// A stack for each lane: a frame for each scale, of a parent's slot and the bits of its `t_max`.
struct Stack([[(u32, u32); LANES]; Self::FRAMES]);

impl Stack {
    /// One for each scale, rounded up to a power of two.
    const FRAMES: usize = 32;

    #[inline(always)]
    fn write<S: Simd>(&mut self, scale: Words<S>, parent: Words<S>, t_max: Floats<S>) {
        let (scale, parent, t_max): ([u32; LANES], [u32; LANES], [f32; LANES]) =
            (scale.into(), parent.into(), t_max.into());
        for lane in 0..LANES {
            self.0[scale[lane] as usize % Self::FRAMES][lane] = (parent[lane], t_max[lane].to_bits());
        }
    }

    #[inline(always)]
    fn read<S: Simd>(&self, simd: S, scale: Words<S>) -> (Words<S>, Floats<S>) {
        let scale: [u32; LANES] = scale.into();
        let [mut parent, mut t_max] = [[0; LANES]; 2];
        for lane in 0..LANES {
            (parent[lane], t_max[lane]) = self.0[scale[lane] as usize % Self::FRAMES][lane];
        }
        (Words::simd_from(simd, parent), Words::simd_from(simd, t_max).bitcast())
    }
}

/// Sixteen rays on their way, in mirrored space.
struct State<S: Simd> {
    simd: S,
    /// The rays that have not ended.
    active: Mask<S>,
    mirror: Words<S>,
    direction: [Floats<S>; 3],
    coef: [Floats<S>; 3],
    bias: [Floats<S>; 3],
    size_at_origin: Floats<S>,
    size_per_t: Floats<S>,
    t_min: Floats<S>,
    t_max: Floats<S>,
    parent: Words<S>,
    scale: Words<S>,
    size: Floats<S>,
    idx: Words<S>,
    pos: [Floats<S>; 3],
    /// Steps so far.
    iterations: Words<S>,
    /// What rays that have ended have hit.
    hit_t: Floats<S>,
    hit_slot: Words<S>,
    hit_voxel: Words<S>,
}

/// Sets a number of the lanes of a mask.
macro_rules! set {
    ($mask:expr, $to:expr, $value:expr) => {
        $to = $mask.select($value, $to)
    };
}

impl<S: Simd> State<S> {
    /// Rays at the root: those of the bits of `cast` go on.
    #[inline(always)]
    fn start(simd: S, scene: &Scene, rays: &[Ray; LANES], cast: u64) -> Self {
        let floats = |x: f32| Floats::splat(simd, x);
        let numbers = |x: u32| Words::splat(simd, x);
        let [mut origin, mut given] = [[[0.0; LANES]; 3]; 2];
        let [mut t_min, mut t_max, mut size_at_origin, mut size_per_t] = [[0.0; LANES]; 4];
        for (lane, ray) in rays.iter().enumerate() {
            for axis in 0..3 {
                (origin[axis][lane], given[axis][lane]) = (ray.origin[axis], ray.direction[axis]);
            }
            (t_min[lane], t_max[lane]) = (ray.t_min, ray.t_max);
            (size_at_origin[lane], size_per_t[lane]) = (ray.size_at_origin, ray.size_per_t);
        }
        let [mut direction, mut coef, mut bias] = [[floats(0.0); 3]; 3];
        let mut mirror = numbers(0);
        for axis in 0..3 {
            let d = away_from_zero(simd, Floats::simd_from(simd, given[axis]));
            direction[axis] = d;
            coef[axis] = floats(1.0) / -d.abs();
            let b = coef[axis] * Floats::simd_from(simd, origin[axis]);
            let positive = d.simd_gt(floats(0.0));
            bias[axis] = positive.select(coef[axis] * 3.0 - b, b);
            mirror |= positive.select(numbers(1 << axis), numbers(0));
        }
        let upper = [coef[0] * 2.0 - bias[0], coef[1] * 2.0 - bias[1], coef[2] * 2.0 - bias[2]];
        let lower = [coef[0] - bias[0], coef[1] - bias[1], coef[2] - bias[2]];
        let t_min = Floats::simd_from(simd, t_min).max(upper[0].max(upper[1]).max(upper[2]));
        let t_max = Floats::simd_from(simd, t_max).min(lower[0].min(lower[1]).min(lower[2]));
        let mut idx = numbers(0);
        let mut pos = [floats(1.0); 3];
        for axis in 0..3 {
            let upper = (coef[axis] * 1.5 - bias[axis]).simd_gt(t_min);
            idx |= upper.select(numbers(1 << axis), numbers(0));
            set!(upper, pos[axis], floats(1.5));
        }
        Self {
            simd,
            active: Mask::from_bitmask(simd, cast),
            mirror,
            direction,
            coef,
            bias,
            size_at_origin: Floats::simd_from(simd, size_at_origin),
            size_per_t: Floats::simd_from(simd, size_per_t),
            t_min,
            t_max,
            parent: numbers(scene.root()),
            scale: numbers(MAX_SCALE - 1),
            size: floats(0.5),
            idx,
            pos,
            iterations: numbers(0),
            hit_t: floats(Hit::MISS_T),
            hit_slot: numbers(0),
            hit_voxel: numbers(Hit::MISS_VOXEL),
        }
    }

    /// Puts rays of another state into the lanes of a mask.
    #[inline(always)]
    fn replace(&mut self, fresh: Mask<S>, by: Self) {
        self.active = fresh.select(by.active, self.active);
        for axis in 0..3 {
            set!(fresh, self.direction[axis], by.direction[axis]);
            set!(fresh, self.coef[axis], by.coef[axis]);
            set!(fresh, self.bias[axis], by.bias[axis]);
            set!(fresh, self.pos[axis], by.pos[axis]);
        }
        set!(fresh, self.mirror, by.mirror);
        set!(fresh, self.size_at_origin, by.size_at_origin);
        set!(fresh, self.size_per_t, by.size_per_t);
        set!(fresh, self.t_min, by.t_min);
        if !fault::made(fault::OLD_SPAN) {
            set!(fresh, self.t_max, by.t_max);
        }
        set!(fresh, self.parent, by.parent);
        set!(fresh, self.scale, by.scale);
        set!(fresh, self.size, by.size);
        set!(fresh, self.idx, by.idx);
        set!(fresh, self.iterations, by.iterations);
        set!(fresh, self.hit_t, by.hit_t);
        set!(fresh, self.hit_slot, by.hit_slot);
        set!(fresh, self.hit_voxel, by.hit_voxel);
    }

    /// What the rays have hit.
    #[inline(always)]
    fn found(&self) -> Found {
        Found {
            t: self.hit_t.into(),
            slot: self.hit_slot.into(),
            voxel: self.hit_voxel.into(),
            iterations: self.iterations.into(),
        }
    }

    /// A step of the loop of the paper's Figure 8; see `esvo_core::reference` for what each part means.
    #[inline(always)]
    fn step<const CONTOURS: bool, const LOD: bool>(&mut self, scene: &Scene, stack: &mut Stack) {
        let simd = self.simd;
        let floats = |x: f32| Floats::splat(simd, x);
        let numbers = |x: u32| Words::splat(simd, x);
        let Self { coef, bias, t_min, t_max, parent, scale, size, idx, pos, .. } = *self;
        count(What::Visits, 1);
        self.iterations = self.active.select(self.iterations + 1, self.iterations);
        let [low, high] = descriptors(simd, scene.slots(), parent);
        let corner = [pos[0] * coef[0] - bias[0], pos[1] * coef[1] - bias[1], pos[2] * coef[2] - bias[2]];
        let tc_max = corner[0].min(corner[1]).min(corner[2]);
        let child = idx ^ self.mirror;
        let bit = numbers(1) << child;
        let below = bit - 1;
        let valid = low >> 8;
        let mut process = self.active & test(valid, bit) & t_min.simd_le(t_max);
        let mut ended = process & !process;
        if LOD {
            let small = process & (tc_max * self.size_per_t + self.size_at_origin).simd_ge(size);
            set!(small, self.hit_t, t_min);
            ended = small;
            process &= !small;
        }
        let half = size * 0.5;
        let centre = [half * coef[0] + corner[0], half * coef[1] + corner[1], half * coef[2] + corner[2]];
        let mut tv_min = t_min;
        let mut tv_max = t_max.min(tc_max);
        if CONTOURS {
            let has = process & test(high, bit);
            if has.any_true() {
                let rank = (high & below).count_ones();
                let at = (parent << 1) + (high >> 8) + rank;
                let word = gather(simd, scene.words(), has.select(at, numbers(0)));
                let a = field(word, 14) * self.direction[0];
                let b = field(word, 20) * self.direction[1];
                let c = field(word, 26) * self.direction[2];
                let inverse = floats(1.0) / away_from_zero(simd, a + b + c);
                let offset = field(word, 7) * size * 1.5;
                let middle = (centre[0] * a + centre[1] * b + centre[2] * c + offset) * inverse;
                let thickness: Floats<S> = word.to_float();
                let reach = (thickness * size * 0.75 * inverse).abs();
                set!(has, tv_min, tv_min.max(middle - reach));
                set!(has, tv_max, tv_max.min(middle + reach));
            }
        }
        let inside = process & tv_min.simd_le(tv_max);
        let leaf = inside & test(low, bit);
        set!(leaf, self.hit_t, tv_min);
        ended |= leaf;
        set!(ended, self.hit_slot, parent);
        set!(ended, self.hit_voxel, child | scale << 8);
        self.active &= !ended;
        let push = inside & !leaf;
        let advance = self.active & !push;
        if push.any_true() {
            // Of all lanes: the frame of a scale at which a lane is, is never wrong.
            stack.write(scale, parent, t_max);
            let mut first = parent + (low >> 17);
            let far = push & test(low, numbers(1 << 16));
            if far.any_true() {
                let [offset, _] = descriptors(simd, scene.slots(), far.select(first, parent));
                set!(far, first, parent + offset);
            }
            // Valid, not a leaf, before this child.
            let elder = valid & !low & below;
            set!(push, self.parent, first + elder.count_ones());
            set!(push, self.scale, scale - 1);
            set!(push, self.idx, numbers(0));
            set!(push, self.t_min, tv_min);
            set!(push, self.t_max, tv_max);
            for axis in 0..3 {
                let upper = push & centre[axis].simd_gt(tv_min);
                self.idx |= upper.select(numbers(1 << axis), numbers(0));
                set!(upper, self.pos[axis], pos[axis] + half);
            }
        }
        if advance.any_true() {
            let mut step = numbers(0);
            let mut differing = numbers(0);
            for axis in 0..3 {
                let crossed = advance & corner[axis].simd_le(tc_max);
                let next = pos[axis] - size;
                let changed = pos[axis].bitcast::<Words<S>>() ^ next.bitcast::<Words<S>>();
                step |= crossed.select(numbers(1 << axis), numbers(0));
                differing |= crossed.select(changed, numbers(0));
                set!(crossed, self.pos[axis], next);
            }
            set!(advance, self.t_min, t_min.max(tc_max));
            self.idx ^= step;
            let pop = advance & test(self.idx, step);
            if pop.any_true() {
                self.pop(pop, differing, scale, stack);
            }
        }
        // 2^(scale - 23).
        self.size = ((self.scale + (127 - MAX_SCALE)) << 23).bitcast();
        self.active &= self.iterations.simd_lt(numbers(MAX_ITERATIONS));
    }

    /// The lanes of a mask leave their nodes. `differing`: the bits in which their positions changed; `scale`: what it was.
    #[inline(always)]
    fn pop(&mut self, mut pop: Mask<S>, differing: Words<S>, scale: Words<S>, stack: &Stack) {
        let simd = self.simd;
        let numbers = |x: u32| Words::splat(simd, x);
        // The number of the highest bit. Those of more than 24 bits, which may be rounded up, are above all frames.
        let highest = (differing.to_float::<Floats<S>>().bitcast::<Words<S>>() >> 23) - 127;
        let new_scale = pop.select(highest, scale);
        let out = pop & new_scale.simd_ge(numbers(MAX_SCALE));
        self.active &= !out;
        pop &= !out;
        set!(pop, self.scale, new_scale);
        let (parent, t_max) = stack.read(simd, self.scale);
        set!(pop, self.parent, parent);
        set!(pop, self.t_max, t_max);
        set!(pop, self.idx, numbers(0));
        for axis in 0..3 {
            let path = self.pos[axis].bitcast::<Words<S>>() >> self.scale;
            set!(pop, self.pos[axis], (path << self.scale).bitcast());
            let upper = pop & test(path, numbers(1));
            self.idx |= upper.select(numbers(1 << axis), numbers(0));
        }
    }
}
