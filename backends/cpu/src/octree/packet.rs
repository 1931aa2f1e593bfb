//! Sixteen rays in lockstep with AVX-512: the reference's operations, lane by lane.
//!
//! Every lane has its own voxel, span and stack; what a lane does not take part in is masked out. Each lane computes
//! exactly what the reference computes for its ray, in the same order and without fused operations, so hits are equal
//! bit for bit. A packet ends when its last lane does; 4 x 4 pixels keep lanes together.

#![cfg(target_arch = "x86_64")]

use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use esvo_core::reference::{EPSILON, MAX_COMPONENT, MAX_ITERATIONS, MAX_SCALE};
use esvo_core::{Fan, Fans, Hit, View};

use super::single::Scene;

/// Rays per packet.
pub const LANES: usize = 16;
/// Edge of the block of pixels that a packet takes.
const BLOCK: usize = 4;

/// Directions and spans of sixteen rays from one origin.
struct Packet {
    origin: [f32; 3],
    direction: [[f32; LANES]; 3],
    t_min: [f32; LANES],
    t_max: f32,
    size_per_t: f32,
    active: u16,
}

/// Results of a packet, a lane each.
struct Hits {
    t: [f32; LANES],
    slot: [u32; LANES],
    voxel: [u32; LANES],
    iterations: [u32; LANES],
}

impl Hits {
    fn get(&self, lane: usize) -> Hit {
        Hit { t: self.t[lane], slot: self.slot[lane], voxel: self.voxel[lane], iterations: self.iterations[lane] }
    }
}

/// Whether the processor has what [`band`] and [`coarse_row`] need, and the image can be addressed with signed 32-bit
/// indices of words.
pub fn can_cast(scene: &Scene) -> bool {
    is_available() && scene.words().len() <= i32::MAX as usize
}

/// Whether the processor has what this module needs.
pub fn is_available() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512cd")
        && is_x86_feature_detected!("avx512vpopcntdq")
}

/// Casts the pixels of the rows from `first_row` on that `hits` has room for.
///
/// # Safety
/// [`can_cast`] must have said so, and the octree must be sound.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn band(scene: &Scene, view: &View, coarse: &[f32], first_row: u32, hits: &mut [Hit]) {
    match (view.contours(), view.max_voxel_pixels > 0.0) {
        (true, true) => band_with::<true, true>(scene, view, coarse, first_row, hits),
        (true, false) => band_with::<true, false>(scene, view, coarse, first_row, hits),
        (false, true) => band_with::<false, true>(scene, view, coarse, first_row, hits),
        (false, false) => band_with::<false, false>(scene, view, coarse, first_row, hits),
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
fn band_with<const CONTOURS: bool, const LOD: bool>(
    scene: &Scene,
    view: &View,
    coarse: &[f32],
    first_row: u32,
    hits: &mut [Hit],
) {
    let width = view.width as usize;
    let height = hits.len() / width;
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let mut packet = Packet {
                origin: view.origin,
                direction: [[0.0; LANES]; 3],
                t_min: [view.t_near; LANES],
                t_max: 1.0,
                size_per_t: view.pixel_size * view.max_voxel_pixels,
                active: 0,
            };
            // Blocks of pixels and of the beam are the same: one start value serves all.
            if view.beam() {
                packet.t_min = [view.beam_start(coarse, left as u32, first_row + top as u32); LANES];
            }
            for lane in 0..LANES {
                let (x, y) = (left + lane % BLOCK, top + lane / BLOCK);
                if x < width && y < height {
                    packet.active |= 1 << lane;
                }
                let direction = view.direction(x as f32 + 0.5, (first_row as usize + y) as f32 + 0.5);
                for axis in 0..3 {
                    packet.direction[axis][lane] = direction[axis];
                }
            }
            let found = cast::<CONTOURS, LOD>(scene, &packet);
            for lane in (0..LANES).filter(|lane| packet.active >> lane & 1 != 0) {
                hits[(top + lane / BLOCK) * width + left + lane % BLOCK] = found.get(lane);
            }
        }
    }
}

