//! Lists of rays.

mod gather;
mod lanes;
mod stage;
#[cfg(test)]
mod tests;

use fearless_simd::{Fallback, Level};

use self::gather::Gather;
use self::lanes::End;
use self::stage::{LANES, Staged};
use super::walk::Walk;
use super::{Fidelity, Hit, Ray, first_hit, is_blocked};
use crate::trace::FRACTION_BITS;
use crate::volume::{Occupancy, Volume};

/// Lanes without a ray that wait for others before they get the next ones. Measured with AVX2.
const FREE: u32 = 1;

/// Mistakes that tests make to see that they are found.
mod fault {
    /// Planes that are crossed at once are taken for one.
    pub(super) const TIES: u8 = 1;
    /// A ray ends where the one before it in its lane did.
    pub(super) const OLD_LIMIT: u8 = 2;

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

/// Vectors that there is code for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Vectors {
    /// Plain arrays.
    Arrays,
    Avx2,
}

/// The first full voxel that each ray touches, as [`first_hit`] finds it.
pub fn first_hits<O: Occupancy + ?Sized>(volume: &O, rays: &[Ray], fidelity: Fidelity) -> Vec<Option<Hit>> {
    if let (Some(dense), Some(vectors)) = (volume.dense(), best()) {
        return first_with(vectors, dense, rays, fidelity);
    }
    rays.iter().map(|ray| first_hit(volume, ray, fidelity).hit).collect()
}

/// Whether each ray touches a full voxel, as [`is_blocked`] says.
pub fn blocked<O: Occupancy + ?Sized>(volume: &O, rays: &[Ray], fidelity: Fidelity) -> Vec<bool> {
    if let (Some(dense), Some(vectors)) = (volume.dense(), best()) {
        return blocked_with(vectors, dense, rays, fidelity);
    }
    rays.iter().map(|ray| is_blocked(volume, ray, fidelity).0).collect()
}

fn best() -> Option<Vectors> {
    #[cfg(target_arch = "x86_64")]
    {
        let level = Level::new();
        if level.as_avx2().is_some() {
            return Some(Vectors::Avx2);
        }
    }
    None
}

fn first_with(vectors: Vectors, volume: &Volume, rays: &[Ray], fidelity: Fidelity) -> Vec<Option<Hit>> {
    let mut hits = vec![None; rays.len()];
    let put = |number: usize, end: End| {
        let ray = &rays[number];
        hits[number] = match end {
            End::Miss => None,
            End::Rare => first_hit(volume, ray, fidelity).hit,
            End::Hit(corner, level, [numerator, denominator]) => {
                let flip = ray.direction.map(|d| d >> 31);
                let cell = std::array::from_fn(|axis| (corner[axis] ^ flip[axis]) >> (FRACTION_BITS + level));
                Some(Hit { cell, level, distance: ray.distance_of_crossing(numerator, denominator) })
            }
        };
    };
    run(vectors, List { volume, rays, fidelity, next: 0, put });
    hits
}

fn blocked_with(vectors: Vectors, volume: &Volume, rays: &[Ray], fidelity: Fidelity) -> Vec<bool> {
    let mut blocked = vec![false; rays.len()];
    let put = |number: usize, end: End| {
        blocked[number] = match end {
            End::Miss => false,
            End::Hit(..) => true,
            End::Rare => is_blocked(volume, &rays[number], fidelity).0,
        };
    };
    run(vectors, List { volume, rays, fidelity, next: 0, put });
    blocked
}

/// Rays that are traced, and where their ends are put.
struct List<'a, P> {
    volume: &'a Volume,
    rays: &'a [Ray],
    fidelity: Fidelity,
    /// The first ray that is not staged.
    next: usize,
    put: P,
}

impl<P: FnMut(usize, End)> List<'_, P> {
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
            let end = if walk.between != [false; 3] {
                End::Rare
            } else if let Some(voxel) = walk.touched_at_origin(&mut 0) {
                End::Hit(voxel.map(|c| c << FRACTION_BITS), 0, [0, walk.on_major(walk.direction)])
            } else {
                continue;
            };
            (self.put)(number, end);
            ended |= 1 << lane;
        }
        ended
    }
}

fn run<P: FnMut(usize, End)>(vectors: Vectors, list: List<'_, P>) {
    #[cfg(target_arch = "x86_64")]
    match vectors {
        Vectors::Avx2 => {
            if let Some(simd) = Level::new().as_avx2() {
                return run_on(simd, list);
            }
        }
        Vectors::Arrays => {}
    }
    run_on(Fallback::new(), list);
}

fn run_on<S: Gather, P: FnMut(usize, End)>(simd: S, list: List<'_, P>) {
    match list.fidelity.fine_until {
        0 => trace::<S, P, false>(simd, list),
        _ => trace::<S, P, true>(simd, list),
    }
}

/// A function of its own, so that it is compiled once.
#[inline(never)]
fn trace<S: Gather, P: FnMut(usize, End), const COARSE: bool>(simd: S, mut list: List<'_, P>) {
    simd.vectorize(
        #[inline(always)]
        || lanes::trace::<S, P, COARSE>(simd, &mut list),
    );
}
