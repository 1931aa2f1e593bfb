//! Tiles of 16 x 16 pixels: sixteen packets go through the upper nodes of the tree together.
//!
//! A tile walks like a packet, with a lane for each of its blocks of 4 x 4 pixels. What a lane holds are bounds: the earliest
//! and the latest `t` at which a ray of the block crosses a plane or a slab. A node is entered without a look at its rays while more
//! than [`FEW`] blocks meet it. Where fewer do, each of them walks on alone, from that voxel. Leaves, and voxels that
//! may end some rays by their size, are looked at block by block.
//!
//! # Why hits are the reference's
//!
//! This continues the proof of the parent module, with its names. A voxel `D` at which a block is looked at is the end of a
//! chain of nodes `N_0` (the root), `N_1`, ..., `N_k = D` that the tile entered. `U_j` is the set of axes on which `N_{j+1}` is
//! the upper half of `N_j`, `m_a(j)` the `t` of `N_j`'s middle plane, `l_a` and `u_a` those of `D`'s lower and upper
//! planes, and `s_0` the start in the root. An `u_a` counts only if `a` is outside some `U_j`. The slabs of the contours
//! of `N_1` to `N_{k-1}` begin at `c_j` and end at `e_j`. For a ray,
//!
//!  - `s` is the greatest of `s_0`, the `u_a` and the `c_j`: where a packet would enter `D`;
//!  - `x` is the least `l_a`: where it leaves `D`;
//!  - `d` is the *doubt*: the reference computes `centre_a(j)` in another way than `m_a(j)`, and they differ by at most `d`.
//!
//! **The doubt.** With `h` the edge of `N_{j+1}` and `x` the plane's place, `m = fl(fl(x c) - b)` and
//! `centre = fl(h c + fl(fl((x - h) c) - b))`; `h c` is exact. Products are at most `2 |c|`, each rounding is at most 2^-24 of its
//! result, and `h` is at most 1/2: the difference is at most 2^-22 `|c|` + 2^-24 (3 `|t|` + `|c|` / 2), that is 2.68e-7 `|c|`
//! + 1.79e-7 `|t|`. Where it matters, `t` is next to a number in the ray's span. [`DOUBT`] is above both.
//!
//! **What is looked for.** A ray is cast again alone if `s <= x + 4 d`, and `x <= s + d` or the second greatest of
//! `{max(s_0, c_j), u_a}` is at least `s - d`. All others are in one of two cases.
//!
//! **1. `s + d < x`, and the others are below `s - d`: the reference comes to `D` and enters it at `s`**, unless it ends
//! before. Let `r_j` be its `t_min` in `N_j`.
//!  - `r_j <= s_j`, the greatest of `s_0` and the `c_i` and `m_a(i)` for `i < j` and `a` outside `U_i`: by
//!    induction, as `t_min` becomes one of these numbers or stays.
//!  - For `a` in `U_j`, `m_a(j) >= l_a >= x > s + d >= r_j + d`, so that `centre_a > r_j`: the reference begins in a child
//!    that is the upper half on the axes of `U_j`, and perhaps on others.
//!  - The others are crossed before: their `m_a(j) <= u_a <= s < x`, and `x` is at most each `m_b(j)` of `b` in `U_j` and each lower
//!    plane of `N_j`. So it comes to `N_{j+1}`. It looks inside: `t_min <= t_max`, as each `e_j` above is at least `s`,
//!    which is tested where the spans are put together.
//!  - Let `s = u_b`, set where `m_b(i) = u_b`. Every other number of `s_i` is below `u_b - d`: the `u_a` and `c_j` by what is
//!    looked for, and earlier planes of `b` since [`Bounds::least_size`] keeps planes of an axis further apart than `2 d`. So
//!    `centre_b > r_i`, the plane is crossed, last of those that are crossed in `N_i`, and `r_{i+1} = u_b`. Later planes `a` outside
//!    `U_j` have `m_a(j) < s - d`, `centre_a < s`: not crossed. If `s` is `s_0` or some `c_i`, the same holds from there on. So `r_k = s`.
//!
//! **2. `s > x + 4 d`: the reference does not look into `D`.** `r_j` is less than `s_j` only by planes whose `t` is within `d` of it:
//! each axis takes at most one of them, as above, so that `s - r_k <= 4 d`, and `r_k > x`. But when the reference comes to a child, its
//! `t_min` is at most `d` above the child's exit: `centre_a > r_k` for its upper halves, and `t_min` is the `t` of a plane
//! that was crossed before.
//!
//! So the reference looks into the same voxels `D` at the same `t`, in the order of the proof's step 3.
//!
//! **3. Bounds.** A tile overlooks no voxel for which `s <= x + 4 d`: [`Bounds::doubt`] is added to exits, and [`Bounds::slack`]
//! is more than the rounding of a plane's `t`: with `o` the origin, the operations on both sides round by at most 2^-24 `|c|` (22 + 7 `|o|`).
//!
//! **4. Slabs of nodes above.** `c_j` and `e_j` of a ray are computed, by the reference's operations, only where they may matter:
//! if the latest `c_j` of the block is at most the earliest entry into `D` less [`Bounds::doubt`], none is `s` or within `d` of it;
//! if the earliest `e_j` is above the latest end, none is the end. Once computed they serve all voxels below a node.