/// Casts the rays of some of the fans.
///
/// # Safety
/// As for [`band`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn fans(scene: &Scene, all: &Fans, some: &[Fan], hits: &mut [Hit]) {
    for (fan, hits) in some.iter().zip(hits.chunks_exact_mut(all.directions.len())) {
        for (directions, hits) in all.directions.chunks(LANES).zip(hits.chunks_mut(LANES)) {
            let mut packet = Packet {
                origin: fan.origin.into(),
                direction: [[0.0; LANES]; 3],
                t_min: [0.0; LANES],
                t_max: 1.0,
                size_per_t: 0.0,
                active: ((1u32 << hits.len()) - 1) as u16,
            };
            for (lane, direction) in directions.iter().enumerate() {
                let ray = Fans::ray(fan, *direction);
                for axis in 0..3 {
                    packet.direction[axis][lane] = ray.direction[axis];
                }
            }
            let found =
                if all.contours { cast::<true, false>(scene, &packet) } else { cast::<false, false>(scene, &packet) };
            for (lane, hit) in hits.iter_mut().enumerate() {
                *hit = found.get(lane);
            }
        }
    }
}

/// Row `j` of the coarse pass.
///
/// # Safety
/// As for [`band`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512cd,avx512vpopcntdq,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn coarse_row(scene: &Scene, view: &View, j: u32, row: &mut [f32]) {
    for (k, values) in row.chunks_mut(LANES).enumerate() {
        let first = view.coarse_ray((k * LANES) as u32, j);
        let mut packet = Packet {
            origin: view.origin,
            direction: [[0.0; LANES]; 3],
            t_min: [first.t_min; LANES],
            t_max: first.t_max,
            size_per_t: first.size_per_t,
            active: ((1u32 << values.len()) - 1) as u16,
        };
        for lane in 0..LANES {
            let direction = view.coarse_ray((k * LANES + lane) as u32, j).direction;
            for axis in 0..3 {
                packet.direction[axis][lane] = direction[axis];
            }
        }
        let found = cast::<false, true>(scene, &packet);
        for (lane, value) in values.iter_mut().enumerate() {
            let hit = found.get(lane);
            *value = if hit.is_miss() { 1.0 } else { view.coarse_start(hit.t, hit.size()) };
        }
    }
}

