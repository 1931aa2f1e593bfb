//! Lists of rays: the answers of [`first_hit`] and [`is_blocked`] for each ray, equal in every bit, several times as fast.
//!
//! Where the processor has AVX2, sixteen rays of a list go through a [`Volume`] at once, in two groups of eight, and where one ends the next one takes its
//! place (`lanes`). Rays that start outside of the volume, or lie between two voxels all the way, or cross planes of several axes at once, are
//! traced one by one, and so are all rays on other processors, through [other volumes](Occupancy::dense) and through volumes of 2 GiB or more. How many
//! cells the volume is asked for is not counted. Lists of some hundred rays and more are worth it.
//!
//! `stage` makes rays ready, eight at once; `gather` reads bytes. The code is written for any vectors of `fearless_simd`.

#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "without vectors the walk traces all rays"))]

mod gather;
mod lanes;
mod stage;
#[cfg(test)]
mod tests;

use self::gather::Gather;
use self::lanes::{Ends, Met};
use self::stage::{LANES, Staged};
use super::walk::Walk;
use super::{Fidelity, Hit, Ray, first_hit, is_blocked};
use crate::trace::FRACTION_BITS;
use crate::volume::{Occupancy, Volume};

/// Mistakes that tests make to see that they are found.
mod fault {
    /// Planes that are crossed at once are taken for one.
    pub(super) const TIES: u8 = 1;
    /// A ray ends where the one before it in its lane did.
    pub(super) const OLD_LIMIT: u8 = 2;
    /// Planes that are crossed where a cell is entered are not looked for.
    pub(super) const ON_PLANE: u8 = 3;
    /// A lane goes on with the byte of the cell before.
    pub(super) const OLD_BYTE: u8 = 4;

    #[cfg(test)]
    thread_local! {
        /// The mistake that this thread makes.
        pub(super) static FAULT: std::cell::Cell<u8> = const { std::cell::Cell::new(0) };
    }

    /// Whether this mistake is to be made. Never, but in tests.
    #[inline(always)]
    pub(super) fn made(_fault: u8) -> bool {
        #[cfg(test)]
        return FAULT.get() == _fault;
        #[cfg(not(test))]
        false
    }
}

/// The vectors that rays are traced in, if this processor has them. With plain arrays in their place lists are slower than the walk, and compiling them takes
/// minutes.
#[cfg(target_arch = "x86_64")]
fn vectors() -> Option<fearless_simd::Avx2> {
    fearless_simd::Level::new().as_avx2()
}

/// The first full voxel that each ray touches, as [`first_hit`] finds it.
pub fn first_hits<O: Occupancy + ?Sized>(volume: &O, rays: &[Ray], fidelity: Fidelity) -> Vec<Option<Hit>> {
    let mut ends = First { rays, hits: vec![None; rays.len()] };
    match run(volume, rays, fidelity, &mut ends) {
        Some(rare) => {
            for ray in rare {
                ends.hits[ray as usize] = first_hit(volume, &rays[ray as usize], fidelity).hit;
            }
            ends.hits
        }
        None => rays.iter().map(|ray| first_hit(volume, ray, fidelity).hit).collect(),
    }
}

/// Whether each ray touches a full voxel, as [`is_blocked`] says.
pub fn blocked<O: Occupancy + ?Sized>(volume: &O, rays: &[Ray], fidelity: Fidelity) -> Vec<bool> {
    let mut ends = Blocked(vec![false; rays.len()]);
    match run(volume, rays, fidelity, &mut ends) {
        Some(rare) => {
            for ray in rare {
                ends.0[ray as usize] = is_blocked(volume, &rays[ray as usize], fidelity).0;
            }
            ends.0
        }
        None => rays.iter().map(|ray| is_blocked(volume, ray, fidelity).0).collect(),
    }
}