use fearless_simd::prelude::*;

use super::super::counters::{What, count, count_alive};
use super::super::scene::Scene;
use super::bounds::{Area, BLOCKS, Bounds, DOUBT};
use super::fault;
use super::packet::{ALL, Contour, Floats, Lanes, Packet, Results, axes, bits};
use super::voxel::{Meeting, Node, Place, Tree, visit};
use super::walk::{self, FRAMES, Stack, cast_alone, enter, walk_alone};

/// A voxel that at most this many blocks meet is entered by each of them alone.
const FEW: u32 = 4;

/// A block whose rays have a greater [`Bounds::doubt`] goes alone.
const MOST_DOUBT: f32 = 1e-4;

/// A block of pixels.
#[derive(Clone, Copy)]
pub(super) struct Block<S: Simd> {
    pub(super) packet: Packet<S>,
    pub(super) results: Results<S>,
    /// Rays of the octant that is under way, their start and their end in the root.
    lanes: Lanes,
    start: Floats<S>,
    end: Floats<S>,
    /// The reference may order two numbers differently if they are not further apart than this.
    doubt: Floats<S>,
}

/// Where the rays of a block meet a voxel.
struct Met<S: Simd> {
    corner: [Floats<S>; 3],
    /// Where the rays cross the upper planes; of the root's not.
    upper: [Floats<S>; 3],
    entry: Floats<S>,
    exit: Floats<S>,
    /// Where they end in the node.
    end: Floats<S>,
    lanes: Lanes,
}

impl<S: Simd> Block<S> {
    #[inline(always)]
    pub(super) fn new(packet: Packet<S>, results: Results<S>) -> Self {
        let coef = packet.coef;
        let most = coef[0].abs().max(coef[1].abs()).max(coef[2].abs());
        let doubt = (most + packet.t_min.abs().max(packet.t_max.abs())) * DOUBT;
        Self { packet, results, lanes: 0, start: most, end: most, doubt }
    }

