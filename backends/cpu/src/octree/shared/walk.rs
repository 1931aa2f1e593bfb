//! The walk of one packet: scalar control, one stack, and vectors of one float for each ray.

use fearless_simd::prelude::*;

use super::super::counters::{What, count, count_alive};
use super::super::scene::Scene;
use super::fault;
use super::packet::{ALL, Floats, Lanes, Packet, Results, axes, bits};
use super::voxel::{Meeting, Node, Place, Tree, visit};

/// Frames of a stack: one for each scale, rounded up to a power of two.
pub(super) const FRAMES: usize = 32;

/// A node on the way from the root, and the rays in it.
#[derive(Clone, Copy)]
pub(super) struct Frame<S: Simd> {
    pub(super) node: Node,
    /// Where the rays cross the planes at the lower corner (0 to 2) and through the centre (3 to 5), and where they start in
    /// the node (6).
    pub(super) t: [Floats<S>; 7],
    /// Where the rays end in the node.
    pub(super) t_max: Floats<S>,
    pub(super) lanes: Lanes,
}

/// Of [`Frame::t`].
pub(super) const START: usize = 6;

/// The children that are the upper half on an axis.
const UPPER: [u32; 3] = [0xaa, 0xcc, 0xf0];

/// The frames of a packet; what they hold has no meaning between packets.
pub(super) struct Stack<S: Simd>(pub(super) [Frame<S>; FRAMES]);

impl<S: Simd> Stack<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let zero = Floats::splat(simd, 0.0);
        Self([Frame { node: Node::NONE, t: [zero; 7], t_max: zero, lanes: 0 }; FRAMES])
    }
}

/// The rays of a packet in the root.
pub(super) struct Entrance<S: Simd> {
    pub(super) lower: [Floats<S>; 3],
    pub(super) start: Floats<S>,
    pub(super) t_max: Floats<S>,
    pub(super) lanes: Lanes,
}

/// Those of the rays that meet the root. Rays that rounding may lead elsewhere are given up.
#[inline(always)]
pub(super) fn enter<S: Simd>(
    packet: &Packet<S>,
    span: [Floats<S>; 2],
    lanes: Lanes,
    results: &mut Results<S>,
) -> Entrance<S> {
    let (upper, lower) = (packet.planes([2.0; 3]), packet.planes([1.0; 3]));
    let start = upper[0].max(upper[1]).max(upper[2]).max(span[0]);
    let exit = lower[0].min(lower[1]).min(lower[2]);
    let t_max = exit.min(span[1]);
    let lanes = lanes & bits(start.simd_le(t_max));
    let strange = lanes & !bits(start.simd_lt(exit));
    results.give_up(strange);
    Entrance { lower, start, t_max, lanes: lanes & !strange }
}

/// Casts rays of a packet, octant by octant. A function of its own: pictures and the coarse pass share what is compiled.
#[inline(never)]
pub(super) fn cast_alone<S: Simd>(
    simd: S,
    scene: &Scene,
    packet: &Packet<S>,
    span: [Floats<S>; 2],
    mut lanes: Lanes,
    stack: &mut Stack<S>,
    results: &mut Results<S>,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            while lanes != 0 {
                let mirror = packet.octant_of(lanes.trailing_zeros());
                let same = lanes & if fault::made(fault::WRONG_OCTANT) { ALL } else { packet.octant(mirror) };
                lanes &= !same;
                traverse(simd, &Tree::new(scene, mirror), packet, span, same, stack, results);
            }
        },
    );
}

/// Casts rays through the node of the first frame: [`walk`] as a function of its own.
#[inline(never)]
pub(super) fn walk_alone<S: Simd>(
    simd: S,
    tree: &Tree,
    packet: &Packet<S>,
    place: Place,
    stack: &mut Stack<S>,
    results: &mut Results<S>,
) {
    simd.vectorize(
        #[inline(always)]
        || walk(simd, tree, packet, place, stack, results),
    );
}

/// Casts those rays of a packet that are mirrored as `tree` says.
#[inline(always)]
fn traverse<S: Simd>(
    simd: S,
    tree: &Tree,
    packet: &Packet<S>,
    span: [Floats<S>; 2],
    lanes: Lanes,
    stack: &mut Stack<S>,
    results: &mut Results<S>,
) {
    let Entrance { lower, start, t_max, lanes } = enter(packet, span, lanes, results);
    let centre = packet.planes([1.5; 3]);
    let t = [lower[0], lower[1], lower[2], centre[0], centre[1], centre[2], start];
    stack.0[0] = Frame { node: tree.node(tree.root, [1.0; 3]), t, t_max, lanes };
    walk(simd, tree, packet, Place::ROOT, stack, results);
}

/// Casts the rays of the first frame through its node, whose depth is 0.
///
/// One function for views with and without contours and small voxels: constants for each of the four took four times as long
/// to compile.
#[inline(always)]
fn walk<S: Simd>(
    simd: S,
    tree: &Tree,
    packet: &Packet<S>,
    mut place: Place,
    stack: &mut Stack<S>,
    results: &mut Results<S>,
) {
    loop {
        let Place { depth, size, scale } = place;
        let frame = &mut stack.0[depth % FRAMES];
        let lanes = frame.lanes & results.alive;
        if frame.node.todo == 0 || lanes == 0 {
            if !place.up() {
                return;
            }
            continue;
        }
        results.iterations += 1;
        count(What::Visits, 1);
        count_alive(scale, lanes.count_ones());
        let child = frame.node.next(tree.mirror);
        let corner = axes(
            #[inline(always)]
            |axis: usize| frame.t[axis + 3 * child.half[axis]],
        );
        let entered = axes(
            #[inline(always)]
            |axis: usize| frame.t[if child.half[axis] == 0 { axis + 3 } else { START }],
        );
        let exit = corner[0].min(corner[1]).min(corner[2]);
        let entry = entered[0].max(entered[1]).max(entered[2]).max(frame.t[START]);
        let meets = if fault::made(fault::TIES) { entry.simd_le(exit) } else { entry.simd_lt(exit) };
        let lanes = lanes & bits(meets & entry.simd_le(frame.t_max));
        if lanes == 0 {
            continue;
        }
        let meeting = Meeting { corner, entry, exit, t_max: frame.t_max, lanes };
        let inside = visit(simd, tree, packet, (&frame.node, &child), place, meeting, results);
        let (mut live, t_min, t_max) = (inside.lanes, inside.t_min, inside.t_max);
        if live == 0 {
            continue;
        }

        // The child's own node.
        let half_size = size * 0.5;
        let pos = frame.node.corner_of(&child, size);
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
            |axis: usize| inside.centre[axis].simd_gt(t_min) ^ above[axis],
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
        let mut node = tree.node(frame.node.slot_of(&child), pos);
        node.todo &= halves;
        count(What::Pushes, 1);
        results.pushes += 1;
        results.rays_pushed += live.count_ones();
        place.down();
        let t = [corner[0], corner[1], corner[2], planes[0], planes[1], planes[2], t_min];
        stack.0[place.depth % FRAMES] = Frame { node, t, t_max, lanes: live };
    }
}
