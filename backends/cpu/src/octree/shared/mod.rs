//! Packets of rays that share a stack: sixteen rays of a picture go through the tree together.
//!
//! `walk` is the walk of a packet, `voxel` what it does in a voxel, `packet` the rays and what they hit. `tile` leads the
//! packets of 16 x 16 pixels through the upper nodes, by the `bounds` of their rays. `picture` cuts pictures into tiles.
//!
//! A packet has one stack. Descriptors, masks of children and the order of visits are scalar; planes, spans and contours are
//! vectors of one float for each ray. A node's children are visited in one order, by a test of each child's cube that tells
//! which rays meet it. Rays of other octants than the first ray's go in a pass of their own.
//!
//! The code is written once, generic over the vectors of `fearless_simd`, and compiled for each of [`Vectors`]. What is proven
//! and tested for one holds for all: additions, subtractions, products, quotients, minima and maxima of floats that are not
//! NaN, and compares, are the same in every instruction set but for the sign of a zero.
//!
//! # Why hits are the reference's
//!
//! Hits equal those of [`esvo_core::reference`] in every bit. `iterations` is another number: the nodes and voxels that the
//! packet has met until the ray ended.
//!
//! All is in mirrored space, where rays leave cubes by the planes at their lower corners. For an axis `a`, `t_a(x)` is the
//! float `x * coef[a] - bias[a]`, rounded after each operation. The coefficient is negative and rounding is monotonic, so that
//! `t_a(x) >= t_a(y)` for `x < y`. A node has for each axis the floats `lower_a`, of the plane at its lower corner, and
//! `middle_a`, of its middle plane. Its exit `E` is the least `lower_a`. A child is the set `U` of the axes on which it is the
//! upper half; its exit is the least of `middle_a` for `a` in `U` and `lower_a` for the others.
//!
//! **(A)** Planes of one axis that bound voxels of the levels that a packet visits have different `t`: `middle_a < lower_a` in
//! every node, and each is less than that of a plane further down. [`finest_scale`] says to which level that holds; nodes
//! below are not entered.
//!
//! **1. Leaving a node.** The reference leaves the deepest voxel at its exit `e`, and crosses every plane of it whose `t` is at
//! most `e`. Let that voxel be the child `U` of a node `N`, and let one of the planes be that of an axis outside `U`, so that
//! the ray leaves `N`. That plane is `N`'s too. `N`'s other lower planes are not above those of the child, so that their `t` are at
//! least `e`: `N`'s exit is `e`. The planes of `N` with this `t` are those of the crossed axes outside `U`: for `a`
//! in `U`, `lower_a > middle_a >= e` by (A). Crossing `middle_a` of such an axis changes a bit of the position that POP rounds
//! away. So leaving the voxel is the same as leaving `N` by its own planes at its own exit. By induction this holds for all
//! nodes that are left at once, and `t_min` is the exit of the last of them, if that is above the `t_min` before: it is, by step 3.
//!
//! **2. The children that a ray visits.** In a node that is entered at `start`, the reference begins with the child `F` of the
//! axes whose centre, computed in another way than `middle_a`, is above `start`. Then it crosses middle planes in the order of
//! their `t`, those with the same `t` together, until that `t` is not below `E`. So it visits `F`, and each subset `U` of
//! `F`, other than `F`, for which every `middle_a` of `F` outside `U` is less than every `middle_a` of `U` and less than `E`. It
//! enters `U` at the greatest of these `middle_a`, its `t_min` after the last step.
//!
//! **3. The test of a packet.** A packet visits the child `U` if `entry < exit`, where `entry` is the greatest of `start` and
//! the `middle_a` for `a` outside `U`. Let `F` be the set of axes with `middle_a > start`, and let `start < E`; rays for which
//! that is not so are found when they enter the node, by the compares of `strange` in `walk`, and cast one by one.
//!  - Not a subset of `F`: some `middle_a` of `U` is at most `start`, so that `exit <= start <= entry`. Not visited.
//!  - `F` itself: `middle_a` outside `F` are at most `start`, so that `entry = start`. The exit is above: `middle_a` of `F` are, and
//!    `lower_a >= E` are. Visited, and entered at `start`.
//!  - Another subset: `entry` is the greatest `middle_a` of `F` outside `U`, since the others are at most `start`. It is less than the
//!    exit if it is less than every `middle_a` of `U` and every `lower_a` outside `U`; with (A), that is the condition of
//!    step 2, since `E` is the least of the latter and of `lower_a > middle_a` in `U`.
//!
//! A ray meets its children in the order of descending numbers, since each is a subset of the one before. A packet visits
//! children in that order, so that a ray's first hit in the packet is its first hit.
//!
//! **4. In a voxel**, both do the same operations with the same numbers: `t_min = entry`, the node's `t_max`, the planes of the
//! child. The reference looks into it if `t_min <= t_max`. At the root, `centre` is `middle`; rays whose span is empty there
//! stay so, since each later `t_min` is above `start`, and miss.
//!
//! **5. No number is NaN**: (A) bounds the origin, [`MAX_COMPONENT`] and [`EPSILON`](esvo_core::reference::EPSILON)
//! the coefficients, and products of three such numbers are far from overflow. The size test is a compare, which both do.

