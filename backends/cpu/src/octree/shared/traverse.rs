//! The traversal of a packet: scalar control, one stack, and vectors of one float for each ray.

use esvo_core::reference::{EPSILON, MAX_SCALE};
use esvo_format::ChildDescriptor;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};

use super::super::scene::Scene;
use super::super::tiles::{Found, LANES};
use super::fault;

/// One float for each ray of a packet.
pub(super) type Floats<S> = f32x16<S>;

/// A bit for each ray of a packet.
pub(super) type Lanes = u32;

/// A bit for each ray.
pub(super) const ALL: Lanes = (1 << LANES) - 1;

/// Frames of a stack: one for each scale, rounded up to a power of two.
const FRAMES: usize = 32;

/// Finest scale of voxels at which a packet enters a node. Rays of coarser octrees take fewer steps than the reference's
/// [`MAX_ITERATIONS`](esvo_core::reference::MAX_ITERATIONS): on each level above, they meet at most three times as many
/// cubes as lie along an edge of the root, less than 2^20 in all.
const FINEST_SCALE: u32 = MAX_SCALE - 17;

/// The finest scale of voxels whose planes a ray from `origin` meets one after the other: the assumption of the proof. `None`
/// if there is no such scale, or if `origin` is not finite.
///
/// For `h` the edge of the voxels, `c` the absolute value of a coefficient and `r` the distance of the origin from 1.5 on an
/// axis, two planes that are `h` apart are met `h c` apart. Each of the two `t` is off by less than 2^-23 `c` from rounding
/// the product, which is at most `2 c`, and by less than 2^-24 `c (r + 1)` from rounding the difference. So `t` differ
/// if 2^23 `h > r + 3`, and 2^23 `h` is 2^scale.
pub(super) fn finest_scale(origin: [f32; 3]) -> Option<u32> {
    let apart = |scale: u32| origin.iter().all(|x| (x - 1.5).abs() + 3.0 < (1u32 << scale) as f32);
    (FINEST_SCALE..MAX_SCALE - 1).find(|scale| apart(*scale))
}

/// Sixteen rays from one point, in the space that is mirrored for each of them so that it runs against every axis.
pub(super) struct Packet<S: Simd> {
    /// As given, but for components that are too close to zero.
    pub(super) direction: [Floats<S>; 3],
    /// Ray `i` crosses the plane at `x` at `t = x * coef[i] - bias[i]`.
    pub(super) coef: [Floats<S>; 3],
    pub(super) bias: [Floats<S>; 3],
    /// The rays whose axis is mirrored.
    pub(super) mirrored: [Lanes; 3],
    pub(super) t_min: f32,
    pub(super) t_max: f32,
    /// The children whose contours are clipped against: all or none.
    pub(super) contours: u8,
    /// At `t`, voxels whose edge is at most `t * size_per_t` end a ray.
    pub(super) size_per_t: f32,
    /// See [`finest_scale`].
    pub(super) finest_scale: u32,
}

impl<S: Simd> Packet<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, origin: [f32; 3], direction: [Floats<S>; 3], finest_scale: u32) -> Self {
        let zero = Floats::splat(simd, 0.0);
        let mut packet = Self {
            direction,
            coef: [zero; 3],
            bias: [zero; 3],
            mirrored: [0; 3],
            t_min: 0.0,
            t_max: 1.0,
            contours: 0,
            size_per_t: 0.0,
            finest_scale,
        };
        for axis in 0..3 {
            let d = away_from_zero(simd, direction[axis]);
            let coef = Floats::splat(simd, 1.0) / -d.abs();
            let bias = coef * origin[axis];
            let positive = d.simd_gt(zero);
            packet.direction[axis] = d;
            packet.coef[axis] = coef;
            packet.bias[axis] = positive.select(coef * 3.0 - bias, bias);
            packet.mirrored[axis] = bits(positive);
        }
        packet
    }

    /// Where the rays cross the planes through a point.
    #[inline(always)]
    fn planes(&self, at: [f32; 3]) -> [Floats<S>; 3] {
        axes(
            #[inline(always)]
            |axis| self.coef[axis] * at[axis] - self.bias[axis],
        )
    }
}