    /// Where the rays whose span this is meet a voxel. Those that the reference may send elsewhere are given up.
    #[inline(always)]
    fn meet(&mut self, simd: S, pos: [f32; 3], size: f32, start: Floats<S>, end: Floats<S>) -> Met<S> {
        count(What::BlockTests, 1);
        let corner = self.packet.planes(pos);
        let upper = axes(
            #[inline(always)]
            |axis: usize| {
                let x = pos[axis] + size;
                if x < 2.0 { self.packet.plane(axis, x) } else { Floats::splat(simd, f32::MIN) }
            },
        );
        let exit = corner[0].min(corner[1]).min(corner[2]);
        let (a, b) = (start.max(upper[0]), upper[1].max(upper[2]));
        let entry = a.max(b);
        // The second latest of the four.
        let second = a.min(b).max(start.min(upper[0]).max(upper[1].min(upper[2])));
        let lanes = self.lanes & self.results.alive;
        let near = lanes & bits(entry.simd_le(exit.min(end) + self.doubt * 4.0));
        let strange = bits(exit.simd_le(entry + self.doubt) | second.simd_ge(entry - self.doubt));
        let strange = if fault::made(fault::NO_DOUBT) { 0 } else { near & strange };
        if strange != 0 {
            self.results.give_up(strange);
        }
        let lanes = near & !strange & bits(entry.simd_lt(exit) & entry.simd_le(end));
        Met { corner, upper, entry, exit, end, lanes }
    }
}

/// The span of the rays of a block in a node.
#[derive(Clone, Copy)]
struct Span<S: Simd> {
    start: Floats<S>,
    end: Floats<S>,
}

/// A node on the way from the root, and the blocks in it: a lane for each.
#[derive(Clone, Copy)]
struct Frame<S: Simd> {
    node: Node,
    /// The contour of the node, if it has one.
    contour: Option<Contour>,
    /// The latest `t` at which a ray of a block crosses the planes at the lower corner.
    lower: [Floats<S>; 3],
    /// The earliest and the latest for the planes through the centre.
    middle: [[Floats<S>; 2]; 3],
    /// The earliest start and the latest end in the node.
    start: Floats<S>,
    end: Floats<S>,
    /// The latest entry into slabs of the node and nodes above, and the earliest exit.
    entered: Floats<S>,
    left: Floats<S>,
    blocks: u32,
    /// The blocks whose spans are known.
    known: u32,
}

/// What is needed to cast tiles; what it holds has no meaning between tiles.
pub(super) struct Tiles<S: Simd> {
    pub(super) blocks: [Block<S>; BLOCKS],
    frames: [Frame<S>; FRAMES],
    spans: [[Span<S>; BLOCKS]; FRAMES],
}

impl<S: Simd> Tiles<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let zero = Floats::splat(simd, 0.0);
        let frame = Frame {
            node: Node::NONE,
            contour: None,
            lower: [zero; 3],
            middle: [[zero; 2]; 3],
            start: zero,
            end: zero,
            entered: zero,
            left: zero,
            blocks: 0,
            known: 0,
        };
        let packet = Packet::new(simd, [zero; 3], [zero; 3], 0);
        Self {
            blocks: [Block::new(packet, Results::new(simd, 0)); BLOCKS],
            frames: [frame; FRAMES],
            spans: [[Span { start: zero, end: zero }; BLOCKS]; FRAMES],
        }
    }
}

/// Casts the rays of the blocks of a tile.
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    scene: &Scene,
    area: &Area<S>,
    origin: [f32; 3],
    tiles: &mut Tiles<S>,
    stack: &mut Stack<S>,
) {
    let mut todo = [0; BLOCKS];
    for (todo, block) in todo.iter_mut().zip(&tiles.blocks) {
        *todo = block.results.alive;
    }
    while let Some(first) = todo.iter().position(|lanes| *lanes != 0) {
        let mirror = tiles.blocks[first].packet.octant_of(todo[first].trailing_zeros());
        let mut members = 0;
        for (k, (block, todo)) in tiles.blocks.iter_mut().zip(&mut todo).enumerate() {
            let same = if fault::made(fault::WRONG_OCTANT) { ALL } else { block.packet.octant(mirror) };
            block.lanes = *todo & same;
            *todo &= !block.lanes;
            members |= u32::from(block.lanes != 0) << k;
        }
        let bounds = Bounds::new(simd, area, origin, mirror, &tiles.blocks[first].packet);
        // Rays that run almost along a plane are in doubt everywhere.
        for k in ones(members) {
            if bounds.doubt[k] > MOST_DOUBT {
                let block = &mut tiles.blocks[k];
                cast_alone(simd, scene, &block.packet, block.packet.span(simd), block.lanes, stack, &mut block.results);
                members &= !(1 << k);
            }
        }
        octant(simd, &Tree::new(scene, mirror), area, members, &bounds, tiles, stack);
    }
}