/// Loads sixteen floats.
#[inline]
#[target_feature(enable = "avx512f")]
fn load(values: &[f32; LANES]) -> __m512 {
    // SAFETY: the array is sixteen floats long; the load has no alignment requirement.
    unsafe { _mm512_loadu_ps(values.as_ptr()) }
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
fn cast<const CONTOURS: bool, const LOD: bool>(scene: &Scene, packet: &Packet) -> Hits {
    // Gathers: `slots` in units of 8 bytes, `words` of 4. Indices are signed; `can_cast` has seen to their range.
    let slots_low = scene.words().as_ptr().cast::<i32>();
    let slots_high = slots_low.wrapping_add(1);
    let zero = _mm512_setzero_si512();
    let one = _mm512_set1_epi32(1);
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    // SAFETY: (of both gathers) an index is the slot of a descriptor or of a far pointer that a sound octree's pointers
    // lead to, in the image; lanes that are masked out are not read.
    let gather_low = |mask: __mmask16, index: __m512i| unsafe {
        _mm512_mask_i32gather_epi32::<8>(_mm512_setzero_si512(), mask, index, slots_low)
    };
    // SAFETY: as above; the high word lies in the same slot.
    let gather_high = |mask: __mmask16, index: __m512i| unsafe {
        _mm512_mask_i32gather_epi32::<8>(_mm512_setzero_si512(), mask, index, slots_high)
    };

    // Rays that are not finite miss without a step.
    let raw: [__m512; 3] = [load(&packet.direction[0]), load(&packet.direction[1]), load(&packet.direction[2])];
    let limit = _mm512_set1_ps(MAX_COMPONENT);
    let mut active = packet.active;
    for component in raw {
        active &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_abs_ps(component), limit);
    }
    if packet.origin.iter().any(|c| !c.is_finite()) {
        active = 0;
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
        let b = _mm512_mul_ps(coef[axis], _mm512_set1_ps(packet.origin[axis]));
        let positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(d, _mm512_setzero_ps());
        let mirrored = _mm512_sub_ps(_mm512_mul_ps(_mm512_set1_ps(3.0), coef[axis]), b);
        bias[axis] = _mm512_mask_mov_ps(b, positive, mirrored);
        mirror = _mm512_mask_or_epi32(mirror, positive, mirror, _mm512_set1_epi32(1 << axis));
    }
    let (spt, root) = (_mm512_set1_ps(packet.size_per_t), _mm512_set1_epi32(scene.root() as i32));
    let t_at = |axis: usize, x: __m512| _mm512_sub_ps(_mm512_mul_ps(x, coef[axis]), bias[axis]);
    let t_all = |x: f32| [0, 1, 2].map(|axis| t_at(axis, _mm512_set1_ps(x)));
    let [x, y, z] = t_all(2.0);
    let mut t_min = _mm512_max_ps(_mm512_max_ps(x, y), z);
    let [x, y, z] = t_all(1.0);
    let mut t_max = _mm512_min_ps(_mm512_min_ps(x, y), z);
    let mut h = t_max;
    t_min = _mm512_max_ps(t_min, load(&packet.t_min));
    t_max = _mm512_min_ps(t_max, _mm512_set1_ps(packet.t_max));

    let mut parent = root;
    let mut low = gather_low(u16::MAX, parent);
    let mut high = gather_high(u16::MAX, parent);
    // Frames are read only where they have been written, so the stacks start without contents.
    let mut stack_parent = [[MaybeUninit::<i32>::uninit(); LANES]; MAX_SCALE as usize + 1];
    let mut stack_t_max = [[MaybeUninit::<f32>::uninit(); LANES]; MAX_SCALE as usize + 1];
    let stack_parent = stack_parent.as_mut_ptr().cast::<i32>();
    let stack_t_max = stack_t_max.as_mut_ptr().cast::<f32>();
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
                let footprint = _mm512_add_ps(_mm512_mul_ps(tc_max, spt), _mm512_setzero_ps());
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
                    let word = unsafe { _mm512_mask_i32gather_epi32::<4>(zero, has, at, slots_low) };
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
                let frame = _mm512_add_epi32(_mm512_slli_epi32::<4>(scale), lanes);
                // SAFETY: a scale is below 24 and a lane below 16, so a frame lies in both stacks.
                unsafe {
                    _mm512_mask_i32scatter_epi32::<4>(stack_parent, store, frame, parent);
                    _mm512_mask_i32scatter_ps::<4>(stack_t_max, store, frame, t_max);
                }
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
        let frame = _mm512_add_epi32(_mm512_slli_epi32::<4>(scale), lanes);
        // SAFETY: the lanes that are read have a frame that was written, in both stacks.
        unsafe {
            parent = _mm512_mask_i32gather_epi32::<4>(parent, pop, frame, stack_parent);
            t_max = _mm512_mask_i32gather_ps::<4>(t_max, pop, frame, stack_t_max);
        }
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

    let mut hits = Hits { t: [0.0; LANES], slot: [0; LANES], voxel: [0; LANES], iterations: [0; LANES] };
    // SAFETY: each array is sixteen elements of four bytes; the stores have no alignment requirement.
    unsafe {
        _mm512_storeu_ps(hits.t.as_mut_ptr(), hit_t);
        _mm512_storeu_si512(hits.slot.as_mut_ptr().cast(), hit_slot);
        _mm512_storeu_si512(hits.voxel.as_mut_ptr().cast(), hit_voxel);
        _mm512_storeu_si512(hits.iterations.as_mut_ptr().cast(), hit_iterations);
    }
    hits
}