/// A node on the way from the root, and the rays in it.
#[derive(Clone, Copy)]
struct Frame<S: Simd> {
    /// Where the rays cross the planes at the lower corner (0 to 2) and through the centre (3 to 5), and where they start in
    /// the node (6).
    t: [Floats<S>; 7],
    /// Where the rays end in the node.
    t_max: Floats<S>,
    /// Lower corner.
    pos: [f32; 3],
    slot: u32,
    descriptor: ChildDescriptor,
    /// Slot of the first child's descriptor.
    first: u32,
    /// The children that were not visited, in mirrored space.
    todo: u32,
    lanes: Lanes,
}

const START: usize = 6;

/// The children that are the upper half on an axis.
const UPPER: [u32; 3] = [0xaa, 0xcc, 0xf0];

/// The frames of a packet; what they hold has no meaning between packets.
pub(super) struct Stack<S: Simd>([Frame<S>; FRAMES]);

impl<S: Simd> Stack<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let zero = Floats::splat(simd, 0.0);
        let frame = Frame {
            t: [zero; 7],
            t_max: zero,
            pos: [0.0; 3],
            slot: 0,
            descriptor: ChildDescriptor(0),
            first: 0,
            todo: 0,
            lanes: 0,
        };
        Self([frame; FRAMES])
    }
}

