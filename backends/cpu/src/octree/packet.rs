//! Sixteen rays in lockstep with AVX-512: the reference's operations, lane by lane.
//!
//! Every lane has its own voxel, span and stack; lanes that a step does not concern are masked out. Each lane computes
//! exactly what the reference computes for its ray, in the same order and without fused operations, so that hits are equal
//! bit for bit. A packet ends when its last lane does; blocks of 4 x 4 pixels keep lanes together.

use std::arch::x86_64::*;

use esvo_core::Hit;
use esvo_core::reference::{EPSILON, MAX_COMPONENT, MAX_ITERATIONS, MAX_SCALE};

use super::gather::{Image, Stack};
use super::scene::Scene;
use super::tiles::{CastPacket, Found, LANES, Lanes, Number, Packet, Task};

/// Whether the processor has what this module is compiled for.
pub(super) fn is_available() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512cd")
        && is_x86_feature_detected!("avx512vpopcntdq")
}

/// Casts packets on a processor that [has](is_available) what that takes.
pub(super) struct Packets<'a> {
    scene: &'a Scene<'a>,
    image: Image<'a>,
}

impl<'a> Packets<'a> {
    /// `None` if the processor lacks an instruction, or gathers cannot reach all of the image.
    pub(super) fn new(scene: &'a Scene<'a>) -> Option<Self> {
        let image = is_available().then(|| Image::new(scene.words()))??;
        Some(Self { scene, image })
    }

    /// Does a task.
    pub(super) fn run(&self, task: Task) {
        // SAFETY: `new` has found all features but BMI, LZCNT and POPCNT, which every processor with AVX-512 has.
        unsafe { self.run_avx512(task) }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
    fn run_avx512(&self, task: Task) {
        task.run(self.scene, self);
    }
}

impl CastPacket for Packets<'_> {
    #[inline(always)]
    fn cast<N: Number, const CONTOURS: bool, const LOD: bool>(&self, packet: &Packet<N>) -> Found {
        // SAFETY: as for `run`.
        unsafe { cast::<N, CONTOURS, LOD>(self, packet) }
    }
}

/// Loads sixteen floats.
#[inline]
#[target_feature(enable = "avx512f")]
fn load(values: &[f32; LANES]) -> __m512 {
    // SAFETY: the array is sixteen floats long; the load has no alignment requirement.
    unsafe { _mm512_loadu_ps(values.as_ptr()) }
}

/// The lanes of a number.
#[inline]
#[target_feature(enable = "avx512f")]
fn spread<N: Number>(number: &N) -> __m512 {
    match number.lanes() {
        Lanes::All(number) => _mm512_set1_ps(number),
        Lanes::Each(numbers) => load(numbers),
    }
}

/// Replaces numbers nearer to zero than [`EPSILON`] by it, keeping the sign.
#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn away_from_zero(x: __m512) -> __m512 {
    let epsilon = _mm512_set1_ps(EPSILON);
    let tiny = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(x), epsilon);
    let sign = _mm512_and_ps(x, _mm512_set1_ps(-0.0));
    _mm512_mask_or_ps(x, tiny, epsilon, sign)
}

/// `2^(scale - 23)`.
#[inline]
#[target_feature(enable = "avx512f")]
fn exp2_of_scale(scale: __m512i) -> __m512 {
    let bias = _mm512_set1_epi32(127 - MAX_SCALE as i32);
    _mm512_castsi512_ps(_mm512_slli_epi32::<23>(_mm512_add_epi32(scale, bias)))
}