/// Traces a list of rays in lanes, and returns those that the walk must trace. `None` if that is all of them: without vectors, in other volumes, and where places of
/// bytes or numbers of rays do not fit 31 bits.
fn run<O: Occupancy + ?Sized>(volume: &O, rays: &[Ray], fidelity: Fidelity, ends: &mut impl Ends) -> Option<Vec<u32>> {
    let volume = volume.dense()?;
    if volume.all_bytes().len() > i32::MAX as usize || rays.len() > lanes::NOBODY as usize {
        return None;
    }
    let list = List { volume, rays, fidelity, next: 0, ends, rare: Vec::new() };
    #[cfg(target_arch = "x86_64")]
    return Some(run_on(vectors()?, list));
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = list;
        None
    }
}

/// Cells that rays hit.
struct First<'a> {
    rays: &'a [Ray],
    hits: Vec<Option<Hit>>,
}

impl Ends for First<'_> {
    const PLACES: bool = true;

    fn put(&mut self, number: u32, _is_hit: bool, met: Option<Met>) {
        let Some(Met { corner, level, time: [numerator, denominator] }) = met else { return };
        let ray = &self.rays[number as usize];
        let flip = ray.direction.map(|d| d >> 31);
        let cell = std::array::from_fn(|axis| (corner[axis] ^ flip[axis]) >> (FRACTION_BITS + level));
        let distance = ray.distance_of_crossing(numerator, denominator);
        self.hits[number as usize] = Some(Hit { cell, level, distance });
    }
}

/// Whether rays are blocked.
struct Blocked(Vec<bool>);

impl Ends for Blocked {
    const PLACES: bool = false;

    #[inline(always)]
    fn put(&mut self, number: u32, is_hit: bool, _met: Option<Met>) {
        if let Some(blocked) = self.0.get_mut(number as usize) {
            *blocked = is_hit;
        }
    }
}

/// Rays that are traced, and where their ends are put.
struct List<'a, L> {
    volume: &'a Volume,
    rays: &'a [Ray],
    fidelity: Fidelity,
    /// The first ray that is not staged.
    next: usize,
    ends: &'a mut L,
    /// Rays that the walk must trace.
    rare: Vec<u32>,
}

impl<'a, L: Ends> List<'a, L> {
    /// Stages rays, as many as there is room for, if so many are left.
    #[inline(always)]
    fn stage<S: Gather>(&mut self, simd: S, staged: &mut Staged, coarsest: u32) {
        for _ in 0..staged.make_room() {
            let number = self.next;
            let rays = &self.rays[number..self.rays.len().min(number + LANES)];
            if rays.is_empty() {
                return;
            }
            self.next += rays.len();
            staged.add(simd, number, rays, self.volume, coarsest, |on_plane| self.at_planes(number, on_plane));
        }
    }

    /// Puts the ends of those rays, of eight from a number on, that end where they begin or are between voxels all the way, and says which these are.
    #[cold]
    fn at_planes(&mut self, number: usize, on_plane: u32) -> u32 {
        let mut ended = 0;
        for lane in (0..LANES).filter(|lane| on_plane >> lane & 1 == 1) {
            let number = number + lane;
            let walk = Walk::new(self.volume, &self.rays[number], self.fidelity);
            if walk.between != [false; 3] || walk.starts_outside() {
                self.rare.push(number as u32);
            } else if let Some(voxel) = walk.touched_at_origin(&mut 0) {
                let time = [0, walk.on_major(walk.direction)];
                let met = Met { corner: voxel.map(|c| c << FRACTION_BITS), level: 0, time };
                self.ends.put(number as u32, true, Some(met));
            } else {
                continue;
            }
            ended |= 1 << lane;
        }
        ended
    }
}

fn run_on<S: Gather, L: Ends>(simd: S, list: List<'_, L>) -> Vec<u32> {
    // Without mips there is no level that fidelity could fall to.
    if list.fidelity.fine_until == 0 || list.fidelity.coarsest == 0 {
        trace::<S, L, false>(simd, list)
    } else {
        trace::<S, L, true>(simd, list)
    }
}

/// A function of its own, so that it is compiled once.
#[inline(never)]
fn trace<S: Gather, L: Ends, const COARSE: bool>(simd: S, mut list: List<'_, L>) -> Vec<u32> {
    simd.vectorize(
        #[inline(always)]
        || lanes::trace::<S, L, COARSE>(simd, &mut list),
    );
    list.rare
}