mod bounds;
mod list;
mod packet;
mod picture;
#[cfg(test)]
mod tests;
mod tile;
mod voxel;
mod walk;

use fearless_simd::prelude::*;

use self::picture::{Band, band, coarse_row};
use super::scene::Scene;
use super::task::Task;
use crate::vectors::{Vectors, Work};

/// Mistakes that tests make to see that they are found.
pub(super) mod fault {
    /// Children that a ray only touches are visited.
    pub(super) const TIES: u8 = 1;
    /// Rays that rounding may lead elsewhere are not looked for at a push.
    pub(super) const NO_CHECK: u8 = 2;
    /// All rays of a packet go in the octant of the first.
    pub(super) const WRONG_OCTANT: u8 = 3;
    /// Slabs of nodes above are forgotten when a block leaves its tile.
    pub(super) const NO_SLABS: u8 = 4;
    /// A tile's bounds are those of one side of its blocks.
    pub(super) const NARROW: u8 = 5;
    /// No ray is in doubt where its block leaves the tile.
    pub(super) const NO_DOUBT: u8 = 6;
    /// A ray in lockstep ends where the one before it in its lane did.
    pub(in super::super) const OLD_SPAN: u8 = 7;

    #[cfg(test)]
    thread_local! {
        /// The mistake that this thread makes.
        pub(super) static FAULT: std::cell::Cell<u8> = const { std::cell::Cell::new(0) };
    }

    /// Whether this mistake is to be made. Never, but in tests.
    #[inline(always)]
    pub(in super::super) fn made(_fault: u8) -> bool {
        #[cfg(test)]
        return FAULT.get() == _fault;
        #[cfg(not(test))]
        false
    }
}

/// Does a task with these vectors. Gives it back if it is not for them, or if the processor does not have them.
pub(super) fn run<'a>(vectors: Vectors, scene: &'a Scene, task: Task<'a>) -> Option<Task<'a>> {
    vectors.run(Packets { scene, task }).unwrap_or_else(|packets| Some(packets.task))
}

struct Packets<'a> {
    scene: &'a Scene<'a>,
    task: Task<'a>,
}

impl<'a> Work for Packets<'a> {
    /// A task that is not for them.
    type Output = Option<Task<'a>>;

    /// Plain arrays cast pictures without tiles, since what they would gain is not worth minutes of compiling. They and SSE2 give
    /// back fans and lists, which they would cast slower than one ray at a time.
    fn run<S: Simd, const TILES: bool, const LISTS: bool>(self, simd: S) -> Option<Task<'a>> {
        let Self { scene, task } = self;
        match task {
            Task::Band { view, coarse, first_row, hits } => {
                let rows = Band { view, coarse, first_row, hits };
                simd.vectorize(
                    #[inline(always)]
                    || band::<_, TILES>(simd, scene, rows),
                );
                None
            }
            Task::CoarseRow { view, row, starts } => {
                simd.vectorize(
                    #[inline(always)]
                    || coarse_row(simd, scene, view, row, starts),
                );
                None
            }
            Task::Fans { all, some, hits } if LISTS => {
                simd.vectorize(
                    #[inline(always)]
                    || list::fans(simd, scene, all, some, hits),
                );
                None
            }
            Task::Rays { rays, contours, hits } if LISTS => {
                simd.vectorize(
                    #[inline(always)]
                    || list::list(simd, scene, rays, contours, hits),
                );
                None
            }
            other => Some(other),
        }
    }
}