/// The loop of the paper's Figure 8; see `esvo_core::reference` for what each step means.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
fn cast<N: Number, const CONTOURS: bool, const LOD: bool>(packets: &Packets, packet: &Packet<N>) -> Found {
    let image = &packets.image;
    let zero = _mm512_setzero_si512();
    let one = _mm512_set1_epi32(1);
    // SAFETY: (of both) rays start at the root of an object, and the pointers of a sound octree lead to descriptors and far
    // pointers in the image: `index` is the slot of one. Lanes that are masked out are not read.
    let gather_low = |mask: __mmask16, index: __m512i| unsafe { image.low_words(mask, index) };
    // SAFETY: as above.
    let gather_high = |mask: __mmask16, index: __m512i| unsafe { image.high_words(mask, index) };

    // Rays that are not finite miss without a step.
    let raw: [__m512; 3] = [load(&packet.direction[0]), load(&packet.direction[1]), load(&packet.direction[2])];
    let limit = _mm512_set1_ps(MAX_COMPONENT);
    let mut active = packet.active;
    for component in raw {
        active &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_abs_ps(component), limit);
    }
    let origin: [__m512; 3] = [spread(&packet.origin[0]), spread(&packet.origin[1]), spread(&packet.origin[2])];
    for component in origin {
        // False for infinity and NaN.
        active &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_abs_ps(component), _mm512_set1_ps(f32::MAX));
    }

    let mut mirror = zero;
    let mut coef = [_mm512_setzero_ps(); 3];
    let mut bias = coef;
    let mut direction = coef;
    for axis in 0..3 {
        let d = away_from_zero(raw[axis]);
        direction[axis] = d;
        let negative = _mm512_or_ps(_mm512_abs_ps(d), _mm512_set1_ps(-0.0));
        coef[axis] = _mm512_div_ps(_mm512_set1_ps(1.0), negative);
        let b = _mm512_mul_ps(coef[axis], origin[axis]);
        let positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(d, _mm512_setzero_ps());
        let mirrored = _mm512_sub_ps(_mm512_mul_ps(_mm512_set1_ps(3.0), coef[axis]), b);
        bias[axis] = _mm512_mask_mov_ps(b, positive, mirrored);
        mirror = _mm512_mask_or_epi32(mirror, positive, mirror, _mm512_set1_epi32(1 << axis));
    }
    let (size_at_origin, size_per_t) = (spread(&packet.size_at_origin), spread(&packet.size_per_t));
    let root = _mm512_set1_epi32(packets.scene.root() as i32);
    let t_at = |axis: usize, x: __m512| _mm512_sub_ps(_mm512_mul_ps(x, coef[axis]), bias[axis]);
    let t_all = |x: f32| [0, 1, 2].map(|axis| t_at(axis, _mm512_set1_ps(x)));
    let [x, y, z] = t_all(2.0);
    let mut t_min = _mm512_max_ps(_mm512_max_ps(x, y), z);
    let [x, y, z] = t_all(1.0);
    let mut t_max = _mm512_min_ps(_mm512_min_ps(x, y), z);
    let mut h = t_max;
    t_min = _mm512_max_ps(t_min, spread(&packet.t_min));
    t_max = _mm512_min_ps(t_max, spread(&packet.t_max));

    let mut parent = root;
    let mut low = gather_low(u16::MAX, parent);
    let mut high = gather_high(u16::MAX, parent);
    let mut stack = Stack::new();
    // Bit s of a lane: its frame of scale s was written.
    let mut pushed = zero;
    let mut scale = _mm512_set1_epi32(MAX_SCALE as i32 - 1);
    let mut size = _mm512_set1_ps(0.5);
    let mut idx = zero;
    let mut pos = [_mm512_set1_ps(1.0); 3];
    for (axis, t) in t_all(1.5).into_iter().enumerate() {
        let upper = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(t, t_min);
        idx = _mm512_mask_or_epi32(idx, upper, idx, _mm512_set1_epi32(1 << axis));
        pos[axis] = _mm512_mask_mov_ps(pos[axis], upper, _mm512_set1_ps(1.5));
    }

    let mut hit_t = _mm512_set1_ps(Hit::MISS_T);
    let mut hit_slot = zero;
    let mut hit_voxel = _mm512_set1_epi32(Hit::MISS_VOXEL as i32);
    let mut hit_iterations = zero;

    for iteration in 1..=MAX_ITERATIONS {
        if active == 0 {
            break;
        }
        let now = _mm512_set1_epi32(iteration as i32);
        let corner: [__m512; 3] = [t_at(0, pos[0]), t_at(1, pos[1]), t_at(2, pos[2])];
        let tc_max = _mm512_min_ps(_mm512_min_ps(corner[0], corner[1]), corner[2]);
        let child = _mm512_xor_si512(idx, mirror);
        let bit = _mm512_sllv_epi32(one, child);
        let below = _mm512_sub_epi32(bit, one);
        let valid = _mm512_srli_epi32::<8>(low);
        let mut process = active & _mm512_test_epi32_mask(valid, bit) & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(t_min, t_max);
        let mut push = 0;
        if process != 0 {
            let voxel = _mm512_or_si512(child, _mm512_slli_epi32::<8>(scale));
            if LOD {
                let footprint = _mm512_add_ps(_mm512_mul_ps(tc_max, size_per_t), size_at_origin);
                let small = process & _mm512_cmp_ps_mask::<_CMP_GE_OQ>(footprint, size);
                hit_t = _mm512_mask_mov_ps(hit_t, small, t_min);
                hit_slot = _mm512_mask_mov_epi32(hit_slot, small, parent);
                hit_voxel = _mm512_mask_mov_epi32(hit_voxel, small, voxel);
                hit_iterations = _mm512_mask_mov_epi32(hit_iterations, small, now);
                active &= !small;
                process &= !small;
            }
            let half = _mm512_mul_ps(size, _mm512_set1_ps(0.5));
            let centre = [0, 1, 2].map(|axis| _mm512_add_ps(_mm512_mul_ps(half, coef[axis]), corner[axis]));
            let mut tv_min = t_min;
            let mut tv_max = _mm512_min_ps(t_max, tc_max);
            if CONTOURS {
                let has = process & _mm512_test_epi32_mask(_mm512_and_si512(high, _mm512_set1_epi32(0xff)), bit);
                if has != 0 {
                    let rank = _mm512_popcnt_epi32(_mm512_and_si512(high, below));
                    let at = _mm512_add_epi32(
                        _mm512_add_epi32(_mm512_slli_epi32::<1>(parent), _mm512_srli_epi32::<8>(high)),
                        rank,
                    );
                    // SAFETY: a sound octree's contour pointers lead into the image.
                    let word = unsafe { image.words(has, at) };
                    let a = _mm512_mul_ps(_mm512_cvtepi32_ps(_mm512_slli_epi32::<14>(word)), direction[0]);
                    let b = _mm512_mul_ps(_mm512_cvtepi32_ps(_mm512_slli_epi32::<20>(word)), direction[1]);
                    let c = _mm512_mul_ps(_mm512_cvtepi32_ps(_mm512_slli_epi32::<26>(word)), direction[2]);
                    let sum = _mm512_add_ps(_mm512_add_ps(a, b), c);
                    let inverse = _mm512_div_ps(_mm512_set1_ps(1.0), away_from_zero(sum));
                    let position = _mm512_cvtepi32_ps(_mm512_slli_epi32::<7>(word));
                    let offset = _mm512_mul_ps(_mm512_mul_ps(position, size), _mm512_set1_ps(1.5));
                    let middle = _mm512_add_ps(_mm512_mul_ps(centre[0], a), _mm512_mul_ps(centre[1], b));
                    let middle = _mm512_add_ps(middle, _mm512_mul_ps(centre[2], c));
                    let middle = _mm512_mul_ps(_mm512_add_ps(middle, offset), inverse);
                    let thickness = _mm512_mul_ps(_mm512_cvtepu32_ps(word), size);
                    let reach = _mm512_mul_ps(_mm512_mul_ps(thickness, _mm512_set1_ps(0.75)), inverse);
                    let reach = _mm512_abs_ps(reach);
                    tv_min = _mm512_mask_max_ps(tv_min, has, tv_min, _mm512_sub_ps(middle, reach));
                    tv_max = _mm512_mask_min_ps(tv_max, has, tv_max, _mm512_add_ps(middle, reach));
                }
            }
            let inside = process & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(tv_min, tv_max);
            let leaf = inside & _mm512_test_epi32_mask(_mm512_and_si512(low, _mm512_set1_epi32(0xff)), bit);
            hit_t = _mm512_mask_mov_ps(hit_t, leaf, tv_min);
            hit_slot = _mm512_mask_mov_epi32(hit_slot, leaf, parent);
            hit_voxel = _mm512_mask_mov_epi32(hit_voxel, leaf, voxel);
            hit_iterations = _mm512_mask_mov_epi32(hit_iterations, leaf, now);
            active &= !leaf;
            push = inside & !leaf;
            if push != 0 {
                let store = push & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(tc_max, h);
                // SAFETY: a scale is below 24.
                unsafe { stack.write(store, scale, parent, t_max) };
                pushed = _mm512_mask_or_epi32(pushed, store, pushed, _mm512_sllv_epi32(one, scale));
                h = _mm512_mask_mov_ps(h, push, tc_max);
                let mut first = _mm512_add_epi32(parent, _mm512_srli_epi32::<17>(low));
                let far = push & _mm512_test_epi32_mask(low, _mm512_set1_epi32(1 << 16));
                if far != 0 {
                    first = _mm512_mask_add_epi32(first, far, parent, gather_low(far, first));
                }
                // Valid, not a leaf, before this child.
                let elder = _mm512_and_si512(_mm512_andnot_si512(low, valid), below);
                let next = _mm512_add_epi32(first, _mm512_popcnt_epi32(elder));
                parent = _mm512_mask_mov_epi32(parent, push, next);
                low = _mm512_mask_mov_epi32(low, push, gather_low(push, parent));
                high = _mm512_mask_mov_epi32(high, push, gather_high(push, parent));
                scale = _mm512_mask_sub_epi32(scale, push, scale, one);
                size = _mm512_mask_mov_ps(size, push, half);
                idx = _mm512_mask_mov_epi32(idx, push, zero);
                for axis in 0..3 {
                    let upper = push & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(centre[axis], tv_min);
                    idx = _mm512_mask_or_epi32(idx, upper, idx, _mm512_set1_epi32(1 << axis));
                    pos[axis] = _mm512_mask_add_ps(pos[axis], upper, pos[axis], half);
                }
                t_min = _mm512_mask_mov_ps(t_min, push, tv_min);
                t_max = _mm512_mask_mov_ps(t_max, push, tv_max);
            }
        }
        let advance = active & !push;
        if advance == 0 {
            continue;
        }
        let mut step = zero;
        let mut differing = zero;
        for axis in 0..3 {
            let crossed = advance & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(corner[axis], tc_max);
            let next = _mm512_sub_ps(pos[axis], size);
            let changed = _mm512_xor_si512(_mm512_castps_si512(pos[axis]), _mm512_castps_si512(next));
            step = _mm512_mask_or_epi32(step, crossed, step, _mm512_set1_epi32(1 << axis));
            differing = _mm512_mask_or_epi32(differing, crossed, differing, changed);
            pos[axis] = _mm512_mask_mov_ps(pos[axis], crossed, next);
        }
        t_min = _mm512_mask_mov_ps(t_min, advance, tc_max);
        idx = _mm512_xor_si512(idx, step);
        let mut pop = advance & _mm512_test_epi32_mask(idx, step);
        if pop == 0 {
            continue;
        }
        let new_scale = _mm512_sub_epi32(_mm512_set1_epi32(31), _mm512_lzcnt_epi32(differing));
        // A shift by 32 or more gives zero, and no frame of scale 23 or more is ever written.
        let written = _mm512_test_epi32_mask(pushed, _mm512_sllv_epi32(one, new_scale));
        let out = pop & !written;
        hit_iterations = _mm512_mask_mov_epi32(hit_iterations, out, now);
        active &= !out;
        pop &= !out;
        scale = _mm512_mask_mov_epi32(scale, pop, new_scale);
        size = _mm512_mask_mov_ps(size, pop, exp2_of_scale(scale));
        // SAFETY: the lanes that are read have a frame of this scale that was written.
        (parent, t_max) = unsafe { stack.read(pop, scale, parent, t_max) };
        low = _mm512_mask_mov_epi32(low, pop, gather_low(pop, parent));
        high = _mm512_mask_mov_epi32(high, pop, gather_high(pop, parent));
        idx = _mm512_mask_mov_epi32(idx, pop, zero);
        for axis in 0..3 {
            let path = _mm512_srlv_epi32(_mm512_castps_si512(pos[axis]), scale);
            let rounded = _mm512_castsi512_ps(_mm512_sllv_epi32(path, scale));
            pos[axis] = _mm512_mask_mov_ps(pos[axis], pop, rounded);
            let upper = pop & _mm512_test_epi32_mask(path, one);
            idx = _mm512_mask_or_epi32(idx, upper, idx, _mm512_set1_epi32(1 << axis));
        }
        h = _mm512_mask_mov_ps(h, pop, _mm512_setzero_ps());
    }
    // Lanes that are still active ran out of iterations.
    hit_iterations = _mm512_mask_mov_epi32(hit_iterations, active, _mm512_set1_epi32(MAX_ITERATIONS as i32));

    let mut found = Found::new();
    // SAFETY: each array is sixteen elements of four bytes; the stores have no alignment requirement.
    unsafe {
        _mm512_storeu_ps(found.t.as_mut_ptr(), hit_t);
        _mm512_storeu_si512(found.slot.as_mut_ptr().cast(), hit_slot);
        _mm512_storeu_si512(found.voxel.as_mut_ptr().cast(), hit_voxel);
        _mm512_storeu_si512(found.iterations.as_mut_ptr().cast(), hit_iterations);
    }
    found
}