/// Casts the rays of an octant.
#[inline(always)]
fn octant<S: Simd>(
    simd: S,
    tree: &Tree,
    area: &Area<S>,
    members: u32,
    bounds: &Bounds<S>,
    tiles: &mut Tiles<S>,
    stack: &mut Stack<S>,
) {
    let Tiles { blocks, frames, spans } = tiles;
    let Packet { size_per_t, contours, finest_scale, t_max, .. } = blocks[0].packet;
    // Blocks with rays that have hit nothing.
    let mut alive = 0;
    let mut starts = [0.0; BLOCKS];
    for k in ones(members) {
        let block = &mut blocks[k];
        let entrance = enter(&block.packet, block.packet.span(simd), block.lanes, &mut block.results);
        (block.lanes, block.start, block.end) = (entrance.lanes, entrance.start, entrance.t_max);
        alive |= u32::from(entrance.lanes != 0) << k;
        starts[k] = block.packet.t_min;
        spans[0][k] = Span { start: block.start, end: block.end };
    }
    {
        let at = |x: f32| [bounds.plane(0, x), bounds.plane(1, x), bounds.plane(2, x)];
        let (upper, lower) = (at(2.0), at(1.0));
        frames[0] = Frame {
            node: tree.node(tree.root, [1.0; 3]),
            contour: None,
            lower: [lower[0][1], lower[1][1], lower[2][1]],
            middle: at(1.5),
            start: upper[0][0].max(upper[1][0]).max(upper[2][0]).max(Floats::simd_from(simd, starts)),
            end: bounds.doubt + t_max,
            entered: Floats::splat(simd, f32::MIN),
            left: Floats::splat(simd, f32::MAX),
            blocks: alive,
            known: alive,
        };
    }
    let mut place = Place::ROOT;
    loop {
        let Place { depth, size, scale } = place;
        let frame = &mut frames[depth % FRAMES];
        let live = frame.blocks & alive;
        if frame.node.todo == 0 || live == 0 {
            if !place.up() {
                return;
            }
            continue;
        }
        count(What::TileTests, 1);
        let child = frame.node.next(tree.mirror);
        let frame = &frames[depth % FRAMES];
        let half = child.half;
        let corner = axes(
            #[inline(always)]
            |axis: usize| if half[axis] == 0 { frame.lower[axis] } else { frame.middle[axis][1] },
        );
        let entered = axes(
            #[inline(always)]
            |axis: usize| if half[axis] == 0 { frame.middle[axis][0] } else { frame.start },
        );
        let exit = corner[0].min(corner[1]).min(corner[2]) + bounds.doubt;
        let entry = entered[0].max(entered[1]).max(entered[2]).max(frame.start);
        let end = exit.min(frame.end);
        let mut live = live & bits(entry.simd_le(end));
        if live == 0 {
            continue;
        }
        let small = live & bits((exit * size_per_t).simd_ge(Floats::splat(simd, size)));
        let pos = frame.node.corner_of(&child, size);
        let leaf = frame.node.is_leaf(&child);
        let mut contour = None;
        let (mut next_start, mut next_end) = (entry, end);
        let (mut next_entered, mut next_left) = (frame.entered, frame.left);
        if frame.node.has_contour(&child, contours) {
            let word = tree.contour(&frame.node, &child);
            contour = Some(word);
            if small != 0 {
                // Rays end at a small voxel before they are clipped against its contour. What the others do is looked at.
                next_entered = Floats::splat(simd, f32::MAX);
            } else {
                count(What::TileContours, 1);
                let [enters, leaves] = bounds.slab(simd, area, word, pos, size);
                (next_start, next_end) = (entry.max(enters[0]), end.min(leaves[1]));
                live &= bits((next_start - bounds.doubt).simd_le(next_end));
                if live == 0 {
                    continue;
                }
                (next_entered, next_left) = (next_entered.max(enters[1]), next_left.min(leaves[0]));
            }
        }
        let half_size = size * 0.5;
        let together = live.count_ones() > FEW && half_size > bounds.least_size && scale > finest_scale;
        let mut members = live;
        if leaf || !together || small != 0 {
            let (early, late) = (entry - bounds.doubt, end);
            let binds =
                live & bits(frames[depth % FRAMES].entered.simd_gt(early) | frames[depth % FRAMES].left.simd_le(late));
            for k in ones(live) {
                let block = &mut blocks[k];
                let (mut start, mut end) = (block.start, block.end);
                if binds >> k & 1 != 0 && !fault::made(fault::NO_SLABS) {
                    // The deepest node above whose span is known; the root's is.
                    let mut above = depth;
                    while frames[above % FRAMES].known >> k & 1 == 0 {
                        above -= 1;
                    }
                    let span = spans[above % FRAMES][k];
                    (start, end) = (span.start, span.end);
                    while above < depth {
                        above += 1;
                        let frame = &mut frames[above % FRAMES];
                        if let Some(contour) = frame.contour {
                            count(What::ContourTests, 1);
                            let size = size * (2 << (depth - above)) as f32;
                            let centre = block.packet.centre(simd, block.packet.planes(frame.node.pos), size);
                            let slab = block.packet.slab(contour, size, centre);
                            (start, end) = (start.max(slab.0), end.min(slab.1));
                        }
                        frame.known |= 1 << k;
                        spans[above % FRAMES][k] = Span { start, end };
                    }
                }
                let meeting = block.meet(simd, pos, size, start, end);
                if meeting.lanes == 0 {
                    members &= !(1 << k);
                } else if leaf || together {
                    count(What::Visits, 1);
                    count_alive(scale, meeting.lanes.count_ones());
                    block.results.iterations += 1;
                    let Met { corner, entry, exit, end, lanes, .. } = meeting;
                    let meeting = Meeting { corner, entry, exit, t_max: end, lanes };
                    let at = (&frames[depth % FRAMES].node, &child);
                    let inside = visit(simd, tree, &block.packet, at, place, meeting, &mut block.results);
                    if inside.lanes == 0 {
                        members &= !(1 << k);
                    }
                } else {
                    count(What::BlockWalks, 1);
                    let t = |axis: usize| if half[axis] == 0 { meeting.upper[axis] } else { meeting.corner[axis] };
                    let c = meeting.corner;
                    stack.0[0] = walk::Frame {
                        node: Node { todo: 1 << child.idx, ..frames[depth % FRAMES].node },
                        t: [c[0], c[1], c[2], t(0), t(1), t(2), meeting.entry],
                        t_max: meeting.end,
                        lanes: meeting.lanes,
                    };
                    walk_alone(simd, tree, &block.packet, Place { depth: 0, ..place }, stack, &mut block.results);
                }
                if block.results.alive & block.lanes == 0 {
                    alive &= !(1 << k);
                }
            }
            if leaf || !together || members & alive == 0 {
                continue;
            }
        }
        count(What::TilePushes, 1);
        let node = tree.node(frames[depth % FRAMES].node.slot_of(&child), pos);
        place.down();
        let next = &mut frames[place.depth % FRAMES];
        next.node = node;
        next.contour = contour;
        next.lower = corner;
        for axis in 0..3 {
            next.middle[axis] = bounds.plane(axis, pos[axis] + half_size);
        }
        next.start = next_start;
        next.end = next_end;
        next.entered = next_entered;
        next.left = next_left;
        next.blocks = members;
        next.known = 0;
    }
}

/// The places of the bits of a number.
#[inline(always)]
fn ones(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let place = bits.trailing_zeros() as usize;
            let some = bits != 0;
            bits &= bits.wrapping_sub(1);
            some.then_some(place % BLOCKS)
        },
    )
}