/// `[mirror][mask]`: the bits of a mask of children in the order of mirrored space.
static MIRRORED: [[u8; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut mirror = 0;
    while mirror < 8 {
        let mut mask = 0;
        while mask < 256 {
            let mut child = 0;
            while child < 8 {
                table[mirror][mask] |= ((mask >> (child ^ mirror) & 1) << child) as u8;
                child += 1;
            }
            mask += 1;
        }
        mirror += 1;
    }
    table
};

/// `f` of every axis. Not [`array::map`], which is not compiled for the instructions of the caller.
#[inline(always)]
pub(super) fn axes<T>(f: impl Fn(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

/// The lanes of a mask as bits.
#[inline(always)]
pub(super) fn bits<S: Simd>(mask: mask32x16<S>) -> Lanes {
    // By halves: one vector has no instruction for it with AVX2.
    let (low, high) = mask.token().split_mask32x16(mask);
    low.to_bitmask() as Lanes | (high.to_bitmask() as Lanes) << 8
}

/// Replaces numbers nearer to zero than [`EPSILON`] by it, keeping the sign.
#[inline(always)]
fn away_from_zero<S: Simd>(simd: S, x: Floats<S>) -> Floats<S> {
    x.abs().simd_lt(Floats::splat(simd, EPSILON)).select(Floats::splat(simd, EPSILON).copysign(x), x)
}

/// Sets the lanes of a mask.
#[inline(always)]
fn set<S: Simd>(mask: mask32x16<S>, to: &mut [u32; LANES], value: u32) {
    let simd = mask.token();
    let old = u32x16::from_slice(simd, &to[..]);
    mask.select(u32x16::splat(simd, value), old).store_slice(&mut to[..]);
}

/// What the rays of a packet have hit so far.
pub(super) struct Results<S: Simd> {
    simd: S,
    pub(super) found: Found,
    /// Rays that hit nothing yet.
    alive: Lanes,
    /// Rays that rounding may lead elsewhere: to be cast one by one.
    pub(super) again: Lanes,
    iterations: u32,
}

impl<S: Simd> Results<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, lanes: Lanes) -> Self {
        Self { simd, found: Found::missed(), alive: lanes, again: 0, iterations: 0 }
    }

    /// Rays end in a voxel.
    #[inline(always)]
    fn hit(&mut self, lanes: Lanes, t: Floats<S>, slot: u32, voxel: u32) {
        let simd = self.simd;
        let mask = mask32x16::from_bitmask(simd, u64::from(lanes));
        let old = Floats::from_slice(simd, &self.found.t[..]);
        mask.select(t, old).store_slice(&mut self.found.t[..]);
        set(mask, &mut self.found.slot, slot);
        set(mask, &mut self.found.voxel, voxel);
        set(mask, &mut self.found.iterations, self.iterations);
        self.alive &= !lanes;
    }

    /// Rays are to be cast one by one.
    #[inline(always)]
    fn give_up(&mut self, lanes: Lanes) {
        self.again |= lanes;
        self.alive &= !lanes;
    }
}

/// Slot of the first child's descriptor, and the children in mirrored space.
#[inline(always)]
fn open(slots: &[u64], order: &[u8; 256], slot: u32, descriptor: ChildDescriptor) -> (u32, u32) {
    let mut first = slot + descriptor.child_ptr();
    if descriptor.far() {
        first = slot.wrapping_add(slots[first as usize] as u32);
    }
    (first, u32::from(order[descriptor.valid_mask() as usize]))
}

/// Casts those rays of a packet that are mirrored as `mirror` says.
///
/// One function for views with and without contours and small voxels: constants for each of the four took four times as long
/// to compile.
#[inline(always)]
pub(super) fn traverse<S: Simd>(
    simd: S,
    scene: &Scene,
    packet: &Packet<S>,
    mirror: usize,
    lanes: Lanes,
    stack: &mut Stack<S>,
    results: &mut Results<S>,
) {
    let (slots, words) = (scene.slots(), scene.words());
    let order = &MIRRORED[mirror & 7];
    {
        let (upper, centre, lower) = (packet.planes([2.0; 3]), packet.planes([1.5; 3]), packet.planes([1.0; 3]));
        let start = upper[0].max(upper[1]).max(upper[2]).max(Floats::splat(simd, packet.t_min));
        let exit = lower[0].min(lower[1]).min(lower[2]);
        let t_max = exit.min(Floats::splat(simd, packet.t_max));
        let lanes = lanes & bits(start.simd_le(t_max));
        results.give_up(lanes & !bits(start.simd_lt(exit)));
        let slot = scene.root();
        let descriptor = ChildDescriptor(slots[slot as usize]);
        let (first, todo) = open(slots, order, slot, descriptor);
        stack.0[0] = Frame {
            t: [lower[0], lower[1], lower[2], centre[0], centre[1], centre[2], start],
            t_max,
            pos: [1.0; 3],
            slot,
            descriptor,
            first,
            todo,
            lanes,
        };
    }
    // Edge and scale of the children of the node.
    let mut size = 0.5f32;
    let mut scale = MAX_SCALE - 1;
    let mut depth = 0usize;
    loop {
        let frame = &mut stack.0[depth % FRAMES];
        let lanes = frame.lanes & results.alive;
        if frame.todo == 0 || lanes == 0 {
            if depth == 0 {
                return;
            }
            depth -= 1;
            scale += 1;
            size *= 2.0;
            continue;
        }
        results.iterations += 1;
        // Upper halves come first.
        let idx = 31 - frame.todo.leading_zeros();
        frame.todo ^= 1 << idx;
        let half = axes(
            #[inline(always)]
            |axis: usize| (idx >> axis & 1) as usize,
        );
        let corner = axes(
            #[inline(always)]
            |axis: usize| frame.t[axis + 3 * half[axis]],
        );
        let entered = axes(
            #[inline(always)]
            |axis: usize| frame.t[if half[axis] == 0 { axis + 3 } else { START }],
        );
        let exit = corner[0].min(corner[1]).min(corner[2]);
        let entry = entered[0].max(entered[1]).max(entered[2]).max(frame.t[START]);
        let meets = if fault::made(fault::TIES) { entry.simd_le(exit) } else { entry.simd_lt(exit) };
        let mut live = lanes & bits(meets & entry.simd_le(frame.t_max));
        if live == 0 {
            continue;
        }
        let child = idx as usize ^ mirror;
        let (slot, descriptor) = (frame.slot, frame.descriptor);
        let voxel = child as u32 | scale << 8;
        let small = live & bits((exit * packet.size_per_t).simd_ge(Floats::splat(simd, size)));
        if small != 0 {
            results.hit(small, entry, slot, voxel);
            live &= !small;
            if live == 0 {
                continue;
            }
        }
        let half_size = size * 0.5;
        // The product is exact, so that a fused operation gives the same.
        let centre = axes(
            #[inline(always)]
            |axis: usize| packet.coef[axis].mul_add(Floats::splat(simd, half_size), corner[axis]),
        );
        let mut t_min = entry;
        let mut t_max = frame.t_max.min(exit);
        if descriptor.contour_mask() & packet.contours & 1 << child != 0 {
            let at = 2 * slot + descriptor.contour_ptr() + descriptor.contour_rank(child as u8);
            let word = words[at as usize];
            let field = |shift: u32| (word << shift) as i32 as f32;
            let a = packet.direction[0] * field(14);
            let b = packet.direction[1] * field(20);
            let c = packet.direction[2] * field(26);
            let inverse = Floats::splat(simd, 1.0) / away_from_zero(simd, a + b + c);
            let middle = (centre[0] * a + centre[1] * b + centre[2] * c + field(7) * size * 1.5) * inverse;
            let reach = (inverse * (word as f32 * size * 0.75)).abs();
            t_min = t_min.max(middle - reach);
            t_max = t_max.min(middle + reach);
            live &= bits(t_min.simd_le(t_max));
            if live == 0 {
                continue;
            }
        }
        if descriptor.leaf_mask() >> child & 1 != 0 {
            results.hit(live, t_min, slot, voxel);
            continue;
        }

        // The child's own node.
        let pos = axes(
            #[inline(always)]
            |axis: usize| frame.pos[axis] + if half[axis] != 0 { size } else { 0.0 },
        );
        let planes = packet.planes(axes(
            #[inline(always)]
            |axis: usize| pos[axis] + half_size,
        ));
        // Rays that the reference may send elsewhere: see the proof.
        let above = axes(
            #[inline(always)]
            |axis: usize| planes[axis].simd_gt(t_min),
        );
        let differ = axes(
            #[inline(always)]
            |axis: usize| centre[axis].simd_gt(t_min) ^ above[axis],
        );
        let strange = differ[0] | differ[1] | differ[2] | t_min.simd_ge(exit);
        let mut strange = if fault::made(fault::NO_CHECK) { 0 } else { live & bits(strange) };
        if scale <= packet.finest_scale {
            strange = live;
        }
        if strange != 0 {
            results.give_up(strange);
            live &= !strange;
            if live == 0 {
                continue;
            }
        }
        // Halves that no ray visits: the upper one, if all cross the middle plane before they start, and the lower one, if all end
        // before they cross it.
        let mut halves = 0xff;
        for axis in 0..3 {
            let upper = live & bits(above[axis]) != 0;
            let lower = live & bits(planes[axis].simd_le(t_max)) != 0;
            halves &= if upper { UPPER[axis] } else { 0 } | if lower { !UPPER[axis] } else { 0 };
        }
        let slot = frame.first + descriptor.child_rank(child as u8);
        let descriptor = ChildDescriptor(slots[slot as usize]);
        let (first, todo) = open(slots, order, slot, descriptor);
        let todo = todo & halves;
        depth += 1;
        scale -= 1;
        size = half_size;
        stack.0[depth % FRAMES] = Frame {
            t: [corner[0], corner[1], corner[2], planes[0], planes[1], planes[2], t_min],
            t_max,
            pos,
            slot,
            descriptor,
            first,
            todo,
            lanes: live,
        };
    }
}
